"""What speaks for and against a pose of the equipment, part by part, and whether it may be believed."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum

import numpy as np

from anchorpose.calibration.equipment.refine import Refined, part_shifts
from anchorpose.calibration.equipment.render import EquipmentCaster, Rendering
from anchorpose.calibration.equipment.rows import RefineConfig, observed_edges
from anchorpose.calibration.equipment.still import StillView

STEADY_M, STEADY_RAD = 0.0015, 0.0008  # 1 to 2 mm over the picture; between bars a metre apart 0.05 degrees


class NoPose(StrEnum):
    """Why a camera has no pose: a result."""

    NO_FLOOR = "sees no floor, so which way is up cannot be told"
    NOT_SEEN = "shows the equipment nowhere"
    LITTLE_SEEN = "shows too little of the equipment"
    SEEN_THROUGH = "sees through places where the equipment model has surface"
    PART_MISSING = "does not show a part of the equipment model where it should be"
    PART_UNREAD = "has no reading where a part of the equipment model should be"
    PART_ELSEWHERE = "shows a part of the equipment model beside its place"
    FILLED = "shows as much beside the equipment as on it, so its outline is not seen"
    OUTLINE = "does not show the equipment's outline where it should be"
    UNSURE = "shows the equipment too vaguely to tell its pose"
    AMBIGUOUS = "shows two places that the equipment model fits"
    ROUND = "shows equipment that looks the same from every side"


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictConfig:
    """What a pose must withstand. Shares are of surface area, so that near parts do not outvote far ones."""

    least_seen: float = 0.2  # of the surface that faces the camera, on it: people hide up to half, the picture ends
    most_through: float = 0.10  # of what is not hidden, seen through: edges of thin bars flicker
    most_through_of_part: float = 0.35
    most_unread_of_part: float = (
        0.7  # of what nothing hides: a part that is absent before a far wall is not read either
    )
    least_pixels_of_part: int = 40  # fewer say nothing about a part
    most_part_shift_m: float = 0.012  # equipment is measured with a tape; two clinics' frames differ by more
    surest_shift_m: float = 0.003  # one sigma: less sure shifts say nothing
    most_filled: float = 0.5  # of the outline's places: within a wall it is all
    least_outlined: float = 0.6  # of the outline's places that nothing hides: the part ends there
    most_off_px: float = 2.0  # within this of its place; edge pixels look one aside
    most_sigma_m: float = 0.006
    most_sigma_rad: float = 0.0087  # half a degree
    least_cosine: float = 0.25  # of incidence: flatter, no camera reads a surface well
    tolerance_m: float = 0.015  # on the surface or not, as at the end of the refinement

    def __post_init__(self) -> None:
        for entry in fields(self):
            if not getattr(self, entry.name) > 0:
                raise ValueError(f"{entry.name} must be positive, got {getattr(self, entry.name)}")


@dataclass(frozen=True, slots=True, eq=False)
class PartEvidence:
    """Areas (m^2) and pixels of each part as expected in the picture, arrays (parts,).

    on, through, hidden, unread: share the expected surface; pixels: all but the hidden; shift_m: by how much the
    part looks displaced, NaN where that is not sure. filled_share,
    outlined_share: see ``_outline_shares``.
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
        """Of the expected surface, how much is seen where it should be."""
        expected = (self.on_m2 + self.through_m2 + self.hidden_m2 + self.unread_m2).sum()
        return float(self.on_m2.sum() / max(expected, 1e-9))

    @property
    def through_share(self) -> float:
        """Of the surface that nothing hides, how much is seen through."""
        return float(self.through_m2.sum() / max((self.on_m2 + self.through_m2).sum(), 1e-9))

    @property
    def score_m2(self) -> float:
        """Surface that is found less twice what is seen through; nothing where all of it sticks in something."""
        return float((self.on_m2 - 2.0 * self.through_m2).sum() * max(0.0, 1.0 - self.filled_share))


def gather_evidence(
    view: StillView, caster: EquipmentCaster, fit: Refined, config: VerdictConfig, refine_config: RefineConfig
) -> PartEvidence:
    """Compare the equipment drawn at a pose with what the frames show there, frame by frame."""
    parts, T = caster.part_count, fit.T_camera_model
    rendering = caster.render(view.camera, T)
    nothing = np.zeros(parts)
    if rendering is None:
        return PartEvidence(nothing, nothing, nothing, nothing, nothing, np.full(parts, np.nan), 1.0, 0.0)
    row, column = np.nonzero(rendering.part >= 0)
    rays = view.camera.pixel_rays()[row + rendering.top, column + rendering.left].astype(np.float64)
    ahead = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    facing = np.abs(np.sum(rendering.normal[row, column] * ahead, axis=1)) / np.linalg.norm(ahead, axis=1)
    row, column = row[facing > config.least_cosine], column[facing > config.least_cosine]
    depth = rendering.depth_m[row, column].astype(np.float64)
    readings = view.frames_m[:, *rendering.window][:, row, column]
    gate = config.tolerance_m + refine_config.noise_gate * view.noise_per_m * depth**2
    on = (np.abs(readings - depth) < gate).sum(axis=0)
    behind = (readings > depth + gate).sum(axis=0)
    before = ((readings > 0) & (readings < depth - gate)).sum(axis=0)
    free = on + behind
    lens = view.camera.intrinsics
    area, part = depth**2 / (lens.fx * lens.fy), rendering.part[row, column]

    def total(mask: np.ndarray) -> np.ndarray:
        return np.bincount(part[mask], area[mask], parts)

    is_on, is_through = (free > 0) & (on >= behind), (free > 0) & (on < behind)
    filled, outlined = _outline_shares(view, caster, fit, rendering, config, refine_config)
    is_hidden = (free == 0) & (before > 0)
    return PartEvidence(
        on_m2=total(is_on), through_m2=total(is_through), hidden_m2=total(is_hidden),
        unread_m2=total((free == 0) & (before == 0)), pixels=np.bincount(part[~is_hidden], minlength=parts),
        shift_m=part_shifts(view, caster, T, fit.edge_bias_px, config.surest_shift_m, refine_config),
        filled_share=filled,
        outlined_share=outlined,
    )  # fmt: skip


def judge(fit: Refined, evidence: PartEvidence, config: VerdictConfig) -> tuple[NoPose | None, int | None]:
    """Why the pose may not be believed, None where it may, and the part that says so, where it is one."""
    if evidence.seen_share < config.least_seen:
        return NoPose.LITTLE_SEEN, None
    if evidence.filled_share > config.most_filled:
        return NoPose.FILLED, None
    told = evidence.pixels >= config.least_pixels_of_part
    through = evidence.through_m2 / np.maximum(evidence.on_m2 + evidence.through_m2, 1e-9)
    missing = np.flatnonzero(told & (through > config.most_through_of_part))
    if len(missing):
        return NoPose.PART_MISSING, int(missing[np.argmax(evidence.through_m2[missing])])
    bare = evidence.unread_m2 / np.maximum(evidence.on_m2 + evidence.through_m2 + evidence.unread_m2, 1e-9)
    unread = np.flatnonzero(told & (bare > config.most_unread_of_part))
    if len(unread):
        return NoPose.PART_UNREAD, int(unread[np.argmax(evidence.unread_m2[unread])])
    if evidence.through_share > config.most_through:
        return NoPose.SEEN_THROUGH, None
    shift = np.nan_to_num(evidence.shift_m)
    if shift.max(initial=0.0) > config.most_part_shift_m:
        return NoPose.PART_ELSEWHERE, int(shift.argmax())
    if evidence.outlined_share < config.least_outlined:
        return NoPose.OUTLINE, None
    turn, place = sigma_of(fit)
    if turn > config.most_sigma_rad or place > config.most_sigma_m:
        return NoPose.UNSURE, None
    return None, None


def sigma_of(fit: Refined) -> tuple[float, float]:
    """One standard deviation of the angle (rad) and of the place of the equipment's centre (m), worst direction.

    What a device's steady error adds does not shrink with the number of pixels.
    """
    turn, place = (np.linalg.eigvalsh(block)[-1] for block in (fit.covariance[:3, :3], fit.covariance[3:, 3:]))
    return float(np.hypot(np.sqrt(turn), STEADY_RAD)), float(np.hypot(np.sqrt(place), STEADY_M))


def _outline_shares(
    view: StillView, caster: EquipmentCaster, fit: Refined, rendering: Rendering, config: VerdictConfig,
    refine_config: RefineConfig,
) -> tuple[float, float]:  # fmt: skip
    """Of the outline's places that nothing hides: the share that does not end there, among those with the part in them
    (a wall, the floor, somebody leaning on it), and the share that ends just where it should."""
    outline = caster.outline(view.camera, fit.T_camera_model, rendering)
    reach = refine_config.reaches_px[-1]
    edges = observed_edges(view, outline, rendering, config.tolerance_m, reach, refine_config)
    off = np.abs(edges.beyond_px - outline.beyond_px - fit.edge_bias_px)
    ends, goes_on, absent = (int(mask.sum()) for mask in (edges.usable, edges.goes_on, edges.absent))
    right = int((edges.usable & (off < config.most_off_px)).sum())
    return goes_on / max(ends + goes_on, 1) if ends + goes_on else 1.0, right / max(ends + goes_on + absent, 1)
