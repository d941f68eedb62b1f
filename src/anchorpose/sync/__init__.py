"""Relate the clock of another device's file, such as EMG or an accelerometer, to the clock of the results."""
