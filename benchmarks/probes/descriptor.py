"""Measure how well the learnt descriptor finds people, and the part and side of the body, in simulated images.

Only readings on a surface are counted: within 3 cm of the true depth at their pixel. The simulator's people, clothes,
rooms and sensors are not those that the descriptor was trained on (``tools/descriptor``).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Final

import numpy as np
from probe import Row, Scene, answer
from scipy.spatial import cKDTree

from anchorpose.body.asset import stored_asset
from anchorpose.camera import Camera
from anchorpose.descriptor.learnt import Described, describe
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.render import PATIENT, TrueImage
from anchorpose.simulate.shoot import set_up

ON_IT_M: Final = 0.03
MOMENTS: Final = 4  # frames described per scene


def _side(names: tuple[str, ...]) -> np.ndarray:
    return np.array(
        [1 if name.startswith("L") and name != "LowerBack" else -1 if name[0] == "R" else 0 for name in names]
    )


class Judge:
    """Compares places on the body with the part of the body that the simulator drew there."""

    def __init__(self) -> None:
        asset = stored_asset()
        low, stature = asset.vertices[:, 1].min(), np.ptp(asset.vertices[:, 1])
        self.nearest = cKDTree((asset.vertices - [0.0, low, 0.0]) / stature)
        self.part, self.side = asset.main_bone(), _side(asset.bone_names)

    def count(self, said: Described, depth_m: np.ndarray, true: TrueImage) -> np.ndarray:
        """Return (8,) counts of pixels: people, people that are found, other things, other things called people; then
        of found people: all, with the right part, on a part with a side, and on the wrong side.
        """
        here = said.row, said.column
        on_it = said.read & (np.abs(depth_m[here] - true.depth_m[here]) < ON_IT_M)
        person, found = on_it & (true.label[here] >= PATIENT), said.person >= 0.5
        other = on_it & ~(true.label[here] >= PATIENT)
        both = person & found
        part = self.part[self.nearest.query(said.place[both])[1]]
        drawn = true.part[here][both].astype(int) - 1
        sided = (self.side[part] != 0) & (self.side[drawn] != 0)
        counted = (person, both, other, other & found, both, part == drawn, sided)
        crossed = (self.side[part] != self.side[drawn])[sided].sum()
        return np.array([*(int(mask.sum()) for mask in counted), crossed], dtype=float)


def measure(scene: Scene) -> Iterator[Row]:
    """Describe the images of all cameras in some frames of the scene, and yield one row of scores."""
    studio, judge = set_up(draw_clinic(scene.simulated)), Judge()
    total, took_s = np.zeros(8), []
    for frame in np.linspace(0, scene.simulated.frames - 1, MOMENTS).astype(int).tolist():
        shot = studio.shoot(frame)
        for camera, true, depth_mm in zip(studio.clinic.cameras, shot.images, shot.depths_mm, strict=True):
            depth_m = depth_mm * np.float32(0.001)
            said, seconds = _timed(depth_m, camera)
            took_s.append(seconds)
            total += judge.count(said, depth_m, true)
    people, found, others, wrong, placed, right, sided, crossed = total.tolist()
    yield (
        "",
        {
            "found_percent": 100.0 * found / people if people else float("nan"),
            "wrong_percent": 100.0 * wrong / others if others else float("nan"),
            "right_part_percent": 100.0 * right / placed if placed else float("nan"),
            "other_side_percent": 100.0 * crossed / sided if sided else float("nan"),
            "image_ms": 1000.0 * float(np.median(took_s)),
        },
    )


def _timed(depth_m: np.ndarray, camera: Camera) -> tuple[Described, float]:
    began = time.process_time()
    said = describe(depth_m, camera)
    return said, time.process_time() - began


if __name__ == "__main__":
    answer(measure)
