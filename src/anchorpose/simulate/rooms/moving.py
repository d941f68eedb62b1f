"""Move furniture during the recording: a piece that a person pushes, or a door that opens."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.rotations import UP, turns_about
from anchorpose.simulate.patient import Actor
from anchorpose.simulate.render import NOTHING, Figure
from anchorpose.simulate.rooms.keep_out import Lane
from anchorpose.simulate.rooms.pieces import Piece, box, piece_of
from anchorpose.simulate.rooms.walls import Panel
from anchorpose.simulate.timeline import body_course, ease

STEP_S: Final = 0.05  # s, step between the times for which the place of moved furniture is computed
AHEAD_M: Final = 0.35  # m, distance between a person who pushes and the nearest part of the furniture
OPENING_S: Final = 1.6  # s, time that a door takes to open
BEFORE_S: Final = 3.0  # s, time before and after the recording for which places of furniture are computed, too


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A piece of furniture that moves during the recording."""

    piece: Piece
    times_s: np.ndarray  # (k,) times for which the place is known
    places_m: np.ndarray  # (k, 2) x and z of the piece at ``times_s``
    yaws: np.ndarray  # (k,) rad, direction of the piece at ``times_s``, positive to the left

    def figure(self, time_s: float) -> Figure:
        """Return the piece of furniture at its place at a time, labelled as a part of the room."""
        x, z = (np.interp(time_s, self.times_s, self.places_m[:, axis]) for axis in (0, 1))
        yaw = float(np.interp(time_s, self.times_s, self.yaws))
        points = self.piece.triangles.reshape(-1, 3) @ turns_about(UP, np.array([yaw]))[0].T + np.array([x, 0.0, z])
        faces = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
        return Figure(points.astype(np.float32), faces, np.zeros(len(faces), np.uint8), NOTHING)


def pushed(piece: Piece, pusher: Actor, lane: Lane, starts_m: float, seconds: float) -> Mover:
    """Return a piece of furniture that stands at the distance ``starts_m`` along a lane, until a person who walks along
    this lane pushes it.

    The piece faces the direction of the push. After the push, the piece stays at the place at which the person turns
    back.
    """
    times_s = np.arange(-BEFORE_S, seconds + BEFORE_S, STEP_S)
    start, along = np.array(lane.start_m), np.subtract(lane.end_m, lane.start_m)
    along = along / np.linalg.norm(along)
    place, _ = body_course(pusher.footwork, times_s)
    reached_m = np.maximum.accumulate((place - start) @ along) + AHEAD_M - float(piece.triangles[..., 0].min())
    travelled_m = np.maximum(reached_m, starts_m)
    yaw = float(np.arctan2(-along[1], along[0]))
    return Mover(piece, times_s, start + travelled_m[:, None] * along, np.full(len(times_s), yaw))


def opening_door(rng: np.random.Generator, panel: Panel, wall_m: float, at_s: float, seconds: float) -> Mover:
    """Return the door of the wall at x = wall_m, which opens away from the room at ``at_s`` and stays open."""
    wide_m, high_m = panel.to_m - panel.from_m, panel.high_m - 0.01
    way = float(rng.choice([-1.0, 1.0]))
    hinge_z = panel.from_m if way > 0.0 else panel.to_m
    leaf = piece_of([box((0.0, high_m / 2.0 + 0.005, way * wide_m / 2.0), (0.04, high_m, wide_m))])
    times_s = np.arange(-BEFORE_S, seconds + BEFORE_S, STEP_S)
    swing = way * rng.uniform(np.radians(50.0), np.radians(110.0)) * ease((times_s - at_s) / OPENING_S)
    return Mover(leaf, times_s, np.tile([wall_m, hinge_z], (len(times_s), 1)), swing)
