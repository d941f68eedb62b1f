"""Descriptors and matchings that the paper compares with: references beside the flow, which nothing of it imports."""
