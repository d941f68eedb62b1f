"""Read a recording folder: check it, pair the depth images of all cameras by time, and read one frame at a time."""
