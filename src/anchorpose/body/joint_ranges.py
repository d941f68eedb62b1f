"""Describe how joints bend in people: the range of each joint, and how the joints of arms and legs bend together.

If only the range of each joint were known, a hidden leg of a seated person would be estimated to hang straight. But the
joints of one limb bend together, and so do the joints of the left and right limbs. These correlations were measured in
motion capture of rehabilitation exercises (``tools/measure_limb_turns.py``). The correlations serve to predict the
rotations of hidden parts of limbs, and to decide which of two poses is likelier. The correlations do not affect visible
parts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, lru_cache
from importlib import resources
from typing import Final, NamedTuple

import numpy as np

from anchorpose.body.asset import BodyAsset
from anchorpose.body.pose import DEGREE, MOVING_BONES, POSE_SIZE, Pose, moving_bones


class JointRange(NamedTuple):
    """Distribution of bone rotations in people: a single Gaussian on the rotation vectors of all moving bones, and
    limits to the bending of elbows, knees and hips.
    """

    mean: np.ndarray  # (m, 3) rad, mean rotation vector of each moving bone
    information: np.ndarray  # (m, 3, m, 3) inverse of the covariance, 0 for the root
    hinge: np.ndarray  # (m, 3) unit axis about which an elbow, knee or hip bends; 0 for other bones
    hinge_limit: np.ndarray  # (m,) rad, minimum rotation about the axis ``hinge``


# Standard deviations in degrees of each bone's turns about the rest pose's axes X (abduction), Y (twist) and Z
# (flexion): about half of the passive ranges of motion in the textbooks. These standard deviations are large, since
# they should decide only about turns that depth images leave open.
_SPREAD_DEG: Final = {
    "LowerBack": (8, 8, 14),
    "Spine": (8, 8, 10),
    "Spine1": (7, 8, 8),
    "Neck": (8, 12, 10),
    "Neck1": (8, 14, 10),
    "Head": (8, 14, 10),
    "Shoulder": (8, 8, 8),
    "Arm": (45, 40, 45),
    "Hand": (14, 14, 14),
    "UpLeg": (16, 16, 35),
    "Foot": (9, 9, 14),
}
_SPINE: Final = ("LowerBack", "Spine", "Spine1")
# standard deviations in degrees of turns about three axes: the hinge axis, the axis perpendicular to hinge and bone,
# and the bone's own axis
_HINGE_SPREAD_DEG: Final = {"ForeArm": (45, 9, 25), "Leg": (40, 5, 8)}

# rad, maximum extension of a hip: mean of 9.4 degrees plus 3 standard deviations (Roaas and Andersson 1982)
HIP_EXTENSION: Final = 25.0 * DEGREE
# minimum part of each turn's variance that is independent of all other turns, as a share of the turn's variance by the
# textbooks; with this part, a pose with only one leg raised stays probable
OWN_VARIANCE: Final = 0.5
# rad, flexion of a knee below which a pose is less probable. Knees stop when the leg is straight; the angle at which
# they stop has a standard deviation of 3 degrees among people (Roaas and Andersson 1982). The cost of a knee's angle is
# -2 log of the share of people whose knees extend so far; this cost is nearly a parabola that begins at a flexion of
# one standard deviation
KNEE_STOP: Final = 3.0 * DEGREE
SEEN_SPREAD: Final = 35.0 * DEGREE
"""Limit (rad) up to which the standard deviations of a visible bone's turns are widened: the textbooks' values are
doubled, but not beyond this limit; larger values stay as they are. The values are doubled since a person may hold a
limb to one side for minutes.

The doubling widens the ranges of turns about a limb's own axis, of abduction and of turns of the feet: with the
textbooks' ranges, hips and toes were displaced in every frame. Flexions have wide ranges already; still wider ranges
increased the error of seated people's thighs in real depth images (UTD-MHAD) by 2 degrees."""


class LimbTurns(NamedTuple):
    """Statistics, measured by motion capture, of k rotations of arms and legs: the turns that ``captured_turns``
    selects.
    """

    mean: np.ndarray  # (k,) rad, mean of each turn
    covariance: np.ndarray  # (k, k) covariance of the turns


@cache
def limb_turns() -> LimbTurns:
    """Return the statistics of limb turns in motion capture, which ship with the package."""
    with (
        resources.files("anchorpose.body").joinpath("data/limb_turns.npz").open("rb") as stream,
        np.load(stream) as stored,
    ):
        return LimbTurns(stored["mean"].astype(np.float64), stored["covariance"].astype(np.float64))


def captured_turns() -> np.ndarray:
    """Return the matrix (k, 3 m) that maps the rotation vectors of the m moving bones to the k turns that motion
    capture measured, left side first.

    The k turns that motion capture measured are all turns of the arms, and the flexions of hips and knees. The joints
    that motion capture measured do not show how a thigh turns about its long axis or in which direction a foot points.
    Motion capture measured no joint of the lower back, so the flexion of a hip is measured from the whole trunk to the
    thigh.
    """
    shown = []
    for side in ("Left", "Right"):
        for bone, axes in (("Arm", range(3)), ("ForeArm", range(3)), ("UpLeg", (2,)), ("Leg", (2,))):
            for axis in axes:
                row = np.zeros((len(MOVING_BONES), 3))
                row[MOVING_BONES.index(f"{side}{bone}"), axis] = 1.0
                if bone == "UpLeg":
                    row[[MOVING_BONES.index(spine) for spine in _SPINE], axis] = -1.0
                shown.append(row.ravel())
    return np.array(shown)


def _limb(name: str) -> str:
    return name.removeprefix("Left").removeprefix("Right")


def hinge_axes(asset: BodyAsset, name: str) -> tuple[np.ndarray, float]:
    """Return three axes as rows (3, 3): the hinge axis (a positive turn bends the limb), the axis perpendicular to
    hinge and bone, and the axis along the bone. Also return the angle by which the joint is bent in the rest pose,
    radians.
    """
    bone = asset.bone(name)
    parent, child = asset.bone_parents[bone], bone + 1
    upper = asset.bone_heads[bone] - asset.bone_heads[parent]
    lower = asset.bone_heads[child] - asset.bone_heads[bone]
    upper, lower = upper / np.linalg.norm(upper), lower / np.linalg.norm(lower)
    bend = float(np.arccos(np.clip(upper @ lower, -1.0, 1.0)))
    axis = np.array([0.0, 0.0, -1.0]) if _limb(name) == "Leg" else np.cross(upper, lower)
    axis -= (axis @ lower) * lower
    axis /= np.linalg.norm(axis)
    return np.stack([axis, np.cross(lower, axis), lower]), bend


@lru_cache(maxsize=512)
def joint_range(asset: BodyAsset, hidden: tuple[int, ...] | None = None) -> JointRange:
    """Return the distribution of joint rotations (``JointRange``) of the asset's skeleton; the root (pelvis) may turn
    freely.

    hidden: indices of the hidden bones in ``MOVING_BONES``. The turns of hidden bones are predicted from the turns of
    visible bones, by the statistics of motion capture. The turns of visible bones have the textbooks' standard
    deviations about the rest pose, doubled, but at most to ``SEEN_SPREAD`` (larger values stay as they are). If
    ``hidden`` is None, all bones follow the statistics of motion capture.
    """
    captured = _as_captured(asset)
    if hidden is None:
        return captured
    size = 3 * len(MOVING_BONES)
    statistics, mean = captured.information.reshape(size, size), captured.mean.ravel()
    u = np.array([3 * row + axis for row in hidden for axis in range(3)], dtype=int)
    s = np.setdiff1d(np.arange(3, size), u)
    information, pull = np.zeros((size, size)), np.zeros(size)
    information[np.ix_(s, s)] = np.linalg.inv(_where_seen(asset)[np.ix_(s, s)])
    if len(u):
        given = statistics[np.ix_(u, s)]
        gain = np.linalg.solve(statistics[np.ix_(u, u)], given)
        information[np.ix_(s, s)] += given.T @ gain
        information[np.ix_(u, s)], information[np.ix_(s, u)] = given, given.T
        information[np.ix_(u, u)] = statistics[np.ix_(u, u)]
        pull[u] = statistics[np.ix_(u, u)] @ mean[u] + given @ mean[s]
        pull[s] = gain.T @ pull[u]
    expected = np.zeros(size)
    expected[3:] = np.linalg.solve(information[3:, 3:], pull[3:])
    shape = captured.information.shape
    return captured._replace(mean=expected.reshape(captured.mean.shape), information=information.reshape(shape))


class _Textbook(NamedTuple):
    """Joint ranges that follow from textbooks alone; fields without a comment are described in ``JointRange``."""

    # (3 m, 3 m) covariance of the bones' turns if bones turn independently of each other; 0 for the root
    covariance: np.ndarray
    hinge: np.ndarray
    hinge_limit: np.ndarray


@cache
def _textbook(asset: BodyAsset) -> _Textbook:
    count = len(MOVING_BONES)
    covariance, hinge, limit = np.zeros((3 * count, 3 * count)), np.zeros((count, 3)), np.zeros(count)
    for row, name in enumerate(MOVING_BONES):
        limb, own = _limb(name), slice(3 * row, 3 * row + 3)
        if limb in _HINGE_SPREAD_DEG:
            axes, bend = hinge_axes(asset, name)
            covariance[own, own] = axes.T @ np.diag((np.array(_HINGE_SPREAD_DEG[limb]) * DEGREE) ** 2) @ axes
            hinge[row] = axes[0]
            limit[row] = KNEE_STOP - bend if limb == "Leg" else -bend  # elbows and knees are bent in the rest pose
        elif limb in _SPREAD_DEG:
            covariance[own, own] = np.diag((np.array(_SPREAD_DEG[limb]) * DEGREE) ** 2)
            if limb == "UpLeg":
                hinge[row, 2], limit[row] = 1.0, -HIP_EXTENSION
    return _Textbook(covariance, hinge, limit)


@cache
def _where_seen(asset: BodyAsset) -> np.ndarray:
    """Return the covariance (3 m, 3 m) of the turns of visible bones: the textbooks' covariance with standard
    deviations that are doubled, but at most to ``SEEN_SPREAD`` (larger values stay as they are).
    """
    covariance = _textbook(asset).covariance.copy()
    for row in range(1, len(MOVING_BONES)):
        own = slice(3 * row, 3 * row + 3)
        variance, axes = np.linalg.eigh(covariance[own, own])
        sigma = np.sqrt(variance)
        covariance[own, own] = axes @ np.diag(np.maximum(sigma, np.minimum(2.0 * sigma, SEEN_SPREAD)) ** 2) @ axes.T
    return covariance


@cache
def _as_captured(asset: BodyAsset) -> JointRange:
    """Return the distribution of all bones' rotations. The turns that motion capture measured (``captured_turns``) have
    its means and correlations, and variances of at least the textbooks'; all other turns have the textbooks' ranges.

    Motion capture does not show how hips and spine share the flexion between trunk and thighs. By the textbooks'
    ranges, the spine contributes a quarter of this flexion. The spine may also bend more and both hips less, or vice
    versa; for each bone of the spine, this exchange has the variance of the bone's flexion by the textbooks. (When
    people sit down, the spine contributes a third of this flexion, Schoberth 1962.)
    """
    count, shown, turns = len(MOVING_BONES), captured_turns(), limb_turns()
    ranges, hinge, limit = _textbook(asset)
    expected = shown @ ranges @ shown.T
    gain = np.linalg.solve(expected, shown @ ranges).T
    covariance = ranges + gain @ (_of_people(expected, turns) - expected) @ gain.T
    for spine in _SPINE:  # add the variance of poses in which the spine bends more and both hips less, or vice versa
        slump = np.zeros((count, 3))
        slump[[MOVING_BONES.index(bone) for bone in (spine, "LeftUpLeg", "RightUpLeg")], 2] = 1.0
        flexion = 3 * MOVING_BONES.index(spine) + 2
        covariance += ranges[flexion, flexion] * np.outer(slump, slump)
    information = np.zeros_like(ranges)
    information[3:, 3:] = np.linalg.inv(covariance[3:, 3:])
    return JointRange((gain @ turns.mean).reshape(count, 3), information.reshape(count, 3, count, 3), hinge, limit)


def _of_people(expected: np.ndarray, turns: LimbTurns) -> np.ndarray:
    """Return the covariance (k, k), in people, of the turns that motion capture measured (``captured_turns``). This
    covariance is the sum of the covariance by motion capture and an independent variance of each turn, since other
    people move differently from the people in the motion capture. The total variance of a turn is at least its variance
    by the textbooks.

    expected (k, k): covariance of the turns that motion capture measured, but by the joint ranges of the textbooks.
    """
    factor = np.linalg.cholesky(expected)
    captured = np.linalg.solve(factor, np.linalg.solve(factor, turns.covariance).T)
    captured += np.diag(np.maximum(1.0 - np.diag(captured), OWN_VARIANCE))
    return np.asarray(factor @ captured @ factor.T)


def expected_turns(asset: BodyAsset, pose: Pose, rows: Sequence[int]) -> np.ndarray:
    """Return (k, 3) rad: the rotation vectors that are expected of the bones ``rows`` (k indices in ``MOVING_BONES``),
    given the turns of all other bones in the pose, by the statistics of motion capture.
    """
    ranges, size = joint_range(asset), 3 * len(MOVING_BONES)
    information, mean = ranges.information.reshape(size, size), ranges.mean.ravel()
    wanted = np.array([3 * row + axis for row in rows for axis in range(3)])
    others = np.setdiff1d(np.arange(3, size), wanted)
    away = pose.rotation_vectors(moving_bones(asset)).ravel() - mean
    pulled = information[np.ix_(wanted, others)] @ away[others]
    expected = mean[wanted] - np.linalg.solve(information[np.ix_(wanted, wanted)], pulled)
    return np.asarray(expected.reshape(-1, 3))


@cache
def turns_together(asset: BodyAsset) -> np.ndarray:
    """Return the correlation (POSE_SIZE, POSE_SIZE) of the bones' turns in people, in the parameters of ``Pose.moved``;
    the root is independent of all bones.
    """
    free = slice(3, POSE_SIZE - 3)
    covariance = np.linalg.inv(joint_range(asset).information.reshape(POSE_SIZE - 3, POSE_SIZE - 3)[3:, 3:])
    sigma = np.sqrt(np.diag(covariance))
    found = np.eye(POSE_SIZE)
    found[free, free] = covariance / sigma[:, None] / sigma
    return found


RAISED: Final = 30.0 * DEGREE  # rad, elevation of an arm at which the shoulder girdle begins to turn with the arm
# turn of the shoulder girdle, divided by the arm's elevation beyond ``RAISED``; when an arm points up, its girdle has
# turned by 30 degrees (Inman et al. 1944)
RHYTHM: Final = 0.2


def joint_range_at(asset: BodyAsset, pose: Pose, hidden: tuple[int, ...] | None = None) -> JointRange:
    """Return ``joint_range``, but the mean turn of each shoulder girdle grows with the elevation of its arm in the
    pose.

    Each step of the fit treats the shoulder girdle's mean turn as constant, so the mean turn pulls the girdle but not
    the arm. Source: Inman, Saunders and Abbott 1944 (J Bone Joint Surg 26:1).
    """
    ranges = joint_range(asset, hidden)
    mean = ranges.mean.copy()
    for row, girdle, arm, along, way in _girdles(asset):
        up = float(pose.rotations[girdle, 1] @ (pose.rotations[arm] @ along))
        raised = max(0.0, math.acos(min(max(-up, -1.0), 1.0)) - RAISED)
        mean[row, 0] = way * RHYTHM * raised
    return ranges._replace(mean=mean)


@cache
def _girdles(asset: BodyAsset) -> tuple[tuple[int, int, int, np.ndarray, float], ...]:
    """Return five values per side: the girdle's row in ``MOVING_BONES``, the girdle's bone, the arm's bone, the arm's
    direction at rest, and the sign of a turn that raises the girdle.
    """
    found = []
    for side, way in (("Left", 1.0), ("Right", -1.0)):
        girdle, arm, below = (asset.bone(f"{side}{name}") for name in ("Shoulder", "Arm", "ForeArm"))
        along = asset.bone_heads[below] - asset.bone_heads[arm]
        found.append((MOVING_BONES.index(f"{side}Shoulder"), girdle, arm, along / np.linalg.norm(along), way))
    return tuple(found)
