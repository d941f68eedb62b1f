"""What stand training is judged by: upright time, standing up, extension, sway, symmetry, assistance."""
