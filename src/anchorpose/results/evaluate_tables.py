"""Contacts against the truth, frame by frame and part by part.

How far the joint angles are from those of the true joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anchorpose.body.contact_regions import REGION_BONES, REGIONS
from anchorpose.errors import InputError
from anchorpose.results.kinematics.joint_angles import joint_angles
from anchorpose.results.records import Contact
from anchorpose.results.tables import JointTable
from anchorpose.results.uncertainty import NORMAL_95


@dataclass(frozen=True, slots=True, eq=False)
class TrueTouch:
    """bones (t, b) bool: in each frame the bones whose skin somebody touches; names (b) of the bones."""

    bones: np.ndarray
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactScore:
    """How well contacts were found; None where there is nothing to take the share of.

    precision: of the reported parts times frames, the share in which a bone of that part is touched. recall: of the
    touched parts times frames, the share in which the part, or one that shares a bone with it, is reported: the truth
    tells bones, so that a knee held from both sides is a touched thigh and a touched shank.
    """

    reported: int  # parts times frames
    touched: int
    precision: float | None
    recall: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactEvaluation:
    """All parts together, and each part that was touched or reported."""

    overall: ContactScore
    per_part: tuple[tuple[str, ContactScore], ...]


def read_true_touch(path: Path) -> TrueTouch | None:
    """What a truth.npz says of contacts: ``touched`` (t, b) and ``part_names`` (b); None where it says nothing.

    Raises InputError where the two do not fit each other, or no bone is one of the body's.
    """
    with np.load(path, allow_pickle=False) as file:
        if "touched" not in file.files or "part_names" not in file.files:
            return None
        touched, names = file["touched"], tuple(str(name) for name in file["part_names"])
        times = len(file["time"])
    known = {bone for bones in REGION_BONES.values() for bone in bones}
    if touched.shape != (times, len(names)) or not known & set(names):
        raise InputError(path, "its touched and part_names do not fit", "give touched (t, b) and part_names (b)")
    return TrueTouch(touched.astype(bool), names)


def evaluate_contacts(contacts: Sequence[Contact], frame: np.ndarray, truth: TrueTouch) -> ContactEvaluation:
    """The contacts of a result; frame (t,): number of the result's frame at each frame of the truth."""
    holds = np.array([[name in bones for name in truth.names] for bones in REGION_BONES.values()])  # (regions, bones)
    own = np.array([not name.startswith("knee") for name in REGIONS])  # parts that the truth's bones tell apart
    touched = (truth.bones[:, None, :] & holds).any(axis=2)
    reported = np.zeros_like(touched)
    for contact in contacts:
        reported[(frame >= contact.first_frame) & (frame <= contact.last_frame), REGIONS.index(contact.part)] = True
    akin = (holds[:, None, :] & holds).any(axis=2)
    found = (reported[:, None, :] & akin).any(axis=2)
    due = touched & own
    scores = [(name, _score(reported[:, k], touched[:, k], due[:, k], found[:, k])) for k, name in enumerate(REGIONS)]
    return ContactEvaluation(
        overall=_score(reported, touched, due, found),
        per_part=tuple((name, score) for name, score in scores if score.reported or score.touched),
    )


def _score(reported: np.ndarray, touched: np.ndarray, due: np.ndarray, found: np.ndarray) -> ContactScore:
    return ContactScore(
        reported=int(reported.sum()),
        touched=int(due.sum()),
        precision=float((reported & touched).sum() / reported.sum()) if reported.any() else None,
        recall=float((due & found).sum() / due.sum()) if due.any() else None,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleError:
    """Of one angle; None where no frame has both it and its truth."""

    frames: int
    mean_abs_deg: float | None
    p95_deg: float | None
    coverage_95: float | None  # share of frames in which the truth lies within 1.96 sigma; honest is 0.95


def angle_errors(joints: JointTable, truth_m: np.ndarray) -> tuple[tuple[str, AngleError], ...]:
    """Each angle's error; truth_m (n, 21, 3) true joints, metres, of the frames of ``joints``, NaN where unknown."""
    found = joint_angles(joints)
    exact = np.zeros_like(joints.sigma_m)
    true = joint_angles(JointTable(joints.frame, joints.time_s, truth_m, joints.state_code, exact))
    away = np.radians(found.degrees - true.degrees)
    error = np.degrees(np.abs(np.arctan2(np.sin(away), np.cos(away))))
    within = error <= NORMAL_95 * found.sigma_deg
    return tuple((name, _summary(error[:, column], within[:, column])) for column, name in enumerate(found.names))


def _summary(error_deg: np.ndarray, within: np.ndarray) -> AngleError:
    known, covered = error_deg[np.isfinite(error_deg)], within[np.isfinite(error_deg)]
    some = len(known) > 0
    return AngleError(
        frames=len(known),
        mean_abs_deg=float(known.mean()) if some else None,
        p95_deg=float(np.percentile(known, 95)) if some else None,
        coverage_95=float(covered.mean()) if some else None,
    )
