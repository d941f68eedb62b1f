"""Check a recording before tracking: frames, times, clocks, poses, the patient and the empty room."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.calibration.calibration import Calibration, DoubtSource, FloorResidual, PoseDoubt, PoseSource
from anchorpose.calibration.clocks import clock_notes
from anchorpose.calibration.first_frames import TOLERANCES_M
from anchorpose.calibration.world import TILTED_RAD, WORST_FLOOR_TILT_RAD
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.check.depth import check_depth, check_lens
from anchorpose.check.material import (
    BORDER_PX,
    ENOUGH_HZ,
    Finding,
    Level,
    Material,
    OfCamera,
    SeenPatient,
    gather_material,
    level_of,
    of_cameras,
)
from anchorpose.isolation.background import BackgroundSource
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import LEFT_OUT, OFF_BEAT, CameraGaps, DepthStream, find_gaps, off_beat
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.given_poses import REMEDY, PosesAsked, ask_poses, remedy_of
from anchorpose.tracker.look import Look
from anchorpose.tracker.preparation import MOVED, OUTDATED
from anchorpose.tracker.room import NOBODY_SEEN

TOO_SLOW_HZ: Final = 5.0  # Hz, minimum frame rate; at a lower rate, a person may walk a whole step between two frames
# share of a camera's frames that are missing or duplicates, above which the finding is yellow (first limit) or red
# (second limit). Tracking bridges single missing frames; if a share above 0.25 is missing, parts of the recording have
# only half the frame rate
SOME_MISSING, MANY_MISSING = 0.05, 0.25
SHORT_S: Final = 4.0  # s, minimum duration of a recording for learning the patient's body
# Share of frame intervals that deviate from multiples of the camera's period by over a quarter of the period, above
# which the finding is yellow (first limit) or red (second limit). At 30 Hz, a deviation by a quarter of the period
# gives a hand that moves at 2 m/s an error of 2 cm.
SOME_UNEVEN, MANY_UNEVEN = 0.05, 0.5


def check_frames(material: Material) -> list[Finding]:
    """Return findings on number, rate and completeness of frames, on the evenness of time stamps, and on the cameras'
    clocks.

    Raises InputError if cameras never overlap in time.
    """
    gaps, streams = find_gaps(material.recording), material.recording.streams
    found = [
        of_cameras("frames", [_frames(one, stream) for one, stream in zip(gaps, streams, strict=True)]),
        of_cameras("time stamps", [_stamps(one, stream) for one, stream in zip(gaps, streams, strict=True)]),
    ]
    damaged = [problem for sample in material.samples for problem in sample.problems]
    if damaged:
        measured = f"{len(damaged)} of the sampled ones cannot be used: {damaged[0]}"
        found.append(Finding("damaged images", Level.YELLOW, measured, "copy the recording again"))
    found += _noted(material.recording.notes)
    return found if len(streams) == 1 else [*found, _clocks(material)]


def _noted(notes: Sequence[str]) -> list[Finding]:
    """Return a finding on the cameras that were left out, and a finding on the other notes of the recording."""
    found = list[Finding]()
    if gone := [note for note in notes if LEFT_OUT in note]:
        remedy = "look at this camera's images, its lens and its cable"
        found.append(Finding("cameras left out", Level.RED, "; ".join(gone), remedy))
    if others := [note for note in notes if LEFT_OUT not in note]:
        remedy = "if images or a unit are wrong because of it, convert or record again"
        found.append(Finding("notes", Level.YELLOW, "; ".join(others), remedy))
    return found


def _frames(gaps: CameraGaps, stream: DepthStream) -> OfCamera:
    rate_hz = 1.0 / gaps.period_s if gaps.period_s else float("nan")
    span_s = float(stream.time_s[-1] - stream.time_s[0])
    total = gaps.usable + gaps.dropped + gaps.duplicates
    lost = level_of((gaps.dropped + gaps.duplicates) / total, SOME_MISSING, MANY_MISSING)
    slow = level_of(-rate_hz, -ENOUGH_HZ, -TOO_SLOW_HZ)
    short = Level.YELLOW if span_s < SHORT_S else Level.GREEN
    measured = "a single one"
    if len(stream.time_s) > 1:
        stated = "" if stream.fps is None else " by recording.json"
        measured = f"{gaps.usable} in {span_s:.1f} s, {rate_hz:.0f} per second{stated}"
    if gaps.dropped:
        measured += f", {100 * gaps.dropped / total:.0f} % missing"
    if gaps.duplicates:
        measured += f", {100 * gaps.duplicates / total:.0f} % stored twice"
    remedies = (
        (lost, "close other programs, use a fast disk, and give every camera a separate USB 3 socket"),
        (slow, "record 15 to 30 depth images per second"),
        (short, f"record {SHORT_S:.0f} s or more: the patient's body is learnt from them"),
    )
    remedy = "; ".join(text for level, text in remedies if level > Level.GREEN)
    return OfCamera(gaps.camera, max(lost, slow, short), measured, remedy)


def _stamps(gaps: CameraGaps, stream: DepthStream) -> OfCamera:
    """Return a finding on frame intervals that are not multiples of the camera's period, and on times without
    frames.
    """
    steps = np.diff(stream.time_s)
    uneven = float(np.mean(off_beat(steps, gaps.period_s) > OFF_BEAT)) if len(steps) else 0.0
    level = level_of(uneven, SOME_UNEVEN, MANY_UNEVEN)
    parts, remedies = ["even"], list[str]()
    if level > Level.GREEN:
        parts = [f"{100 * uneven:.0f} % come too early or too late"]
        remedies.append("keep the device's own time stamps, not those of the computer, when recording")
    ends = [f"starts {gaps.late_s:.1f} s late"] * bool(gaps.late_s)
    ends += [f"ends {gaps.early_s:.1f} s early"] * bool(gaps.early_s)
    ends += [f"nothing from {begin_s:.1f} to {end_s:.1f} s" for begin_s, end_s in gaps.pauses]
    if ends:
        remedies.append("start all cameras before the session and stop them after it")
    if gaps.repeated:
        ends.append(f"{gaps.repeated} repeat the previous time and are left out")
    level = max(level, Level.YELLOW) if ends else level
    return OfCamera(gaps.camera, level, ", ".join([*parts, *ends]), "; ".join(remedies))


def _clocks(material: Material) -> Finding:
    if material.settled is None:
        return Finding("clocks", Level.YELLOW, "not compared: the cameras' poses are unknown", "see camera poses")
    clocks = material.settled.clocks
    doubtful = any(camera.doubt is not None for camera in clocks.cameras)
    level = Level.YELLOW if doubtful else Level.GREEN
    remedy = "let a person walk through the view of all cameras at the start" if doubtful else ""
    return Finding("clocks", level, "; ".join(clock_notes(clocks)), remedy)


SOURCES: Final = {PoseSource.FLOOR: "not given; found from floor and patient"}


def check_poses(material: Material) -> list[Finding]:
    """Return findings on the source of poses, the floor, and whether two cameras show the same room."""
    if material.settled is None:
        assert material.refusal is not None
        return [Finding("camera poses", Level.RED, material.refusal.problem, material.refusal.remedy)]
    calibration = material.settled.calibration
    asked = ask_poses(
        material.recording, calibration, material.settled.clocks, material.scenes, material.settled.samples
    )
    return [_poses(calibration, asked), _floor(material), *_agreement(asked)]


def _poses(calibration: Calibration, asked: PosesAsked) -> Finding:
    """Return a finding on the source of each pose, or on what contradicts the pose. Contradictions between two cameras
    are reported by ``_agreement``.
    """
    own = [doubt for doubt in asked.doubts if doubt.source is not DoubtSource.CAMERAS]
    parts = []
    for pose in calibration.poses:
        doubt = max((one for one in own if pose.camera in one.cameras), key=lambda one: one.refuted, default=None)
        if doubt is None:
            parts.append(OfCamera(pose.camera, Level.GREEN, SOURCES.get(pose.source, str(pose.source))))
        else:
            parts.append(OfCamera(pose.camera, _level(doubt), doubt.sentence, remedy_of(doubt)))
    return of_cameras("camera poses", parts)


def _level(doubt: PoseDoubt | None) -> Level:
    """Return the level of a doubt about a pose: red if tracking would refuse the pose."""
    return Level.GREEN if doubt is None else Level.RED if doubt.refuted else Level.YELLOW


def _agreement(asked: PosesAsked) -> list[Finding]:
    """Return one finding on how well the poses in each pair of cameras agree; no finding if no pair sees enough in
    common.
    """
    between = {doubt.cameras: doubt for doubt in asked.doubts if doubt.source is DoubtSource.CAMERAS}
    parts = [
        OfCamera(" and ".join(names := pair.past.cameras), _level(between.get(names)), pair.measured, REMEDY)
        for pair in asked.pairs
        if pair.measured
    ]
    return [of_cameras("cameras agree", parts)] if parts else []


def _floor(material: Material) -> Finding:
    """Return a finding on how even the floor is, and on the floor's tilt against the horizontal of the given poses."""
    assert material.settled is not None
    calibration = material.settled.calibration
    if not calibration.residuals:
        remedy = "tilt a camera so that a metre of floor before the patient is in view: the floor gives the vertical"
        return Finding("floor", Level.YELLOW, "no camera sees it", remedy)
    return of_cameras("floor", [_one_floor(floor) for floor in calibration.residuals])


def _one_floor(floor: FloorResidual) -> OfCamera:
    tilted = level_of(floor.tilt_rad, TILTED_RAD, WORST_FLOOR_TILT_RAD)
    uneven = level_of(floor.residual_m, TOLERANCES_M[0], np.inf)
    measured, remedies = f"seen, even to {1000 * floor.residual_m:.0f} mm", list[str]()
    if tilted > Level.GREEN:
        measured += f", {np.degrees(floor.tilt_rad):.1f} degrees off the given pose"
        remedies.append("correct camera_to_world and the lens, or set camera_to_world to null to have it found")
    if uneven > Level.GREEN:
        remedies.append("switch the camera's smoothing off")
    return OfCamera(floor.camera, max(tilted, uneven), measured, "; ".join(remedies))


SELDOM: Final = 0.5  # minimum share of the sampled frames in which the patient should be found
# maximum number of the patient's pixels along an image border that does not cut off the body; even a hand that is
# cut off has more
CUT_PX: Final = 3
# share of frames in which an image border cuts off the body, above which a camera's part of the finding is yellow
# (first limit) or red (second limit); raised hands may be cut off
SOMETIMES, MOSTLY = 0.1, 0.5
# m, smallest and largest good distance of the patient; nearer, no lens shows feet and head; farther, a forearm has only
# 10 pixels
NEAR_M, FAR_M = 1.2, 4.0
BORDERS: Final = ("above", "below", "on the picture's left", "on its right")
# hidden share of the skin that faces the camera, above which the finding is yellow (first limit) or red (second limit);
# above 0.8, more of the body is inferred than seen
HALF_HIDDEN, MOSTLY_HIDDEN = 0.5, 0.8


def check_patient(material: Material) -> list[Finding]:
    """Return the findings on the patient, other people, mirrors and the empty room."""
    look = material.look
    if look is None:
        return [Finding("patient", Level.YELLOW, "not looked for: the cameras' poses are unknown", "see camera poses")]
    found = [_found(look)]
    if material.patient:
        found += [_whole(material), _distance(material), _hidden(material)]
    return [*found, _others(look), _mirrors(look), _still(look), _empty_room(look, material.recording.backgrounds_m)]


def _found(look: Look) -> Finding:
    shown, of = len(look.initial_frames), len(look.sightings)
    measured = f"found in {shown} of {of} sampled frames"
    if not shown:
        remedy = "look at the depth images; move the camera so that it sees the whole patient within 5 m"
        return Finding("patient", Level.RED, NOBODY_SEEN, remedy)
    if shown < SELDOM * of:
        remedy = (
            "right where the patient comes late; otherwise another person may be taken for the patient: name the place "
            "when tracking, --patient x,z@frame, or record again without people who stand in the way"
        )
        return Finding("patient", Level.YELLOW, measured, remedy)
    return Finding("patient", Level.GREEN, measured)


def _whole(material: Material) -> Finding:
    """Return a finding on image borders that cut off the patient. The finding is red only if every camera cuts off the
    patient in most frames.
    """
    parts = [_cut_off(material, index, camera) for index, camera in enumerate(material.cameras)]
    worst = Level.RED if all(part.level is Level.RED for part in parts) else Level.YELLOW
    return of_cameras("whole in view", [part._replace(level=min(part.level, worst)) for part in parts])


def _cut_off(material: Material, index: int, camera: Camera) -> OfCamera:
    seen = [one for one in material.patient if (view := one.views[index]) is not None and view.patient.any()]
    if not seen:
        return OfCamera(camera.name, Level.YELLOW, "the patient is out of view", "turn the camera towards the patient")
    cut = np.array([_borders(one, index, camera, material.floor_m) for one in seen]).mean(axis=0)
    level = max(level_of(share, SOMETIMES, MOSTLY) for share in cut.tolist())
    if level is Level.GREEN:
        return OfCamera(camera.name, level, "from head to feet")
    shares = zip(BORDERS, cut.tolist(), strict=True)
    told = [f"{side} in {100 * share:.0f} %" for side, share in shares if share > SOMETIMES]
    remedy = "move the camera back, or turn it towards what is cut off"
    return OfCamera(camera.name, level, f"cut off {', '.join(told)} of the frames", remedy)


def _borders(seen: SeenPatient, index: int, camera: Camera, floor_m: float | None) -> tuple[bool, bool, bool, bool]:
    """Return whether the image's upper, lower, left and right border cuts off the patient.

    The lower border also cuts off the patient if the floor under the patient lies outside the image, since bars may
    hide the legs at the border.
    """
    view = seen.views[index]
    assert view is not None
    patient = view.patient
    strips = (patient[:BORDER_PX], patient[-BORDER_PX:], patient[:, :BORDER_PX].T, patient[:, -BORDER_PX:].T)
    above, below, left, right = (int(np.count_nonzero(strip.any(axis=0))) > CUT_PX for strip in strips)
    if floor_m is not None:
        x, z = seen.person.ground_xz_m
        place = transform_points(invert_rigid(camera.require_pose()), np.array([[x, floor_m, z]]))
        pixel = camera.project(place)[0]
        below |= not pixel[1] <= camera.height - 1  # NaN (beyond the lens's valid radius) counts as below
    return above, below, left, right


def _distance(material: Material) -> Finding:
    parts, remedy = [], "2 to 3 m is best: the whole body is in view, and a hand has enough pixels"
    for index, camera in enumerate(material.cameras):
        away_m = material.distance_m(index)
        level = Level.GREEN if not away_m < NEAR_M and not away_m > FAR_M else Level.YELLOW
        parts.append(OfCamera(camera.name, level, f"{away_m:.1f} m" if np.isfinite(away_m) else "not in view", remedy))
    return of_cameras("distance", parts)


def _hidden(material: Material) -> Finding:
    """Return a finding on the share of skin that equipment or people hide from the camera that sees most in a frame."""
    hidden = np.array([one.hidden for one in material.patient])
    known = hidden[np.isfinite(hidden).any(axis=1)]
    if not len(known):
        return Finding("hidden", Level.YELLOW, "no body fits what is seen of the patient", "look at the depth images")
    share = float(np.median(np.nanmin(known, axis=1)))
    level = level_of(share, HALF_HIDDEN, MOSTLY_HIDDEN)
    remedy = "move the camera 10 to 20 degrees to a side on which nobody crouches, or add a second camera"
    measured = f"{100 * share:.0f} % of the patient behind equipment or people"
    return Finding("hidden", level, measured, remedy if level > Level.GREEN else "")


def _others(look: Look) -> Finding:
    most = max((len(one.people) for one in look.sightings), default=0)
    rival = look.initial_frames[0].choice.rival_xz_m if look.initial_frames else None
    if rival is not None:
        place = ",".join(f"{round(float(along), 2) + 0.0:.2f}" for along in rival)  # + 0.0 turns -0 into 0
        measured = f"up to {most} people; the one at {place} may be the patient as well"
        remedy = f"if that is the patient, track with --patient {place}; look at the pictures of the report"
        return Finding("other people", Level.YELLOW, measured, remedy)
    return Finding("other people", Level.GREEN, "nobody else" if most < 2 else f"up to {most} people at a time")


def _mirrors(look: Look) -> Finding:
    if look.notes:
        remedy = "cover mirrors, or turn the camera away from them"
        return Finding("mirrors", Level.YELLOW, "; ".join(look.notes), remedy)
    return Finding("mirrors", Level.GREEN, "none found")


def _still(look: Look) -> Finding:
    moved = [scene.camera.name for scene in look.scenes if scene.background.moved]
    if not moved:
        return Finding("cameras stay", Level.GREEN, "no move found between beginning and end")
    remedy = "track the frames before and after the move separately, with --start and --stop"
    return Finding("cameras stay", Level.YELLOW, f"{', '.join(moved)} {MOVED}", remedy)


def _empty_room(look: Look, recorded_m: Sequence[np.ndarray | None]) -> Finding:
    """Return a finding on the depth images of the empty room. recorded_m: one per camera, None without such an image;
    an image that does not fit the recording was not used.
    """
    parts, remedy = [], "record a depth image with the equipment in place and nobody in view, as background.png"
    for scene, room_m in zip(look.scenes, recorded_m, strict=True):
        given = scene.background.source is BackgroundSource.PICTURE
        measured = "recorded" if given else "no picture of it" if room_m is None else OUTDATED
        parts.append(OfCamera(scene.camera.name, Level.GREEN if given else Level.YELLOW, measured, remedy))
    return of_cameras("empty room", parts)


def check_recording(recording: Path) -> list[Finding]:
    """Return the findings in the order in which people read them; at most a few dozen depth images per camera are
    read.

    Raises InputError if the recording cannot be used at all.
    """
    with one_thread():
        material = gather_material(open_recording(recording), TrackConfig())
        return [
            *check_patient(material),
            *check_depth(material),
            *check_frames(material),
            *check_lens(material),
            *check_poses(material),
        ]
