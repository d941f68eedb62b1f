"""Joints smoothed over time, with what came before and what came after (Rauch, Tung and Striebel 1965,
doi:10.2514/3.3166)."""

from __future__ import annotations

import numpy as np

FIRST_SPEED_M_S = 1.0  # standard deviation of a joint's velocity before anything is known of it


def smooth_in_time(
    time_s: np.ndarray, joints_m: np.ndarray, sigma_m: np.ndarray, acceleration: float
) -> np.ndarray:  # fmt: skip
    """The most likely course (t, j, 3) of joints seen at joints_m (t, j, 3), (t, j) sigma_m off, whose velocity is a
    random walk: it changes by ``acceleration`` times the square root of the time, m/s.

    Every axis of every joint by itself. time_s (t,): strictly rising or falling.
    """
    steps_s = np.abs(np.diff(time_s))
    mean, spread, ahead_mean, ahead_spread = _forwards(steps_s, joints_m, sigma_m, acceleration)
    smooth = mean[-1]
    course = [smooth[:, 0]]
    for k in range(len(steps_s) - 1, -1, -1):
        gain = np.linalg.solve(ahead_spread[k], _motion(steps_s[k]) @ spread[k]).transpose(0, 2, 1)
        smooth = mean[k] + gain @ (smooth - ahead_mean[k])
        course.append(smooth[:, 0])
    return np.array(course[::-1])


def _forwards(
    steps_s: np.ndarray, joints_m: np.ndarray, sigma_m: np.ndarray, acceleration: float
) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Kalman's filter: position and velocity (j, 2, 3) and their covariance (j, 2, 2) of each frame, and as predicted
    from the frame before, of each but the first."""
    count = joints_m.shape[1]
    mean = np.stack([joints_m[0], np.zeros((count, 3))], axis=1)
    spread = np.zeros((count, 2, 2))
    spread[:, 0, 0], spread[:, 1, 1] = sigma_m[0] ** 2, FIRST_SPEED_M_S**2
    means, spreads, ahead_means, ahead_spreads = [mean], [spread], [], []
    for k, step_s in enumerate(steps_s.tolist(), 1):
        motion = _motion(step_s)
        mean, spread = motion @ mean, motion @ spread @ motion.T + acceleration**2 * _random_walk(step_s)
        ahead_means.append(mean)
        ahead_spreads.append(spread)
        gain = spread[:, :, 0] / (spread[:, 0, 0] + sigma_m[k] ** 2)[:, None]
        mean = mean + gain[:, :, None] * (joints_m[k] - mean[:, 0])[:, None, :]
        spread = spread - gain[:, :, None] * spread[:, None, 0]
        means.append(mean)
        spreads.append(spread)
    return means, spreads, ahead_means, ahead_spreads


def _motion(step_s: float) -> np.ndarray:
    return np.array([[1.0, step_s], [0.0, 1.0]])


def _random_walk(step_s: float) -> np.ndarray:
    """(2, 2) covariance that position and velocity gain in a step, for an acceleration of one."""
    return np.array([[step_s**3 / 3.0, step_s**2 / 2.0], [step_s**2 / 2.0, step_s]])
