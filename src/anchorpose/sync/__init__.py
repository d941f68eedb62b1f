"""Bring the results and the file of another device, such as EMG or an accelerometer, to one clock."""
