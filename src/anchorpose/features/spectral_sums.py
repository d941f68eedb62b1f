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


def body_sums(spectrum: Spectrum, weights: np.ndarray) -> np.ndarray:
    """(d,) float64: the integral of ``weighted_squares`` over the piece of surface with the largest area.

    Over all pieces crumbs would count as much as the body at low eigenvalues, and over each node's own a severed arm
    would change at high ones. NaN without triangles.
    """
    if spectrum.piece_count == 0:
        return np.full(weights.shape[1], np.nan)
    at = spectrum.piece >= 0
    largest = np.bincount(spectrum.piece[at], spectrum.mass_m2[at]).argmax()
    body = spectrum.piece == largest
    sums: np.ndarray = (spectrum.mass_m2[body] @ spectrum.eigenfunctions[body] ** 2) @ weights
    return sums


def require_range(name: str, limits: tuple[float, float] | None) -> None:
    """Raises ValueError on what is no range of positive numbers."""
    if limits is not None and not 0 < limits[0] < limits[1] < np.inf:
        raise ValueError(f"{name} must be two positive numbers, the smaller first, got {limits}")
