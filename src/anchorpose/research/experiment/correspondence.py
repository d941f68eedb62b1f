"""Compute the true correspondence of simulated surfaces: for each node (point of the patient's mesh) of a frame, the
place in another frame to which the skin point at this node has moved.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from anchorpose.simulate.clinic import Clinic, Performance, draw_clinic
from anchorpose.simulate.config import SimulationConfig

# m, maximum distance from a skin point to the nearest node for the point to count as seen; twice the spacing of nodes
SEEN_M = 0.025
ON_SKIN_M = 0.05  # m, maximum distance from the skin of a node that is on the patient
SPACING_M = 0.04  # m, spacing of the sampled skin points between which distances along the skin are computed

REGIONS = {
    "head": ("Head", "Neck"),
    "trunk": ("Hips", "LowerBack", "Spine", "HipJoint", "Shoulder"),
    "upper arm": ("Arm",),
    "forearm": ("ForeArm",),
    "hand": ("Hand", "Finger", "Thumb"),
    "thigh": ("UpLeg",),
    "shank": ("Leg",),
    "foot": ("Foot", "Toe"),
}
"""Beginnings of the names of each region's bones, without Left or Right. If beginnings of several regions fit a bone's
name, the longest beginning decides.
"""

LAST_WITHOUT_SIDE = 1  # index of "trunk" in ``REGIONS``, the last region without a left and a right side


@dataclass(frozen=True, slots=True, eq=False)
class TruePlaces:
    """The true places, in another frame, of the skin points that the m nodes of one frame show."""

    vertex: np.ndarray  # (m,), vertex of the skin nearest to the node
    place_m: np.ndarray  # (m, 3), position in the other frame, world; NaN if the node is not on the patient
    seen: np.ndarray  # (m,) bool, whether the other frame has a node within ``SEEN_M`` of ``place_m``


class Skin:
    """The patient's skin, clothes included, in all frames of a simulated recording."""

    def __init__(self, simulation: SimulationConfig) -> None:
        self.clinic: Clinic = draw_clinic(simulation)
        self.performance: Performance = self.clinic.act(self.clinic.true_times_s(0))

    def at(self, frame: int) -> np.ndarray:
        """Return the skin's vertices (v, 3) in a frame, metres, world."""
        return np.asarray(self.performance.figures(frame)[0].skin_m, dtype=np.float64)

    def follow(self, nodes_m: np.ndarray, frame: int, other: int, other_nodes_m: np.ndarray) -> TruePlaces:
        """Return the true places of a frame's nodes (m, 3) in another frame, whose surface has nodes (n, 3)."""
        here, there = self.at(frame), self.at(other)
        distance, vertex = cKDTree(here).query(nodes_m)
        place = there[vertex] + (nodes_m - here[vertex])
        place[distance > ON_SKIN_M] = np.nan
        seen = np.zeros(len(nodes_m), bool)
        known = np.isfinite(place).all(axis=1)
        seen[known] = cKDTree(other_nodes_m).query(place[known])[0] < SEEN_M
        return TruePlaces(vertex, place, seen)

    def vertex_at(self, places_m: np.ndarray, frame: int) -> np.ndarray:
        """Return the vertex (m,) of the skin that is nearest to each place (m, 3) in a frame."""
        vertex: np.ndarray = cKDTree(self.at(frame)).query(places_m)[1]
        return vertex

    def along_skin_m(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Return (m,) metres along the skin from the vertices ``one`` to the vertices ``other``.

        Distances are stored only between sampled vertices, so a long distance may be too small by ``SPACING_M``.
        """
        rest, sample, between = self._sampled
        straight = np.linalg.norm(rest[one] - rest[other], axis=1)
        near_one, near_other = self._nearest[one], self._nearest[other]
        way = between[near_one, near_other]
        for vertex, near in ((one, near_one), (other, near_other)):
            way = way - np.linalg.norm(rest[vertex] - rest[sample[near]], axis=1)
        return np.maximum(straight, way)

    @cached_property
    def _sampled(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the skin in the rest pose (v, 3), a sample (s,) of its vertices, and the distances (s, s) between
        these sampled vertices along the edges of the mesh.
        """
        body = self.clinic.patient.person.body
        rest, faces = body.vertices, body.asset.faces
        cell = np.unique(np.floor(rest / SPACING_M).astype(np.int64), axis=0, return_index=True)[1]
        edges = np.unique(np.sort(np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]]), axis=1), axis=0)
        length = np.linalg.norm(rest[edges[:, 0]] - rest[edges[:, 1]], axis=1)
        mesh = csr_array((length, edges.T), shape=(len(rest), len(rest)))
        return rest, cell, dijkstra(mesh, directed=False, indices=cell)[:, cell]

    @cached_property
    def _nearest(self) -> np.ndarray:
        rest, sample, _ = self._sampled
        nearest: np.ndarray = cKDTree(rest[sample]).query(rest)[1]
        return nearest

    @cached_property
    def region(self) -> np.ndarray:
        """Return (v,) the region of each vertex, as an index into ``REGIONS``: the region of the bone that moves it."""
        return np.array([region_of(name) for name in self._bone_names])[self._main_bone]

    @cached_property
    def side(self) -> np.ndarray:
        """Return the side (v,) of each vertex: -1 on a left limb, 1 on a right limb, 0 on head and trunk."""
        limb = [region_of(name) > LAST_WITHOUT_SIDE for name in self._bone_names]
        sign = [
            (name[0] == "R") - (name[0] == "L") if on_limb else 0
            for name, on_limb in zip(self._bone_names, limb, strict=True)
        ]
        return np.array(sign)[self._main_bone]

    @property
    def _bone_names(self) -> tuple[str, ...]:
        return tuple(self.clinic.patient.person.body.asset.bone_names)

    @property
    def _main_bone(self) -> np.ndarray:
        return self.clinic.patient.person.body.asset.main_bone()


def region_of(bone: str) -> int:
    """Return the index into ``REGIONS`` of a bone's region. Raises ValueError for a bone that is in no region."""
    name = bone.removeprefix("Left").removeprefix("Right")
    names = {name, bone, name[1:]}  # in LHipJoint and LThumb, a single letter stands for the side
    fits = [
        (len(start), index)
        for index, starts in enumerate(REGIONS.values())
        for start in starts
        if any(known.startswith(start) for known in names)
    ]
    if not fits:
        raise ValueError(f"bone {bone} belongs to no region")
    return max(fits)[1]
