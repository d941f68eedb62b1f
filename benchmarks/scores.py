"""Score a tracked recording: compare its results with the truth, labels or instruments, and return scores by name."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from recordings import Ready

from anchorpose.body.learning import BONES
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.recording.recording import Recording
from anchorpose.research.benchmark.labels import (
    LABELLERS,
    LabelledPerson,
    apart_m,
    off_m,
    place_of,
    read_label_set,
    read_labels,
    shift_m,
    trunk_pixel,
    within,
)
from anchorpose.results.contact_scores import ContactScore
from anchorpose.results.evaluate import Evaluation, evaluate
from anchorpose.results.run_record import RUN_FILE, read_run
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.results.uncertainty import NORMAL_95
from anchorpose.rotations import unit
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.preparation import settle

Scores = dict[str, float]
"""Scores by name (``table.COLUMNS``). A score that does not apply is absent; one that could not be measured is NaN."""

SKIP_S: Final = 1.0  # s at the start that are not scored: tracking may settle
LABELS: Final = Path(__file__).parent / "labels"
NAN: Final = float("nan")

SEEN: Final = 0.5  # least share of the skin around a joint that faces the camera, for the joint to be in plain view
PLAIN: Final = 0.6  # least share of the joints of trunk and head in plain view, for the patient to be in plain view
RIGHT_M, WRONG_M, FAR_M = 0.10, 0.15, 0.10
FAR_SIGMAS: Final = 4.0
TRUNK: Final = [JOINT_INDEX[name] for name in ("SpineMid", "SpineShoulder", "Head", "ShoulderLeft", "ShoulderRight")]

TRACKED: Final = 0.5  # least share of the joints that are not lost, for a person to be tracked
NEAR_M: Final = 3.5  # a person farther from the camera need not be tracked
REACHES_M: Final = {"within_60": 0.06, "within_100": 0.10}
AT_REST: Final = 4  # number of frames at the start or end in which the thigh rests, as in the script ``INSTRUMENT``
TILTED_DEG: Final = 10.0  # smaller tilts are left out: an angle is never negative, so near rest its error has no sign
INSTRUMENT: Final = Path(__file__).resolve().parents[2] / "shared" / "tools" / "utd_mhad.py"


def against_truth(ready: Ready, results: Path) -> Scores:
    """Compare the results with the simulator's truth, after the first second."""
    assert ready.truth is not None
    found = evaluate(results, ready.truth, SKIP_S)
    contacts = {} if found.contacts is None else contact_scores(found.contacts.overall)
    return _scores_of(found) | contacts | _bone_scores(ready.truth, results)


def contacts_by_part(ready: Ready, results: Path) -> Iterator[tuple[str, Scores]]:
    """Yield precision and recall, by frame, of contacts with people and with equipment: for all contacts, for each
    state, and for each body part that was touched or reported as touched."""
    assert ready.truth is not None
    evaluation = evaluate(results, ready.truth, SKIP_S)
    for prefix, found in (("", evaluation.contacts), ("equipment: ", evaluation.supports)):
        if found is not None:
            yield f"{prefix}all parts", contact_scores(found.overall)
            yield from ((f"{prefix}{state} alone", contact_scores(score)) for state, score in found.per_state)
            yield from ((f"{prefix}{part}", contact_scores(score)) for part, score in found.per_part)


def _scores_of(found: Evaluation) -> Scores:
    wrong_s = [wrong.seconds for _, wrong in found.wrong_in_view]
    return {
        "mean_mm": _number(found.overall.mean_mm),
        "p95_mm": _number(found.overall.p95_mm),
        "hidden_mm": _number(found.hidden.mean_mm),
        "confident": _number(found.confident_errors),
        "cover_seen": _number(found.observed.coverage_95),
        "cover_hidden": _number(found.hidden.coverage_95),
        "lost": _number(found.overall.lost_share),
        "wrong_s": max(wrong_s, default=NAN) if found.view_known else NAN,
    }


def contact_scores(score: ContactScore) -> Scores:
    """Return precision and recall, and the counts (parts times frames) whose sums give both for several recordings."""
    right = 0.0 if score.precision is None else score.precision * score.reported
    found = 0.0 if score.recall is None else score.recall * score.touched
    counts = {"reported": score.reported, "reported_right": right, "touched": score.touched, "touched_found": found}
    return counts | {"precision": _number(score.precision), "recall": _number(score.recall)}


def _bone_scores(truth: Path, results: Path) -> Scores:
    """Return the median error of the learnt lengths of limb bones, and the share of lengths within 1.96 sigma."""
    body = read_run(results / RUN_FILE)["body"]
    if body is None:
        return {}
    with np.load(truth) as file:
        joints_m, names = file["joints"][0], [str(name) for name in file["names"]]
    learnt = {bone["bone"]: (bone["length_m"], bone["sigma_m"]) for bone in body["bones"]}
    rows = []
    for name, start, end in BONES:
        true_m = np.linalg.norm(joints_m[names.index(end)] - joints_m[names.index(start)])
        if name in learnt and np.isfinite(true_m):
            rows.append((abs(learnt[name][0] - true_m), learnt[name][1]))
    if not rows:
        return {}
    off, sigma = np.array(rows).T
    return {"bone_mm": 1e3 * float(np.median(off)), "bone_cover": float(np.mean(off < NORMAL_95 * sigma))}


def _number(value: float | None) -> float:
    return NAN if value is None else float(value)


# One camera whose pose is unknown: joints are compared in the camera's frame.


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The truth in one camera's coordinates. joints_m: (t, 21, 3); seen, plain: (t, 21) and (t,) bool, whether each
    joint and the patient are in plain view.
    """

    joints_m: np.ndarray
    seen: np.ndarray
    plain: np.ndarray
    time_s: np.ndarray


def view_of(truth: Path) -> View:
    """Return the truth of a recording by one camera, in this camera's coordinates."""
    with np.load(truth) as file:
        T_world_camera, joints_m, share, time_s = (
            file[key] for key in ("camera_to_world", "joints", "seen_share", "time")
        )
    plain = (share[:, TRUNK].max(axis=2) > SEEN).mean(axis=1) >= PLAIN
    return View(transform_points(invert_rigid(T_world_camera[0]), joints_m), share.max(axis=2) > SEEN, plain, time_s)


def name_patient(ready: Ready) -> dict[str, Any] | None:
    """Return the settings with which a user would point out the patient, in the first frame in which the patient is in
    plain view; None without such a frame.
    """
    assert ready.truth is not None
    view = view_of(ready.truth)
    if not view.plain.any():
        return None
    recording, first = open_recording(ready.recording), int(np.argmax(view.plain))
    camera = settle(recording, TrackConfig()).calibration.cameras[0]
    x, _, z = transform_points(camera.require_pose(), view.joints_m[first, JOINT_INDEX["SpineBase"]]).tolist()
    return {"patient_xz_m": (x, z), "patient_frame": int(recording.streams[0].frame[first])}


def in_a_room(ready: Ready, results: Path) -> Scores:
    """Score the first pose, and the frames in which a patient is in plain view, for a recording by one camera.

    right: in some frame of the first second of plain view, every joint in plain view is within 100 mm of the truth.
    accepted_wrong: joints are reported in the first second of plain view, and in each of its frames the mean error of
    the joints in plain view is over 150 mm.
    """
    assert ready.truth is not None
    view, table = view_of(ready.truth), read_joints(results / JOINTS_FILE)
    off, rows = np.linalg.norm(_in_camera(table, results) - view.joints_m[table.frame], axis=2), table.frame
    seen, plain, time_s = view.seen[rows], view.plain[rows], view.time_s[rows]
    if not plain.any():
        return {}
    began_s = time_s[int(np.argmax(plain))]
    second = np.flatnonzero((time_s >= began_s) & (time_s <= began_s + 1.0) & plain)
    means = [float(np.nanmean(off[k][seen[k]])) for k in second if np.isfinite(off[k][seen[k]]).any()]
    known = np.isfinite(off) & plain[:, None]
    far = known & (off > FAR_M) & (off > FAR_SIGMAS * np.sqrt(3.0) * np.nan_to_num(table.sigma_m, nan=np.inf))
    return {
        "right": float(any(bool((off[k][seen[k]] < RIGHT_M).all()) for k in second)),  # a lost joint (NaN) is not right
        "accepted_wrong": float(bool(means) and min(means) > WRONG_M),
        "mean_mm": _mean_mm(off[known]),
        "p95_mm": 1e3 * float(np.percentile(off[known], 95)) if known.any() else NAN,
        "confident": float(far.sum() / max(1, known.sum())),
        "lost": float(np.isnan(off[plain]).mean()),
    }


def not_found() -> Scores:
    """Return the scores of a room whose recording was refused: nothing right, everything lost."""
    return {"right": 0.0, "accepted_wrong": 0.0, "lost": 1.0}


def _mean_mm(off_m_: np.ndarray) -> float:
    return 1e3 * float(off_m_.mean()) if off_m_.size else NAN


def _in_camera(table: JointTable, results: Path) -> np.ndarray:
    pose = np.array(read_run(results / RUN_FILE)["cameras"][0]["camera_to_world"])
    return transform_points(invert_rigid(pose), table.position_m)


# Real depth: labels by eye, and an inertial sensor.


class LabelledFrame(NamedTuple):
    """A labelled frame of a sequence of MSR Action3D, with the tracked joints: joints_m (21, 3) in the camera's frame,
    sigma_m (21,); lost joints are NaN. people: one for each labeller; depth_m: the depth image; camera: at the origin.
    """

    people: tuple[LabelledPerson, LabelledPerson]
    joints_m: np.ndarray
    sigma_m: np.ndarray
    depth_m: np.ndarray
    camera: Camera

    @property
    def clear(self) -> LabelledPerson:
        """Return the person with each joint half-way between both labels, without joints unclear to a labeller."""
        one, other = self.people
        both = (one.joints.keys() & other.joints.keys()) - one.unclear - other.unclear
        middle = {
            name: tuple(np.mean([one.joints[name], other.joints[name]], axis=0).tolist()) for name in sorted(both)
        }
        return replace(one, joints=middle)


def against_msr_labels(ready: Ready, results: Path) -> Scores:
    """Compare tracked joints of MSR Action3D with the labels that both labellers set and neither marked as unclear."""
    away = list[LabelError]()
    for frame in _labelled_frames(ready, results):
        away += _label_errors(frame.clear, frame.joints_m, frame.sigma_m, frame.depth_m, frame.camera)
    return _label_scores(away)


def by_joint(ready: Ready, results: Path) -> Iterator[tuple[str, Scores]]:
    """Yield, for each label of ``against_msr_labels``, the joint's name without its side, and in millimetres: how far
    the tracked joint is right of and below the label, how far apart both labels are, and the joint's stated sigma.
    """
    for frame in _labelled_frames(ready, results):
        apart = apart_m(*frame.people, frame.depth_m, frame.camera)
        for name, shift in shift_m(frame.clear, frame.joints_m, frame.depth_m, frame.camera).items():
            found = (*shift[:2], apart.get(name, NAN), frame.sigma_m[JOINT_INDEX[name]])
            names = ("right_mm", "below_mm", "apart_mm", "stated_mm")
            scores = {score: 1e3 * float(one) for score, one in zip(names, found, strict=True)}
            yield name.removesuffix("Left").removesuffix("Right"), scores


def _labelled_frames(ready: Ready, results: Path) -> Iterator[LabelledFrame]:
    sequence = ready.recording.name
    first, second = (read_label_set(LABELS, "msr_action3d", labeller)[sequence] for labeller in LABELLERS)
    recording, table = open_recording(ready.recording), read_joints(results / JOINTS_FILE)
    camera, joints_m = replace(recording.cameras[0], T_world_camera=np.eye(4)), _in_camera(table, results)
    for frame, (one, *_) in first.items():
        row = int(np.flatnonzero(table.frame == frame)[0])
        depth_m = _depth(recording, frame)
        yield LabelledFrame((one, second[frame][0]), joints_m[row], table.sigma_m[row], depth_m, camera)


def labelled_sequences() -> tuple[str, ...]:
    """Return the sequences of MSR Action3D that have labels."""
    return tuple(read_label_set(LABELS, "msr_action3d", LABELLERS[0]))


LabelError = tuple[float, float]
"""A joint's distance from its label and its stated sigma, in metres. The distance is inf for a lost joint, which has no
sigma (NaN), and for a joint far in front of or behind the labelled skin."""


def _label_errors(
    labelled: LabelledPerson, joints_m: np.ndarray, sigma_m: np.ndarray, depth_m: np.ndarray, camera: Camera
) -> Iterator[LabelError]:
    for name, away_m in off_m(labelled, joints_m, depth_m, camera).items():
        yield away_m, float(sigma_m[JOINT_INDEX[name]])


def _label_scores(errors: Sequence[LabelError]) -> Scores:
    """Return the shares of joints near their label, and the share of confident errors. A confident error is at least
    ``FAR_M``, and more than ``FAR_SIGMAS`` sigma on each of the two axes perpendicular to the line of sight. The error
    of a joint far in front of or behind the labelled skin counts as ``FAR_M``.
    """
    if not errors:
        return {}
    away, sigma = np.array(errors).T
    shares = {name: float(np.mean(away < reach)) for name, reach in REACHES_M.items()}
    at_least = np.where(np.isfinite(away), away, FAR_M)
    confident = (at_least >= FAR_M) & (at_least > FAR_SIGMAS * np.sqrt(2.0) * np.nan_to_num(sigma, nan=np.inf))
    return shares | {
        "label_confident": float(np.mean(confident)),
        "median_mm": 1e3 * float(np.median(away)),
        "labels": float(len(away)),
    }


def people_in(folder: str) -> tuple[str, ...]:
    """Return the labelled people of a real recording who are in plain view in some frame."""
    frames = read_labels(LABELS, folder, LABELLERS[0])
    return tuple(sorted({one.person for people in frames.values() for one in people if one.plain and one.joints}))


def name_labelled(ready: Ready, person: str) -> dict[str, Any] | None:
    """Return the settings with which a user would point out a labelled person: in the frame near the camera in which
    most joints are clearly seen; None without such a frame.
    """
    recording, best, most = open_recording(ready.recording), None, 0
    camera = settle(recording, TrackConfig()).calibration.cameras[0]
    for frame, people in read_labels(LABELS, ready.recording.name, LABELLERS[0]).items():
        for one in (one for one in people if one.person == person and one.plain):
            place = place_of(one, _depth(recording, frame), camera)
            near = place is not None and np.linalg.norm(place - camera.position_m) < NEAR_M
            if place is not None and near and len(one.joints) > most:
                best, most = (
                    {"patient_xz_m": (float(place[0]), float(place[2])), "patient_frame": frame},
                    len(one.joints),
                )
    return best


def against_people_labels(ready: Ready, results: Path, person: str) -> Scores:
    """Compare the tracked joints of a person, who was pointed out to the tracker, with the labels of both labellers."""
    recording, table = open_recording(ready.recording), read_joints(results / JOINTS_FILE)
    pose = np.array(read_run(results / RUN_FILE)["cameras"][0]["camera_to_world"])
    camera = replace(recording.cameras[0], T_world_camera=pose)
    away, tracked, another = list[LabelError](), list[bool](), 0
    for labeller in LABELLERS:
        for frame, people in read_labels(LABELS, ready.recording.name, labeller).items():
            row = int(np.flatnonzero(table.frame == frame)[0])
            own = next((one for one in people if one.person == person), None)
            another += _is_another(own, people, table, row, camera)
            if own is not None and own.plain:
                lost = table.lost[row].mean()
                tracked.append(bool(lost < TRACKED))
                if lost < 1.0:
                    depth_m = _depth(recording, frame)
                    away += _label_errors(own, table.position_m[row], table.sigma_m[row], depth_m, camera)
    share = float(np.mean(tracked)) if tracked else NAN
    return _label_scores(away) | {"tracked": share, "another": float(another)}


def _is_another(
    own: LabelledPerson | None, people: Sequence[LabelledPerson], table: JointTable, row: int, camera: Camera
) -> bool:
    """Return whether the tracked trunk lies in another person's box and not in the patient's own."""
    place = trunk_pixel(table, row, camera)
    if place is None or (own is not None and within(own.box, place)):
        return False
    return any(within(one.box, place) for one in people if one is not own)


def _depth(recording: Recording, frame: int) -> np.ndarray:
    depth = read_frame(recording, int(np.flatnonzero(recording.streams[0].frame == frame)[0])).depths_m[0]
    assert depth is not None, frame
    return depth


def against_inertial_sensor(ready: Ready, results: Path) -> Scores:
    """Compare the tracked tilt of the right thigh with that of a sensor strapped to it
    (``../shared/tools/utd_mhad.py``); also return the share of frames in which both differ by less than 1.96 sigma.
    """
    command = [sys.executable, str(INSTRUMENT), str(ready.recording), str(results)]
    found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    scores = {"tilt_deg": _number(found["imu"].get("rms_deg")), "kinect_deg": found["kinect_vs_imu"]["rms_deg"]}
    if "lag_s" in found["imu"]:
        scores["tilt_cover"] = _tilt_cover(ready.recording, results, found["imu"]["lag_s"])
    return scores | {"lost": 1.0 - found["imu"]["known_share"]}


def _tilt_cover(recording: Path, results: Path, lag_s: float) -> float:
    """Return the share of frames with a measured tilt over ``TILTED_DEG`` in which the tracked tilt lies within 1.96
    sigma of it. Sigma is computed from the sigmas of hip and knee, without the error of the thigh's direction at rest.
    lag_s: seconds to add to the images' times to get times on the sensor's clock.
    """
    table = read_joints(results / JOINTS_FILE)
    hip, knee = JOINT_INDEX["HipRight"], JOINT_INDEX["KneeRight"]
    thigh_m = table.position_m[:, knee] - table.position_m[:, hip]
    length_m = np.linalg.norm(thigh_m, axis=1)
    sigma_deg = np.degrees(np.hypot(table.sigma_m[:, hip], table.sigma_m[:, knee]) / length_m)
    with np.load(recording / "imu.npz") as sensor:
        rest = slice(-AT_REST, None) if str(sensor["rest_at"]) == "end" else slice(AT_REST)
        measured_deg = np.interp(table.time_s + lag_s, sensor["time_s"], sensor["angle_deg"])
    down = thigh_m / length_m[:, None]
    tilt_deg = np.degrees(np.arccos(np.clip(down @ unit(np.nanmean(down[rest], axis=0)), -1.0, 1.0)))
    known = np.isfinite(tilt_deg) & (measured_deg > TILTED_DEG)
    return float(np.mean(np.abs(tilt_deg - measured_deg)[known] < NORMAL_95 * sigma_deg[known])) if known.any() else NAN
