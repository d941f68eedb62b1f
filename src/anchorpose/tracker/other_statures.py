"""Try taller and shorter bodies on the frames from which the body was learnt, and widen the belief in the shape.

Gauss-Newton steps end in the minimum nearest to their start, and the covariance there says nothing of other minima. The
feet are often cut off or inside wide trousers; then bodies 10 % taller or shorter explain the images as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from anchorpose.body.belief import vague_belief
from anchorpose.body.evidence import Evidence
from anchorpose.body.learning import REACHES_M, learn_body, most_different
from anchorpose.body.pose import PARTS, Pose
from anchorpose.body.pose_probability import log_probability
from anchorpose.body.registration import descend
from anchorpose.body.rivals import OWN_BODY_ERROR, believed
from anchorpose.body.shape_prior import ShapeBelief, standing_height
from anchorpose.body.skin_points import FittedShape, body_points, build_body
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.prior_shape import TALLER, TRIED_SIGMA_M

# factors on the learnt stature; both bodies are learnt again from there
OTHERS: Final = (TALLER[1], 1.0 / TALLER[1])


class PosedFrame(NamedTuple):
    """A frame with the pose that was tracked in it."""

    pose: Pose
    evidence: Evidence


def frames_nats(shape: FittedShape, frames: Sequence[PosedFrame], config: TrackConfig) -> float:
    """Return the mean log probability, in nats, of some frames, given a shape that is registered to each.

    It is the mean, not the sum, since errors of the shape affect all frames alike.
    """
    body, nats = build_body(body_points(), shape), list[float]()
    for pose, evidence in frames:
        pose = descend(body, pose, vague_belief(pose), evidence, config.registration)
        nats.append(log_probability(body, pose, evidence))
    return float(np.mean(nats))


def with_other_statures(
    learnt: ShapeBelief, known: ShapeBelief, frames: Sequence[PosedFrame], config: TrackConfig
) -> ShapeBelief:
    """Return the belief with the same shape and a covariance that includes other statures.

    Each other stature counts by its odds: the log probability of its shape and of these frames (the mean over the
    frames) against those of the learnt shape, reduced by ``believed``, since errors of clothes affect both. known: the
    belief before any frame. Half as many frames are used as for learning, those whose poses differ most.
    """
    chosen = most_different(body_points(), [frame.pose for frame in frames], config.learning.frame_count // 2)
    some = [frames[number] for number in chosen]
    shapes = [learnt.shape, *(_learnt_at(factor, learnt.shape, known, some, config) for factor in OTHERS)]
    common = known.common(body_points().asset)
    nats = [frames_nats(shape, some, config) - 0.5 * common.cost(shape) for shape in shapes]
    odds = np.exp([believed(one - nats[0], PARTS, OWN_BODY_ERROR) for one in nats])
    return learnt.including(shapes[1:], (odds / odds.sum())[1:])


def _learnt_at(
    factor: float, shape: FittedShape, known: ShapeBelief, frames: Sequence[PosedFrame], config: TrackConfig
) -> FittedShape:
    """Return the shape that is learnt from some frames if learning begins at another stature."""
    points = body_points()
    asset, count = points.asset, points.asset.common_count
    height_m, _ = standing_height(asset, shape)
    scaled = replace(known, shape=shape).common(asset).standing(asset, factor * height_m, TRIED_SIGMA_M).shape
    coefficients = np.append(scaled.coefficients[:count], shape.coefficients[count:])
    return learn_body(
        points,
        replace(shape, coefficients=coefficients),
        [frame.pose for frame in frames],
        [frame.evidence for frame in frames],
        known,
        config.registration,
        REACHES_M,
    ).belief.shape
