"""tau_0,i: the equipment's pose in one camera, from its depth frames and chi_0 alone (paper, Section III)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.calibration.equipment_model import Equipment
from anchorpose.calibration.equipment_refine import FloorPrior, Refined, refine, standing_prior
from anchorpose.calibration.equipment_residuals import StillView
from anchorpose.calibration.equipment_search import search_floor
from anchorpose.calibration.equipment_verdict import NoPose, PartEvidence, gather_evidence, judge, sigma_of
from anchorpose.camera import transform_points
from anchorpose.settings import Positive, settings

TRIED: Final = 6  # places of the search that are refined; the right one was always among the first two
LEAST_LEAD: Final = 0.9  # the pose accepted explains this share of what the best-scoring one does
RIVAL: Final = 0.75  # another credible pose that explains this share of it leaves the choice open
DISTINCT_M, DISTINCT_RAD = 0.08, 0.12  # two poses nearer than this are one, of which one has not settled
TWO_HEIGHTS_M: Final = 0.03  # between chi_0's lowest point and Y = 0: either may be the floor


@settings
class EquipmentPoseConfig:
    """How exactly the equipment must be where it is expected."""

    tolerance_m: Positive = 0.015  # of readings from its surface, as at the end of the refinement


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentPose:
    """fit.T_camera_model maps Gamma_0 to the camera; evidence: what supports it."""

    fit: Refined
    evidence: PartEvidence

    @property
    def camera_to_world(self) -> np.ndarray:
        """T_world_camera (4, 4), the world being Gamma_0."""
        inverse: np.ndarray = np.linalg.inv(self.fit.T_camera_model)
        return inverse

    @property
    def sigma_rad(self) -> float:
        return sigma_of(self.fit)[0]

    @property
    def sigma_m(self) -> float:
        return sigma_of(self.fit)[1]


@dataclass(frozen=True, slots=True, eq=False)
class NoEquipmentPose:
    """Why this camera has none; part: the one that shows it, where it is one."""

    why: NoPose
    part: str | None = None


def find_equipment(
    view: StillView, equipment: Equipment, config: EquipmentPoseConfig
) -> EquipmentPose | NoEquipmentPose:
    """Search, refine, judge; of poses that chi_0's symmetry makes the same, any one.

    The floor gives up and height; chi_0's lowest point or Gamma_0's Y = 0 is assumed on it.
    """
    if equipment.symmetry.round:
        return NoEquipmentPose(NoPose.ROUND)
    fits: list[EquipmentPose] = []
    for floor_m in _floor_heights(equipment):
        fits += _fits(view, equipment, floor_m, config)
    fits.sort(key=lambda pose: -pose.evidence.score_m2)
    good = [pose for pose in fits if judge(pose.fit, pose.evidence)[0] is None]
    if not good or good[0].evidence.score_m2 < LEAST_LEAD * fits[0].evidence.score_m2:
        return _reason(fits, equipment)
    rivals = [pose for pose in good[1:] if pose.evidence.score_m2 > RIVAL * good[0].evidence.score_m2]
    if any(_is_rival(good[0], other, equipment) for other in rivals):
        return NoEquipmentPose(NoPose.AMBIGUOUS)
    return good[0]


def refit(
    view: StillView, equipment: Equipment, start: np.ndarray, prior: FloorPrior, config: EquipmentPoseConfig
) -> EquipmentPose | NoEquipmentPose:
    """Refine and judge again from a pose that is right within a bar's width (T_camera_model)."""
    pose = _refined(view, equipment, start, prior, config)
    if pose is None:
        return NoEquipmentPose(NoPose.LITTLE_SEEN)
    why, part = judge(pose.fit, pose.evidence)
    return pose if why is None else NoEquipmentPose(why, None if part is None else equipment.names[part])


def _refined(
    view: StillView, equipment: Equipment, start: np.ndarray, prior: FloorPrior, config: EquipmentPoseConfig
) -> EquipmentPose | None:
    fit = refine(view, equipment, start, prior)
    return None if fit is None else EquipmentPose(fit, gather_evidence(view, equipment, fit, config.tolerance_m))


def _fits(view: StillView, equipment: Equipment, floor_m: float, config: EquipmentPoseConfig) -> list[EquipmentPose]:
    """The best places of the search, refined, and those that a near symmetry would have mistaken for them."""
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
    """What is wrong with the pose that finds most of the surface and its outline."""
    if not fits:
        return NoEquipmentPose(NoPose.NOT_SEEN)
    likely = max(fits, key=lambda pose: pose.evidence.on_m2.sum() * (1.0 - pose.evidence.filled_share))
    why, part = judge(likely.fit, likely.evidence)
    if why == NoPose.FILLED:
        return NoEquipmentPose(NoPose.NOT_SEEN)
    return NoEquipmentPose(why or NoPose.AMBIGUOUS, None if part is None else equipment.names[part])


def _is_rival(accepted: EquipmentPose, other: EquipmentPose, equipment: Equipment) -> bool:
    """Whether ``other`` is another place or direction, and not a turn of chi_0 onto itself."""
    centre = equipment.samples.centre_m
    for turn in (np.eye(4), *equipment.symmetry.same):
        T = accepted.fit.T_camera_model @ turn
        apart = np.linalg.norm(transform_points(T, centre) - transform_points(other.fit.T_camera_model, centre))
        if apart < DISTINCT_M and angle_between(T, other.fit.T_camera_model) < DISTINCT_RAD:
            return False
    return True


def angle_between(T_a: np.ndarray, T_b: np.ndarray) -> float:
    """Angle (rad) of the turn from one pose (4, 4) to the other."""
    return float(np.arccos(np.clip((np.trace(T_a[:3, :3].T @ T_b[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
