"""Everything that tracking may be told, stage by stage."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Final

from anchorpose.association.hypotheses import GateConfig
from anchorpose.association.matcher import HypothesisConfig
from anchorpose.body.learning import LearningConfig
from anchorpose.body.part_registration import PartRegistrationConfig
from anchorpose.body.registration import RegistrationConfig
from anchorpose.body.uncertainty import UncertaintyConfig
from anchorpose.body.visibility import VisibilityConfig
from anchorpose.calibration.clock.clocks import ClockConfig
from anchorpose.calibration.equipment.seen import EquipmentWorldConfig
from anchorpose.calibration.floor import FloorConfig
from anchorpose.calibration.people.camera_to_camera import CameraToCameraConfig
from anchorpose.geodesics.anchors import AnchorConfig
from anchorpose.isolation.config import IsolationConfig
from anchorpose.results.contact_intervals import ContactConfig
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.tracker.bystanders import BystanderConfig
from anchorpose.tracker.standing_feet import StandingConfig
from anchorpose.tracking.motion import MotionConfig
from anchorpose.tracking.motion_file import SHIPPED
from anchorpose.tracking.tree import TreeConfig

HEIGHTS_M: Final = (1.2, 2.2)  # of adults: beyond, the shape space knows nobody, and the unit was mistaken


class Method(StrEnum):
    """How a frame's pairs become a pose."""

    ARTICULATED = "articulated"  # all parts at once, joined, on the learnt body
    PARTS = "parts"  # the paper's own: every part by itself, from frame to frame


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowConfig:
    """How the patient is followed over time."""

    look_ahead: int = 3  # N_Tr, depth of the track tree (paper, Section V)
    tree_nodes: int = 800  # source nodes of the tree: 40 a body part
    see_again_m: float = 0.03  # skin expected so far from where it was when the frame came in: half a forearm's width
    part_reach_m: float = 0.08  # a node farther off the skin moves with no part
    history: int = 12  # frames kept for the motion dynamics
    samples: int = 16  # frames looked at beforehand for the background and for who stays
    lost_sigma_m: float = 0.25  # a joint less sure than half a forearm is lost, not estimated
    lost_after_s: float = 1.0  # without any evidence the whole patient is searched for again
    search_pause: int = 4  # frames between two searches for an arm, which cost as much as ten frames
    least_explained: float = 0.55  # share of the surface a first pose must account for

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class SmoothingConfig:
    """How two passes over a recording, there and back again, are put together."""

    apart_m: float = 0.06  # a limb's joints nearer than this are averaged: the width of a wrist, so it is the same limb
    trunk_apart_m: float = 0.15  # half a shoulder breadth: beyond, the trunk is in two places, and no limb can be mixed
    hidden_cost: float = 0.5  # of a joint that is not seen, in a frame; of one that is, 0
    lost_cost: float = 2.0  # of a joint where the cameras look past it: it is not there
    switch_cost: float = 0.2  # of going over from one pass to the other: less than a hidden joint in one frame
    switch_cost_per_m: float = 10.0  # a jump of 0.2 m has to save one lost joint
    acceleration: float = (
        2.0  # m/s in a second, with the root of time: 1 m/s in the quarter of a second that a reach starts in
    )
    lost_sigma_m: float = 0.25  # what a lost joint's place is worth: as FollowConfig.lost_sigma_m

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackConfig:
    """The resolved configuration of a run, saved in run.json."""

    method: Method = Method.ARTICULATED
    start: int = 0  # first frame to track
    stop: int | None = None  # frame to stop before; None = the end
    smooth: bool = False  # track against time as well and put both together: not for live use, and twice the work
    height_m: float | None = None  # the patient's standing height; None = that of recording.json, or unknown
    patient_xz_m: tuple[float, float] | None = None  # where the patient stands at the start, if the user says so
    motions: str | None = None  # file of reference movements; None = those that ship with the package
    clocks: ClockConfig = field(default_factory=ClockConfig)
    placing: CameraToCameraConfig = field(default_factory=CameraToCameraConfig)
    floor: FloorConfig = field(default_factory=FloorConfig)
    equipment_pose: EquipmentWorldConfig = field(default_factory=EquipmentWorldConfig)
    isolation: IsolationConfig = field(default_factory=IsolationConfig)
    bystanders: BystanderConfig = field(default_factory=BystanderConfig)
    surface: SurfaceConfig = field(default_factory=SurfaceConfig)
    anchors: AnchorConfig = field(default_factory=AnchorConfig)
    hypotheses: HypothesisConfig = field(default_factory=HypothesisConfig)
    gate: GateConfig = field(default_factory=GateConfig)
    tree: TreeConfig = field(default_factory=TreeConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    parts: PartRegistrationConfig = field(default_factory=PartRegistrationConfig)
    learning: LearningConfig = field(default_factory=LearningConfig)
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)
    uncertainty: UncertaintyConfig = field(default_factory=UncertaintyConfig)
    follow: FollowConfig = field(default_factory=FollowConfig)
    standing: StandingConfig = field(default_factory=StandingConfig)
    smoothing: SmoothingConfig = field(default_factory=SmoothingConfig)
    contacts: ContactConfig = field(default_factory=ContactConfig)

    def __post_init__(self) -> None:
        if self.start < 0 or (self.stop is not None and self.stop <= self.start):
            raise ValueError(f"start must not be negative and stop must come after it, got {self.start} to {self.stop}")
        shortest, tallest = HEIGHTS_M
        if self.height_m is not None and not shortest <= self.height_m <= tallest:
            raise ValueError(f"height_m is in metres, {shortest} to {tallest}, got {self.height_m:g}")

    @property
    def motion_file(self) -> Path:
        """The file of reference movements."""
        return SHIPPED if self.motions is None else Path(self.motions)
