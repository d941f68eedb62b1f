"""Draw the people around the patient: therapists, who walk in, hold the patient and leave; and passers-by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.camera import Camera
from anchorpose.rotations import FORWARD, UP, orthonormal_frame, rotate, unit
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.holds import TASKS, Hold, Task, choose_hold, nearest_s, tasks_on
from anchorpose.simulate.patient import LONG_AGO_S, PALM_ABOVE_BONE_M, Actor, draw_waves, resting_channels
from anchorpose.simulate.person import Person, draw_person, skin_points
from anchorpose.simulate.posture import SIDES, finger_direction, palm_normal, pose_bones
from anchorpose.simulate.retarget import CapturedActor
from anchorpose.simulate.timeline import (
    CHANNEL_INDEX,
    Footwork,
    HandGoals,
    Movement,
    channel_values,
    posture_from,
    stand,
    standing_pelvis_m,
    walk,
    walk_seconds,
    walk_until,
    yaw_towards,
)

STANCE_M = 0.28  # m, distance between the feet
CROUCHES = np.linspace(0.0, 1.0, 21)  # tried depths of a crouch, from 0 (standing) to 1 (deep)
SHOULDERS_ABOVE_HOLD_M = 0.22  # m, preferred height of the shoulders above the held places
COMFORTABLE_REACH = 0.85  # comfortable distance from shoulder to held place, as a share of the arm's length
DISTANCES_M = np.linspace(0.3, 1.1, 33)  # m, tried distances from the balls of the feet to the held places
# share of the patient's motion with which the therapist's body moves along; the arms follow the rest of the motion
FOLLOW = 0.85
# m, maximum distance over which a therapist's body follows a patient without a captured movement
FARTHEST_FOLLOW_M = 0.25
LEAN_M = 0.12  # m, maximum distance over which a therapist's body follows a patient with a captured movement
LOWEST_PELVIS_M = 0.30  # m, minimum height above the floor of the pelvis of a therapist who crouches
# rad, change of the bend of finger joints that lays the fingers, which are curled in the rest pose, flat on skin
FLATTENING = -0.45
HELD_M = 0.005  # m; a hand counts as holding if its wrist is at most this far from its goal

PASSING_M = (0.6, 1.5)  # m, range of the distance between a camera and a person who passes it
BESIDE_M = 3.2  # m, distance from each end of a passer-by's path to its crossing with the line of sight
SLANTS_RAD = np.linspace(-0.6, 0.6, 25)  # rad, tried angles of the path; 0 = across the line of sight
CLEAR_M = 0.7  # m, intended distance of the path from the other cameras and from the patient
HALFWAY = (0.35, 0.65)  # range of the time at which a passer-by crosses the line of sight, as a share of the recording


@dataclass(frozen=True, slots=True, eq=False)
class Therapist:
    """A person in the room who is not the patient."""

    actor: Actor
    hold: Hold | None  # places that the hands hold; None = the person holds nothing

    def bones(self, times_s: np.ndarray, patient: Actor | CapturedActor, patient_bones: np.ndarray) -> np.ndarray:
        """Return T_world_rest (t, b, 4, 4) of every bone of the therapist. Hands that hold the patient move with the
        held bones. patient_bones (t, b, 4, 4): T_world_rest of the patient's bones.
        """
        if self.hold is None:
            return self.actor.bones(times_s)
        person = self.actor.person
        channels = self.actor.channels(times_s)
        place_m, normal = skin_points(patient.person, patient_bones, self.hold.vertices)
        # a patient with a captured movement may sit down, farther than the therapist's body can follow; so the
        # therapist's leaning and crouching are limited
        captured = isinstance(patient, CapturedActor)
        _follow(channels, self.hold, place_m, LEAN_M if captured else FARTHEST_FOLLOW_M)
        if captured:
            lowest = LOWEST_PELVIS_M - standing_pelvis_m(person.body)
            channels[CHANNEL_INDEX["pelvis_up"]] = channels[CHANNEL_INDEX["pelvis_up"]].clip(lowest)
        goals = _hand_goals(person, self.hold, place_m, normal)
        posture = posture_from(person.body, channels, self.actor.footwork, times_s, goals)
        return pose_bones(person.body, posture)

    def held_joints(
        self, times_s: np.ndarray, patient: Actor | CapturedActor, patient_bones: np.ndarray, bones: np.ndarray
    ) -> np.ndarray:
        """Return (t, 2) int: the patient's joint that each hand holds, -1 if it holds no joint, or cannot follow the
        joint.
        """
        if self.hold is None:
            return np.full((len(times_s), 2), -1)
        person, wrist_bones = self.actor.person, [self.actor.person.body.asset.bone(f"{side}Hand") for side in SIDES]
        goals = _hand_goals(person, self.hold, *skin_points(patient.person, patient_bones, self.hold.vertices))
        hands = bones[:, wrist_bones]
        wrists_m = rotate(hands[..., :3, :3], person.body.bone_heads[wrist_bones]) + hands[..., :3, 3]
        return np.where(np.linalg.norm(wrists_m - goals.wrist_m, axis=2) < HELD_M, self.hold.joints, -1)


def draw_therapists(
    rng: np.random.Generator, config: SimulationConfig, patient: Actor | CapturedActor
) -> tuple[Therapist, ...]:
    """Draw the configuration's number of therapists. At most two of them do a task on the patient; the others only walk
    by.
    """
    possible = tasks_on(patient, config)
    tasks = [task for name in config.therapist_tasks for task in possible if task.name == name]
    for index in rng.permutation(len(TASKS)):
        seat = config.stool or config.equipment == "wheelchair" or config.movement_file is None
        on_stool = seat and patient.sits() and TASKS[index].azimuth[0] > np.pi / 2.0
        if TASKS[index] in possible and not on_stool and all(_apart(TASKS[index], taken) for taken in tasks):
            tasks.append(TASKS[index])
    holding = min(config.therapists, 2, len(tasks))
    found = [_draw_holder(rng, config, patient, draw_person(rng, config.clothing_m), task) for task in tasks[:holding]]
    found += [
        _draw_passer(rng, config, draw_person(rng, config.clothing_m)) for _ in range(config.therapists - holding)
    ]
    return tuple(found)


def _apart(task: Task, other: Task) -> bool:
    """Return whether two therapists have enough space beside each other while they do these tasks."""
    gap = np.mean(task.azimuth) - np.mean(other.azimuth)
    return bool(abs((gap + np.pi) % (2.0 * np.pi) - np.pi) > 1.5)


def _draw_holder(
    rng: np.random.Generator, config: SimulationConfig, patient: Actor | CapturedActor, person: Person, task: Task
) -> Therapist:
    azimuth = rng.uniform(*task.azimuth)
    outward = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
    already_there = rng.random() < 0.25 or config.therapists_stay
    arrive_s = -5.0 if already_there else rng.uniform(0.1, 0.35) * config.seconds
    crouch_s, grasp_s = rng.uniform(0.8, 1.2), rng.uniform(0.5, 0.8)
    ready_s = arrive_s + crouch_s + grasp_s
    hold_from_s, patient_leaves_s = patient.stay_s(ready_s)
    leaves = rng.random() < 0.75 and not config.therapists_stay
    hold_until_s = max(hold_from_s, 0.0) + rng.uniform(0.3, 0.55) * config.seconds if leaves else 1e3
    hold_until_s = min(hold_until_s, patient_leaves_s)

    at_s = max(hold_from_s, 0.0)
    if isinstance(patient, CapturedActor):
        at_s = nearest_s(patient, task, outward, np.arange(min(at_s, config.seconds - 1.0), config.seconds, 0.2))
    hold = choose_hold(patient, task, -outward, at_s)
    base = resting_channels(person, in_frame=False)
    crouch, spot = choose_spot(person, base, hold)
    stays_s, waits_s = hold_until_s - arrive_s, hold_from_s - ready_s
    movements = [
        Movement(crouch_offsets(crouch), arrive_s - 0.2, crouch_s, stays_s, 1.0),
        grasp(arrive_s + crouch_s + waits_s, grasp_s, hold_until_s - hold_from_s, rng.uniform(0.4, 0.7)),
    ]
    footwork = _visit(rng, spot, azimuth + np.pi, arrive_s, hold_until_s + 1.2 if leaves else None)
    return Therapist(Actor(person, base, movements, footwork, draw_waves(rng)), hold)


def grasp(start_s: float, comes_s: float, holds_s: float, goes_s: float) -> Movement:
    """Return a movement that brings both hands to the patient, keeps them there with flat fingers, and removes them."""
    hands = (("pull_left", 1.0), ("pull_right", 1.0), ("fingers_left", FLATTENING), ("fingers_right", FLATTENING))
    return Movement(hands, start_s, comes_s, holds_s, goes_s)


def _draw_passer(rng: np.random.Generator, config: SimulationConfig, person: Person) -> Therapist:
    """Draw a person who walks through the room between the front camera and the patient, or behind the patient."""
    way = rng.choice([-1.0, 1.0])
    x = rng.uniform(1.1, 1.5) if rng.random() < 0.6 else -rng.uniform(0.8, 1.2)
    start, goal = np.array([x, -way * 2.2]), np.array([x + rng.uniform(-0.3, 0.3), way * 2.2])
    facing = yaw_towards(start, goal)
    start_s = rng.uniform(-0.2, 0.5) * config.seconds - 1.5
    return _walker(rng, person, walk(stand(start, facing, STANCE_M), goal, facing, start_s, STANCE_M))


def draw_passer_by(
    rng: np.random.Generator, config: SimulationConfig, cameras: tuple[Camera, ...], camera: int | None = None
) -> Therapist:
    """Draw a person who walks across the line from a camera to the patient, in the middle of the recording. camera:
    index of the camera; None = drawn.
    """
    person = draw_person(rng, config.clothing_m)
    chosen = cameras[int(rng.integers(len(cameras))) if camera is None else camera]
    towards = -chosen.position_m[[0, 2]]
    away_m = float(np.linalg.norm(towards))
    towards = towards / away_m
    crossing = chosen.position_m[[0, 2]] + min(rng.uniform(*PASSING_M), away_m - 1.0) * towards
    slant = rng.uniform(-0.25, 0.25)
    across = np.array([-towards[1], towards[0]]) * rng.choice([-1.0, 1.0])
    courses = np.cos(SLANTS_RAD)[:, None] * across + np.sin(SLANTS_RAD)[:, None] * towards
    others_m = np.array([other.position_m[[0, 2]] for other in cameras if other is not chosen]).reshape(-1, 2)
    course = courses[_clear_course(courses, crossing, others_m, slant)]
    start, goal = crossing - BESIDE_M * course, crossing + BESIDE_M * course
    facing = yaw_towards(np.zeros(2), course)
    standing = stand(start, facing, STANCE_M)
    start_s = rng.uniform(*HALFWAY) * config.seconds - 0.5 * walk_seconds(standing, goal, facing, STANCE_M)
    return _walker(rng, person, walk(standing, goal, facing, start_s, STANCE_M))


def _clear_course(courses: np.ndarray, crossing_m: np.ndarray, others_m: np.ndarray, slant: float) -> int:
    """Return the index of the path whose angle is nearest to ``slant``, among the paths that keep ``CLEAR_M`` away from
    the other cameras (k, 2) and the patient. If no path keeps this distance, return the index of the path that stays
    farthest away.

    courses (n, 2): unit directions (x, z) of the paths through ``crossing_m``, with the angles ``SLANTS_RAD``.
    """
    to_others = np.concatenate([others_m, np.zeros((1, 2))]) - crossing_m
    beside_m = np.abs(courses[:, :1] * to_others[:, 1] - courses[:, 1:] * to_others[:, 0]).min(axis=1)
    strayed = np.abs(SLANTS_RAD - slant)
    return int(np.argmin(np.where(beside_m >= CLEAR_M, strayed, 10.0 - beside_m)))


def _walker(rng: np.random.Generator, person: Person, footwork: Footwork) -> Therapist:
    """Return a person who only walks."""
    return Therapist(Actor(person, resting_channels(person, in_frame=False), [], footwork, draw_waves(rng)), None)


def _visit(
    rng: np.random.Generator, spot: np.ndarray, facing: float, arrive_s: float, leave_s: float | None
) -> Footwork:
    """Return steps that reach ``spot`` (x, z) from the side at ``arrive_s``, and leave at ``leave_s`` (None: never)."""
    outside = spot + rng.uniform(1.6, 2.2) * _sideways(rng, spot)
    standing = stand(outside, yaw_towards(outside, spot), STANCE_M)
    footwork = walk_until(standing, spot, facing, arrive_s, STANCE_M)
    if leave_s is None:
        return footwork
    exit_m = spot + rng.uniform(1.6, 2.2) * _sideways(rng, spot)
    return walk(footwork, exit_m, yaw_towards(spot, exit_m), leave_s, STANCE_M)


def _sideways(rng: np.random.Generator, spot: np.ndarray) -> np.ndarray:
    """Draw a horizontal direction (2,), x and z, from ``spot`` away from the patient, to the left or the right."""
    way = np.sign(spot[1]) if abs(spot[1]) > 0.35 else rng.choice([-1.0, 1.0])
    direction = np.array([np.sign(spot[0]) * rng.uniform(0.0, 0.5), way])
    return direction / np.linalg.norm(direction)


def crouch_offsets(crouch: float) -> tuple[tuple[str, float], ...]:
    """Return the channel offsets of a crouch, from 0 (standing) to 1 (deep, on raised heels)."""
    both = [("knee_out", 0.5 * crouch), ("heel", 0.9 * max(0.0, crouch - 0.3))]
    return (
        ("pelvis_up", -0.6 * crouch),
        ("pelvis_forward", -0.1 * crouch),
        ("pelvis_flex", 0.1 + 0.2 * crouch),
        ("trunk_flex", 0.2 + 0.35 * crouch),
        ("head_flex", 0.1 - 0.5 * crouch),
        *((f"{channel}_{side}", amount) for channel, amount in both for side in ("left", "right")),
    )


def choose_spot(person: Person, base: np.ndarray, hold: Hold) -> tuple[float, np.ndarray]:
    """Return the crouch (0 to 1) and the place (x, z) from which both hands reach the held places most comfortably."""
    shoulders, arm_m = _crouched_shoulders(person, base)
    across = np.cross(hold.facing, UP)
    offset = hold.places_m - hold.reference_m
    local = np.stack([offset @ hold.facing, hold.places_m[:, 1], offset @ across], axis=1)
    holds = local[None, None] + DISTANCES_M[None, :, None, None] * FORWARD
    reach = np.linalg.norm(holds - shoulders[:, None], axis=3)
    above_m = shoulders[..., 1].mean(axis=1) - hold.reference_m[1] - SHOULDERS_ABOVE_HOLD_M
    strain = np.maximum(reach.max(axis=2) - COMFORTABLE_REACH * arm_m, 0.0)
    crowding = np.maximum(COMFORTABLE_REACH * arm_m - reach.mean(axis=2), 0.0)
    best = np.unravel_index(np.argmin(5.0 * strain + crowding + 0.5 * np.abs(above_m)[:, None]), strain.shape)
    spot = hold.reference_m - DISTANCES_M[best[1]] * hold.facing
    return float(CROUCHES[best[0]]), spot[[0, 2]]


def _crouched_shoulders(person: Person, base: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the shoulders (c, 2, 3) at each depth of the crouch, of a therapist at the origin who faces +X; and the
    length of the arm.
    """
    asset, body = person.body.asset, person.body
    crouching = [Movement(crouch_offsets(crouch), LONG_AGO_S, 1.0, 1e3, 1.0) for crouch in CROUCHES]
    channels = np.concatenate([channel_values(base, [movement], np.zeros(1)) for movement in crouching], axis=1)
    times_s = np.zeros(len(CROUCHES))
    footwork = stand(np.zeros(2), 0.0, STANCE_M)
    bones = pose_bones(body, posture_from(body, channels, footwork, times_s, HandGoals.none(len(times_s))))
    arms = [asset.bone(f"{side}Arm") for side in SIDES]
    moved = bones[:, arms]
    chain = [body.bone_heads[asset.bone(name)] for name in ("LeftArm", "LeftForeArm", "LeftHand")]
    arm_m = float(np.linalg.norm(chain[1] - chain[0]) + np.linalg.norm(chain[2] - chain[1]))
    return rotate(moved[..., :3, :3], body.bone_heads[arms]) + moved[..., :3, 3], arm_m


def _follow(channels: np.ndarray, hold: Hold, place_m: np.ndarray, farthest_m: float) -> None:
    """Change ``channels`` so that the therapist's pelvis shifts as the held places (t, 2, 3) on the patient move."""
    pull = channels[CHANNEL_INDEX["pull_left"]]
    moved = (FOLLOW * (place_m.mean(axis=1) - hold.reference_m)).clip(-farthest_m, farthest_m)
    channels[CHANNEL_INDEX["pelvis_up"]] += pull * moved[:, 1]
    channels[CHANNEL_INDEX["pelvis_forward"]] += pull * (moved @ hold.facing)
    channels[CHANNEL_INDEX["pelvis_right"]] += pull * (moved @ np.cross(hold.facing, UP))


def _hand_goals(person: Person, hold: Hold, place_m: np.ndarray, normal: np.ndarray) -> HandGoals:
    """Return the hands' goals: palms flat on the held skin, and fingers that point away from the therapist and upwards.

    place_m, normal (t, 2, 3): held places on the skin and their normals.
    """
    wrists, turns = np.zeros_like(place_m), np.zeros((*place_m.shape, 3))
    for side in (0, 1):
        along, palm = finger_direction(person.body, side), palm_normal(person.body, side)
        asset, heads = person.body.asset, person.body.bone_heads
        name = SIDES[side]
        palm_m = np.linalg.norm(heads[asset.bone(f"{name}FingerBase")] - heads[asset.bone(f"{name}Hand")])
        n = normal[:, side]
        wanted = hold.facing + 0.5 * UP
        fingers = unit(wanted - (n @ wanted)[:, None] * n)
        turns[:, side] = orthonormal_frame(fingers, -n) @ orthonormal_frame(along, palm).T
        wrists[:, side] = place_m[:, side] + PALM_ABOVE_BONE_M * n - palm_m * fingers
    return HandGoals(wrists, turns)
