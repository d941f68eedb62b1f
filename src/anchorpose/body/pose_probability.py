"""Compute the probability of a pose, given a frame and prior knowledge of bodies. The probabilities serve to decide
between poses.

Depth readings show where skin is; the learnt descriptor predicts which place on the body each pixel shows. Depth
readings alone are not enough: a body that faces the wrong way, or two legs on the pixels of one leg, cover as much
surface as the correct pose. The descriptor's errors affect whole limbs at a time. So the descriptor's predictions on a
large patch of skin count as only one observation, and depth readings can overrule the descriptor.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np

from anchorpose.body.constraints import Constraints
from anchorpose.body.evidence import Evidence, separation_rows, standing_rows
from anchorpose.body.explanation import segment_of_points
from anchorpose.body.fit import prior_equations
from anchorpose.body.likelihood import ALIKE_M, SKIN_SIGMA_M, likelihood, render_skin
from anchorpose.body.pose import PARTS, Pose
from anchorpose.body.skin_points import Body, PosedPoints, SkinPoints, pose_points
from anchorpose.camera import Camera
from anchorpose.descriptor.learnt import described, nearest_rays
from anchorpose.isolation.view import View

SPACING_M: Final = 0.028  # m, spacing of skin points
# m, width on the body of the pixels at which the descriptor's predictions are used; the descriptor's grid has this
# spacing at a distance of 2 to 4 m
NAMED_FOOTPRINT_M: Final = 0.04
# m, side of a square patch of skin; the descriptor's errors at all points of a patch count as one error. The side of
# this patch of skin is the integral of the correlation between the descriptor's errors at two points over the distance
# between these points
NAMED_ALIKE_M: Final = 0.25
# share of predicted places with an error above three standard deviations, in simulated images and in real images of the
# data set UTD-MHAD
WRONGLY_NAMED: Final = 0.03
FROM_BEFORE: Final = 20.0
"""Assumed ratio of how often a single camera stands in front of the patient to how often it stands behind the patient.

docs/guide/cameras.md asks users to place a single camera in front, and the subjects of UTD-MHAD and MSR Action3D face
their cameras. The ratio is not measured; it matters only if the images do not show which way the patient faces."""

# an adult's skin area, in units of the squared stature: 1.8 m2 at 1.7 m (Du Bois and Du Bois 1916)
SKIN_AREA: Final = 0.6


def log_probability(body: Body, pose: Pose, evidence: Evidence) -> float:
    """Return the log probability, in nats, of a pose, given the depth readings, the descriptor's predictions and prior
    knowledge of bodies.

    The prior knowledge is that joints bend as in people, that limbs do not intersect, and that feet stand on the floor.
    """
    posed = pose_points(body, pose)
    known = prior_equations(body.points, pose, None).cost
    known += _cost(separation_rows(body, posed), posed) * (SPACING_M / ALIKE_M) ** 2
    if evidence.floor_m is not None:
        known += _cost(standing_rows(body, posed, evidence.floor_m, 1.0), posed)
    readings = likelihood(body, pose, evidence).total
    return readings + float(named_nats(body, pose, evidence).sum()) - 0.5 * known


def facing_nats(body: Body, pose: Pose, cameras: Sequence[Camera]) -> float:
    """Return the prior log probability, in nats, that the body faces this way relative to a single camera; 0 with
    several cameras. This prior is not part of ``log_probability``: differences of ``log_probability`` between poses are
    reduced because of errors of shape and clothes (``believed``), and these errors do not affect the prior.
    """
    if len(cameras) != 1:
        return 0.0
    transforms = body.transforms(pose)[body.points.asset.bone("Spine1")]
    forward, away = transforms[[0, 2], 0], cameras[0].position_m[[0, 2]] - pose.root_m[[0, 2]]
    length = float(np.linalg.norm(forward) * np.linalg.norm(away))
    return 0.5 * float(np.log(FROM_BEFORE)) * float(forward @ away) / length if length > 0.0 else 0.0


def _cost(rows: Constraints, posed: PosedPoints) -> float:
    """Return the sum over all rows of the squared deviation (residual divided by sigma), limited by the row's robust
    kernel.
    """
    scaled = (rows.residuals(posed) / rows.scale_m) ** 2
    return float(((rows.scale_m / rows.sigma_m) ** 2 * scaled / (1.0 + scaled)).sum())


def named_nats(body: Body, pose: Pose, evidence: Evidence) -> np.ndarray:
    """Return (PARTS, 2) nats, arranged as in ``Likelihood``: for each part of a limb, the log likelihood ratio of the
    places that the descriptor predicts at the part's pixels. The ratio compares two assumptions: the pixels show the
    skin that the pose puts there, or they show an unknown place on the skin. Only readings with the person's label near
    the posed skin are used.
    """
    skin_m, nats = pose_points(body, pose).points_m, np.zeros(2 * PARTS)
    for view, camera in zip(evidence.views, evidence.cameras, strict=True):
        if view is not None:
            nats += _named_by(body.points, skin_m, view, camera, evidence.label)
    return nats.reshape(PARTS, 2)


def _named_by(points: SkinPoints, skin_m: np.ndarray, view: View, camera: Camera, label: int) -> np.ndarray:
    """Return ``named_nats`` (2 PARTS,) computed from the image of one camera alone."""
    skin = render_skin(points, skin_m, camera, NAMED_FOOTPRINT_M)
    if skin is None:
        return np.zeros(2 * PARTS)
    every = (slice(None, None, skin.step), slice(None, None, skin.step))
    row, column, inside = (values[every] for values in nearest_rays(camera))
    shown = inside & (skin.point >= 0) & (view.labels[every] == label)
    shown &= np.abs(view.depth_m[every] - skin.depth_m) < 3.0 * SKIN_SIGMA_M
    said = described(view.depth_m, camera)
    place, error = said.place[row[shown], column[shown]], said.error[row[shown], column[shown]]
    named = np.isfinite(error)
    # variance of a predicted place along each of two axes in the plane of the skin; ``error`` is the place's mean error
    point, variance = skin.point[shown][named], 2.0 / np.pi * error[named].astype(np.float64) ** 2
    away2 = ((place[named] - places(points)[point]) ** 2).sum(axis=1)
    right = SKIN_AREA / (2.0 * np.pi * variance) * np.exp(-0.5 * away2 / variance)
    nats = np.log((1.0 - WRONGLY_NAMED) * right + WRONGLY_NAMED)
    share = skin.patches * (ALIKE_M / NAMED_ALIKE_M) ** 2
    return np.bincount(segment_of_points(points)[point], nats, 2 * PARTS) * share


@cache
def places(points: SkinPoints) -> np.ndarray:
    """Return the place (p, 3) of each skin point on the standing mean adult, in units of this adult's height: X
    forward, Y up from the floor, Z right, as in ``Described.place``.
    """
    skin = points.asset.vertices
    return np.asarray((skin[points.vertex] - [0.0, skin[:, 1].min(), 0.0]) / np.ptp(skin[:, 1]))
