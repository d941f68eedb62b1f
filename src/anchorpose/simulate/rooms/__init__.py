"""Simulate real rooms seen by one camera on a shelf, a tripod or under the ceiling: clutter, mirrors, people, filtered
depth.
"""
