"""Compute the truth of a session: its trials, and its incidents with time, side and depth."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from anchorpose.body.kinematics import BodyMesh
from anchorpose.joints import JOINT_INDEX
from anchorpose.rotations import unit
from anchorpose.simulate.sessions.patient import CLONUS_S, Happening, SessionPatient
from anchorpose.simulate.sessions.plan import PlannedTrial

TRUTH_HZ: Final = 100.0  # Hz, rate at which movements are sampled to measure an incident
GRAVITY_M_S2: Final = 9.81
SOLE_M: Final = 0.03  # m; skin, or a shoe's sole, below this height counts as on the floor
_TURN: Final = np.radians(np.arange(0.0, 360.0, 5.0))
# (2, 72) directions in which the extent of the soles is measured
DIRECTIONS: Final = np.stack([np.cos(_TURN), np.sin(_TURN)])


@dataclass(frozen=True, slots=True)
class TrueEvent:
    """An incident with its true depth."""

    kind: str  # knee_buckle, recovery_step or clonus, each with _left or _right; or failed_stand
    start_s: float  # onset of the incident
    end_s: float  # time of greatest depth of a buckle or failed stand, foot strike of a recovery step, end of a clonus
    # depth of the incident, in ``unit``: of a buckle, the bend in degrees; of a clonus, the amplitude in degrees; of a
    # failed stand, the share of the way from the seat to straight legs; of a recovery step, the greatest distance in mm
    # of the extrapolated centre of mass beyond the soles before the step
    depth: float
    unit: str


def true_events(patient: SessionPatient) -> tuple[TrueEvent, ...]:
    """Return each of the patient's incidents, with its depth measured on the patient's bones."""
    return tuple(_event(patient, happening) for happening in patient.happenings)


def _event(patient: SessionPatient, happening: Happening) -> TrueEvent:
    start_s, end_s = happening.start_s, happening.end_s
    match happening.kind.rsplit("_", 1)[0]:
        case "knee_buckle":
            before_deg, deepest_deg = _knee_deg(patient, str(happening.side), np.array([start_s, end_s]))
            return TrueEvent(happening.kind, start_s, end_s, float(deepest_deg - before_deg), "deg")
        case "clonus":
            times_s = np.arange(start_s, start_s + CLONUS_S, 1.0 / TRUTH_HZ)
            depth_deg = 0.5 * float(np.ptp(_knee_deg(patient, str(happening.side), times_s)))
            return TrueEvent(happening.kind, start_s, end_s, depth_deg, "deg")
        case "recovery_step":
            lost_s, beyond_m = _loss_of_balance(patient, start_s, end_s)
            return TrueEvent(happening.kind, lost_s, end_s, 1000.0 * beyond_m, "mm")
        case _:
            return TrueEvent(happening.kind, start_s, end_s, _risen(patient, start_s, end_s), "1")


def _joints(patient: SessionPatient, times_s: np.ndarray) -> dict[str, np.ndarray]:
    """Return the positions (t, 3) of each joint by its name."""
    body: BodyMesh = patient.person.body
    joints_m = np.array([body.joints(bones) for bones in patient.bones(times_s)])
    return {name: joints_m[:, index] for name, index in JOINT_INDEX.items()}


def _knee_deg(patient: SessionPatient, side: str, times_s: np.ndarray) -> np.ndarray:
    """Return the knee's flexion (t,) in degrees, 0 = straight."""
    joints, side = _joints(patient, times_s), side.capitalize()
    hip, knee, ankle = (joints[f"{name}{side}"] for name in ("Hip", "Knee", "Ankle"))
    cosine = (unit(knee - hip) * unit(ankle - knee)).sum(axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _risen(patient: SessionPatient, seated_s: float, highest_s: float) -> float:
    """Return the rise of the pelvis as a share of the way from the seat to straight legs."""
    joints = _joints(patient, np.array([seated_s, highest_s]))
    sides = ("Left", "Right")
    height_m = np.mean([joints[f"Hip{s}"] - joints[f"Ankle{s}"] for s in sides], axis=0)[:, 1]
    bones = [joints[f"{a}{s}"] - joints[f"{b}{s}"] for s in sides for a, b in (("Hip", "Knee"), ("Knee", "Ankle"))]
    leg_m = float(np.linalg.norm(bones, axis=2).sum(axis=0)[0]) / len(sides)
    return float((height_m[1] - height_m[0]) / (leg_m - height_m[0]))


def _loss_of_balance(patient: SessionPatient, falls_s: float, strikes_s: float) -> tuple[float, float]:
    """Return the time at which the extrapolated centre of mass leaves the convex outline around both soles, and its
    greatest distance beyond this outline before the foot that makes the recovery step leaves the floor.

    The centre of mass is the body's centre of volume, extrapolated as in Hof et al. 2005
    (doi:10.1016/j.jbiomech.2004.03.025).
    """
    step = next(step for step in patient.footwork.steps if step.start_s > falls_s)
    times_s = np.arange(falls_s - 0.2, step.start_s + 1.5 / TRUTH_HZ, 1.0 / TRUTH_HZ)
    skins = [patient.person.skin(bones, 0.0).astype(np.float64) for bones in patient.bones(times_s)]
    mass_m = np.array([_centre_of_volume(skin, patient.person.body.asset.faces) for skin in skins])
    sole = skins[0][skins[0][:, 1] < SOLE_M][:, [0, 2]]
    frequency = np.sqrt(GRAVITY_M_S2 / mass_m[0, 1])
    carried_m = (mass_m + np.gradient(mass_m, times_s, axis=0) / frequency)[:, [0, 2]]
    beyond_m = (carried_m @ DIRECTIONS - (sole @ DIRECTIONS).max(axis=0)).max(axis=1)
    inside = np.flatnonzero(beyond_m <= 0.0)
    return float(times_s[min(int(inside[-1]) + 1, len(times_s) - 1)]), float(beyond_m.max())


def _centre_of_volume(skin_m: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the centre of volume (3,) of a closed surface, by its tetrahedra."""
    a, b, c = (skin_m[faces[:, k]] for k in range(3))
    volume = (a * np.cross(b, c)).sum(axis=1)
    return np.asarray((volume[:, None] * (a + b + c)).sum(axis=0) / (4.0 * volume.sum()))


def truth_arrays(plan: Sequence[PlannedTrial], patient: SessionPatient) -> dict[str, Any]:
    """Return the arrays that truth.npz contains only if the recording is a session."""
    events = true_events(patient)
    return {
        "event_kind": np.array([event.kind for event in events], dtype=np.str_),
        "event_unit": np.array([event.unit for event in events], dtype=np.str_),
        **{f"event_{name}": np.array([getattr(e, name) for e in events]) for name in ("start_s", "end_s", "depth")},
        "trial_condition": np.array([trial.condition for trial in plan]),
        **{f"trial_{name}": np.array([getattr(trial, name) for trial in plan]) for name in _OF_TRIALS},
    }


_OF_TRIALS: Final = ("onset_s", "duration_s", "amplitude_v", "block", "helped", "hands_off", "held_deg")


def events_table(plan: Sequence[PlannedTrial]) -> str:
    """Return the text of events.tsv, in the format of ``anchorpose record``, with each trial's amplitude and block."""
    rows = ["onset\tduration\ttrial_type\tamplitude\tblock"]
    rows += [f"{t.onset_s:.4f}\t{t.duration_s:.4f}\t{t.condition}\t{t.amplitude_v:g}\t{t.block}" for t in plan]
    return "\n".join(rows) + "\n"


def units_of_events() -> str:
    """Return the text of events.json."""
    return json.dumps({"amplitude": {"Units": "V", "Description": "amplitude of the stimulator"}}, indent=1) + "\n"
