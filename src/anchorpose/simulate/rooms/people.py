"""Draw the people of a room: the patient, other people who sit, stand or walk through, and a mannequin."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from anchorpose.recording.equipment import EquipmentPart
from anchorpose.rotations import UP, turns_about
from anchorpose.simulate.aids import sweep_of
from anchorpose.simulate.captured_patient import draw_captured
from anchorpose.simulate.equip import fit_around
from anchorpose.simulate.patient import (
    LONG_AGO_S,
    STANCE_M,
    Actor,
    draw_patient,
    draw_waves,
    resting_channels,
    seated_offsets,
)
from anchorpose.simulate.person import Person, draw_person
from anchorpose.simulate.retarget import CapturedActor
from anchorpose.simulate.rooms.keep_out import Lane
from anchorpose.simulate.rooms.pieces import Piece, box, piece_of
from anchorpose.simulate.rooms.plan import Seat
from anchorpose.simulate.timeline import (
    CHANNEL_INDEX,
    Footwork,
    Movement,
    Step,
    final_stance,
    stand,
    walk,
    walk_seconds,
    walk_until,
    yaw_towards,
)

if TYPE_CHECKING:
    from anchorpose.simulate.config import SimulationConfig

SEATED_MOTIONS: Final = ("reach", "arm-raise", "head")
STANDING_MOTIONS: Final = ("standing", "weight-shift", "trunk", "head", "reach")
BACK_REST_M: Final = 0.45  # m, height of the top of a chair's back rest above the seat
# s, minimum duration of the movement to which a seat is fitted, so that it includes the rise of ``_rising``
RISING_S: Final = 2.0


def draw_room_patient(rng: np.random.Generator, config: SimulationConfig, person: Person) -> Actor | CapturedActor:
    """Return the patient at the origin, who does a captured movement or the motions of the configuration."""
    if config.movement_file is not None:
        return draw_captured(rng, config, person)
    actor = draw_patient(rng, config, person, None)
    return seated(actor) if config.room is not None and config.room.posture == "sits" else actor


def draw_bystander(rng: np.random.Generator, config: SimulationConfig, seat: Seat | None) -> tuple[Actor, Piece | None]:
    """Draw another person at the origin who faces +X and stands, or sits on ``seat`` if given. Also return the seat."""
    motions = STANDING_MOTIONS if seat is None else SEATED_MOTIONS
    alone = replace(
        config, room=None, motions=motions, movement_file=None, movement=None, away_s=(), stool=False, passers_by=0
    )
    actor = draw_patient(rng, alone, draw_person(rng, config.clothing_m), None)
    if seat is None:
        return actor, None
    actor = seated(actor)
    return actor, draw_seat(rng, alone, actor, seat)


def seated(actor: Actor) -> Actor:
    """Return the person, seated for the whole recording."""
    sits = Movement(seated_offsets(actor.person), LONG_AGO_S, 1.0, 1e4, 1.0)
    return replace(actor, movements=[sits, *actor.movements])


def draw_seat(rng: np.random.Generator, config: SimulationConfig, patient: Actor | CapturedActor, seat: Seat) -> Piece:
    """Return a stool, chair or wheelchair fitted under a person at the origin who sits at times."""
    wheels = seat == "wheelchair"
    fitting = replace(config, room=None, equipment="wheelchair" if wheels else "none", stool=not wheels, away_s=())
    fitting = replace(fitting, seconds=max(config.seconds, RISING_S))
    parts = fit_around(rng, fitting, _rising(patient) if wheels else patient, None)
    if wheels:
        return piece_of(
            [p for p in parts if p.name in ("seat", "back")], [p for p in parts if p.name not in ("seat", "back")]
        )
    return piece_of([*parts, *_back_rest(config, patient, parts)] if seat == "chair" else parts)


def _rising(patient: Actor | CapturedActor) -> Actor | CapturedActor:
    """Return the person with rising from the seat as the only movement; a person with a captured movement stays
    unchanged. A wheelchair fitted to this person also leaves space for standing legs.
    """
    if isinstance(patient, CapturedActor):
        return patient
    rises = Movement(seated_offsets(patient.person), LONG_AGO_S, 1.0, -LONG_AGO_S - 0.7, 0.5)
    return replace(patient, movements=[rises])


def _back_rest(
    config: SimulationConfig, patient: Actor | CapturedActor, parts: tuple[EquipmentPart, ...]
) -> list[EquipmentPart]:
    """Return a board behind the trunk of a person who sits on a stool, and its posts."""
    times_s = np.arange(0.0, config.seconds, 0.25)
    sweep = sweep_of(patient.person, patient.bones(times_s))
    (seat,) = (part.triangles()[0] for part in parts if part.name == "seat")
    seat_m, middle_m = float(seat[:, 1].max()), seat.mean(axis=0)
    trunk = sweep.within(seat_m, seat_m + BACK_REST_M, 0.25)
    behind_m = min(float(trunk[:, 0].min()), float(seat[:, 0].min())) - 0.04
    posts: list[EquipmentPart] = [
        box((behind_m, (seat_m + BACK_REST_M) / 2.0, float(middle_m[2]) + z), (0.03, seat_m + BACK_REST_M, 0.03))
        for z in (-0.19, 0.19)
    ]
    return [*posts, box((behind_m, seat_m + 0.3, float(middle_m[2])), (0.03, 0.3, 0.42))]


def moved_actor(actor: Actor, place_m: np.ndarray, yaw: float) -> Actor:
    """Move a person, who is at the origin and faces +X, to a place (x, z), and turn them to the left by ``yaw``."""
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    feet = actor.footwork
    steps = tuple(
        Step(s.side, s.start_s, s.duration_s, _pair(turn @ np.array(s.place_m) + place_m), s.yaw + yaw)
        for s in feet.steps
    )
    return replace(actor, footwork=Footwork(feet.places_m @ turn.T + place_m, feet.yaws + yaw, steps))


def over_origin(patient: Actor, seat: Piece | None, share: float) -> tuple[Actor, Piece | None]:
    """Move a person and the seat forward: by ``share`` times the distance by which the pelvis moves back when the
    person sits down.
    """
    ahead_m = -share * dict(seated_offsets(patient.person))["pelvis_forward"]
    place = np.array([ahead_m, 0.0])
    return moved_actor(patient, place, 0.0), None if seat is None else seat.placed(place, 0.0)


def walks_in(actor: Actor, from_m: np.ndarray, start_s: float) -> Actor:
    """Return the person, who walks in from a place (x, z) at ``start_s``; movements that begin before the arrival are
    left out.
    """
    places, yaws = final_stance(actor.footwork)
    home, facing = places.mean(axis=0), float(yaws.mean())
    standing = stand(from_m, yaw_towards(from_m, home), STANCE_M)
    arrives_s = start_s + walk_seconds(standing, home, facing, STANCE_M)
    later = [m for m in actor.movements if m.start_s > arrives_s]
    return replace(actor, movements=later, footwork=walk_until(standing, home, facing, arrives_s, STANCE_M))


def draw_walker(rng: np.random.Generator, config: SimulationConfig, lane: Lane, at_s: float) -> Actor:
    """Draw a person who walks along a lane and is in its middle at ``at_s``."""
    person = draw_person(rng, config.clothing_m)
    start, goal = np.array(lane.start_m), np.array(lane.end_m)
    facing = yaw_towards(start, goal)
    standing = stand(start, facing, STANCE_M)
    start_s = at_s - 0.5 * walk_seconds(standing, goal, facing, STANCE_M)
    return _walking(rng, person, walk(standing, goal, facing, start_s, STANCE_M), [])


def draw_pusher(rng: np.random.Generator, config: SimulationConfig, lane: Lane, arrive_s: float) -> Actor:
    """Draw a person who walks along a lane with the hands in front of the body until ``arrive_s``, then turns and walks
    back.
    """
    person = draw_person(rng, config.clothing_m)
    start, goal = np.array(lane.start_m), np.array(lane.end_m)
    facing = yaw_towards(start, goal)
    footwork = walk_until(stand(start, facing, STANCE_M), goal, facing, arrive_s, STANCE_M)
    footwork = walk(footwork, start, facing + np.pi, arrive_s + 1.0, STANCE_M)
    offsets = tuple(
        (f"{channel}_{side}", amount)
        for channel, amount in (("shoulder_flex", 0.6), ("elbow", 0.6))
        for side in ("left", "right")
    )
    return _walking(rng, person, footwork, [Movement(offsets, LONG_AGO_S, 1.0, arrive_s - LONG_AGO_S - 1.0, 0.6)])


def draw_mannequin(rng: np.random.Generator, config: SimulationConfig) -> np.ndarray:
    """Return triangles (n, 3, 3) of a dressed figure at the origin that faces +X, in one unchanging posture."""
    person = draw_person(rng, config.clothing_m)
    base = resting_channels(person, in_frame=False)
    for channel, low, high in (("shoulder_flex", -0.2, 1.2), ("shoulder_abduct", 0.1, 0.8), ("elbow", 0.1, 1.4)):
        for side in ("left", "right"):
            base[CHANNEL_INDEX[f"{channel}_{side}"]] = rng.uniform(low, high)
    actor = Actor(person, base, [], stand(np.zeros(2), 0.0, STANCE_M), ())
    skin = person.skin(actor.bones(np.zeros(1))[0], 0.0).astype(np.float64)
    return np.asarray(skin[person.body.asset.faces])


def turned(triangles: np.ndarray, yaw: float) -> np.ndarray:
    """Return points (..., 3) turned to the left about the Y axis by ``yaw``."""
    return np.asarray(triangles @ turns_about(UP, np.array([yaw]))[0].T)


def _walking(rng: np.random.Generator, person: Person, footwork: Footwork, movements: list[Movement]) -> Actor:
    return Actor(person, resting_channels(person, in_frame=False), movements, footwork, draw_waves(rng))


def _pair(place_m: np.ndarray) -> tuple[float, float]:
    return float(place_m[0]), float(place_m[1])
