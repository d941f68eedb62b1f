"""Heat kernel signature: how much heat is still at a node some time after it was put there.

Sums over a spectrum that every spectral signature is made of.

Scale-invariant heat kernel signature: HKS without what the size of the surface does to it.

Wave kernel signature: how likely a quantum particle of some energy is at a node.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.research.features.spectrum import Spectrum


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


DECAY = 4.0 * np.log(10.0)
"""A wave that decays by so much (e^-DECAY = 1e-4) has gone: the shortest and the longest time of Sun et al."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HksConfig:
    """Which times."""

    times: int = 100  # as Sun et al.
    range_m2: tuple[float, float] | None = None  # first and last time; None: from the spectrum, as Sun et al.
    scaled: bool = True  # by the heat trace, as Sun et al. compare: else short times outweigh all others

    def __post_init__(self) -> None:
        if self.times < 1:
            raise ValueError(f"times must be at least 1, got {self.times}")
        require_range("range_m2", self.range_m2)


def hks(spectrum: Spectrum, config: HksConfig | None = None, chosen: np.ndarray | None = None) -> np.ndarray:
    """sum_i exp(-lambda_i t) phi_i(x)^2 at times t evenly apart in their logarithm.

    Times are in m², heat diffusing over one square metre in a time of one. Returns (k, times) float32 in 1/m², a row
    for each chosen node (k,) int, None meaning all; NaN at nodes without triangles, and everywhere if the times are to
    come from a spectrum without positive eigenvalues. Scaled: each time divided by its integral over the largest piece
    of surface, the heat trace.
    Source: Sun, Ovsjanikov and Guibas 2009 (doi:10.1111/j.1467-8659.2009.01515.x), Section 4.
    """
    config = config or HksConfig()
    times_m2 = heat_times(spectrum, config)
    weights = np.exp(-spectrum.eigenvalues[:, None] * times_m2)
    heat = weighted_squares(spectrum, weights, chosen)
    if config.scaled:
        heat /= body_sums(spectrum, weights)
    return heat.astype(np.float32)


def heat_times(spectrum: Spectrum, config: HksConfig) -> np.ndarray:
    """(times,) m²: from when the shortest wave has gone to when the longest has, unless the range is given."""
    positive = spectrum.eigenvalues[spectrum.positive]
    if config.range_m2 is not None:
        first, last = config.range_m2
    elif len(positive):
        first, last = DECAY / positive[-1], DECAY / positive[0]
    else:
        return np.full(config.times, np.nan)
    return np.geomspace(first, last, config.times)


BASE = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SiHksConfig:
    """Which times, and how much of what they say."""

    first_octave: float = -22.0  # of 1 m²: half a mm, squared, when the shortest wave has hardly decayed
    octaves: float = 24.0  # as Bronstein and Kokkinos; up to 4 m², when a body's longest wave has gone
    steps_per_octave: int = 16  # as Bronstein and Kokkinos
    frequencies: int = 6  # the lowest, as Bronstein and Kokkinos

    def __post_init__(self) -> None:
        if not np.isfinite(self.first_octave):
            raise ValueError(f"first_octave must be finite, got {self.first_octave}")
        if not 0 < self.octaves < np.inf:
            raise ValueError(f"octaves must be positive, got {self.octaves}")
        if self.steps_per_octave < 1:
            raise ValueError(f"steps_per_octave must be at least 1, got {self.steps_per_octave}")
        if not 1 <= self.frequencies <= int(self.octaves * self.steps_per_octave) // 2:
            raise ValueError(f"{self.frequencies} frequencies cannot be told from the times given")


def si_hks(spectrum: Spectrum, config: SiHksConfig | None = None, chosen: np.ndarray | None = None) -> np.ndarray:
    """|Fourier transform| of d log h / d tau, where h is the HKS at times 2^tau m².

    A surface of s times the size has its HKS divided by s² and shifted by 2 log2 s octaves: the logarithm's derivative
    takes away the one, the modulus the other, as long as the derivative is zero at both ends of the times; that is what
    many octaves are for. Returns (k, frequencies) float32, a row for each chosen node (k,) int, None meaning all, from
    frequency 0 on; NaN at nodes without triangles.
    Source: Bronstein and Kokkinos 2010 (doi:10.1109/CVPR.2010.5539838), Section 3.
    """
    config = config or SiHksConfig()
    octave = config.first_octave + np.arange(0, config.octaves, 1.0 / config.steps_per_octave)
    decay = spectrum.eigenvalues[:, None] * BASE**octave
    left = np.exp(-decay)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = -np.log(BASE) * weighted_squares(spectrum, decay * left, chosen)
        slope /= weighted_squares(spectrum, left, chosen)
    wave = np.exp(-2j * np.pi * np.outer(np.arange(len(octave)), np.arange(config.frequencies)) / len(octave))
    return (np.abs(slope @ wave) / config.steps_per_octave).astype(np.float32)


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
