"""Simulate real rooms with clutter, mirrors, people and filtered depth, seen by one camera on a shelf, on a tripod or
under the ceiling.
"""
