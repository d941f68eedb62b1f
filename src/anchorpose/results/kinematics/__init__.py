"""Joint angles: their definitions, one module per region of the body, and their uncertainty."""
