"""Simulate sessions of trials under two conditions: with and without stimulation."""
