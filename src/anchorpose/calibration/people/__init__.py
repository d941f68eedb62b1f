"""Cameras placed against each other by the people they see."""
