"""Build the equipment that a configuration names, and fit it around the patient and their movements."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.equipment import EquipmentPart
from anchorpose.simulate.aids import (
    WIDEST_M,
    HeldEquipment,
    Sweep,
    build_stool,
    fit_chest_pad,
    fit_parallel_bars,
    fit_sling,
    fit_standing_frame,
    fit_walker,
    fit_wheelchair,
    sweep_of,
)
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.patient import LONG_AGO_S, STANCE_M, Actor, resting_channels, seated_offsets
from anchorpose.simulate.person import Person
from anchorpose.simulate.retarget import CapturedActor
from anchorpose.simulate.timeline import Movement, ball_ahead_m, stand, standing_pelvis_m

SWEEP_HZ = 5.0  # Hz, rate at which the patient's movement is sampled to find the space that it needs
STOOL_HALF_M = 0.20  # m, distance of a stool's middle from the standing patient's legs: half its depth plus a margin
CEILING_M = 2.65  # m, height of the ceiling from which a sling hangs
BELOW_NECK_M = 0.15  # m, distance from the joint SpineShoulder down to the middle of the sternum
HELD = ("standing-frame", "parallel-bars", "walker")  # kinds of equipment that the patient holds


def fit_held(rng: np.random.Generator, config: SimulationConfig, person: Person) -> HeldEquipment | None:
    """Build the equipment that the patient's hands hold, fitted to the upright patient. Return None if the hands hold
    no equipment.
    """
    if config.equipment not in HELD:
        return None
    sweep = sweep_of(person, _posed(person).bones(np.zeros(1)))
    if config.equipment == "walker":
        return fit_walker(rng, sweep, _handle_m(person))
    return _fit_frame(rng, config, person, sweep, _trunk_half_width_m(person, sweep))


def fit_around(
    rng: np.random.Generator, config: SimulationConfig, patient: Actor | CapturedActor, held: HeldEquipment | None
) -> tuple[EquipmentPart, ...]:
    """Return all equipment: the parts of ``held``, and parts that are fitted to the patient's whole movement.

    held: result of ``fit_held``; None for a captured movement, to which all equipment is fitted.
    """
    parts = () if held is None else held.parts
    captured = isinstance(patient, CapturedActor)
    if config.equipment != "none" and (captured or config.equipment not in HELD or config.chest_pad):
        times_s = np.arange(0.0, config.seconds, 1.0 / SWEEP_HZ)
        parts += _fit_swept(rng, config, patient, sweep_of(patient.person, patient.bones(times_s)), captured)
    if config.stool and config.equipment != "wheelchair" and patient.sits():
        parts += _fitted_stool(rng, patient)
    return parts


def _fit_swept(
    rng: np.random.Generator, config: SimulationConfig, patient: Actor | CapturedActor, sweep: Sweep, captured: bool
) -> tuple[EquipmentPart, ...]:
    person = patient.person
    joints_m = person.body.rest_joints()
    sternum_m = float(joints_m[JOINT_INDEX["SpineShoulder"], 1]) - BELOW_NECK_M
    match config.equipment:
        case "wheelchair":
            return fit_wheelchair(rng, sweep, patient.sits())
        case "sling":
            return fit_sling(rng, sweep, sternum_m, CEILING_M)
        case "walker":
            return fit_walker(rng, sweep, _handle_m(person)).parts
    parts: tuple[EquipmentPart, ...] = ()
    rail_m, half_m = standing_pelvis_m(person.body), _trunk_half_width_m(person, sweep)
    if captured:
        frame = _fit_frame(rng, config, person, sweep, _arms_half_width_m(sweep, rail_m, half_m))
        parts, rail_m, half_m = frame.parts, float(frame.grip_m[0, 1]), float(frame.grip_m[1, 2])
    if config.chest_pad:
        parts += fit_chest_pad(rng, sweep, sternum_m, rail_m - 0.02, half_m)
    return parts


def _fit_frame(
    rng: np.random.Generator, config: SimulationConfig, person: Person, sweep: Sweep, half_width_m: float
) -> HeldEquipment:
    """Build parallel bars or a standing frame outside the space through which legs and belly move."""
    pelvis_m = standing_pelvis_m(person.body)
    if config.equipment == "parallel-bars":
        return fit_parallel_bars(rng, pelvis_m=pelvis_m, half_width_m=half_width_m)
    knee_m = _knee_m(person)
    front = sweep.within(knee_m - 0.1, 1.2)[:, 0]
    return fit_standing_frame(
        rng, pelvis_m=pelvis_m, knee_m=knee_m, front_m=float(front.max()), half_width_m=half_width_m
    )


def _trunk_half_width_m(person: Person, sweep: Sweep) -> float:
    """Return the half width of a frame: the largest distance of trunk or legs from z = 0, plus space for an arm."""
    return float(np.abs(sweep.within(_knee_m(person) - 0.1, np.inf)[:, 2]).max()) + 0.14


def _arms_half_width_m(sweep: Sweep, rail_m: float, least_m: float) -> float:
    """Return the half width, ``least_m`` to ``WIDEST_M``, of a frame with space for arms that move at rail height."""
    arms = np.abs(sweep.within(rail_m - 0.12, rail_m + 0.12, arms=True)[:, 2])
    return float(np.clip(arms.max() + 0.05, min(least_m, WIDEST_M), WIDEST_M))


def _knee_m(person: Person) -> float:
    return float(person.body.bone_heads[person.body.asset.bone("LeftLeg"), 1])


def _handle_m(person: Person) -> float:
    """Return the height of a walker's handles: the height of the wrists of hanging arms, slightly below the hips."""
    return 0.96 * standing_pelvis_m(person.body)


SEAT_BONES: Final = ("Hips", "LHipJoint", "RHipJoint", "LeftUpLeg", "RightUpLeg")
"""Names of the bones whose skin rests on the seat when a patient sits."""


def _fitted_stool(rng: np.random.Generator, patient: Actor | CapturedActor) -> tuple[EquipmentPart, ...]:
    """Build a stool under the seated patient, with its top at the lowest skin of the buttocks."""
    person, foremost_m = patient.person, np.inf
    if isinstance(patient, CapturedActor):
        bones = patient.bones(patient.lowest_s())[0]
        upright = sweep_of(person, patient.bones(patient.highest_s())).within(0.1, 0.6)
        foremost_m = float(upright[:, 0].min()) - STOOL_HALF_M
    else:
        seated = Movement(seated_offsets(person), LONG_AGO_S, 1.0, 1e3, 1.0)
        bones = Actor(person, patient.base, [seated], patient.footwork, ()).bones(np.zeros(1))[0]
    skin = person.skin(bones, 0.0)
    hips_m = bones[0, :3, :3] @ person.body.bone_heads[0] + bones[0, :3, 3]
    center = (min(float(hips_m[0] + 0.02), foremost_m), float(hips_m[2]))
    above = (np.abs(skin[:, 0] - center[0]) < 0.2) & (np.abs(skin[:, 2] - center[1]) < 0.2)
    # only skin of these bones counts, since heels under the seat would lower the seat
    above &= np.isin(np.array(person.body.asset.bone_names)[person.body.asset.main_bone()], SEAT_BONES)
    return build_stool(rng, center, float(skin[above, 1].min()) + 0.01)


def _posed(person: Person) -> Actor:
    """Return the person standing still at the origin, the posture to which held equipment is fitted."""
    feet = stand(np.array([ball_ahead_m(person.body), 0.0]), 0.0, STANCE_M)
    return Actor(person, resting_channels(person, False), [Movement((), LONG_AGO_S, 1.0, 1e3, 1.0)], feet, ())
