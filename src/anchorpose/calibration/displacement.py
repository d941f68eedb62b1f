"""Find how far two cameras' poses displace the surfaces that both cameras see.

Room and people are used together: floor and walls determine tilt and height, people determine the shift along floor and
walls. Room and people each have half of the weight, so that a large room does not decide alone: a wrong focal length
displaces the far ends of the room, but not the people. Whether both cameras show the same surfaces is decided by the
people alone, since floor and walls also coincide if a pose is shifted along them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from anchorpose.calibration.common_view import (
    LevelView,
    huber_weights,
    level_view,
    moved_by,
    paired_rows,
    shown_by_both,
)
from anchorpose.calibration.first_frames import level_of_pose
from anchorpose.camera import Camera, invert_rigid, transform_points

# m, maximum distance of paired points in each iteration; it stays at 10 cm in the last iterations, since wrong
# intrinsics leave paired points 5 cm apart
DISPLACEMENT_GATES_M: Final = (*[0.4] * 4, *[0.3] * 3, *[0.2] * 3, *[0.15] * 2, *[0.1] * 3)
ROOM_PX, PEOPLE_PX = 6, 3  # pixels, grid steps: every sixth pixel for the room, every third pixel for people
LEAST_SURFACE_PAIRS: Final = 500
# minimum result of ``_support``, which measures how well the data determine a shift, for a displacement to be stated.
# If ``_support`` returned less, correct poses seemed to displace surfaces by 26 and 32 mm; if it returned more, by at
# most 9 mm. Without people in view, ``_support`` often returns 0.001.
LEAST_SUPPORT: Final = 0.02
# m, rad: prior sigmas of an iteration's change of pose; they damp changes that the data do not determine
STEP_M, STEP_RAD = 0.1, 0.2
# m, maximum distance between two cameras' points that count as on one surface, when the misfits of the fitted and of
# the given pose are computed
COMPARED_M: Final = 0.15
# maximum misfit of the fitted pose, divided by the misfit of the given pose, for the fitted pose to count. A fitted
# pose that only slides surfaces along themselves has the same misfit as the given pose, so it does not count
BETTER: Final = 0.8
# m, maximum residual of the fit for its rotation to be stated; correct poses leave up to 6 mm, intrinsics that are
# wrong by 2 % leave 15 to 25 mm
TIGHT_M: Final = 0.010


@dataclass(frozen=True, slots=True)
class Displacement:
    """How far two cameras' poses displace common surfaces. off_m: distance by which the fitted pose moves the people
    or, without people, the room. If the fitted pose is not better than the given poses, off_m is the median distance
    between the two cameras' surfaces at the given poses. turn_rad: rotation from the given to the fitted pose, None if
    the fitted pose is not better or the surfaces do not fit closely enough.
    """

    off_m: float
    turn_rad: float | None


def common_surfaces(
    camera: Camera, room_m: np.ndarray, background_m: np.ndarray | None, depths_m: Sequence[np.ndarray]
) -> LevelView:
    """Prepare the view of a camera with a pose: the first frame of the view has the surfaces of the room, and each
    further frame has the people in one of the depth images.

    room_m, depths_m: (height, width) float32, 0 = no reading; background_m: depth image of the empty room, None without
    such an image.
    """
    level = level_of_pose(camera.require_pose())
    room = level_view(camera, level, np.full_like(room_m, np.inf), [room_m], ROOM_PX)
    people = level_view(camera, level, room_m if background_m is None else background_m, depths_m, PEOPLE_PX)
    return replace(
        room,
        depths_m=(*room.depths_m, *people.depths_m),
        smooth_m=(*room.smooth_m, *people.smooth_m),
        people=(*room.people, *people.people),
        seen=(*room.seen, *people.seen),
    )


def find_displacement(first: LevelView, second: LevelView) -> Displacement | None:
    """Find how far two cameras' poses displace common surfaces; None if the surfaces do not determine this distance, or
    if, at the given pose as well as at the fitted pose, at least half of the points that both cameras should show are
    not on a common surface.

    first, second: ``common_surfaces`` of the same moments. The method is point-to-plane least squares in all six
    degrees of freedom, with Huber's weights.
    """
    given = T = invert_rigid(first.camera.require_pose()) @ second.camera.require_pose()
    for gate in DISPLACEMENT_GATES_M:
        jacobian, residual, moment = paired_rows(first, second, T, gate)
        if len(residual) < LEAST_SURFACE_PAIRS:
            return None
        weight, spread = huber_weights(residual)
        weight = _halved(weight, moment > 0)
        information = (jacobian * weight[:, None]).T @ jacobian
        damping = np.repeat([(10.0 * spread / STEP_RAD) ** 2, (10.0 * spread / STEP_M) ** 2], 3)
        T = moved_by(T, -np.linalg.solve(information + np.diag(damping), jacobian.T @ (weight * residual)))
    seen = [each.points_m[each.person] for each in second.seen]
    people = np.concatenate(seen[1:]) if any(len(each) for each in seen[1:]) else seen[0]
    place = people.mean(axis=0, keepdims=True)
    there = transform_points(T, place)
    if _support(jacobian, weight, there[0]) < LEAST_SUPPORT:
        return None
    misfit_m, fitted_m = _misfit_m(first, second, given), _misfit_m(first, second, T)
    if not np.isfinite(min(misfit_m, fitted_m)):
        return None
    if fitted_m > BETTER * misfit_m:
        return Displacement(misfit_m, None)
    off_m = float(np.linalg.norm(there - transform_points(given, place)))
    turn = float(np.arccos(np.clip((np.trace((T @ invert_rigid(given))[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
    return Displacement(off_m, turn if spread <= TIGHT_M else None)


def _misfit_m(first: LevelView, second: LevelView, T_first_second: np.ndarray) -> float:
    """Return the median distance between the two cameras' surfaces of people or, without people in view, of the room.

    The median is taken over all points that both cameras should show. The distance of a point counts as infinite if the
    other camera does not show the point's surface within ``COMPARED_M``, so the result is infinite unless more than
    half of the points are on one surface.
    """
    moments = range(1, len(first.seen)) if _anybody(first) or _anybody(second) else range(1)
    found = [np.empty(0)]
    for moment in moments:
        for views, T in (((first, second), T_first_second), ((second, first), invert_rigid(T_first_second))):
            both = shown_by_both(*views, T, moment)
            away_m = np.where(both.is_one_surface(COMPARED_M), both.away_m(), np.inf)
            found.append(away_m[both.is_comparable(COMPARED_M)])
    away_m = np.concatenate(found)
    # the higher of the two middle values, so that the median of one finite and one infinite distance is infinite
    return float(np.partition(away_m, len(away_m) // 2)[len(away_m) // 2]) if len(away_m) else np.inf


def _anybody(view: LevelView) -> bool:
    return any(seen.person.any() for seen in view.seen[1:])


def _halved(weight: np.ndarray, of_people: np.ndarray) -> np.ndarray:
    """Return the weights (n,), scaled so that the weights of the room and the weights of the people have the same sum;
    unchanged if either sum is 0.
    """
    shares = [weight[which].sum() for which in (of_people, ~of_people)]
    if min(shares) <= 0.0:
        return weight
    return np.asarray(weight * np.where(of_people, 1.0 / shares[0], 1.0 / shares[1]) * len(weight) / 2.0)


def _support(jacobian: np.ndarray, weight: np.ndarray, place_m: np.ndarray) -> float:
    """Return how well the data determine a shift at ``place_m`` if the rotation is unknown, too. The result is the
    share (0 to 1) of the weight that resists a shift in the least determined direction.
    """
    about_place = jacobian.copy()
    about_place[:, :3] -= np.cross(place_m, jacobian[:, 3:])
    mean = (about_place * weight[:, None]).T @ about_place / weight.sum()
    turn, both = mean[:3, :3] + 1e-9 * np.eye(3), mean[:3, 3:]
    return float(np.linalg.eigvalsh(mean[3:, 3:] - both.T @ np.linalg.solve(turn, both))[0])
