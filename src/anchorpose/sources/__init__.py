"""Read recordings in the formats of other recording programs (recorders), each format in its own module."""
