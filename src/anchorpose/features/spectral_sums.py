"""Sums over a spectrum that every spectral signature is made of."""

from __future__ import annotations

import numpy as np

from anchorpose.features.spectrum import Spectrum


def weighted_squares(spectrum: Spectrum, weights: np.ndarray, chosen: np.ndarray | None) -> np.ndarray:
    """sum_i w_i phi_i(x)^2, (k, d) float64 in 1/m², for weights (pairs, d) at each chosen node (k,) int, None = all.

    NaN at nodes without triangles.
    """
    waves = spectrum.eigenfunctions if chosen is None else spectrum.eigenfunctions[np.asarray(chosen)]
    sums: np.ndarray = (waves**2) @ weights
    return sums


def piece_sums(spectrum: Spectrum, weights: np.ndarray, chosen: np.ndarray | None) -> np.ndarray:
    """The integral of ``weighted_squares`` over each node's own piece, (k, d) float64: sum_i w_i over the piece's waves.

    NaN at nodes without triangles.
    """
    at = spectrum.piece >= 0
    share = np.zeros((spectrum.piece_count + 1, len(spectrum.eigenvalues)))  # how much of each wave is in which piece
    np.add.at(share, spectrum.piece[at], spectrum.mass_m2[at, None] * spectrum.eigenfunctions[at] ** 2)
    share[-1] = np.nan
    sums: np.ndarray = (share @ weights)[spectrum.piece if chosen is None else spectrum.piece[np.asarray(chosen)]]
    return sums


def require_range(name: str, limits: tuple[float, float] | None) -> None:
    """Raises ValueError on what is no range of positive numbers."""
    if limits is not None and not 0 < limits[0] < limits[1] < np.inf:
        raise ValueError(f"{name} must be two positive numbers, the smaller first, got {limits}")
