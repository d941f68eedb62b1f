"""Scale-invariant heat kernel signature: HKS without what the size of the surface does to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.features.spectral_sums import weighted_squares
from anchorpose.features.spectrum import Spectrum

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
