"""Simulate a patient who does a captured movement. If the arms would be inside a broad body, the arms are abducted."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.body.skin_points import body_points
from anchorpose.rotations import FORWARD, UP, rotate, turns
from anchorpose.simulate.capture import Capture, lay_out
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.movement_file import read_clips
from anchorpose.simulate.person import Person, skin_points
from anchorpose.simulate.posture import OUTWARD
from anchorpose.simulate.retarget import CapturedActor, retarget
from anchorpose.simulate.timeline import ease

# s of movement before and after the recording, for cameras with wrong clocks, which take images too early or too late
MARGIN_S: Final = 3.0
ANGLES_RAD: Final = tuple(np.radians(np.arange(0.0, 41.0, 8.0)).tolist())  # angles of abduction that are tried
GIVES_M: Final = 0.01  # m, maximum tolerated depth of an arm inside the body, since soft tissue gives way
HANGING_RAD: Final = 1.0  # rad; an upper arm that is raised by less than this is abducted by the full angle
RAISED_RAD: Final = 1.6  # rad; an arm that is raised by more than this is not abducted
DRAWS: Final = 6  # maximum number of draws of a movement; the first movement whose arms stay outside the body is used
CHECK_HZ: Final = 3.0  # moments per second at which arms are tested for being inside the body
DEEPEST_M: Final = 0.15  # m, search radius for the nearest skin: half a trunk's depth, to exclude the trunk's far side
# minimum cosine, for a point inside the body, between the direction to the nearest skin and the normal of that skin
UNDER_SKIN: Final = 0.7
# A bone whose name contains one of these texts must stay outside the body.
FOREARMS: Final = ("ForeArm", "Hand", "Thumb", "Finger")
# texts in the names of arm bones; all other bones belong to head, trunk or legs
ARMS: Final = (*FOREARMS, "Arm", "Shoulder")


def draw_captured(rng: np.random.Generator, config: SimulationConfig, person: Person) -> CapturedActor:
    """Draw the configuration's movement, which begins at a random phase: the recording may begin in the middle of the
    movement.

    If the arms cannot be kept out of the body, the movement is drawn again, up to ``DRAWS`` times in all.
    """
    if config.movement_file is None or config.movement is None:
        raise ValueError("a captured movement needs movement_file and movement")
    for _ in range(DRAWS):
        clips = read_clips(config.movement_file, config.movement, rng, config.subjects)
        first, phase = int(rng.integers(len(clips.names))), float(rng.uniform())
        capture = lay_out(clips, first, phase, -MARGIN_S, config.seconds + MARGIN_S)
        actor, clear = with_arms_clear(retarget(person, capture), config.seconds)
        if clear:
            break
    return actor


def with_arms_clear(actor: CapturedActor, seconds: float) -> tuple[CapturedActor, bool]:
    """Abduct the arms by the smallest angle at which no forearm is inside trunk or legs; return the changed movement
    and True.

    If all of ``ANGLES_RAD`` are too small, use the last angle and return False. seconds: duration that is tested, from
    time 0.
    """
    times_s = np.arange(0.0, seconds, 1.0 / CHECK_HZ)
    for angle in ANGLES_RAD:
        found = replace(actor, capture=_abducted(actor.capture, angle))
        times_s = times_s[arms_within_m(found.person, found.bones(times_s)) > GIVES_M]
        if not len(times_s):
            return found, True
    return found, False


def arms_within_m(person: Person, bones: np.ndarray) -> np.ndarray:
    """Return the greatest depth (t,), metres, of forearms and hands inside trunk or legs; 0 if they are outside."""
    from scipy.spatial import cKDTree

    points = body_points()
    names = np.array([points.asset.bone_names[bone] for bone in points.part])
    forearm = np.array([any(part in name for part in FOREARMS) for name in names])
    rest = ~np.array([any(part in name for part in ARMS) for name in names])
    place, normals = skin_points(person, bones, points.vertex)
    deepest = np.zeros(len(bones))
    for t in range(len(bones)):
        away, nearest = cKDTree(place[t, rest]).query(place[t, forearm], distance_upper_bound=DEEPEST_M)
        near = np.isfinite(away)
        gap = place[t, rest][nearest[near]] - place[t, forearm][near]
        depth = (gap * normals[t, rest][nearest[near]]).sum(axis=1)
        inside = depth > UNDER_SKIN * away[near]
        deepest[t] = depth[inside].max(initial=0.0)
    return deepest


def _abducted(capture: Capture, angle: float) -> Capture:
    """Abduct the arms about the thorax's forward axis by ``angle``; arms that are raised are abducted by less, or not
    at all.
    """
    arms, axes = capture.arms.copy(), capture.arm_axis.copy()
    forward = rotate(capture.thorax, np.broadcast_to(FORWARD, (len(arms), 3)))
    down = rotate(capture.thorax, np.broadcast_to(-UP, (len(arms), 3)))
    for side in (0, 1):
        raised = np.arccos(np.clip((arms[:, side, 0] * down).sum(axis=1), -1.0, 1.0))
        share = 1.0 - ease((raised - HANGING_RAD) / (RAISED_RAD - HANGING_RAD))
        turn = turns((-OUTWARD[side] * angle * share)[:, None] * forward)
        arms[:, side] = np.einsum("nij,nkj->nki", turn, arms[:, side])
        axes[:, side] = rotate(turn, axes[:, side])
    return replace(capture, arms=arms, arm_axis=axes)
