"""What programs call: arrays in, joints out (docs/python.md)."""
