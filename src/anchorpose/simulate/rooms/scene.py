"""Draw one room as a whole: camera, walls, furniture, the patient and all other people, from one seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, get_args

import numpy as np

from anchorpose.camera import Camera
from anchorpose.rotations import UP, turns_about
from anchorpose.simulate.patient import Actor
from anchorpose.simulate.person import Person, draw_patient_person
from anchorpose.simulate.retarget import CapturedActor
from anchorpose.simulate.rooms.keep_out import Lane, disc, is_free
from anchorpose.simulate.rooms.layout import first_lanes, lay_out, stand_before
from anchorpose.simulate.rooms.moving import Mover, opening_door, pushed
from anchorpose.simulate.rooms.people import (
    draw_bystander,
    draw_mannequin,
    draw_pusher,
    draw_room_patient,
    draw_seat,
    draw_walker,
    moved_actor,
    over_origin,
    turned,
    walks_in,
)
from anchorpose.simulate.rooms.pieces import PIECES, Piece
from anchorpose.simulate.rooms.plan import SEATED_SHARE, Other, Posture, RoomConfig, Seat
from anchorpose.simulate.rooms.spoil import Spoil, draw_spoil
from anchorpose.simulate.rooms.walls import (
    CORRIDOR_M,
    BackWall,
    Mirror,
    Outline,
    draw_back_wall,
    draw_outline,
    mirror_on_wall,
    room_triangles,
)
from anchorpose.simulate.sensor import SENSORS, SensorSpec, intrinsics_of
from anchorpose.simulate.therapist import Therapist

if TYPE_CHECKING:
    from anchorpose.simulate.config import SimulationConfig

ROOM_KEY: Final = 1002  # key of a room's random streams; ``clinic`` and ``config`` use other keys
STREAMS: Final = ("plan", "patient", "programme", "walls", "people", "furniture", "spoil", "beyond")
ASKEW_RAD: Final = 0.35  # rad, maximum angle between the line of sight and the room's long axis
PERSON_CLEAR_M: Final = 0.5  # m, radius of the free area around a person who sits or stands
WALK_CLEAR_M: Final = 0.35  # m, width that stays free on each side of a walking person's path
TRIES: Final = 200  # maximum number of places that are tried for a person
SEATED_AHEAD: Final[dict[Posture, float]] = {"stands": 0.0, "stands-up": 0.5, "sits": 1.0}
"""Forward shift of the patient for each posture, which brings the pelvis to the place at which the camera is aimed. The
unit is the distance by which the pelvis is farther back in sitting than in standing.
"""


@dataclass(frozen=True, slots=True, eq=False)
class RoomScene:
    """The content of a room in the world frame; the patient is at the origin and faces +X."""

    camera: Camera
    triangles: np.ndarray  # (n, 3, 3) triangles of everything that never moves
    shiny: np.ndarray  # (n,) bool, triangles of bare metal
    mirror: Mirror | None
    patient: Actor | CapturedActor
    people: tuple[Therapist, ...]  # all other people; people who walk through come last
    movers: tuple[Mover, ...]  # furniture that moves
    spoil: Spoil  # losses of readings


@dataclass(frozen=True, slots=True, eq=False)
class _Draft:
    """A room while it is being furnished, in the room frame: the patient is at the origin, and X points away from the
    camera, at most ``ASKEW_RAD`` off the line of sight.
    """

    config: SimulationConfig
    room: RoomConfig
    yaw: float  # rad, direction of the room frame's X axis in the world, positive to the left
    outline: Outline
    back: BackWall
    camera_m: np.ndarray  # (3,) position of the camera
    taken: list[Lane]  # areas of the floor in which nothing more may be placed
    half_view: float  # tangent of half of the horizontal field of view
    doorways: list[Lane]  # paths of walking people; a side wall has a doorway where a path crosses it
    pieces: list[Piece]
    people: list[Actor]
    movers: list[Mover]


def room_stream(config: SimulationConfig, name: str) -> np.random.Generator:
    """Return the random generator for one purpose in a room; name: one of ``STREAMS`` in this module."""
    return np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(ROOM_KEY, STREAMS.index(name))))


def draw_scene(config: SimulationConfig, room: RoomConfig) -> RoomScene:
    """Draw the room that ``config`` and ``room`` describe, with all people in it."""
    person = draw_patient_person(room_stream(config, "patient"), config)
    patient = draw_room_patient(room_stream(config, "programme"), config, person)
    draft = _draw_empty_room(room_stream(config, "walls"), config, room)
    rng = room_stream(config, "people")
    patient = _late(rng, draft, patient) if isinstance(patient, Actor) and config.away_s else patient
    seat = draw_seat(rng, config, patient, room.seat) if patient.sits() else None
    if isinstance(patient, Actor):
        patient, seat = over_origin(patient, seat, SEATED_AHEAD[room.posture])
    for number, other in enumerate(room.others, start=1):
        _add_person(rng, draft, other, pushes=room.pushed and number == len(room.others))
    if room.mannequin:
        _add_mannequin(rng, draft)
    _furnish(room_stream(config, "furniture"), draft, person)
    return _finished(draft, patient, person, seat)


def room_camera(room: RoomConfig, sensor: str, lens: str | None) -> Camera:
    """Return the camera at its place. Its optical axis lies in the vertical plane through camera and patient."""
    spec = SENSORS[sensor]
    return Camera(
        name="room",
        width=spec.width,
        height=spec.height,
        depth_scale=0.001,
        intrinsics=intrinsics_of(spec, lens),
        T_world_camera=camera_pose(room),
    )


def camera_pose(room: RoomConfig) -> np.ndarray:
    """Return T_world_camera (4, 4) of the room's camera, tilted downward and rolled about its optical axis."""
    yaw = room.azimuth_rad + np.pi  # towards the patient
    level, right = np.array([np.cos(yaw), 0.0, -np.sin(yaw)]), np.array([np.sin(yaw), 0.0, np.cos(yaw)])
    away = np.cos(room.tilt_rad) * level - np.sin(room.tilt_rad) * UP
    right = turns_about(away, np.array([room.roll_rad]))[0] @ right
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = np.stack([right, np.cross(away, right), away], axis=1)
    T_world_camera[:3, 3] = room.camera_height_m * UP - room.distance_m * level
    return T_world_camera


def _draw_empty_room(rng: np.random.Generator, config: SimulationConfig, room: RoomConfig) -> _Draft:
    spec: SensorSpec = SENSORS[config.sensor]
    askew = rng.uniform(-ASKEW_RAD, ASKEW_RAD)
    yaw = room.azimuth_rad + np.pi + askew
    camera_m = turned(camera_pose(room)[:3, 3], -yaw)
    outline, half_view = draw_outline(rng, room, spec.farthest_m), spec.width / 2.0 / spec.focal_px
    back = draw_back_wall(rng, room, outline, half_view)
    taken = first_lanes(room, camera_m[[0, 2]])
    if back.opening is not None and back.way_out:
        middle_m = np.array([outline.back_m, (back.opening.from_m + back.opening.to_m) / 2.0])
        taken.append(disc(middle_m, 0.6))
    if back.mirror is not None:
        taken.append(disc(np.array([outline.back_m, (back.mirror.from_m + back.mirror.to_m) / 2.0]), 0.4))
    return _Draft(config, room, yaw, outline, back, camera_m, taken, half_view, [], [], [], [])


def _late(rng: np.random.Generator, draft: _Draft, patient: Actor) -> Actor:
    """Return the patient, who walks in from beside the camera's view, at right angles to the line of sight."""
    edge_m = 1.05 * draft.half_view * draft.room.distance_m + 0.5
    way = float(rng.choice([-1.0, 1.0]))
    across = np.array([-draft.camera_m[2], draft.camera_m[0]]) / draft.room.distance_m
    from_m = way * edge_m * across
    lane = Lane((float(from_m[0]), float(from_m[1])), (0.0, 0.0), WALK_CLEAR_M)
    draft.taken.append(lane)
    draft.doorways.append(lane)
    world = turned(np.array([from_m[0], 0.0, from_m[1]]), draft.yaw)
    return walks_in(patient, world[[0, 2]], draft.config.away_s[0][1])


def _add_person(rng: np.random.Generator, draft: _Draft, other: Other, pushes: bool) -> None:
    """Add a person who sits, stands, walks through or pushes furniture, if a place is free."""
    config = draft.config
    if other in ("sits", "stands"):
        place = _free_place(rng, draft, PERSON_CLEAR_M)
        if place is None:
            return
        yaw = rng.uniform(-np.pi, np.pi)
        kinds = get_args(Seat)
        actor, seat = draw_bystander(rng, config, kinds[int(rng.integers(3))] if other == "sits" else None)
        draft.people.append(moved_actor(actor, place, yaw))
        if seat is not None:
            draft.pieces.append(seat.placed(place, yaw))
        return
    lane = _walking_lane(rng, draft, before=other == "passes-before")
    draft.taken.append(lane)
    draft.doorways.append(lane)
    if pushes:
        _add_pusher(rng, draft, lane)
    else:
        draft.people.append(draw_walker(rng, config, lane, rng.uniform(0.3, 0.7) * config.seconds))


def _add_pusher(rng: np.random.Generator, draft: _Draft, lane: Lane) -> None:
    """Add a person who pushes furniture from one place on a lane to another place, and leaves it there."""
    start, gap = np.array(lane.start_m), np.subtract(lane.end_m, lane.start_m)
    starts, ends = rng.uniform(0.3, 0.42), rng.uniform(0.55, 0.68)
    stop = start + ends * gap
    walked = Lane(lane.start_m, (float(stop[0]), float(stop[1])), lane.radius_m)
    actor = draw_pusher(rng, draft.config, walked, rng.uniform(0.5, 0.75) * draft.config.seconds)
    piece = PIECES["stool" if draft.room.moved == "stool" else "wheelchair"](rng)
    draft.people.append(actor)
    draft.movers.append(pushed(piece, actor, walked, starts * float(np.linalg.norm(gap)), draft.config.seconds))


def _walking_lane(rng: np.random.Generator, draft: _Draft, before: bool) -> Lane:
    """Draw a lane across the room, from the corridor on one side to the corridor on the other side, in front of the
    patient (``before``) or behind.
    """
    o, away_m = draft.outline, draft.room.distance_m
    x = -rng.uniform(0.8, away_m - 0.7) if before else rng.uniform(0.85, o.back_m - 0.5)
    way, beyond_m = float(rng.choice([-1.0, 1.0])), CORRIDOR_M - 0.5
    ends = (o.left_m - beyond_m, o.right_m + beyond_m)
    slant_m = rng.uniform(-0.2, 0.2)
    start, end = (x - slant_m, ends[0]), (x + slant_m, ends[1])
    return Lane(start, end, WALK_CLEAR_M) if way > 0.0 else Lane(end, start, WALK_CLEAR_M)


def _add_mannequin(rng: np.random.Generator, draft: _Draft) -> None:
    place = _free_place(rng, draft, PERSON_CLEAR_M)
    if place is not None:
        triangles = draw_mannequin(rng, draft.config)
        draft.pieces.append(
            Piece(triangles, np.zeros(len(triangles), dtype=bool)).placed(place, rng.uniform(-3.1, 3.1))
        )


def _free_place(rng: np.random.Generator, draft: _Draft, radius_m: float) -> np.ndarray | None:
    """Return a free place (2,), x and z, in the camera's view, and add it to ``draft.taken``; return None if no place
    is free.
    """
    o, camera = draft.outline, draft.camera_m[[0, 2]]
    axis = -camera / np.linalg.norm(camera)
    for _ in range(TRIES):
        place = np.array([rng.uniform(camera[0] + 1.2, o.back_m - 0.6), rng.uniform(o.left_m + 0.5, o.right_m - 0.5)])
        gap = place - camera
        ahead_m, aside_m = float(gap @ axis), abs(float(gap[0] * axis[1] - gap[1] * axis[0]))
        if ahead_m > 1.0 and aside_m < 0.8 * draft.half_view * ahead_m and is_free(place, radius_m, draft.taken):
            draft.taken.append(disc(place, radius_m))
            return place
    return None


def _furnish(rng: np.random.Generator, draft: _Draft, person: Person) -> None:
    """Add low furniture in front of the patient's legs, then clutter elsewhere, then a door that opens."""
    room = draft.room
    head_m = person.height_m * (SEATED_SHARE if room.posture != "stands" else 1.0)
    free = draft.taken[3:]  # without the three areas of ``first_lanes``, which low furniture may enter
    draft.pieces.extend(stand_before(rng, room, draft.camera_m, head_m, free))
    draft.pieces.extend(lay_out(rng, room, draft.outline, [*draft.taken, *free]))
    if room.moved == "door" and draft.back.opening is not None:
        at_s = rng.uniform(0.2, 0.6) * draft.config.seconds
        draft.movers.append(opening_door(rng, draft.back.opening, draft.outline.back_m, at_s, draft.config.seconds))


def _finished(draft: _Draft, patient: Actor | CapturedActor, person: Person, seat: Piece | None) -> RoomScene:
    """Return the room of the finished draft, in the world frame."""
    room, config = draft.room, draft.config
    walls = room_triangles(room_stream(config, "beyond"), draft.outline, draft.back, tuple(draft.doorways))
    still = [Piece(walls, np.zeros(len(walls), dtype=bool)), *draft.pieces]
    placed = [piece.placed(np.zeros(2), draft.yaw) for piece in still] + ([] if seat is None else [seat])
    bare = tuple(patient.person.body.asset.bone_names)
    return RoomScene(
        camera=room_camera(room, config.sensor, config.lens),
        triangles=np.concatenate([piece.triangles for piece in placed]),
        shiny=np.concatenate([piece.shiny for piece in placed]),
        mirror=_mirror(draft),
        patient=patient,
        people=tuple(Therapist(moved_actor(actor, np.zeros(2), draft.yaw), None) for actor in draft.people),
        movers=tuple(_turned_mover(mover, draft.yaw) for mover in draft.movers),
        spoil=draw_spoil(room_stream(config, "spoil"), bare, room.dark_clothes, room.shiny, room.interference),
    )


def _mirror(draft: _Draft) -> Mirror | None:
    if draft.back.mirror is None:
        return None
    there = mirror_on_wall(draft.back.mirror, draft.outline.back_m)
    return Mirror(*(turned(points, draft.yaw) for points in (there.point_m, there.normal, there.triangles)))


def _turned_mover(mover: Mover, yaw: float) -> Mover:
    places = np.stack([mover.places_m[:, 0], np.zeros(len(mover.places_m)), mover.places_m[:, 1]], axis=1)
    return Mover(mover.piece, mover.times_s, turned(places, yaw)[:, [0, 2]], mover.yaws + yaw)
