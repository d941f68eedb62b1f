"""Compute what an inertial sensor on a segment of the body would measure, from the tracked joints."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.agreement.clock import GRID_HZ, Signals, on_grid
from anchorpose.agreement.placement import segment_axes
from anchorpose.joints import JOINT_INDEX
from anchorpose.results.tables import JointTable
from anchorpose.rotations import UP

SEGMENTS: Final = {
    "pelvis": ("SpineBase", "SpineBase"),
    "trunk": ("SpineMid", "SpineShoulder"),
    **{
        f"{segment}_{side.lower()}": (f"{upper}{side}", f"{lower}{side}")
        for segment, upper, lower in (
            ("upper_arm", "Shoulder", "Elbow"),
            ("forearm", "Elbow", "Wrist"),
            ("thigh", "Hip", "Knee"),
            ("shank", "Knee", "Ankle"),
            ("foot", "Ankle", "Foot"),
        )
        for side in ("Left", "Right")
    },
}
"""Upper and lower joint of each segment. The sensor is assumed to be midway between these joints; the segment's axes
are the axes of the lower joint.
"""

DIRECTION_ERROR_RAD: Final = 0.07
"""Standard deviation in rad of the error of a segment's tracked direction (four degrees). In twelve real recordings,
the thigh's direction had an error of 2.7 degrees in the median recording, and of 4.8 in the worst.
"""

GRAVITY_M_S2: Final = 9.81

SMOOTHING_S: Final = 0.1
"""Standard deviation in s of the kernel that smooths both joints and sensor signals. Tracked joints jitter by some
millimetres between frames. In the second derivative, this jitter would be some metres per second squared; after
smoothing, it is 0.1 m/s2.
"""


def specific_force(joints: JointTable, segment: str) -> Signals:
    """Return the specific force in m/s2 along the segment's axes: acceleration less gravity, as an accelerometer on the
    segment measures it.

    The values (g, 3) of the returned signal are NaN at times at which joints are missing. At rest the force points
    upwards with the size of gravity.
    """
    time_s, middle_m, axes = _motion(joints, segment)
    acceleration = _derivative(_derivative(middle_m)) + GRAVITY_M_S2 * UP
    return Signals(time_s, np.einsum("gij,gi->gj", axes, acceleration))


def angular_velocity(joints: JointTable, segment: str) -> Signals:
    """Return the angular velocity in rad/s about the segment's axes, as a gyroscope on the segment measures it. The
    values (g, 3) of the returned signal are NaN at times at which joints are missing.
    """
    time_s, _, axes = _motion(joints, segment)
    rate = np.einsum("gij,gik->gjk", axes, _derivative(axes.reshape(-1, 9)).reshape(-1, 3, 3))
    return Signals(time_s, np.stack([rate[:, 2, 1], rate[:, 0, 2], rate[:, 1, 0]], axis=1))


def one_way_sigma_s(joints: JointTable, segment: str, from_s: float, to_s: float) -> float:
    """Return the standard deviation in s of the error that a wrong direction of the segment causes in a clock offset,
    if the offset is found from the movement between ``from_s`` and ``to_s``.

    If a segment is tracked too far forward, its movement forward seems early and its movement back seems late. In a
    movement forward and back, these two errors of the offset cancel. They remain only if the last posture differs from
    the first, for example after sitting down. The result is NaN if the segment's direction is unknown.
    """
    time_s, _, axes = _motion(joints, segment)
    along = axes[(time_s >= from_s) & (time_s <= to_s)][:, :, 1]
    along = along[np.isfinite(along).all(axis=1)]
    if len(along) < 2:
        return float("nan")
    speed = _derivative(along)
    return float(DIRECTION_ERROR_RAD * np.linalg.norm(along[-1] - along[0]) * GRID_HZ / (speed**2).sum())


def _motion(joints: JointTable, segment: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the times (g,) of an even grid, and at these times the smoothed midpoint (g, 3) in metres and the axes (g,
    3, 3) of a segment.
    """
    upper, lower = (JOINT_INDEX[name] for name in SEGMENTS[segment])
    middle_m = joints.position_m[:, [upper, lower]].mean(axis=1)
    axes = segment_axes(joints.position_m)[:, lower]
    smooth = on_grid(joints.time_s, np.concatenate([middle_m, axes.reshape(-1, 9)], axis=1), SMOOTHING_S)
    return smooth.time_s, smooth.values[:, :3], smooth.values[:, 3:].reshape(-1, 3, 3)


def _derivative(values: np.ndarray) -> np.ndarray:
    """Return the derivative per second (g, k) of values (g, k) at the times of the grid."""
    return np.asarray(np.gradient(values, 1.0 / GRID_HZ, axis=0))
