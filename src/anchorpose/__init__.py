"""Markerless clinical motion capture: depth recordings to 21 joints, with what was seen and how sure it is."""

__version__ = "0.2.0"
