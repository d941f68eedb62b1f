"""tau_0,i: the equipment's pose in one camera, from its depth picture and chi_0 alone (paper, Section III)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from anchorpose.calibration.equipment.refine import FloorPrior, Refined, refine
from anchorpose.calibration.equipment.render import EquipmentCaster
from anchorpose.calibration.equipment.rows import RefineConfig
from anchorpose.calibration.equipment.samples import EquipmentSamples, Symmetry, find_symmetry, sample_equipment
from anchorpose.calibration.equipment.search import SearchConfig, search_floor
from anchorpose.calibration.equipment.still import StillView
from anchorpose.calibration.equipment.verdict import (
    NoPose,
    PartEvidence,
    VerdictConfig,
    gather_evidence,
    judge,
    sigma_of,
)
from anchorpose.camera import transform_points
from anchorpose.recording.equipment import EquipmentModel


@dataclass(frozen=True, slots=True, kw_only=True)
class EquipmentPoseConfig:
    """From the search to the verdict."""

    tried: int = 6  # places of the search that are refined; the right one was always among the first two
    least_lead: float = 0.9  # the pose taken explains so much of what the best-scoring one does
    rival: float = 0.75  # another believable pose that explains this share of it leaves the choice open
    distinct_m: float = 0.08
    distinct_rad: float = 0.12  # two poses nearer than this are one, of which one has not settled
    two_heights_m: float = 0.03  # between chi_0's lowest point and Y = 0: either may be the floor
    search: SearchConfig = field(default_factory=SearchConfig)
    refine: RefineConfig = field(default_factory=RefineConfig)
    verdict: VerdictConfig = field(default_factory=VerdictConfig)

    def __post_init__(self) -> None:
        for name in ("tried", "least_lead", "rival", "distinct_m", "distinct_rad", "two_heights_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True, eq=False)
class Equipment:
    """chi_0, prepared once for all cameras."""

    model: EquipmentModel
    samples: EquipmentSamples
    caster: EquipmentCaster
    symmetry: Symmetry

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parts."""
        return tuple(part.name for part in self.model.parts)


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentPose:
    """fit.T_camera_model maps Gamma_0 to the camera; evidence: what speaks for it."""

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
    """Why this camera has none; part: the one that says so, where it is one."""

    why: NoPose
    part: str | None = None


def prepare_equipment(model: EquipmentModel) -> Equipment:
    """Everything that depends on chi_0 alone."""
    samples = sample_equipment(model)
    return Equipment(model, samples, EquipmentCaster(model), find_symmetry(model, samples))


def find_equipment(
    view: StillView, equipment: Equipment, config: EquipmentPoseConfig
) -> EquipmentPose | NoEquipmentPose:
    """Search, refine, judge; of poses that chi_0's symmetry makes the same, any one.

    The floor gives up and height; chi_0's lowest point or Gamma_0's Y = 0 is looked for on it.
    """
    if equipment.symmetry.round:
        return NoEquipmentPose(NoPose.ROUND)
    fits: list[EquipmentPose] = []
    for floor_m in _floor_heights(equipment, config):
        fits += _fits(view, equipment, floor_m, config)
    fits.sort(key=lambda pose: -pose.evidence.score_m2)
    good = [pose for pose in fits if judge(pose.fit, pose.evidence, config.verdict)[0] is None]
    if not good or good[0].evidence.score_m2 < config.least_lead * fits[0].evidence.score_m2:
        return _reason(fits, equipment, config)
    rivals = [pose for pose in good[1:] if pose.evidence.score_m2 > config.rival * good[0].evidence.score_m2]
    if any(_is_rival(good[0], other, equipment, config) for other in rivals):
        return NoEquipmentPose(NoPose.AMBIGUOUS)
    return good[0]


def _reason(fits: list[EquipmentPose], equipment: Equipment, config: EquipmentPoseConfig) -> NoEquipmentPose:
    """What is wrong with the pose that finds most of the surface and its outline."""
    if not fits:
        return NoEquipmentPose(NoPose.NOT_SEEN)
    likely = max(fits, key=lambda pose: pose.evidence.on_m2.sum() * (1.0 - pose.evidence.filled_share))
    why, part = judge(likely.fit, likely.evidence, config.verdict)
    if why == NoPose.FILLED:
        return NoEquipmentPose(NoPose.NOT_SEEN)
    return NoEquipmentPose(why or NoPose.AMBIGUOUS, None if part is None else equipment.names[part])


def refit(
    view: StillView, equipment: Equipment, start: np.ndarray, prior: FloorPrior, config: EquipmentPoseConfig
) -> EquipmentPose | NoEquipmentPose:
    """Refine and judge again from a pose that is right within a bar's width (T_camera_model)."""
    fit = refine(view, equipment.caster, start, equipment.samples.centre_m, prior, config.refine)
    if fit is None:
        return NoEquipmentPose(NoPose.LITTLE_SEEN)
    evidence = gather_evidence(view, equipment.caster, fit, config.verdict, config.refine)
    why, part = judge(fit, evidence, config.verdict)
    if why is not None:
        return NoEquipmentPose(why, None if part is None else equipment.names[part])
    return EquipmentPose(fit, evidence)


def standing_prior(floor_m: float, config: RefineConfig) -> FloorPrior:
    """What is believed before anything is seen: chi_0 stands upright on the floor."""
    return FloorPrior(np.array([0.0, 1.0, 0.0]), floor_m, config.standing_sigma_m, config.standing_sigma_rad)


def _floor_heights(equipment: Equipment, config: EquipmentPoseConfig) -> tuple[float, ...]:
    lowest = float(equipment.caster.vertices_m[:, 1].min())
    return (lowest,) if abs(lowest) < config.two_heights_m else (lowest, 0.0)


def _fits(view: StillView, equipment: Equipment, floor_m: float, config: EquipmentPoseConfig) -> list[EquipmentPose]:
    """The best places of the search, refined, and those that a near symmetry would have mistaken for them."""
    prior = standing_prior(floor_m, config.refine)
    found = search_floor(
        view.still_m, view.camera, view.floor, equipment.samples, floor_m, view.noise_per_m, config.search
    )
    starts = [candidate.T_camera_model for candidate in found[: config.tried]]
    fits: list[EquipmentPose] = []
    for start in starts:
        fit = refine(view, equipment.caster, start, equipment.samples.centre_m, prior, config.refine)
        if fit is not None:
            fits.append(EquipmentPose(fit, gather_evidence(view, equipment.caster, fit, config.verdict, config.refine)))
    if fits:
        best = max(fits, key=lambda pose: pose.evidence.score_m2).fit.T_camera_model
        for turn in equipment.symmetry.alike:
            fit = refine(view, equipment.caster, best @ turn, equipment.samples.centre_m, prior, config.refine)
            if fit is not None:
                evidence = gather_evidence(view, equipment.caster, fit, config.verdict, config.refine)
                fits.append(EquipmentPose(fit, evidence))
    return fits


def _is_rival(taken: EquipmentPose, other: EquipmentPose, equipment: Equipment, config: EquipmentPoseConfig) -> bool:
    """Whether ``other`` is another place or direction, and no turn of chi_0 onto itself."""
    centre = equipment.samples.centre_m
    for turn in (np.eye(4), *equipment.symmetry.same):
        T = taken.fit.T_camera_model @ turn
        apart = np.linalg.norm(transform_points(T, centre) - transform_points(other.fit.T_camera_model, centre))
        if apart < config.distinct_m and angle_between(T, other.fit.T_camera_model) < config.distinct_rad:
            return False
    return True


def angle_between(T_a: np.ndarray, T_b: np.ndarray) -> float:
    """Angle (rad) of the turn from one pose (4, 4) to the other."""
    return float(np.arccos(np.clip((np.trace(T_a[:3, :3].T @ T_b[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
