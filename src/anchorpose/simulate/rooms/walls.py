"""Build a room: floor, walls with windows and doorways, the space behind these openings, and a mirror on a wall."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from anchorpose.simulate.rooms.keep_out import Lane
from anchorpose.simulate.rooms.plan import RoomConfig

WALL_M: Final = 2.7  # m, height of the walls
DOOR_HEIGHT_M: Final = 2.05  # m, height of all doorways
DOOR_WIDTH_M: Final = 0.95  # m, width of all doorways
CORRIDOR_M: Final = 1.3  # m, width of the corridors beside the room, from which people walk in
TRIES: Final = 200  # maximum number of places that are tried for a panel
BEHIND_MIRROR_M: Final = 0.004  # m from wall to mirror: the glass's thickness, so that rays meet the mirror first


@dataclass(frozen=True, slots=True)
class Outline:
    """Places of the walls in the room frame, metres. The patient is at 0; X points away from the camera."""

    front_m: float  # x of the wall behind the camera
    back_m: float  # x of the wall behind the patient
    left_m: float  # z of the left wall, as seen by the camera
    right_m: float  # z of the right wall, as seen by the camera


@dataclass(frozen=True, slots=True)
class Panel:
    """A rectangle on the back wall: an opening, a mirror or a poster."""

    from_m: float  # z where the panel begins
    to_m: float  # z where the panel ends
    low_m: float  # height of the lower edge
    high_m: float  # height of the upper edge

    def apart(self, other: Panel) -> bool:
        """Return whether two panels are at least a hand's breadth (0.1 m) apart along the wall."""
        return self.to_m + 0.1 < other.from_m or other.to_m + 0.1 < self.from_m


@dataclass(frozen=True, slots=True, eq=False)
class Mirror:
    """A plane mirror."""

    point_m: np.ndarray  # (3,) a point of the plane
    normal: np.ndarray  # (3,) unit normal towards the room
    triangles: np.ndarray  # (2, 3, 3) the two triangles of the mirror

    def reflect(self, points_m: np.ndarray) -> np.ndarray:
        """Return the mirror images (..., 3) of points (..., 3), as far behind the mirror as the points are in front."""
        return np.asarray(points_m - 2.0 * self.before_m(points_m)[..., None] * self.normal)

    def before_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return (...) the distance of points (..., 3) in front of the mirror, negative behind it."""
        return np.asarray((points_m - self.point_m) @ self.normal)


@dataclass(frozen=True, slots=True)
class BackWall:
    """The opening in the back wall and the objects on the wall; each field is None if the room has no such opening or
    object.
    """

    opening: Panel | None
    way_out: bool  # True: the opening is a doorway, without a door or with a door that opens; False: a window
    mirror: Panel | None
    poster: Panel | None


def draw_outline(rng: np.random.Generator, room: RoomConfig, range_m: float) -> Outline:
    """Draw walls around the camera and the patient, with space for people who walk behind the patient.

    range_m: the sensor's range. A door that opens during the recording is within the sensor's range. The mirror image
    of the patient is within the sensor's range, too, if the room has enough space.
    """
    least_m = 1.5 if "passes-behind" in room.others else 0.9
    most_m = least_m + 1.8
    free_m = range_m - room.distance_m - 0.3
    if room.mirror or room.moved == "door":
        most_m = float(np.clip(0.5 * free_m if room.mirror else free_m, least_m + 0.1, most_m))
    return Outline(
        front_m=-room.distance_m - rng.uniform(0.5, 2.0),
        back_m=rng.uniform(least_m, most_m),
        left_m=-rng.uniform(1.7, 3.2),
        right_m=rng.uniform(1.7, 3.2),
    )


def draw_back_wall(rng: np.random.Generator, room: RoomConfig, outline: Outline, half_view: float) -> BackWall:
    """Draw opening, mirror and poster in the part of the back wall that the camera sees. half_view: tangent of half of
    the field of view.
    """
    reach_m = 0.75 * half_view * (room.distance_m + outline.back_m)
    seen = (max(outline.left_m + 0.1, -reach_m), min(outline.right_m - 0.1, reach_m))
    taken: list[Panel] = []
    opening = mirror = poster = None
    way_out = room.moved == "door" or room.opening == "doorway"
    if way_out:
        opening = _draw_panel(rng, seen, taken, (DOOR_WIDTH_M, DOOR_WIDTH_M), (0.0, DOOR_HEIGHT_M))
    elif room.opening == "window":
        opening = _draw_panel(rng, seen, taken, (0.7, 1.4), (rng.uniform(0.7, 1.0), rng.uniform(1.8, 2.3)))
    if room.mirror:
        mirror = _draw_panel(rng, seen, taken, (0.6, 1.3), (rng.uniform(0.15, 0.5), rng.uniform(1.7, 2.0)))
    if room.poster:
        poster = _draw_panel(rng, seen, taken, (0.5, 0.8), (rng.uniform(0.8, 1.1), rng.uniform(1.6, 2.0)))
    return BackWall(opening, way_out, mirror, poster)


def room_triangles(rng: np.random.Generator, outline: Outline, back: BackWall, lanes: tuple[Lane, ...]) -> np.ndarray:
    """Return triangles (n, 3, 3), room frame: floor, ceiling, walls, the corridors on both sides, and the room behind a
    doorway in the back wall. Side walls have doorways where ``lanes``, the paths of people, cross them.
    """
    o, beside_m = outline, CORRIDOR_M
    corners = {
        "fl": (o.front_m, o.left_m),
        "fr": (o.front_m, o.right_m),
        "bl": (o.back_m, o.left_m),
        "br": (o.back_m, o.right_m),
    }
    openings = [back.opening] if back.opening is not None else []
    found = [
        floor_triangles(o.front_m, o.back_m, o.left_m - beside_m, o.right_m + beside_m),
        floor_triangles(o.front_m, o.back_m, o.left_m, o.right_m) + np.array([0.0, WALL_M, 0.0]),
        wall_triangles(corners["bl"], corners["br"], [_along(panel, o.left_m) for panel in openings]),
        wall_triangles(corners["fl"], corners["bl"], _doorways(lanes, o, o.left_m)),
        wall_triangles(corners["fr"], corners["br"], _doorways(lanes, o, o.right_m)),
        wall_triangles((o.front_m, o.left_m - beside_m), (o.back_m, o.left_m - beside_m), []),
        wall_triangles((o.front_m, o.right_m + beside_m), (o.back_m, o.right_m + beside_m), []),
        wall_triangles(corners["fl"], corners["fr"], []),
    ]
    if back.opening is not None and back.way_out:
        found.append(farther_room(rng, back.opening, o.back_m))
    if back.poster is not None:
        found.append(panel_triangles(back.poster, o.back_m - 0.015))
    return np.concatenate(found)


def farther_room(rng: np.random.Generator, opening: Panel, wall_m: float) -> np.ndarray:
    """Return triangles (n, 3, 3) of the room behind an opening of the wall at x = wall_m."""
    deep_m, left_m, right_m = (
        rng.uniform(1.2, 3.5),
        opening.from_m - rng.uniform(0.3, 1.5),
        opening.to_m + rng.uniform(0.3, 1.5),
    )
    far_m = wall_m + deep_m
    return np.concatenate(
        [
            floor_triangles(wall_m, far_m, left_m, right_m),
            wall_triangles((far_m, left_m), (far_m, right_m), []),
            wall_triangles((wall_m, left_m), (far_m, left_m), []),
            wall_triangles((wall_m, right_m), (far_m, right_m), []),
        ]
    )


def mirror_on_wall(panel: Panel, wall_m: float) -> Mirror:
    """Return the mirror on the back wall, at x = wall_m in the room frame (patient at the origin, X away from the
    camera).
    """
    x = wall_m - BEHIND_MIRROR_M
    return Mirror(np.array([x, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]), panel_triangles(panel, x))


def panel_triangles(panel: Panel, x_m: float) -> np.ndarray:
    """Return the triangles (2, 3, 3) of the panel, as a board at x = ``x_m``."""
    p = panel
    return _quad([(x_m, p.low_m, p.from_m), (x_m, p.low_m, p.to_m), (x_m, p.high_m, p.to_m), (x_m, p.high_m, p.from_m)])


def floor_triangles(x0: float, x1: float, z0: float, z1: float) -> np.ndarray:
    """Return the two triangles (2, 3, 3) of a rectangle of the floor."""
    return _quad([(x0, 0.0, z0), (x1, 0.0, z0), (x1, 0.0, z1), (x0, 0.0, z1)])


def wall_triangles(start: tuple[float, float], end: tuple[float, float], holes: list[Panel]) -> np.ndarray:
    """Return triangles (n, 3, 3) of a wall from start (x, z) to end (x, z) with rectangular holes. ``from_m`` and
    ``to_m`` of a hole are distances from the start.
    """
    a, b = np.array(start), np.array(end)
    long_m = float(np.linalg.norm(b - a))
    cuts = sorted(
        {0.0, long_m, *(float(np.clip(at, 0.0, long_m)) for hole in holes for at in (hole.from_m, hole.to_m))}
    )
    found = [np.zeros((0, 3, 3))]
    for near_m, far_m in pairwise(cuts):
        middle = (near_m + far_m) / 2.0
        spans = [(hole.low_m, hole.high_m) for hole in holes if hole.from_m < middle < hole.to_m]
        solid = [(0.0, WALL_M)] if not spans else [(0.0, min(s[0] for s in spans)), (max(s[1] for s in spans), WALL_M)]
        (x0, z0), (x1, z1) = a + (b - a) * near_m / long_m, a + (b - a) * far_m / long_m
        found += [
            _quad([(x0, low, z0), (x1, low, z1), (x1, high, z1), (x0, high, z0)]) for low, high in solid if high > low
        ]
    return np.concatenate(found)


def _doorways(lanes: tuple[Lane, ...], outline: Outline, side_m: float) -> list[Panel]:
    """Return a doorway where each lane crosses the side wall at z = side_m; its place is stated by distances from the
    end of the wall that lies behind the camera.
    """
    half_m = 0.5 * DOOR_WIDTH_M
    crossings = [x for lane in lanes for x in lane.crossings_m(side_m)]
    return [Panel(x - outline.front_m - half_m, x - outline.front_m + half_m, 0.0, DOOR_HEIGHT_M) for x in crossings]


def _along(panel: Panel, start_m: float) -> Panel:
    return Panel(panel.from_m - start_m, panel.to_m - start_m, panel.low_m, panel.high_m)


def _draw_panel(
    rng: np.random.Generator,
    seen: tuple[float, float],
    taken: list[Panel],
    width_m: tuple[float, float],
    height_m: tuple[float, float],
) -> Panel | None:
    """Choose a panel at random on the part ``seen`` (from z to z) of a wall, and add it to ``taken``. The panel keeps a
    distance from all panels in ``taken``. Return None if no space is left.
    """
    for _ in range(TRIES):
        wide_m = rng.uniform(*width_m)
        if wide_m > seen[1] - seen[0]:
            continue
        from_m = rng.uniform(seen[0], seen[1] - wide_m)
        panel = Panel(from_m, from_m + wide_m, *height_m)
        if all(panel.apart(other) for other in taken):
            taken.append(panel)
            return panel
    return None


def _quad(corners: list[tuple[float, float, float]]) -> np.ndarray:
    return np.array([[corners[0], corners[i], corners[i + 1]] for i in (1, 2)])
