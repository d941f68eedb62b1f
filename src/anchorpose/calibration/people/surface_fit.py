"""The pose between two level cameras, refined on the surfaces of people that both see at the same moments.

Point-to-plane least squares with projective association, both ways (Chen and Medioni 1992,
doi:10.1016/0262-8856(92)90066-C).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.calibration.people.common_view import LevelView, points_with_normals
from anchorpose.camera import invert_rigid, transform_points

GATES_M = (
    0.4,
    0.4,
    0.4,
    0.3,
    0.3,
    0.3,
    0.2,
    0.2,
    0.2,
    0.15,
    0.1,
    0.06,
    0.04,
    0.03,
    0.03,
)  # the search is good to 0.3 m
WORST_CONDITION = 1e9  # a turn or shift that nothing tells
SAME_WAY = 0.8  # cosine between the normals of one surface in two cameras
HUBER = 1.5
LEAST_PAIRS = 200
MAD_OF_NORMAL = 0.6745


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceFit:
    """T_first_second (4, 4) between camera frames. residual_m: robust deviation of point to plane; pairs: points used;
    impossible: share of one camera's people that fall beside the people the other sees, the worse of both ways;
    common: share that falls into its picture, likewise; sigma_m, sigma_rad:
    standard errors of the place and the turn, moments taken as independent."""

    T_first_second: np.ndarray
    residual_m: float
    pairs: int
    impossible: float
    common: float
    sigma_m: float
    sigma_rad: float

    @property
    def sentence(self) -> str:
        """The residuals for people."""
        return (
            f"surfaces agree to {1000.0 * self.residual_m:.1f} mm, {100.0 * self.impossible:.0f} % of the people one "
            f"sees fall beside those of the other, ± {1000.0 * self.sigma_m:.1f} mm, "
            f"± {np.degrees(self.sigma_rad):.2f} degrees"
        )


def fit_people(first: LevelView, second: LevelView, T_first_second: np.ndarray) -> SurfaceFit | None:
    """The turn about the vertical and the shift over the floor, from a first guess that is right in all else.

    Moments are pictures at the same place of both views. None where too little is seen by both. Walls are left out:
    along a wall nothing tells a shift, and they would hold the cameras back.
    """
    up, ahead, aside = first.T_level_camera[[1, 0, 2], :3]
    zero = np.zeros(3)
    freedom = np.stack([np.append(up, zero), np.append(zero, ahead), np.append(zero, aside)], axis=1)
    T = T_first_second
    for gate in GATES_M:
        rows = [
            _rows(first, second, T, gate),
            _rows(second, first, invert_rigid(T), gate),
        ]
        jacobian, residual, moment = _joined(rows, T)
        jacobian = jacobian @ freedom
        if len(residual) < LEAST_PAIRS:
            return None
        spread = float(np.median(np.abs(residual))) / MAD_OF_NORMAL + 1e-6
        weight = 1.0 / np.maximum(1.0, np.abs(residual) / (HUBER * spread))
        information = (jacobian * weight[:, None]).T @ jacobian
        if np.linalg.cond(information) > WORST_CONDITION:
            return None
        covariance = np.linalg.inv(information)
        T = _moved(T, -freedom @ (covariance @ (jacobian.T @ (weight * residual))))
    scores = np.zeros((int(moment.max()) + 1, jacobian.shape[1]))
    np.add.at(scores, moment, jacobian * (weight * residual)[:, None])
    spread_of_pose = freedom @ covariance @ (scores.T @ scores) @ covariance @ freedom.T
    there, back = outside_silhouette(first, second, T), outside_silhouette(second, first, invert_rigid(T))
    sigma_rad, sigma_m = (float(np.sqrt(np.trace(spread_of_pose[k : k + 3, k : k + 3]))) for k in (0, 3))
    return SurfaceFit(T, spread, len(residual), max(there[0], back[0]), min(there[1], back[1]), sigma_m, sigma_rad)


def _rows(
    target: LevelView, source: LevelView, T_target_source: np.ndarray, gate_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points of the source in the target's frame, the target's points and normals there (n, 3), and their moments."""
    found = []
    for moment, seen in enumerate(source.seen):
        points = transform_points(T_target_source, seen.points_m[seen.person])
        normals = seen.normals[seen.person] @ T_target_source[:3, :3].T
        column, row, inside = target.camera.pixel_of(points)
        inside &= (column > 2) & (row > 2) & (column < target.camera.width - 3) & (row < target.camera.height - 3)
        points, normals, row, column = points[inside], normals[inside], row[inside], column[inside]
        there, plane, good = points_with_normals(target.camera, target.smooth_m[moment], row, column)
        good &= np.einsum("ij,ij->i", plane, normals) > SAME_WAY
        good &= np.abs(np.einsum("ij,ij->i", plane, points - there)) < gate_m
        good &= np.linalg.norm(points - there, axis=1) < 2.0 * gate_m
        found.append((points[good], there[good], plane[good], np.full(int(good.sum()), moment)))
    points, there, plane, moments = (np.concatenate(part) for part in zip(*found, strict=True))
    return points, there, plane, moments


def _joined(
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]], T_first_second: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Jacobian (n, 6) for a small turn and shift in the first frame, residual (n,), moment (n,), of both directions.

    Rows from the first camera's points are residuals in the second frame, turned into the first; the motion is that of
    the second camera's things, so their sign is the other way round.
    """
    points, there, plane, moments = rows[0]
    forth = np.hstack([np.cross(points, plane), plane]), np.einsum("ij,ij->i", plane, points - there), moments
    points_b, there_b, plane_b, moments_b = rows[1]
    here, seen = transform_points(T_first_second, points_b), transform_points(T_first_second, there_b)
    normal = plane_b @ T_first_second[:3, :3].T
    back = -np.hstack([np.cross(seen, normal), normal]), np.einsum("ij,ij->i", normal, here - seen), moments_b
    jacobian, residual, moment = (np.concatenate(parts) for parts in zip(forth, back, strict=True))
    return jacobian, residual, moment


def _moved(T: np.ndarray, step: np.ndarray) -> np.ndarray:
    import cv2

    motion = np.eye(4)
    motion[:3, :3], _ = cv2.Rodrigues(step[:3])
    motion[:3, 3] = step[3:]
    return np.asarray(motion @ T)


def outside_silhouette(target: LevelView, source: LevelView, T_target_source: np.ndarray) -> tuple[float, float]:
    """Of the source's people: the share that falls where the target has a reading and sees no people, and the share
    that falls into the target's picture at all."""
    outside = readings = inside = total = 0
    for depth, people, seen in zip(target.depths_m, target.people, source.seen, strict=True):
        column, row, within = target.camera.pixel_of(transform_points(T_target_source, seen.points_m[seen.person]))
        row, column = row[within], column[within]
        read = depth[row, column] > 0
        outside += int((read & ~people[row, column]).sum())
        readings += int(read.sum())
        inside += len(row)
        total += len(within)
    return (outside / readings if readings else 1.0), (inside / total if total else 0.0)
