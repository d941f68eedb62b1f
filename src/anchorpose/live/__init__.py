"""Depth images while they are taken: cameras, recording them, and joints at once."""
