"""Read recordings as recorders write them, each format in its own module."""
