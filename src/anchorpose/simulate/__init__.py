"""Simulated clinics: bodies that move, therapists who hold them, a standing frame, and a depth sensor that errs."""
