"""Simulate cluttered rooms like real ones, with mirrors, people and filtered depth, seen by one camera on a shelf, on a
tripod or under the ceiling.
"""
