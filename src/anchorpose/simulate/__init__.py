"""Simulate clinics: moving bodies, therapists who hold them, equipment, and depth sensors with their errors."""
