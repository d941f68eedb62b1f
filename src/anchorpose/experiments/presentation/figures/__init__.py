"""The figures, a module each with its ``FIGURE``; ``drawing`` says what all of them look like."""
