"""Reading a recording folder: checked, cameras paired by time, one frame set at a time."""
