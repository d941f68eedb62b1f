"""Placeholder until the page is merged."""


def write_outcome(outcome, out):
    pass
