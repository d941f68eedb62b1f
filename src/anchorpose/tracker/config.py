"""Define the settings of a tracking run. Each stage defines its own settings; this module joins them."""

from __future__ import annotations

from dataclasses import field
from enum import StrEnum
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.body.config import LearningConfig, RegistrationConfig, UncertaintyConfig, VisibilityConfig
from anchorpose.calibration.camera_to_camera import PlacingConfig
from anchorpose.calibration.clocks import ClockConfig
from anchorpose.calibration.equipment_pose import EquipmentPoseConfig
from anchorpose.geodesics.anchors import AnchorConfig
from anchorpose.motion.database import SHIPPED
from anchorpose.motion.prediction import MotionConfig
from anchorpose.recording.recording_file import FARTHEST_CAMERA_M
from anchorpose.results.contact_intervals import ContactConfig
from anchorpose.settings import Count, Positive, settings
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.track_tree.hypotheses import GateConfig, HypothesisConfig
from anchorpose.track_tree.tree import TreeConfig

# m, smallest and largest height of the patient that a user may give. The body model does not cover heights outside
# these limits, and such heights were probably given in a wrong unit
HEIGHTS_M: Final = (1.2, 2.2)


class Method(StrEnum):
    """The method by which the pose of a frame is found."""

    # all parts of the learnt body are fitted to the frame together, linked by the body's joints
    ARTICULATED = "articulated"
    PARTS = "parts"  # the paper's method: each body part is registered separately, from one frame to the next


@settings
class FollowConfig:
    """Settings of how the patient is followed over time."""

    look_ahead: Count = 3  # number of later frames that the track tree spans: the tree's depth N_Tr (paper, Section V)
    # maximum number of the patient's surface nodes that the track tree follows; about 40 for each segment of the body
    tree_nodes: Count = 800
    history: Count = 12  # number of past frames kept for predicting the next pose (motion dynamics)
    # number of frames read before tracking, to learn the empty room and to choose the patient; three times as many if a
    # camera has no image of the empty room
    samples: Count = 16
    # m, maximum sigma (standard deviation) of a joint's position; a joint with a larger sigma counts as lost. The
    # maximum sigma is the length of a forearm
    lost_sigma_m: Positive = 0.25
    # s, maximum time for which tracking goes on while no frame shows the patient; after this time, the patient is
    # searched for again
    lost_after_s: Positive = 1.0
    # whether a body is fitted to each bystander (person other than the patient) and followed; False = only the last
    # seen skin of each bystander is kept
    bystanders: bool = True


@settings
class TrackConfig:
    """All settings of a run, as saved in run.json."""

    method: Method = Method.ARTICULATED
    start: int = 0  # position in the recording of the first frame to track
    stop: int | None = None  # position of the frame before which tracking stops; None = the end of the recording
    # whether to track backward, too, and to combine the forward and the backward pass. The forward and the backward
    # pass take twice the time of a single pass, and a backward pass is impossible during live tracking
    smooth: bool = False
    height_m: float | None = None  # m, the patient's standing height; None = the height in recording.json, if any
    # m, patient's x and z on the floor; None = the patient is chosen automatically
    patient_xz_m: tuple[float, float] | None = None
    # number of the frame in which the patient is at patient_xz_m; None = the first frame with a person at this place
    patient_frame: int | None = None
    # file of reference movements, by which the next poses are predicted; None = the file that ships with the package
    motions: str | None = None
    clocks: ClockConfig = field(default_factory=ClockConfig)
    placing: PlacingConfig = field(default_factory=PlacingConfig)
    equipment_pose: EquipmentPoseConfig = field(default_factory=EquipmentPoseConfig)
    surface: SurfaceConfig = field(default_factory=SurfaceConfig)
    anchors: AnchorConfig = field(default_factory=AnchorConfig)
    hypotheses: HypothesisConfig = field(default_factory=HypothesisConfig)
    gate: GateConfig = field(default_factory=GateConfig)
    tree: TreeConfig = field(default_factory=TreeConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    learning: LearningConfig = field(default_factory=LearningConfig)
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)
    uncertainty: UncertaintyConfig = field(default_factory=UncertaintyConfig)
    follow: FollowConfig = field(default_factory=FollowConfig)
    contacts: ContactConfig = field(default_factory=ContactConfig)

    def __post_init__(self) -> None:
        if self.start < 0 or (self.stop is not None and self.stop <= self.start):
            raise ValueError(f"start must not be negative and stop must come after it, got {self.start} to {self.stop}")
        if self.patient_frame is not None and self.patient_xz_m is None:
            raise ValueError("patient_frame is given without patient_xz_m; give the patient's place as well")
        if self.patient_xz_m is not None and not np.abs(self.patient_xz_m).max() <= FARTHEST_CAMERA_M:
            raise ValueError(f"patient_xz_m is in metres, up to {FARTHEST_CAMERA_M:g}, got {self.patient_xz_m}")
        shortest, tallest = HEIGHTS_M
        if self.height_m is not None and not shortest <= self.height_m <= tallest:
            raise ValueError(f"height_m is in metres, {shortest} to {tallest}, got {self.height_m:g}")

    @property
    def motion_file(self) -> Path:
        """Return the file of reference movements."""
        return SHIPPED if self.motions is None else Path(self.motions)
