"""Fit taller and shorter bodies to the frames from which the body was learnt, and include them in the belief in the
shape (its estimate and uncertainty).

Learning takes Gauss-Newton steps, which end in the local minimum of the fitting cost that is nearest to their start.
The covariance at this minimum does not include other minima, such as bodies of another stature. If the feet are cut off
or inside wide trousers, as they often are, bodies 10 % taller or shorter explain the images equally well.
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
from anchorpose.recording.recording import Subject
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.prior_shape import TRIED_SIGMA_M, shape_cost

# factors on the learnt stature; learning starts again from each of these statures. The factors allow for an error of 8
# to 9 %: one person's learnt statures differed by up to 9 % between twelve sequences of MSR Action3D
OTHERS: Final = (0.92, 1.0 / 0.92)


class PosedFrame(NamedTuple):
    """A frame with the pose that was tracked in it."""

    pose: Pose
    evidence: Evidence


def frames_nats(shape: FittedShape, frames: Sequence[PosedFrame], config: TrackConfig) -> float:
    """Return the mean log probability, in nats, of some frames, given a body of this shape that is registered to each
    frame.

    The log probabilities are averaged, not summed, since errors of the shape affect all frames alike.
    """
    body, nats = build_body(body_points(), shape), list[float]()
    for pose, evidence in frames:
        pose = descend(body, pose, vague_belief(pose), evidence, config.registration)
        nats.append(log_probability(body, pose, evidence))
    return float(np.mean(nats))


def with_other_statures(
    learnt: ShapeBelief, known: ShapeBelief, frames: Sequence[PosedFrame], subject: Subject, config: TrackConfig
) -> ShapeBelief:
    """Return the belief with the same shape, and with a covariance that includes bodies of other statures.

    Each other stature is weighted by its odds against the learnt stature. The log odds are the difference of two sums,
    for the shape of this stature and for the learnt shape. Each sum adds the log probability of the shape to the mean
    log probability of the frames. ``believed`` reduces the log odds, since clothes cause errors of both sums. known:
    the belief in the shape before any frame was used; subject: the user's statements about the patient. Half as many
    frames are used as for learning: the frames whose poses differ most.
    """
    chosen = most_different(body_points(), [frame.pose for frame in frames], config.learning.frame_count // 2)
    some = [frames[number] for number in chosen]
    shapes = [learnt.shape, *(_learnt_at(factor, learnt.shape, known, some, config) for factor in OTHERS)]
    nats = [frames_nats(shape, some, config) - 0.5 * shape_cost(shape, subject, config) for shape in shapes]
    odds = np.exp([believed(one - nats[0], PARTS, OWN_BODY_ERROR) for one in nats])
    return learnt.including(shapes[1:], (odds / odds.sum())[1:])


def _learnt_at(
    factor: float, shape: FittedShape, known: ShapeBelief, frames: Sequence[PosedFrame], config: TrackConfig
) -> FittedShape:
    """Return the shape that is learnt from some frames if learning begins at another stature: ``factor`` times that of
    ``shape``.
    """
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
