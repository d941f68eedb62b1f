"""Update the whole pose, instead of separate body parts, by a filter.

The paper names "an EKF, UKF, or particle tracking filter" (Section III). The state is the pose. The measurements are
the places at which the skin points beside the nodes should lie. These places follow from the nodes' matches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.body.belief import PoseBelief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import Constraints, place_constraints, thin
from anchorpose.body.fit import damped_step, hidden_bones, pose_equations, prior_equations, range_information
from anchorpose.body.kinematics import skin
from anchorpose.body.pose import POSE_SIZE
from anchorpose.body.skin_points import Body, PosedPoints, pose_points
from anchorpose.research.experiment.config import Update
from anchorpose.track_tree.global_hypothesis import PAIR_SIGMA_M, GlobalHypothesis, part_motion, skin_places
from anchorpose.tracker.observation import Observation

PAIR_SCALE_M: Final = 3.0 * PAIR_SIGMA_M  # m; a match this far from its skin point has a quarter of its full weight
FAR_M: Final = 1000.0  # m, scale of the robust kernel, so large that every match keeps its full weight
KALMAN_STEPS: Final = 4  # number of Gauss-Newton steps of the iterated extended Kalman filter, which converges in three
PARTICLES: Final = 200  # number of particles, three per parameter of the pose, so that their covariance has full rank
COMPARED: Final = 120  # maximum number of matches with which a particle is compared; this takes 0.1 ms per particle
# minimum share of effective particles in a step of tempering; the effective number is 1 / (sum of squared weights)
EFFECTIVE: Final = 0.5
SPREAD: Final = 0.3  # random shift of each resampled particle, in standard deviations of all particles


def match_rows(
    body: Body,
    now: PosedPoints,
    hypothesis: GlobalHypothesis,
    window: Sequence[Observation],
    predicted: PoseBelief,
    robust: bool,
) -> Constraints:
    """Return the constraints (rows of a least-squares system) that pull the skin point beside each node to the place of
    the node's match.

    The match is shifted along the skin by the offset of the skin point from the node (``skin_places``).

    robust: whether a match far from the skin point has less weight than a near match. window: observations of this and
    later frames.
    """
    T_next_now = part_motion(now.transforms, body.transforms(predicted.pose))
    places = skin_places(now, hypothesis, window, T_next_now)
    found = np.isfinite(places).all(axis=1)
    scale_m = PAIR_SCALE_M if robust else FAR_M
    return place_constraints(hypothesis.point[found], places[found], PAIR_SIGMA_M, scale_m)


def update_by_rows(
    update: Update, body: Body, rows: Constraints, predicted: PoseBelief, config: RegistrationConfig, seed: int
) -> PoseBelief:
    """Return the pose and its uncertainty after the filter's update by the constraints ``rows``; without constraints,
    return the prediction.

    seed: seed of the random particles.
    """
    if not len(rows):
        return predicted
    if update is Update.KALMAN:
        return kalman_update(body, rows, predicted, config)
    return particle_update(body, rows, predicted, config, seed)


def kalman_update(body: Body, rows: Constraints, predicted: PoseBelief, config: RegistrationConfig) -> PoseBelief:
    """Return the pose and its uncertainty after the update of an iterated extended Kalman filter by the constraints
    ``rows``.
    """
    expected, pose = (predicted.pose, predicted.information), predicted.pose
    for _ in range(KALMAN_STEPS):
        pose = damped_step(body, pose, rows, expected, config.rows_per_observation)
    posed = pose_points(body, pose)
    hidden = hidden_bones(body.points, rows, config.rows_per_observation)
    prior = prior_equations(body.points, pose, expected, hidden)
    hessian = pose_equations(body, pose, posed, rows, prior, config.rows_per_observation).hessian
    return PoseBelief(pose, np.linalg.inv(hessian), hessian - range_information(body.points, pose, hidden))


def particle_update(
    body: Body, rows: Constraints, predicted: PoseBelief, config: RegistrationConfig, seed: int
) -> PoseBelief:
    """Return the mean and covariance of particles (poses) that are drawn from the prediction and weighted by their
    likelihood, which follows from the constraints ``rows``.

    The pose has sixty-six parameters, so a single particle would get all the weight if the likelihood were applied at
    once. Therefore the likelihood is tempered (Neal 2001, doi:10.1023/A:1008923215028): each step raises it to a power
    so small that at least half of the particles stay effective; the powers of all steps sum to 1. After each step,
    particles are drawn again in a way that keeps their mean and covariance (Liu and West 2001).
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(19,)))
    states = rng.standard_normal((PARTICLES, POSE_SIZE)) @ np.linalg.cholesky(predicted.covariance).T
    compared, left = _some_matches(rows), 1.0
    per_row = len(rows) / (len(compared) * config.rows_per_observation)
    while left > 0.0:
        log_weight = -0.5 * per_row * np.array([_cost(body, predicted, state, compared) for state in states])
        share = _tempered(log_weight, left)
        states, left = _drawn_again(states, _weights(share * log_weight), rng), left - share
    covariance = np.cov(states.T)
    mean = predicted.pose.moved(states.mean(axis=0), body.points.moving)
    return PoseBelief(mean, covariance, np.linalg.inv(covariance))


def _some_matches(rows: Constraints) -> Constraints:
    """Return the rows of at most ``COMPARED`` matches; a match has three rows, one per axis."""
    match = 3 * thin(len(rows) // 3, COMPARED)[:, None] + np.arange(3)
    chosen = np.zeros(len(rows), bool)
    chosen[match.ravel()] = True
    return rows.where(chosen)


def _cost(body: Body, predicted: PoseBelief, change: np.ndarray, rows: Constraints) -> float:
    """Return the sum, over all rows, of Geman-McClure's kernel applied to the row's deviation in the pose moved by
    ``change``.
    """
    points, of = body.points, rows.point[::3]
    transforms = body.transforms(predicted.pose.moved(change, points.moving))
    placed = skin(points.bones[of], points.influence[of], transforms, body.rest_m[of], body.rest_normals[of])[0]
    scaled = ((placed - rows.target_m[::3]).ravel() / rows.scale_m) ** 2
    return float(((rows.scale_m / rows.sigma_m) ** 2 * scaled / (1.0 + scaled)).sum())


def _weights(log_weight: np.ndarray) -> np.ndarray:
    weight: np.ndarray = np.exp(log_weight - log_weight.max())
    return weight / weight.sum()


def _tempered(log_weight: np.ndarray, left: float) -> float:
    """Return the largest power of the likelihood at which at least the share ``EFFECTIVE`` of the particles stays
    effective.

    left: the power that earlier steps have not yet applied; the result is at most this power.
    """

    def effective(share: float) -> float:
        return 1.0 / float((_weights(share * log_weight) ** 2).sum())

    least, low, high = EFFECTIVE * len(log_weight), 0.0, left
    if effective(left) >= least:
        return left
    for _ in range(30):
        middle = (low + high) / 2.0
        low, high = (middle, high) if effective(middle) >= least else (low, middle)
    return high


def _drawn_again(states: np.ndarray, weight: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw particles with equal weights, with the same mean and covariance as the given weighted particles."""
    mean, covariance = weight @ states, np.cov(states.T, aweights=weight)
    place = (rng.random() + np.arange(len(states))) / len(states)
    kept = states[np.minimum(np.searchsorted(np.cumsum(weight), place), len(states) - 1)]
    jitter = rng.multivariate_normal(np.zeros(len(mean)), covariance, len(states), method="eigh")
    return np.asarray(mean + np.sqrt(1.0 - SPREAD**2) * (kept - mean) + SPREAD * jitter)
