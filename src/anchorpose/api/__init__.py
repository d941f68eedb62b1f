"""Provide the functions that programs call: arrays in, joints out (docs/python.md)."""
