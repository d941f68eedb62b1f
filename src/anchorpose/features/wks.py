"""Wave kernel signature: how likely a quantum particle of some energy is at a node."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.features.spectral_sums import body_sums, require_range, weighted_squares
from anchorpose.features.spectrum import Spectrum


@dataclass(frozen=True, slots=True, kw_only=True)
class WksConfig:
    """Which energies, and how sharply they are told apart."""

    energies: int = 100  # as Aubry et al.
    width_steps: float = 7.0  # standard deviation of an energy's logarithm, in steps between energies; as Aubry et al.
    range_per_m2: tuple[float, float] | None = None  # eigenvalues between which energies lie; None: the spectrum's own

    def __post_init__(self) -> None:
        if not self.width_steps > 0:
            raise ValueError(f"width_steps must be positive, got {self.width_steps}")
        if not self.energies > 4 * self.width_steps:
            raise ValueError(f"{self.energies} energies leave nothing between margins of 2 x {self.width_steps} steps")
        require_range("range_per_m2", self.range_per_m2)


def wks(spectrum: Spectrum, config: WksConfig | None = None, chosen: np.ndarray | None = None) -> np.ndarray:
    """sum_i w_i(e) phi_i(x)^2 with w_i a bell of log lambda_i around e; the integral over the largest piece is 1.

    Returns (k, energies) float32 in 1/m², a row for each chosen node (k,) int, None meaning all; NaN at nodes without
    triangles or on a piece without positive eigenvalues, whose particles have no energy.
    Source: Aubry, Schlickewei and Cremers 2011 (doi:10.1109/ICCVW.2011.6130444), Sections 3 and 4; energies keep two
    standard deviations from either end of the range.
    """
    config = config or WksConfig()
    moving = spectrum.positive
    log_energy, width = wave_energies(spectrum, config)
    weights = np.zeros((len(moving), config.energies))
    level = np.log(spectrum.eigenvalues[moving])
    weights[moving] = np.exp(-0.5 * ((log_energy - level[:, None]) / width) ** 2)
    with np.errstate(invalid="ignore"):
        likely = weighted_squares(spectrum, weights, chosen) / body_sums(spectrum, weights)
    likely[_still(spectrum)[slice(None) if chosen is None else np.asarray(chosen)]] = np.nan
    return likely.astype(np.float32)


def _still(spectrum: Spectrum) -> np.ndarray:
    """(n,) bool: nodes on pieces without a wave, as those too small for the shortest one taken from the spectrum."""
    at = spectrum.piece >= 0
    inside = spectrum.mass_m2[at] * (spectrum.eigenfunctions[np.ix_(at, spectrum.positive)] ** 2).sum(axis=1)
    waves = np.append(np.bincount(spectrum.piece[at], inside, spectrum.piece_count), 0.0)  # how many each piece has
    still: np.ndarray = waves[spectrum.piece] < 0.5
    return still


def wave_energies(spectrum: Spectrum, config: WksConfig) -> tuple[np.ndarray, float]:
    """(energies,) logarithms of eigenvalues in 1/m², evenly apart, and the bell's deviation; NaN without any."""
    positive = spectrum.eigenvalues[spectrum.positive]
    if config.range_per_m2 is not None:
        low, high = np.log(config.range_per_m2)
    elif len(positive) > 1:
        low, high = np.log(positive[0]), np.log(positive[-1])
    else:
        return np.full(config.energies, np.nan), np.nan
    width = config.width_steps * (high - low) / config.energies
    return np.linspace(low + 2.0 * width, high - 2.0 * width, config.energies), float(width)
