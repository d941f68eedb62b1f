"""How numbers of descriptors are compared: rounding may take a vote over the edge of a bin."""

import numpy as np


def assert_same_but_for_an_edge(
    found: np.ndarray, expected: np.ndarray, rows: float = 0.97, vote: float = 0.25
) -> None:
    """The same numbers, but in a few rows in which rounding took a vote over the edge of a bin.

    vote: how large a vote may be, relative to the largest number.
    """
    assert found.shape == expected.shape
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    off = np.nanmax(np.abs(found - expected), axis=1) / np.nanmax(np.abs(expected))
    assert (off < 1e-4).mean() >= rows
    assert np.median(off) < 1e-5
    assert np.nanmax(off) <= vote
