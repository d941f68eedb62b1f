"""Provide the functions that other programs call to get joints from depth images (docs/python.md)."""
