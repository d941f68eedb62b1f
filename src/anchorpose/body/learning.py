"""The patient's own body: shape, bone lengths and clothing learnt from several frames at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from anchorpose.body.evidence import Evidence, evidence_rows
from anchorpose.body.fit import ShapeFrame, ShapePrior, learn_shape_step
from anchorpose.body.pose import Pose
from anchorpose.body.registration import RegistrationConfig
from anchorpose.body.skin_points import FittedShape, SkinPoints, rest_points


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningConfig:
    """How much of the recording the shape is learnt from, and how."""

    window_s: float = 4.0  # a patient moves enough in it to show where the limbs turn
    own_shape: bool = True  # False: nothing is learnt, everybody is the mean adult of the given or seen height
    frame_count: int = 12  # spread over the window; more frames say the same again
    reaches_m: tuple[float, ...] = (0.12, 0.10, 0.10, 0.08, 0.08, 0.06, 0.06, 0.06)
    prior: ShapePrior = field(default_factory=ShapePrior)

    def __post_init__(self) -> None:
        if not self.window_s > 0 or self.frame_count < 1 or not self.reaches_m or min(self.reaches_m) <= 0:
            raise ValueError("window_s, frame_count and reaches_m must be positive")


@dataclass(frozen=True, slots=True, eq=False)
class LearnedBody:
    """The shape and the pose of each frame it was learnt from."""

    shape: FittedShape
    poses: tuple[Pose, ...]


def learn_body(
    points: SkinPoints, shape: FittedShape, poses: Sequence[Pose], evidence: Sequence[Evidence],
    config: LearningConfig, registration: RegistrationConfig,
) -> LearnedBody:  # fmt: skip
    """One shape for all frames, each frame's own pose: alternate correspondences and a joint Gauss-Newton step.

    Raises ValueError when no frame is given.
    """
    if not poses:
        raise ValueError("a body needs at least one frame to be learnt from")
    current = list(poses)
    for reach_m in config.reaches_m:
        rest = rest_points(points, shape)
        frames = [
            ShapeFrame(pose, evidence_rows(points, rest, pose, seen, reach_m, registration.constraints))
            for pose, seen in zip(current, evidence, strict=True)
        ]
        shape, current = learn_shape_step(points, shape, frames, config.prior, registration.fit)
    return LearnedBody(shape, tuple(current))
