"""Poses by printed markers."""
