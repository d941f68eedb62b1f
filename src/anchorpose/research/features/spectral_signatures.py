"""Compute the spectrum of a surface's Laplace-Beltrami operator, and three descriptors from the spectrum.

The descriptors are the heat kernel signature (HKS), the scale-invariant HKS and the wave kernel signature (WKS).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from pydantic import AfterValidator, Field
from scipy.linalg import eigh
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from anchorpose.research.features.laplacian import Laplacian, surface_laplacian
from anchorpose.settings import Count, Positive, settings
from anchorpose.surface.surface import Surface

# number of eigenpairs; with this number, the shortest wave on the 0.45 m² of a body's seen surface is 10 cm long; Sun
# et al. and Aubry et al. used 300 on closed meshes
PAIRS: Final = 150
# number of Lanczos vectors per eigenpair; on body meshes of 2,300 nodes, 1.6 is faster than 1.3 or 2.5
LANCZOS_VECTORS: Final = 1.6
START: Final = 20110413  # seed of Lanczos's first vector; with ARPACK's own vector, two runs differ in the last digits
DECAY: Final = 4.0 * np.log(10.0)  # exponent of a decay to 1e-4; sets the first and last time of the HKS (Sun et al.)


def _ascending(limits: tuple[float, float]) -> tuple[float, float]:
    if not 0 < limits[0] < limits[1] < np.inf:
        raise ValueError(f"two positive numbers, the smaller first, are needed, got {limits}")
    return limits


Range = Annotated[tuple[float, float], AfterValidator(_ascending)]
"""A range: two positive numbers, the smaller number first."""


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """The lowest eigenpairs of a surface's Laplace-Beltrami operator.

    The sign of an eigenfunction is arbitrary; so is the choice of eigenfunctions for eigenvalues that coincide.
    """

    # (k,) float64 in 1/m², ascending; for each connected piece of surface, one eigenvalue is exactly 0
    eigenvalues: np.ndarray
    # (n, k) float64 in 1/m, orthonormal with respect to ``mass_m2``; NaN at nodes without triangles
    eigenfunctions: np.ndarray
    mass_m2: np.ndarray  # (n,), area of each node; 0 without triangles
    piece: np.ndarray  # (n,) int32, number of the node's connected piece; -1 without a triangle

    def __len__(self) -> int:
        return len(self.piece)

    @property
    def piece_count(self) -> int:
        return int(self.piece.max(initial=-1)) + 1

    @property
    def positive(self) -> np.ndarray:
        """Return (k,) bool: True except for the one eigenvalue of each piece of surface that is 0."""
        return self.eigenvalues > 0.0


def spectrum(surface: Surface, pairs: int = PAIRS) -> Spectrum:
    """Return the lowest ``pairs`` eigenpairs of all pieces together, with Neumann's condition at the outline.

    Fewer pairs are returned if fewer nodes have triangles. All pieces of surface share one list of eigenpairs, so their
    shortest waves are about equally long.
    """
    return spectrum_of(surface_laplacian(surface), len(surface), pairs)


def spectrum_of(laplacian: Laplacian, count: int, pairs: int = PAIRS) -> Spectrum:
    """Return the spectrum of an operator that is defined on some of ``count`` nodes.

    Raises ValueError if ``pairs`` is less than 1.
    """
    if pairs < 1:
        raise ValueError(f"pairs must be at least 1, got {pairs}")
    values, waves = _eigenpairs(laplacian, min(pairs, len(laplacian.node)))
    functions = np.full((count, len(values)), np.nan)
    functions[laplacian.node] = waves
    mass_m2, piece = np.zeros(count), np.full(count, -1, np.int32)
    mass_m2[laplacian.node], piece[laplacian.node] = laplacian.mass_m2, laplacian.piece
    return Spectrum(values, functions, mass_m2, piece)


def _eigenpairs(laplacian: Laplacian, pairs: int) -> tuple[np.ndarray, np.ndarray]:
    """Return eigenvalues (k,) and eigenfunctions (v, k).

    The lowest pair of each piece is set to eigenvalue 0 and a constant function, which rounding would leave inexact.
    """
    if pairs == 0:
        return np.empty(0), np.empty((0, 0))
    scale = 1.0 / np.sqrt(laplacian.mass_m2)
    symmetric = (diags_array(scale) @ laplacian.stiffness @ diags_array(scale)).tocsc()
    values, vectors = _lowest(symmetric, pairs, 1.0 / laplacian.mass_m2.sum())
    waves = vectors * scale[:, None]
    area = np.bincount(laplacian.piece, laplacian.mass_m2)
    still = min(len(area), pairs)
    values[:still] = 0.0
    waves[:, :still] = (laplacian.piece[:, None] == np.arange(still)) / np.sqrt(area[:still])
    return values, waves


def _lowest(matrix: csc_array, pairs: int, shift: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest eigenpairs of a symmetric matrix by shift and invert.

    The shift is just below the lowest eigenvalue, which is 0.
    """
    count = matrix.shape[0]
    if LANCZOS_VECTORS * pairs >= count - 1:
        values, vectors = eigh(matrix.toarray())
        return values[:pairs], vectors[:, :pairs]
    factors = splu(
        (matrix + shift * diags_array(np.ones(count))).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    values, vectors = eigsh(
        matrix,
        pairs,
        sigma=-shift,
        OPinv=LinearOperator(matrix.shape, factors.solve, dtype=np.float64),
        v0=np.random.default_rng(START).standard_normal(count),
        ncv=max(int(LANCZOS_VECTORS * pairs), min(count, pairs + 20)),
    )
    order = np.argsort(values, kind="stable")
    return values[order], vectors[:, order]


def weighted_squares(spectrum: Spectrum, weights: np.ndarray) -> np.ndarray:
    """Return the weighted sums of squared eigenfunctions, sum_i w_i phi_i(x)^2, (n, d) float64 in 1/m², at each node x.
    weights (pairs, d): for each of d sums, the weight w_i of each eigenfunction phi_i.

    NaN at nodes without triangles.
    """
    sums: np.ndarray = (spectrum.eigenfunctions**2) @ weights
    return sums


def body_sums(spectrum: Spectrum, weights: np.ndarray) -> np.ndarray:
    """Return (d,) float64: the integral of ``weighted_squares`` over the piece of surface with the largest area.

    With the integral over all pieces, small pieces would count as much as the body at low eigenvalues. With the
    integral over each node's own piece, the values on an arm that an object separates from the body would change at
    high eigenvalues. The result is NaN for a surface without triangles.
    """
    if spectrum.piece_count == 0:
        return np.full(weights.shape[1], np.nan)
    at = spectrum.piece >= 0
    largest = np.bincount(spectrum.piece[at], spectrum.mass_m2[at]).argmax()
    body = spectrum.piece == largest
    sums: np.ndarray = (spectrum.mass_m2[body] @ spectrum.eigenfunctions[body] ** 2) @ weights
    return sums


@settings
class HksConfig:
    """Settings of the heat kernel signature."""

    times: Count = 100  # number of points in time, as in Sun et al.
    range_m2: Range | None = None  # m², first and last time; None = computed from the spectrum, as in Sun et al.
    # whether values are divided by the heat trace, as in Sun et al.; otherwise short times outweigh all others
    scaled: bool = True


def hks(spectrum: Spectrum, config: HksConfig | None = None) -> np.ndarray:
    """Return the heat kernel signature, (n, times) float32 in 1/m².

    The signature is the heat that remains at a node at time t if a unit of heat is put there at time 0: sum_i
    exp(-lambda_i t) phi_i^2, with the eigenvalues lambda_i and the eigenfunctions phi_i. Times are in m²: diffusivity
    is 1, so heat spreads over about one square metre in a time of 1 m². The logarithms of the times are evenly spaced.
    If scaled, each time's column is divided by its integral over the largest piece of surface, the heat trace. The
    signature is NaN at nodes without triangles, and everywhere if times should come from a spectrum without positive
    eigenvalues. Source: Sun, Ovsjanikov and Guibas 2009 (doi:10.1111/j.1467-8659.2009.01515.x), Section 4.
    """
    config = config or HksConfig()
    times_m2 = heat_times(spectrum, config)
    weights = np.exp(-spectrum.eigenvalues[:, None] * times_m2)
    heat = weighted_squares(spectrum, weights)
    if config.scaled:
        heat /= body_sums(spectrum, weights)
    return heat.astype(np.float32)


def heat_times(spectrum: Spectrum, config: HksConfig) -> np.ndarray:
    """Return the times (times,) m², from the time at which the shortest wave has decayed to the time at which the
    longest wave has decayed.

    If the configuration has a range, the first and the last time are taken from this range instead.
    """
    positive = spectrum.eigenvalues[spectrum.positive]
    if config.range_m2 is not None:
        first, last = config.range_m2
    elif len(positive):
        first, last = DECAY / positive[-1], DECAY / positive[0]
    else:
        return np.full(config.times, np.nan)
    return np.geomspace(first, last, config.times)


@settings
class SiHksConfig:
    """Settings of the scale-invariant heat kernel signature."""

    # First time, in octaves relative to 1 m². Before this time, no wave has decayed much.
    first_octave: Annotated[float, Field(allow_inf_nan=False)] = -22.0
    # number of octaves of time, as in Bronstein and Kokkinos; at the last time, 4 m², a body's longest wave has decayed
    octaves: Positive = 24.0
    steps_per_octave: Count = 16  # number of points in time per octave, as in Bronstein and Kokkinos
    frequencies: Count = 6  # number of frequencies from the lowest on, as in Bronstein and Kokkinos

    def __post_init__(self) -> None:
        if self.frequencies > int(self.octaves * self.steps_per_octave) // 2:
            raise ValueError(f"the times given do not resolve {self.frequencies} frequencies")


def si_hks(spectrum: Spectrum, config: SiHksConfig | None = None) -> np.ndarray:
    """Compute the scale-invariant HKS: |Fourier transform| of d log h / d tau, where h is the HKS at times 2^tau m².

    If a surface is scaled by s, its HKS is divided by s² and shifted by 2 log2 s octaves. The derivative of the
    logarithm removes the division, and the modulus removes the shift, as long as the derivative is zero at both ends of
    the times; this needs many octaves. Returns (n, frequencies) float32 from frequency 0 on; NaN at nodes without
    triangles. Source: Bronstein and Kokkinos 2010 (doi:10.1109/CVPR.2010.5539838), Section 3.
    """
    config = config or SiHksConfig()
    octave = config.first_octave + np.arange(0, config.octaves, 1.0 / config.steps_per_octave)
    decay = spectrum.eigenvalues[:, None] * 2.0**octave
    left = np.exp(-decay)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = -np.log(2.0) * weighted_squares(spectrum, decay * left)
        slope /= weighted_squares(spectrum, left)
    wave = np.exp(-2j * np.pi * np.outer(np.arange(len(octave)), np.arange(config.frequencies)) / len(octave))
    return (np.abs(slope @ wave) / config.steps_per_octave).astype(np.float32)


@settings
class WksConfig:
    """Settings of the wave kernel signature: energies, and how sharply they are resolved."""

    energies: Count = 100  # number of energies, as in Aubry et al.
    # standard deviation of the Gaussian around an energy's logarithm, in units of the logarithmic range of the
    # eigenvalues divided by ``energies``, as in Aubry et al.
    width_steps: Positive = 7.0
    range_per_m2: Range | None = None  # eigenvalues between which energies lie; None = lowest above 0 to highest

    def __post_init__(self) -> None:
        if not self.energies > 4 * self.width_steps:
            raise ValueError(f"{self.energies} energies leave nothing between margins of 2 x {self.width_steps} steps")


def wks(spectrum: Spectrum, config: WksConfig | None = None) -> np.ndarray:
    """Return the wave kernel signature, (n, energies) float32 in 1/m².

    The signature is the probability that a quantum particle of energy e is at a node: sum_i w_i(e) phi_i(x)^2, with the
    eigenfunctions phi_i. The weight w_i is a Gaussian of the logarithm of the eigenvalue lambda_i around log e, and the
    signature's integral over the largest piece of surface is 1. The signature is NaN at nodes without triangles, and on
    a piece without positive eigenvalues, whose particles have no energy. Source: Aubry, Schlickewei and Cremers 2011
    (doi:10.1109/ICCVW.2011.6130444), Sections 3 and 4. Energies lie at least two standard deviations of the Gaussian
    inside the range of the logarithms of the positive eigenvalues, or inside the range that the configuration has.
    """
    config = config or WksConfig()
    moving = spectrum.positive
    log_energy, width = wave_energies(spectrum, config)
    weights = np.zeros((len(moving), config.energies))
    level = np.log(spectrum.eigenvalues[moving])
    weights[moving] = np.exp(-0.5 * ((log_energy - level[:, None]) / width) ** 2)
    with np.errstate(invalid="ignore"):
        likely = weighted_squares(spectrum, weights) / body_sums(spectrum, weights)
    likely[_without_wave(spectrum)] = np.nan
    return likely.astype(np.float32)


def _without_wave(spectrum: Spectrum) -> np.ndarray:
    """Return (n,) bool: nodes on pieces without a wave (an eigenfunction with a positive eigenvalue), such as pieces
    smaller than the shortest wave.
    """
    at = spectrum.piece >= 0
    inside = spectrum.mass_m2[at] * (spectrum.eigenfunctions[np.ix_(at, spectrum.positive)] ** 2).sum(axis=1)
    waves = np.append(np.bincount(spectrum.piece[at], inside, spectrum.piece_count), 0.0)  # number of waves per piece
    without: np.ndarray = waves[spectrum.piece] < 0.5
    return without


def wave_energies(spectrum: Spectrum, config: WksConfig) -> tuple[np.ndarray, float]:
    """Return evenly spaced logarithms (energies,) of eigenvalues in 1/m², and the Gaussian's standard deviation.

    Both are NaN if fewer than two eigenvalues are positive and the configuration has no range.
    """
    positive = spectrum.eigenvalues[spectrum.positive]
    if config.range_per_m2 is not None:
        low, high = np.log(config.range_per_m2)
    elif len(positive) > 1:
        low, high = np.log(positive[0]), np.log(positive[-1])
    else:
        return np.full(config.energies, np.nan), np.nan
    width = config.width_steps * (high - low) / config.energies
    return np.linspace(low + 2.0 * width, high - 2.0 * width, config.energies), float(width)
