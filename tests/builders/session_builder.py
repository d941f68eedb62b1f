"""Sessions made up for the tests of measures: a stick figure that stands, sits, sways and is touched as asked for."""

from dataclasses import replace

import numpy as np
from results_builder import standing_joints

from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES, LOST
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.measuring import MeasureConfig, measure_session
from anchorpose.results.records import Contact, Measure
from anchorpose.results.stand_training.stance import Session
from anchorpose.results.tables import JointTable

RATE = 20.0


def squatting_joints(thigh_deg: np.ndarray, shank_deg: np.ndarray | float = 0.0) -> np.ndarray:
    """(n, 21, 3): feet on the ground, thighs leant back by so much from the vertical, shanks forward; trunk upright."""
    thigh, shank = np.broadcast_arrays(np.radians(thigh_deg), np.radians(shank_deg))
    rest = standing_joints()
    lift = {name: np.zeros((len(thigh), 3)) for name in ("knee", "above")}
    lengths = {  # of the stick figure's shank and thigh
        "shank": rest[JOINT_INDEX["KneeLeft"], 1] - rest[JOINT_INDEX["AnkleLeft"], 1],
        "thigh": rest[JOINT_INDEX["HipLeft"], 1] - rest[JOINT_INDEX["KneeLeft"], 1],
    }
    lift["knee"][:, 0] = lengths["shank"] * np.sin(shank)
    lift["knee"][:, 1] = lengths["shank"] * (np.cos(shank) - 1.0)
    lift["above"] = lift["knee"].copy()
    lift["above"][:, 0] -= lengths["thigh"] * np.sin(thigh)
    lift["above"][:, 1] += lengths["thigh"] * (np.cos(thigh) - 1.0)
    joints = np.repeat(rest[None], len(thigh), axis=0)
    for row, name in enumerate(JOINT_NAMES):
        if name.startswith("Knee"):
            joints[:, row] += lift["knee"]
        elif not name.startswith(("Ankle", "Foot")):
            joints[:, row] += lift["above"]
    return joints


def table(position_m: np.ndarray, sigma_m: float = 0.005, lost: dict[str, slice] | None = None) -> JointTable:
    """Joints (n, 21, 3) at ``RATE`` frames a second; all seen but the lost ones."""
    frames = len(position_m)
    position, sigma = position_m.copy(), np.full((frames, JOINT_COUNT), sigma_m)
    state_code = np.zeros((frames, JOINT_COUNT), np.int8)
    for name, when in (lost or {}).items():
        position[when, JOINT_INDEX[name]], sigma[when, JOINT_INDEX[name]] = np.nan, np.nan
        state_code[when, JOINT_INDEX[name]] = LOST
    return JointTable(np.arange(frames, dtype=np.int32), np.arange(frames) / RATE, position, state_code, sigma)


def measured(
    joints: JointTable, contacts: tuple[Contact, ...] | None = (), equipment: tuple[str, ...] = ()
) -> tuple[Session, dict[tuple[str | None, ...], Measure]]:
    """The session, and its measures by name, side, part and person."""
    session, measures = measure_session(joints, joint_angles(joints), contacts, MeasureConfig(), equipment=equipment)
    found = {(m.measure, m.side, m.part, m.person): m for m in measures}
    assert len(found) == len(measures)  # no row is there twice
    return session, found


def value(found: dict[tuple[str | None, ...], Measure], name: str, side: str | None = None) -> float:
    """A measure of the whole session that must have a value."""
    number = found[name, side, None, None].value
    assert number is not None
    return number


def why(found: dict[tuple[str | None, ...], Measure], name: str, side: str | None = None) -> str:
    """The reason for which a measure of the whole session has no value."""
    row = found[name, side, None, None]
    assert row.value is None, name
    return str(row.why or "")


def contact(part: str, person: str, first: int, last: int, seen: float = 1.0) -> Contact:
    """Touched by a person from one frame to another, both included."""
    return Contact(
        part=part,
        person=person,
        first_frame=first,
        last_frame=last,
        start_s=first / RATE,
        end_s=last / RATE,
        seen_share=seen,
        area_cm2=30.0,
        gap_mm=5.0,
    )


def support(part: str, equipment: str, first: int, last: int, seen: float = 1.0) -> Contact:
    """Touched by a part of the equipment from one frame to another, both included."""
    return replace(contact(part, "", first, last, seen), person=None, with_=equipment)
