"""Reading a recording folder: checked, paired by time, one frame set at a time."""
