"""Descriptors of single nodes that other methods use, to compare the flow with; nothing of the flow imports them."""
