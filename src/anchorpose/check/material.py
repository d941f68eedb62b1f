"""Gather the material of the checks (the recording, its sampled frames, the people in them), and define findings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np

from anchorpose.body.constraints import thin
from anchorpose.body.skin_points import pose_points
from anchorpose.body.visibility import SkinReason, skin_reasons
from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.isolation.people import PatientChoice, Person
from anchorpose.isolation.scene import Scene, find_all_pieces
from anchorpose.isolation.separation import separate_initial
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.reader import frame_range, read_frame
from anchorpose.recording.recording import (
    DepthStream,
    FrameSet,
    Recording,
    align_clocks,
    depths_of,
    nominal_period_s,
    pair_frames,
)
from anchorpose.tracker.bystanders import rough_person
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.look import Look
from anchorpose.tracker.preparation import Settled, look_for_patient, sample_recording, settle
from anchorpose.tracker.sighting import see_people_apart


class Level(IntEnum):
    """The severity of a finding, defined by its effect on tracking."""

    GREEN = 0  # the value is in the expected range
    YELLOW = 1  # results will be less accurate, or have gaps
    RED = 2  # results will be wrong or missing


@dataclass(frozen=True, slots=True)
class Finding:
    """A finding. check: name of the check; measured: one phrase with units; remedy: advice, empty if nothing has to be
    done.
    """

    check: str
    level: Level
    measured: str
    remedy: str = ""


class OfCamera(NamedTuple):
    """One camera's part of a finding. remedy: empty if nothing has to be done."""

    camera: str
    level: Level
    measured: str
    remedy: str = ""


def level_of(value: float, yellow: float, red: float) -> Level:
    """Return the level of a value: red above the limit ``red``, else yellow above the limit ``yellow``, else green; NaN
    (not measured) is green.
    """
    return Level.RED if value > red else Level.YELLOW if value > yellow else Level.GREEN


def of_cameras(check: str, parts: Sequence[OfCamera]) -> Finding:
    """Join the parts of several cameras to one finding with the worst level; with several cameras, the finding names
    them.

    If some parts are not green, green parts and their remedies are left out.
    """
    level = max(part.level for part in parts)
    told = [part for part in parts if part.level > Level.GREEN or level is Level.GREEN]
    measured: dict[str, list[str]] = {}
    for part in told:
        measured.setdefault(part.measured, []).append(part.camera)
    named = [text if len(parts) == 1 else f"{', '.join(names)}: {text}" for text, names in measured.items()]
    remedies = dict.fromkeys(part.remedy for part in told if part.level > Level.GREEN and part.remedy)
    return Finding(check, level, "; ".join(named), "; ".join(remedies))


LOOKS: Final = 6  # number of frames in which the patient is examined closely; each frame takes up to 1 s
PAIRS: Final = 6  # number of pairs of successive frames that are compared to find readings that come and go
BODIES: Final = 8  # number of frames in which a body is fitted to each person; 1 s of computing for three people
SHORT: Final = 300  # minimum number of frames per camera for thinning a recording; 10 s at 30 frames per second
ENOUGH_HZ: Final = 14.5  # Hz, frame rate needed for clocks and poses; recorders often just miss the advised 15 Hz
# pixels, width of the strip along an image's edge that counts as its border, since filters leave outer rows without
# readings
BORDER_PX: Final = 4
# m, maximum depth difference between a skin point of a roughly fitted body and a reading of the patient, for the
# reading to count as a view of this point
REACH_M: Final = 0.10


@dataclass(frozen=True, slots=True, eq=False)
class SeenPatient:
    """The patient in one sampled frame. person: the patient's place and size; views: each camera's depth image
    with a label per pixel (such as patient, equipment or background), None without a depth image. hidden (cameras,):
    share of the skin facing each camera that equipment or people hide; NaN if no body was fitted.
    """

    person: Person
    views: tuple[View | None, ...]
    hidden: np.ndarray

    @property
    def cut_above(self) -> bool:
        """Return whether the upper border cuts off the patient in every image that shows them, so that the head is not
        seen.
        """
        shown = [view.patient for view in self.views if view is not None and view.patient.any()]
        return all(patient[:BORDER_PX].any() for patient in shown)


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """The material that the checks examine. recording: the recording; its cameras have one common clock if ``settled``
    is known. settled: clocks and poses; look: empty room and people. ``settled`` and ``look`` are None if the cameras'
    poses are unknown; ``refusal`` has the reason. successive: pairs of successive frames, between which people hardly
    move. patient: the patient in some of the sampled frames; empty if no patient was found.
    """

    recording: Recording
    samples: tuple[FrameSet, ...]
    settled: Settled | None
    look: Look | None
    refusal: InputError | None
    successive: tuple[tuple[FrameSet, FrameSet], ...]
    patient: tuple[SeenPatient, ...]

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """Return the cameras with the poses that tracking would use, if known."""
        return self.recording.cameras if self.settled is None else self.settled.calibration.cameras

    @property
    def scenes(self) -> tuple[Scene, ...]:
        """Return each camera with its empty room and equipment; empty if poses are unknown."""
        return () if self.look is None else self.look.scenes

    @property
    def floor_scenes(self) -> list[Scene]:
        """Return, for each camera that sees the floor, the camera with its empty room and equipment."""
        residuals = () if self.settled is None else self.settled.calibration.residuals
        names = {floor.camera for floor in residuals}
        return [scene for scene in self.scenes if scene.camera.name in names]

    @property
    def floor_m(self) -> float | None:
        """Return the height of the floor in the world; None if no camera sees it."""
        return None if self.settled is None else self.settled.calibration.floor_height_m

    def by_camera(self) -> Iterator[tuple[Camera, list[np.ndarray]]]:
        """Yield each camera with its sampled depth images (height, width), metres, 0 = no reading."""
        for index, camera in enumerate(self.cameras):
            yield camera, depths_of(self.samples, index)

    def successive_of(self, index: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return those pairs of ``successive`` in which the camera with this index has both images."""
        pairs = [(one.depths_m[index], other.depths_m[index]) for one, other in self.successive]
        return [(one, other) for one, other in pairs if one is not None and other is not None]

    def distance_m(self, index: int) -> float:
        """Return the median depth of the patient's pixels in one camera; NaN where the patient is not seen."""
        depths = [np.median(view.depth_m[view.patient]) for view in self.views_of(index) if view.patient.any()]
        return float(np.median(depths)) if depths else float("nan")

    def views_of(self, index: int) -> list[View]:
        """Return one camera's depth images with their labels, in the frames of ``patient`` in which it has an image."""
        return [view for seen in self.patient if (view := seen.views[index]) is not None]


def gather_material(recording: Recording, config: TrackConfig) -> Material:
    """Find clocks, poses, the empty room and the patient in sampled frames; without poses, only gather the frames.

    Raises InputError if the cameras never overlap in time, or if a camera has no readable depth image.
    """
    pair_frames(recording)
    try:
        settled = settle(_thinned(recording), config)
    except InputError as refusal:
        _, samples = sample_recording(recording, config)
        return Material(recording, tuple(samples), None, None, refusal, _successive(recording), ())
    timed = align_clocks(recording, settled.clocks.clocks)
    look = look_for_patient(settled, replace(config, follow=replace(config.follow, samples=BODIES)))
    frames = dict(zip(settled.chosen, settled.samples, strict=True))
    shown = sorted(look.initial_frames, key=lambda one: one.frame)
    chosen = [shown[k] for k in thin(len(shown), LOOKS)]
    patient = tuple(_look_closely(frames[one.frame], one.choice, look.scenes) for one in chosen)
    return Material(timed, settled.samples, settled, look, None, _successive(timed), patient)


def _thinned(recording: Recording) -> Recording:
    """Return the recording with only every n-th frame of each camera whose frame rate is higher than needed to find
    clocks and poses; a short recording is returned whole.
    """
    if min(len(stream.files) for stream in recording.streams) < SHORT:
        return recording
    return replace(recording, streams=tuple(_thinned_stream(stream) for stream in recording.streams))


def _thinned_stream(stream: DepthStream) -> DepthStream:
    period_s = nominal_period_s(stream)
    nth = max(1, int(1.0 / (ENOUGH_HZ * period_s))) if period_s else 1
    by_frame = {name: getattr(stream, name) for name in ("files", "time_s", "frame", "duplicate", "listed")}
    thinned: dict[str, Any] = {name: None if rows is None else rows[::nth] for name, rows in by_frame.items()}
    return replace(stream, **thinned)


def _successive(recording: Recording) -> tuple[tuple[FrameSet, FrameSet], ...]:
    positions = frame_range(recording)[:-1]
    chosen = [positions[k] for k in thin(len(positions), PAIRS)]
    return tuple((read_frame(recording, k), read_frame(recording, k + 1)) for k in chosen)


def _look_closely(frame_set: FrameSet, choice: PatientChoice, scenes: Sequence[Scene]) -> SeenPatient:
    pieces = find_all_pieces(frame_set, scenes)
    cameras = [scene.camera for scene in scenes]
    people = see_people_apart(pieces, cameras).people
    person = min(people.people, key=lambda one: float(np.linalg.norm(one.ground_xz_m - choice.ground_xz_m)))
    views = separate_initial(pieces, people, choice)
    return SeenPatient(person, views, _hidden(views, cameras))


def _hidden(views: Sequence[View | None], cameras: Sequence[Camera]) -> np.ndarray:
    """Return (cameras,): share of the skin facing each camera that something hides, according to a body fitted to the
    patient.
    """
    hidden = np.full(len(cameras), np.nan)
    person = rough_person(views, cameras, PixelLabel.PATIENT)
    if person is None:
        return hidden
    posed = pose_points(person.body, person.found.belief.pose)
    for index, (view, camera) in enumerate(zip(views, cameras, strict=True)):
        if view is not None:
            reason, facing = skin_reasons(posed, view, camera, REACH_M)
            turned = reason[facing & (reason != SkinReason.SELF)]
            if len(turned):
                hidden[index] = np.mean(np.isin(turned, (SkinReason.EQUIPMENT, SkinReason.PERSON)))
    return hidden
