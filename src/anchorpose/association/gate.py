"""The gate: how far apart the descriptors of one skin point may be in two frames (paper, error analysis; Section V)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class GateConfig:
    """e_max = e_1 + e_2: what the anchors' jitter and the surface's noise may add between two frames."""

    anchor_bound_m: float = 0.020  # 3 cm in all at 1 m; the paper's 5 cm gave best matches a quarter worse
    surface_bound_per_m: float = 0.010  # geodesic noise left after smoothing: 1 % of the way to the anchor
    search_radius_m: float = 0.12  # a 3.6 m/s hand over one 33 ms frame, about its predicted place

    def __post_init__(self) -> None:
        for name in ("anchor_bound_m", "surface_bound_per_m"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if not self.search_radius_m > 0:
            raise ValueError(f"search_radius_m must be positive, got {self.search_radius_m}")


def error_bound(descriptor: np.ndarray, subsets: np.ndarray, config: GateConfig) -> np.ndarray:
    """(m, s) float32: e_max in metres for every node and subset of anchors, linear in distance (paper, Section V).

    descriptor (m, 5) metres; subsets (s, n_s) of anchor indices, whose mean distance counts. NaN or inf where a
    distance is missing or unreachable: what is not known has no bound.
    """
    distance = np.asarray(descriptor, dtype=np.float32)[:, subsets].mean(axis=2)
    return config.anchor_bound_m + config.surface_bound_per_m * distance
