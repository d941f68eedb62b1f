"""The lowest eigenvalues of a surface's Laplace-Beltrami operator, and their eigenfunctions.

The Laplace-Beltrami operator of a surface's triangles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from anchorpose.research.features.intrinsic_delaunay import intrinsic_delaunay
from anchorpose.surface.mesh import faces
from anchorpose.surface.surface import Surface


@dataclass(frozen=True, slots=True, eq=False)
class Laplacian:
    """node (v,) int32: the surface's nodes that belong to a triangle; all else is in their order.

    stiffness (v, v) float64 sparse, symmetric, positive semidefinite, no positive entry off its diagonal: cotangent
    weights; mass_m2 (v,) float64: the area nearer to the node than to any other (Voronoi's), which unlike thirds of
    triangles does not depend on which diagonal cuts a square; piece (v,) int32: which triangles that
    hang together, by a corner at least, each node belongs to.
    """

    node: np.ndarray
    stiffness: csc_array
    mass_m2: np.ndarray
    piece: np.ndarray


def surface_laplacian(surface: Surface) -> Laplacian:
    """Cotangent weights with lumped mass on the intrinsic Delaunay triangulation; Neumann's condition at the outline.

    Links carry no triangles and so no heat. Triangles with a node whose position is not finite are left out.
    """
    triangles = faces(surface)
    return mesh_laplacian(surface.points_m, triangles[np.isfinite(surface.points_m).all(axis=1)[triangles].all(axis=1)])


def mesh_laplacian(points_m: np.ndarray, triangles: np.ndarray) -> Laplacian:
    """The same for any triangles (f, 3) int of points (n, 3) metres, also where three share an edge."""
    node, own = np.unique(triangles, return_inverse=True)
    count = len(node)
    edges, values = intrinsic_delaunay(np.asarray(points_m, np.float64)[node], own.reshape(-1, 3))
    tail, head = edges.T
    weight = np.where(tail == head, 0.0, values[:, 0] / 2.0)  # halves, for each triangle has a front and a back
    off = coo_array((np.tile(-weight, 2), (np.append(tail, head), np.append(head, tail))), shape=(count, count)).tocsc()
    diagonal = np.bincount(np.append(tail, head), np.tile(weight, 2), count)
    stiffness = (off + coo_array((diagonal, (np.arange(count), np.arange(count))), shape=(count, count))).tocsc()
    mass_m2 = np.bincount(np.append(tail, head), np.tile(values[:, 1] / 2.0, 2), count)
    piece = connected_components(coo_array((np.ones(len(tail), np.int8), (tail, head)), shape=(count, count)), False)[1]
    return Laplacian(node.astype(np.int32), csc_array(stiffness), mass_m2, piece.astype(np.int32))


LANCZOS_VECTORS = 1.6  # for each pair asked for: on body meshes of 2,300 nodes faster than 1.3 and 2.5
START = 20110413  # seed of Lanczos' first vector: with ARPACK's own, two runs would differ in the last digits


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectrumConfig:
    """How much of the spectrum."""

    pairs: int = 150  # waves down to 10 cm on a body's 0.45 m²; Sun et al. and Aubry et al. took 300 of closed meshes

    def __post_init__(self) -> None:
        if self.pairs < 1:
            raise ValueError(f"pairs must be at least 1, got {self.pairs}")


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """eigenvalues (k,) float64 in 1/m², ascending, exactly 0 once for each piece of surface.

    eigenfunctions (n, k) float64 in 1/m, orthonormal in the sense of mass_m2 (n,), the area that is each node's own:
    NaN and 0 at nodes without triangles. piece (n,) int32: which triangles that hang together, -1 without any.
    Eigenfunctions of one sign or the other are the same, and where eigenvalues coincide so are their turned mixtures.
    """

    eigenvalues: np.ndarray
    eigenfunctions: np.ndarray
    mass_m2: np.ndarray
    piece: np.ndarray

    def __len__(self) -> int:
        return len(self.piece)

    @property
    def piece_count(self) -> int:
        return int(self.piece.max(initial=-1)) + 1

    @property
    def positive(self) -> np.ndarray:
        """(k,) bool: eigenvalues other than the pieces' zeros."""
        return self.eigenvalues > 0.0


def spectrum(surface: Surface, config: SpectrumConfig | None = None) -> Spectrum:
    """The lowest ``pairs`` eigenpairs of all pieces together, fewer where there are fewer nodes with triangles.

    Pieces share the spectrum, each with its own waves down to one length for all. Neumann's condition at the outline.
    """
    return spectrum_of(surface_laplacian(surface), len(surface), config)


def spectrum_of(laplacian: Laplacian, count: int, config: SpectrumConfig | None = None) -> Spectrum:
    """The same for an operator on some of ``count`` nodes."""
    config = config or SpectrumConfig()
    values, waves = _eigenpairs(laplacian, min(config.pairs, len(laplacian.node)))
    functions = np.full((count, len(values)), np.nan)
    functions[laplacian.node] = waves
    mass_m2, piece = np.zeros(count), np.full(count, -1, np.int32)
    mass_m2[laplacian.node], piece[laplacian.node] = laplacian.mass_m2, laplacian.piece
    return Spectrum(values, functions, mass_m2, piece)


def _eigenpairs(laplacian: Laplacian, pairs: int) -> tuple[np.ndarray, np.ndarray]:
    """(k,) and (v, k). The lowest are known: a constant on each piece, whose eigenvalue rounding would leave near 0."""
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
    """Eigenpairs of a symmetric matrix by shift and invert, around a shift just below its lowest eigenvalue of 0."""
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
