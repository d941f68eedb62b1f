"""Compute measures of stand training: upright time, standing up, extension, sway, symmetry, assistance."""
