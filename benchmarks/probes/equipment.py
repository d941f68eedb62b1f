"""Score the equipment proposed from depth images of an empty clinic, by three cameras and by the front camera alone.

explained: share of the true equipment's pixels within 15 mm of the proposal; wrong: share of the proposal's pixels
farther than 15 mm from the true equipment; found: share of the true parts that are found. For the found parts, the
other scores are the median errors of cross-section and length, and the median distance of the middle lines.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from probe import Row, Scene, answer

from anchorpose.calibration.proposal import NoEquipment, propose_equipment
from anchorpose.calibration.proposal_readings import Region
from anchorpose.camera import Camera, transform_points
from anchorpose.isolation.background import equipment_depth
from anchorpose.recording.equipment import Box, Cylinder, EquipmentModel
from anchorpose.recording.reader import open_recording

NEAR_M: Final = 0.015
ALONG: Final = 0.95  # least cosine of the angle between a true bar and the one proposed for it
BESIDE_M: Final = 0.08  # greatest distance of their middle lines
Bar = Box | Cylinder


def measure(scene: Scene) -> Iterator[Row]:
    """Propose equipment from some cameras, and judge the proposal where these cameras see it."""
    recording = open_recording(scene.recording)
    truth, rooms_m = recording.equipment, [room for room in recording.backgrounds_m if room is not None]
    assert truth is not None
    for part, count in (("three cameras", 3), ("front camera alone", 1)):
        cameras = recording.cameras[:count]
        proposal = propose_equipment(cameras, rooms_m[:count], 0.0, Region())
        yield part, {"refused": 1.0} if isinstance(proposal, NoEquipment) else _scores(proposal.model, truth, cameras)


def _scores(found: EquipmentModel, truth: EquipmentModel, cameras: tuple[Camera, ...]) -> dict[str, float]:
    true_m, found_m = (np.concatenate([_surface(camera, model) for camera in cameras]) for model in (truth, found))
    bars = [part for part in truth.parts if isinstance(part, Bar)]
    errors = np.array([error for bar in bars if (error := _errors_mm(bar, found)) is not None]).reshape(-1, 3)
    section_mm, length_mm, off_line_mm = np.median(errors, axis=0) if len(errors) else np.full(3, np.nan)
    return {
        "explained_percent": 100.0 * float((np.abs(found.distance_m(true_m)) < NEAR_M).mean()),
        "wrong_percent": 100.0 * float((np.abs(truth.distance_m(found_m)) >= NEAR_M).mean()),
        "found_percent": 100.0 * len(errors) / len(bars),
        "section_mm": section_mm,
        "length_mm": length_mm,
        "off_line_mm": off_line_mm,
    }


def _surface(camera: Camera, model: EquipmentModel) -> np.ndarray:
    """Return the points (n, 3), world, at which the camera's rays first meet the model."""
    rays, depth_m = camera.pixel_rays(), equipment_depth(camera, model)
    points = np.concatenate([rays * depth_m[..., None], depth_m[..., None]], axis=2)[depth_m > 0]
    return transform_points(camera.require_pose(), points.astype(np.float64))


def _errors_mm(true: Bar, model: EquipmentModel) -> tuple[float, float, float] | None:
    """Return the errors of cross-section, length and middle line of the proposed part nearest to a true one."""
    middle_m, axis, section_m, length_m = _as_bar(true)
    found = []
    for part in (part for part in model.parts if isinstance(part, Bar)):
        center_m, along, breadth_m, extent_m = _as_bar(part)
        offset_m = center_m - middle_m
        off_m = float(np.linalg.norm(offset_m - (offset_m @ axis) * axis))
        if abs(along @ axis) >= ALONG and off_m < BESIDE_M:
            found.append((off_m, float(np.abs(breadth_m - section_m).max()), abs(extent_m - length_m)))
    if not found:
        return None
    off_m, section_off_m, length_off_m = min(found)
    return 1e3 * section_off_m, 1e3 * length_off_m, 1e3 * off_m


def _as_bar(part: Bar) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return middle, direction, the two sizes across and the length."""
    if isinstance(part, Cylinder):
        return part.center_m, part.axis, np.full(2, 2.0 * part.radius_m), part.length_m
    long = int(np.argmax(part.size_m))
    return part.center_m, part.rotation[:, long], np.sort(np.delete(part.size_m, long)), float(part.size_m[long])


if __name__ == "__main__":
    answer(measure)
