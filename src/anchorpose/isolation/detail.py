"""How finely one camera's depth frames resolve what is at a distance, by what the recording itself shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

LIMB_M: Final = 0.08  # how thick a forearm is, the thinnest limb: 25 cm around
SHARP_EDGE_PX: Final = 2.0  # a pixel on an edge shows one side or the other, or both mixed


@dataclass(frozen=True, slots=True)
class DepthDetail:
    """edge_px: how wide this camera's depth edges are; focal_px; step_per_m: the step between grey values is
    ``step_per_m z^2`` (1/m), 0 = not known."""

    edge_px: float
    focal_px: float
    step_per_m: float = 0.0

    @property
    def filtered(self) -> bool:
        """Whether filters have drawn the edges out."""
        return self.edge_px > SHARP_EDGE_PX

    def edge_m(self, distance_m: float) -> float:
        """Width of a depth edge at a distance, metres."""
        return self.edge_px * distance_m / self.focal_px

    def step_m(self, distance_m: float) -> float:
        """Step between neighbouring readings at a distance, metres."""
        return self.step_per_m * distance_m**2

    @property
    def limbs_until_m(self) -> float:
        """The distance beyond which edges are wider than a limb: no pixel shows a limb's own depth there."""
        return LIMB_M * self.focal_px / self.edge_px
