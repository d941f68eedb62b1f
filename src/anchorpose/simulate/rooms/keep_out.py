"""Describe areas of the floor that must stay free: lanes, which are strips with round ends, and discs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Lane:
    """All places within ``radius_m`` of the line from one place (x, z) to another; a disc if both are the same."""

    start_m: tuple[float, float]
    end_m: tuple[float, float]
    radius_m: float

    def clear_m(self, place_m: np.ndarray) -> float:
        """Return the distance of a place (x, z) from the lane, negative inside."""
        start, along = np.array(self.start_m), np.subtract(self.end_m, self.start_m)
        length2 = float(along @ along)
        share = float(np.clip((place_m - start) @ along / length2, 0.0, 1.0)) if length2 > 0.0 else 0.0
        return float(np.linalg.norm(place_m - start - share * along)) - self.radius_m

    def crossings_m(self, z_m: float) -> tuple[float, ...]:
        """Return the x at which the lane's centre line crosses z = z_m, as a tuple of one number; empty if the line
        does not cross it.
        """
        (x0, z0), (x1, z1) = self.start_m, self.end_m
        if (z0 - z_m) * (z1 - z_m) >= 0.0:
            return ()
        return (x0 + (x1 - x0) * (z_m - z0) / (z1 - z0),)


def disc(place_m: np.ndarray, radius_m: float) -> Lane:
    """Return a disc around a place (x, z), as a lane."""
    at = (float(place_m[0]), float(place_m[1]))
    return Lane(at, at, radius_m)


def is_free(place_m: np.ndarray, radius_m: float, taken: list[Lane]) -> bool:
    """Return whether a disc around a place (x, z) overlaps none of the lanes."""
    return all(lane.clear_m(place_m) > radius_m for lane in taken)
