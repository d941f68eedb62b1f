"""Place furniture: beside and behind the patient, along the walls, and low pieces in front of the patient's legs."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.simulate.rooms.keep_out import Lane, disc, is_free
from anchorpose.simulate.rooms.pieces import AT_WALLS, PIECES, Piece
from anchorpose.simulate.rooms.plan import MIDDLE_SHARE, Clutter, RoomConfig
from anchorpose.simulate.rooms.walls import Outline

TRIES: Final = 120  # maximum number of places that are tried for a piece
CAMERA_CLEAR_M: Final = 0.7  # m, radius around the camera that stays free of furniture
PATIENT_CLEAR_M: Final = 0.75  # m, radius around the patient that stays free for movements
# m, distance that furniture keeps on each side from the line of sight between camera and patient
SIGHT_CLEAR_M: Final = 0.35
LEGS_CLEAR_M: Final = 0.5  # m, minimum distance between the patient and furniture in front of the legs
BELOW_SIGHT_M: Final = 0.04  # m; low furniture stays this far below the line from the camera to the patient's middle


def first_lanes(room: RoomConfig, camera_m: np.ndarray) -> list[Lane]:
    """Return the areas that stay free in any room: around the patient, the camera and the line between both."""
    here = (float(camera_m[0]), float(camera_m[1]))
    return [disc(np.zeros(2), PATIENT_CLEAR_M), disc(camera_m, CAMERA_CLEAR_M), Lane(here, (0.0, 0.0), SIGHT_CLEAR_M)]


def lay_out(rng: np.random.Generator, room: RoomConfig, outline: Outline, taken: list[Lane]) -> list[Piece]:
    """Place the room's clutter in the room frame, in which the patient is at the origin and X points away from the
    camera. Each piece keeps clear of the areas ``taken``, to which its own area is then added. A piece without a free
    place is left out.
    """
    found = []
    for kind in room.clutter:
        for _ in range(TRIES):
            piece = PIECES[kind](rng)
            place, yaw = _draw_place(rng, kind, piece, outline)
            if is_free(place, 0.85 * piece.radius_m, taken) and _inside(place, piece, outline, kind):
                taken.append(disc(place, 0.85 * piece.radius_m))
                found.append(piece.placed(place, yaw))
                break
    return found


def stand_before(
    rng: np.random.Generator, room: RoomConfig, camera_m: np.ndarray, head_m: float, taken: list[Lane]
) -> list[Piece]:
    """Place low furniture between camera and patient. The furniture may hide the legs but not the patient's middle.

    camera_m (3,): the camera; head_m: height of the patient's head; taken: areas that stay free.
    """
    found = []
    away_m = float(np.linalg.norm(camera_m[[0, 2]]))
    across = np.array([-camera_m[2], camera_m[0]]) / away_m
    for kind in room.before:
        for _ in range(TRIES):
            piece = PIECES[kind](rng)
            share = rng.uniform((CAMERA_CLEAR_M - 0.2) / away_m, 1.0)
            place = (1.0 - share) * camera_m[[0, 2]] + rng.uniform(-0.4, 0.4) * across
            near = max(share - piece.radius_m / away_m, 0.0)
            ends_m = [camera_m[1] + s * (MIDDLE_SHARE * head_m - camera_m[1]) for s in (near, share)]
            below = piece.height_m < min(ends_m) - BELOW_SIGHT_M
            apart = np.linalg.norm(place) > piece.radius_m + LEGS_CLEAR_M
            if below and apart and is_free(place, 0.8 * piece.radius_m, taken):
                taken.append(disc(place, 0.8 * piece.radius_m))
                found.append(piece.placed(place, rng.uniform(-np.pi, np.pi)))
                break
    return found


def _draw_place(rng: np.random.Generator, kind: Clutter, piece: Piece, outline: Outline) -> tuple[np.ndarray, float]:
    """Draw a piece's place (x, z) and yaw: at a wall with its back to the wall, or anywhere, depending on the kind."""
    o = outline
    x, z = rng.uniform(o.front_m + 0.3, o.back_m - 0.3), rng.uniform(o.left_m + 0.3, o.right_m - 0.3)
    if kind not in AT_WALLS and rng.random() < 0.7:
        return np.array([x, z]), rng.uniform(-np.pi, np.pi)
    behind_m = 0.05 - float(piece.triangles[..., 0].min())
    wall = int(rng.choice(3, p=(0.5, 0.25, 0.25)))
    places = ((o.back_m - behind_m, z), (x, o.left_m + behind_m), (x, o.right_m - behind_m))
    return np.array(places[wall]), (np.pi, -0.5 * np.pi, 0.5 * np.pi)[wall]


def _inside(place_m: np.ndarray, piece: Piece, outline: Outline, kind: Clutter) -> bool:
    """Return whether a piece lies inside the walls. Kinds that stand at a wall may be nearer to it than other kinds."""
    margin_m = 0.2 if kind in AT_WALLS else 0.7 * piece.radius_m
    o = outline
    x, z = float(place_m[0]), float(place_m[1])
    return bool(
        o.front_m + margin_m < x < o.back_m - (0.0 if kind in AT_WALLS else margin_m)
        and o.left_m + margin_m * (kind not in AT_WALLS) < z < o.right_m - margin_m * (kind not in AT_WALLS)
    )
