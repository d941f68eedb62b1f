"""Check frames, time stamps and clocks, and whether the cameras' poses are known and agree."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.calibration.calibration import Calibration, DoubtSource, FloorResidual, PoseDoubt, PoseSource
from anchorpose.calibration.clocks import clock_notes
from anchorpose.calibration.world import TILTED_RAD, WORST_FLOOR_TILT_RAD
from anchorpose.check.material import ENOUGH_HZ, Finding, Level, Material, OfCamera, level_of, of_cameras
from anchorpose.recording.pairing import OFF_BEAT, CameraGaps, find_gaps, off_beat
from anchorpose.recording.recording import DepthStream
from anchorpose.tracker.given_poses import REMEDY, PosesAsked, ask_poses, remedy_of

TOO_SLOW_HZ: Final = 5.0  # people move by a step from one frame to the next
SOME_MISSING, MANY_MISSING = 0.05, 0.25  # gaps of single frames are bridged; a quarter lost halves the rate in places
SHORT_S: Final = 4.0  # the patient's body is learnt from so much
SOME_UNEVEN, MANY_UNEVEN = 0.05, 0.5  # off the beat: a hand at 2 m/s is then 2 cm elsewhere at 30 Hz


def check_frames(material: Material) -> list[Finding]:
    """Number, rate and completeness; how even the time stamps are; how the cameras' clocks are known.

    Raises InputError where cameras never overlap in time.
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
    if material.recording.notes:
        measured, remedy = "; ".join(material.recording.notes), "look at this camera's images, its lens and its cable"
        found.append(Finding("cameras left out", Level.RED, measured, remedy))
    return found if len(streams) == 1 else [*found, _clocks(material)]


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
        (lost, "close other programs, use a fast disk, and give every camera a USB 3 socket of its own"),
        (slow, "record 15 to 30 depth images per second"),
        (short, f"record {SHORT_S:.0f} s or more: the patient's body is learnt from them"),
    )
    remedy = "; ".join(text for level, text in remedies if level > Level.GREEN)
    return OfCamera(gaps.camera, max(lost, slow, short), measured, remedy)


def _stamps(gaps: CameraGaps, stream: DepthStream) -> OfCamera:
    """Steps between frames that are no multiple of the camera's period, and what is missing at the ends."""
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
        ends.append(f"{gaps.repeated} repeat the time before and are left out")
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
UNEVEN_M: Final = 0.02  # floors are flat to that; cameras that smooth make waves


def check_poses(material: Material) -> list[Finding]:
    """Where poses come from, the floor, and whether two cameras show one room."""
    if material.settled is None:
        assert material.refusal is not None
        return [Finding("camera poses", Level.RED, material.refusal.problem, material.refusal.remedy)]
    calibration = material.settled.calibration
    asked = ask_poses(
        material.recording, calibration, material.settled.clocks, material.scenes, material.settled.samples
    )
    return [_poses(calibration, asked), _floor(material), *_agreement(asked)]


def _poses(calibration: Calibration, asked: PosesAsked) -> Finding:
    """Where each pose comes from, or what contradicts it but other cameras."""
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
    """As serious as what tracking does about it."""
    return Level.GREEN if doubt is None else Level.RED if doubt.refuted else Level.YELLOW


def _agreement(asked: PosesAsked) -> list[Finding]:
    """One finding over all pairs of cameras; none where no pair shares enough."""
    between = {doubt.cameras: doubt for doubt in asked.doubts if doubt.source is DoubtSource.CAMERAS}
    parts = [
        OfCamera(" and ".join(names := pair.past.cameras), _level(between.get(names)), pair.measured, REMEDY)
        for pair in asked.pairs
        if pair.measured
    ]
    return [of_cameras("cameras agree", parts)] if parts else []


def _floor(material: Material) -> Finding:
    """How even the floor is, and how upright the world stands on it."""
    assert material.settled is not None
    calibration = material.settled.calibration
    if not calibration.residuals:
        remedy = "tilt a camera so that a metre of floor before the patient is in view: the floor gives the vertical"
        return Finding("floor", Level.YELLOW, "no camera sees it", remedy)
    return of_cameras("floor", [_one_floor(floor) for floor in calibration.residuals])


def _one_floor(floor: FloorResidual) -> OfCamera:
    tilted = level_of(floor.tilt_rad, TILTED_RAD, WORST_FLOOR_TILT_RAD)
    uneven = level_of(floor.residual_m, UNEVEN_M, np.inf)
    measured, remedies = f"seen, even to {1000 * floor.residual_m:.0f} mm", list[str]()
    if tilted > Level.GREEN:
        measured += f", {np.degrees(floor.tilt_rad):.1f} degrees off the given pose"
        remedies.append("correct camera_to_world and the lens, or set camera_to_world to null to have it found")
    if uneven > Level.GREEN:
        remedies.append("switch the camera's smoothing off")
    return OfCamera(floor.camera, max(tilted, uneven), measured, "; ".join(remedies))
