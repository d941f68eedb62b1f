"""Read a recording folder: check it, pair cameras by time, and read one frame set at a time."""
