"""Find and check the equipment's pose in one camera (tau_0,i of the paper, Section III), from depth frames and the
equipment model alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import cv2
import numpy as np

from anchorpose.calibration.equipment_model import SAME_M, Equipment
from anchorpose.calibration.equipment_refine import (
    FINE,
    STEADY_ERROR_M,
    FloorPrior,
    Gate,
    Prediction,
    Refined,
    StillView,
    incidence,
    observed_edges,
    part_shifts,
    predict,
    refine,
    standing_prior,
)
from anchorpose.calibration.equipment_search import search_floor
from anchorpose.calibration.first_frames import NOISE_GATE
from anchorpose.camera import transform_points
from anchorpose.settings import Positive, settings

# Shares of the equipment or of a part refer to surface area in m2, not to pixels, so that near parts do not count more.
LEAST_SEEN: Final = 0.2  # minimum share of the equipment that must be seen; people or the image border hide up to half
# maximum share of the unhidden surface that is seen through; not 0, since edge pixels of bars often read the background
MOST_THROUGH: Final = 0.10
MOST_THROUGH_OF_PART: Final = 0.35
# maximum share of a part's unhidden surface that may lack readings; if more is missing, the part may be absent, and the
# wall behind it out of range
MOST_UNREAD_OF_PART: Final = 0.7
LEAST_PIXELS_OF_PART: Final = 40  # minimum number of unhidden pixels for a part to be judged
# maximum share of the seen outline's points at which readings may continue beyond the outline at the same depth. If the
# equipment is tried inside a wall, the wall's readings continue beyond the whole outline
MOST_FILLED: Final = 0.5
LEAST_OUTLINED: Final = 0.6  # minimum share of the outline's unhidden points at which the surface must end as predicted
# px, maximum distance between a seen edge and the predicted edge; seen edges often have an error of one pixel
MOST_OFF_PX: Final = 2.0
MOST_SIGMA_M: Final = 0.006
MOST_SIGMA_RAD: Final = 0.0087  # rad, maximum sigma of the equipment's direction: half a degree
LEAST_COSINE: Final = 0.25  # minimum cosine of the angle of incidence; no camera reads surfaces well at flatter angles
# rad (0.05 degrees), angle by which a camera's systematic error seems to turn equipment with bars a metre apart
STEADY_RAD: Final = 0.0008


class NoPose(StrEnum):
    """The reason why a camera has no pose. Such a reason is a result and not an error."""

    NO_FLOOR = "sees no floor, so which way is up is unknown"
    NOT_SEEN = "shows the equipment nowhere"
    LITTLE_SEEN = "shows too little of the equipment"
    SEEN_THROUGH = "sees through places where the equipment model has surface"
    PART_MISSING = "does not show a part of the equipment model where it should be"
    PART_UNREAD = "has no reading where a part of the equipment model should be"
    PART_ELSEWHERE = "shows a part of the equipment model beside its place"
    FILLED = "shows as much beside the equipment as on it, so its outline is not seen"
    OUTLINE = "does not show the equipment's outline where it should be"
    UNSURE = "shows the equipment too vaguely to find its pose"
    AMBIGUOUS = "shows two places that the equipment model fits"
    ROUND = "shows equipment that looks the same from every side"


@dataclass(frozen=True, slots=True, eq=False)
class PartEvidence:
    """The evidence in the depth frames for each part at a pose; arrays (parts,), areas in m^2.

    on_m2, through_m2, hidden_m2, unread_m2: area of the predicted surface that is seen in its place, that is seen
    through, that is hidden or out of range, and that has no reading. pixels: number of the part's pixels that are not
    hidden; shift_m: apparent displacement of the part, NaN if inaccurate. filled_share: share of the outline's points
    on seen parts at which the surface continues beyond the outline; outlined_share: share of the outline's unhidden
    points at which the surface ends as predicted.
    """

    on_m2: np.ndarray
    through_m2: np.ndarray
    hidden_m2: np.ndarray
    unread_m2: np.ndarray
    pixels: np.ndarray
    shift_m: np.ndarray
    filled_share: float
    outlined_share: float

    @property
    def seen_share(self) -> float:
        """Return the share of the predicted surface that is seen in its place."""
        expected = (self.on_m2 + self.through_m2 + self.hidden_m2 + self.unread_m2).sum()
        return float(self.on_m2.sum() / max(expected, 1e-9))

    @property
    def through_share(self) -> float:
        """Return the share of the unhidden surface that is seen through."""
        return float(self.through_m2.sum() / max((self.on_m2 + self.through_m2).sum(), 1e-9))

    @property
    def score_m2(self) -> float:
        """Return (area seen in place - 2 * area seen through) * (1 - ``filled_share``), in m2."""
        return float((self.on_m2 - 2.0 * self.through_m2).sum() * max(0.0, 1.0 - self.filled_share))


def gather_evidence(view: StillView, equipment: Equipment, fit: Refined, tolerance_m: float) -> PartEvidence:
    """Compare the equipment as predicted at a pose with the frames, frame by frame. Surface beyond the camera's range
    counts as hidden. Pixels that see through the equipment are left out if they lie beside pixels that show the
    equipment, because edge pixels of a bar often read the background. All areas are 0 if the equipment is outside the
    depth image.
    """
    prediction, parts = predict(view.camera, equipment, fit.T_camera_model), equipment.caster.part_count
    if prediction is None:
        return _nothing_in_image(parts)
    rendering = prediction.rendering
    row, column = np.nonzero(rendering.part >= 0)
    facing = incidence(view.camera, rendering, row, column)[2] > LEAST_COSINE
    row, column = row[facing], column[facing]
    depth = rendering.depth_m[row, column].astype(np.float64)
    readings = view.frames_m[:, *rendering.window][:, row, column]
    gate = tolerance_m + NOISE_GATE * view.noise_per_m * depth**2
    on = (np.abs(readings - depth) < gate).sum(axis=0)
    behind = (readings > depth + gate).sum(axis=0)
    free, before = on + behind, ((readings > 0) & (readings < depth - gate)).sum(axis=0)
    lens = view.camera.intrinsics
    area, part = depth**2 / (lens.fx * lens.fy), rendering.part[row, column]

    def total(mask: np.ndarray) -> np.ndarray:
        return np.bincount(part[mask], area[mask], parts)

    shown, past = (free > 0) & (on >= behind), (free > 0) & (on < behind)
    beside = np.zeros(rendering.part.shape, np.uint8)
    beside[row[shown], column[shown]] = 1
    past &= cv2.dilate(beside, np.ones((3, 3), np.uint8))[row, column] == 0
    hidden = (free == 0) & ((before > 0) | (depth > view.range_m))
    filled, outlined = _outline_shares(view, prediction, fit.edge_bias_px, tolerance_m)
    return PartEvidence(
        on_m2=total(shown),
        through_m2=total(past),
        hidden_m2=total(hidden),
        unread_m2=total((free == 0) & ~hidden),
        pixels=np.bincount(part[~hidden], minlength=parts),
        shift_m=part_shifts(view, prediction, fit.edge_bias_px, parts),
        filled_share=filled,
        outlined_share=outlined,
    )


def _nothing_in_image(parts: int) -> PartEvidence:
    nothing = np.zeros(parts)
    return PartEvidence(nothing, nothing, nothing, nothing, nothing, np.full(parts, np.nan), 1.0, 0.0)


def _outline_shares(view: StillView, prediction: Prediction, bias_px: float, tolerance_m: float) -> tuple[float, float]:
    """Return two shares of the outline's unhidden points. First, among the points at which the part is seen: the share
    at which the surface continues beyond the outline. This happens if the part lies inside a wall or the floor, or if a
    person leans on the part. Second, among all unhidden points: the share at which the surface ends as predicted.
    """
    edges = observed_edges(view, prediction, Gate(tolerance_m, FINE.reach_px))
    off = np.abs(edges.beyond_px - prediction.outline.beyond_px - bias_px)
    ends, goes_on, absent = (int(mask.sum()) for mask in (edges.usable, edges.goes_on, edges.absent))
    right = int((edges.usable & (off < MOST_OFF_PX)).sum())
    return goes_on / max(ends + goes_on, 1) if ends + goes_on else 1.0, right / max(ends + goes_on + absent, 1)


def why_rejected(pose: EquipmentPose, names: Sequence[str]) -> NoEquipmentPose | None:
    """Return why the pose is rejected; None if it is accepted. names: one per part of the equipment."""
    evidence = pose.evidence
    if evidence.seen_share < LEAST_SEEN:
        return NoEquipmentPose(NoPose.LITTLE_SEEN)
    if evidence.filled_share > MOST_FILLED:
        return NoEquipmentPose(NoPose.FILLED)
    enough = evidence.pixels >= LEAST_PIXELS_OF_PART
    through = evidence.through_m2 / np.maximum(evidence.on_m2 + evidence.through_m2, 1e-9)
    missing = np.flatnonzero(enough & (through > MOST_THROUGH_OF_PART))
    if len(missing):
        return NoEquipmentPose(NoPose.PART_MISSING, names[missing[np.argmax(evidence.through_m2[missing])]])
    unread_share = evidence.unread_m2 / np.maximum(evidence.on_m2 + evidence.through_m2 + evidence.unread_m2, 1e-9)
    unread = np.flatnonzero(enough & (unread_share > MOST_UNREAD_OF_PART))
    if len(unread):
        return NoEquipmentPose(NoPose.PART_UNREAD, names[unread[np.argmax(evidence.unread_m2[unread])]])
    if evidence.through_share > MOST_THROUGH:
        return NoEquipmentPose(NoPose.SEEN_THROUGH)
    shift = np.nan_to_num(evidence.shift_m)
    if shift.max(initial=0.0) > SAME_M:
        return NoEquipmentPose(NoPose.PART_ELSEWHERE, names[shift.argmax()])
    if evidence.outlined_share < LEAST_OUTLINED:
        return NoEquipmentPose(NoPose.OUTLINE)
    unsure = pose.sigma_rad > MOST_SIGMA_RAD or pose.sigma_m > MOST_SIGMA_M
    return NoEquipmentPose(NoPose.UNSURE) if unsure else None


TRIED: Final = 6  # number of search results that are refined; the correct result was always among the best two
# minimum score of the best accepted pose, divided by the best score of all poses, accepted or rejected; with a smaller
# ratio, no pose is accepted
LEAST_LEAD: Final = 0.9
RIVAL: Final = 0.75  # if another accepted pose has more than this share of the best score, the choice is ambiguous
DISTINCT_M, DISTINCT_RAD = 0.08, 0.12  # m and rad; poses that differ by less than both are the same pose
# m; if the model's lowest point is farther than this from its plane Y = 0, both heights are tried as the floor's height
TWO_HEIGHTS_M: Final = 0.03


@settings
class EquipmentPoseConfig:
    """Settings for checking a pose: how closely readings must lie on the equipment's surface."""

    tolerance_m: Positive = 0.015  # m, maximum distance of a reading from the surface, as in the refinement's last step


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentPose:
    """The pose that was found. fit.T_camera_model maps the equipment's frame (Gamma_0) to the camera frame; evidence:
    how the depth frames agree with this pose.

    The standard deviations ``sigma_m`` and ``sigma_rad`` include the systematic error of a camera, since this error
    does not become smaller with more pixels.
    """

    fit: Refined
    evidence: PartEvidence

    @property
    def camera_to_world(self) -> np.ndarray:
        """Return T_world_camera (4, 4), where the world is the equipment's frame Gamma_0."""
        inverse: np.ndarray = np.linalg.inv(self.fit.T_camera_model)
        return inverse

    @property
    def sigma_rad(self) -> float:
        """Return the standard deviation of the equipment's rotation, about the axis about which it is largest."""
        return float(np.hypot(np.sqrt(np.linalg.eigvalsh(self.fit.covariance[:3, :3])[-1]), STEADY_RAD))

    @property
    def sigma_m(self) -> float:
        """Return the standard deviation of the position of the equipment's centre, in the direction in which it is
        largest.
        """
        return float(np.hypot(np.sqrt(np.linalg.eigvalsh(self.fit.covariance[3:, 3:])[-1]), STEADY_ERROR_M))


@dataclass(frozen=True, slots=True, eq=False)
class NoEquipmentPose:
    """The reason why this camera has no pose. part: name of the equipment's part that causes the rejection, if it is a
    single part.
    """

    why: NoPose
    part: str | None = None


def find_equipment(
    view: StillView, equipment: Equipment, config: EquipmentPoseConfig
) -> EquipmentPose | NoEquipmentPose:
    """Search for the equipment's pose, refine and check it; for symmetric equipment, the result may be any of the
    equivalent poses.

    The floor determines the vertical and the height: the model's lowest point or the plane Y = 0 of its frame is
    assumed to lie on the floor.
    """
    if equipment.symmetry.round:
        return NoEquipmentPose(NoPose.ROUND)
    fits: list[EquipmentPose] = []
    for floor_m in _floor_heights(equipment):
        fits += _fits(view, equipment, floor_m, config)
    fits.sort(key=lambda pose: -pose.evidence.score_m2)
    good = [pose for pose in fits if why_rejected(pose, equipment.names) is None]
    if not good or good[0].evidence.score_m2 < LEAST_LEAD * fits[0].evidence.score_m2:
        return _reason(fits, equipment)
    rivals = [pose for pose in good[1:] if pose.evidence.score_m2 > RIVAL * good[0].evidence.score_m2]
    if any(_is_rival(good[0], other, equipment) for other in rivals):
        return NoEquipmentPose(NoPose.AMBIGUOUS)
    return good[0]


def refit(
    view: StillView, equipment: Equipment, start: np.ndarray, prior: FloorPrior, config: EquipmentPoseConfig
) -> EquipmentPose | NoEquipmentPose:
    """Refine and check the equipment's pose again; ``start`` is a pose (T_camera_model) that is correct within a bar's
    width.
    """
    pose = _refined(view, equipment, start, prior, config)
    if pose is None:
        return NoEquipmentPose(NoPose.LITTLE_SEEN)
    rejected = why_rejected(pose, equipment.names)
    return pose if rejected is None else rejected


def _refined(
    view: StillView, equipment: Equipment, start: np.ndarray, prior: FloorPrior, config: EquipmentPoseConfig
) -> EquipmentPose | None:
    fit = refine(view, equipment, start, prior)
    return None if fit is None else EquipmentPose(fit, gather_evidence(view, equipment, fit, config.tolerance_m))


def _fits(view: StillView, equipment: Equipment, floor_m: float, config: EquipmentPoseConfig) -> list[EquipmentPose]:
    """Return the refined poses of the best search results. Also turn the best of them by each rotation of
    ``Symmetry.alike`` (after which the equipment looks similar), and return these poses, refined again.
    """
    prior = standing_prior(floor_m)

    def refined(starts: list[np.ndarray]) -> list[EquipmentPose]:
        poses = (_refined(view, equipment, start, prior, config) for start in starts)
        return [pose for pose in poses if pose is not None]

    fits = refined(search_floor(view, equipment.samples, floor_m)[:TRIED])
    if not fits:
        return []
    best = max(fits, key=lambda pose: pose.evidence.score_m2).fit.T_camera_model
    return fits + refined([best @ turn for turn in equipment.symmetry.alike])


def _floor_heights(equipment: Equipment) -> tuple[float, ...]:
    lowest = float(equipment.caster.vertices_m[:, 1].min())
    return (lowest,) if abs(lowest) < TWO_HEIGHTS_M else (lowest, 0.0)


def _reason(fits: list[EquipmentPose], equipment: Equipment) -> NoEquipmentPose:
    """Return why no pose is accepted: the reason for the refined pose that agrees best with the seen surface and
    outline.
    """
    if not fits:
        return NoEquipmentPose(NoPose.NOT_SEEN)
    likely = max(fits, key=lambda pose: pose.evidence.on_m2.sum() * (1.0 - pose.evidence.filled_share))
    rejected = why_rejected(likely, equipment.names)
    if rejected is None:
        return NoEquipmentPose(NoPose.AMBIGUOUS)
    return NoEquipmentPose(NoPose.NOT_SEEN) if rejected.why is NoPose.FILLED else rejected


def _is_rival(accepted: EquipmentPose, other: EquipmentPose, equipment: Equipment) -> bool:
    """Return whether ``other`` differs from the accepted pose by more than a symmetry of the equipment."""
    centre = equipment.samples.centre_m
    for turn in (np.eye(4), *equipment.symmetry.same):
        T = accepted.fit.T_camera_model @ turn
        apart = np.linalg.norm(transform_points(T, centre) - transform_points(other.fit.T_camera_model, centre))
        if apart < DISTINCT_M and angle_between(T, other.fit.T_camera_model) < DISTINCT_RAD:
            return False
    return True


def angle_between(T_a: np.ndarray, T_b: np.ndarray) -> float:
    """Return the angle (rad) of the turn from one pose (4, 4) to the other."""
    return float(np.arccos(np.clip((np.trace(T_a[:3, :3].T @ T_b[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
