"""Write a simulated recording, with the images that its recorder keeps, and the recording's truth."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.body.contact_regions import REGIONS
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_NAMES
from anchorpose.recording.equipment import write_equipment
from anchorpose.recording.events import EVENTS_FILE, sidecar_of
from anchorpose.recording.recording_file import camera_document
from anchorpose.recording.writable import check_place, new_folder
from anchorpose.simulate.clinic import Clinic, Programme, draw_clinic, random_stream
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.render import PATIENT
from anchorpose.simulate.sessions.patient import SessionPatient
from anchorpose.simulate.sessions.truth import events_table, truth_arrays, units_of_events
from anchorpose.simulate.shoot import Studio, set_up
from anchorpose.simulate.touches import Touch, touches

EQUIPMENT_FILE: Final = "equipment.json"
# level of PNG compression; a higher level triples the time and saves only 3 % of the size, since noise hardly
# compresses
PNG_COMPRESSION: Final = 2
# maximum share of the patient's pixels that passers-by hide in a frame that does not count as occluded
PASSER_HIDES: Final = 0.25
JITTER_LIMIT: Final = 0.4  # maximum jitter as a share of the frame period; above 0.5, stamps could change their order
JITTER_SPREADS: Final = 2.0  # number of standard deviations at which the jitter's normal distribution is cut off


def simulate_recording(
    out: Path,
    config: SimulationConfig,
    progress: Callable[[int, int], None] | None = None,
    programme: Programme | None = None,
) -> None:
    """Write ``out/recording/`` and ``out/truth/``, either completely or not at all.

    ``progress(done, total)`` is called after every frame; programme: function that draws the patient's movements; None
    = the movements that ``config`` states. Raises InputError if ``out`` exists and is not empty, or is a link.
    """
    out = Path(out)
    check_place(out)
    if out.is_symlink() or (out.exists() and (not out.is_dir() or any(out.iterdir()))):
        raise InputError(out, "is there already and not empty, or a link", "choose another folder or remove it first")
    with new_folder(out.resolve().parent, out):
        work = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
        try:
            _write_all(work, draw_clinic(config, programme), progress)
            work.chmod(0o755)
            if out.exists():
                out.rmdir()
            work.rename(out)
        finally:
            shutil.rmtree(work, ignore_errors=True)


def _write_all(work: Path, clinic: Clinic, progress: Callable[[int, int], None] | None) -> None:
    recording, truth, config = work / "recording", work / "truth", clinic.config
    for camera in clinic.cameras:
        for folder in (
            recording / camera.name / "depth",
            truth / "labels" / camera.name,
            truth / "parts" / camera.name,
        ):
            folder.mkdir(parents=True)
    _write_documents(recording, clinic)
    studio, records = set_up(clinic), tuple(draw_record(clinic, index) for index in range(config.cameras))
    for index, camera in enumerate(clinic.cameras):
        if clinic.scene is None:  # cluttered rooms have no background.png, since real rooms are hardly ever emptied
            _write_png(recording / camera.name / "background.png", studio.background_mm(index))
        _write_stamps(recording / camera.name / "timestamps.csv", records[index])
    patient_pixels, contacts, seen, behind = [], [], [], []
    for frame in range(config.frames):
        shot = studio.shoot(frame)
        for index, camera in enumerate(clinic.cameras):
            image, record, depth = shot.images[index], records[index], recording / camera.name / "depth"
            if record.kept[frame]:
                _write_shown(depth, record, frame, shot.depths_mm[index])
            _write_shown(truth / "labels" / camera.name, record, frame, image.label)
            _write_shown(truth / "parts" / camera.name, record, frame, image.part)
        patient_pixels.append([int((image.label == PATIENT).sum()) for image in shot.images])
        contacts.append(touches(clinic, studio.performances[0], shot.figures, frame))
        seen.append(shot.seen_share)
        behind.append(shot.behind_passers)
        if progress is not None:
            progress(frame + 1, config.frames)
    sight = Sight(np.array(patient_pixels), np.array(seen), np.array(behind), studio.in_hole)
    _write_truth(truth / "truth.npz", studio, records, sight, contacts)


def _write_documents(recording: Path, clinic: Clinic) -> None:
    """Write recording.json; also equipment.json for a clinic with equipment, and events.tsv and events.json for a
    session.
    """
    equipment, cameras, missing = clinic.equipment, clinic.cameras, clinic.config.body.missing
    if not clinic.config.pose_known:
        cameras = tuple(replace(camera, T_world_camera=None) for camera in cameras)
    document = {
        "format": "rgbd-recording",
        "version": 1,
        "cameras": [camera_document(camera) for camera in cameras],
        "equipment": None if equipment is None else EQUIPMENT_FILE,
        **({"subject": {"missing": list(missing)}} if missing else {}),
    }
    text = json.dumps(document, indent=1) + "\n"
    (recording / "recording.json").write_text(text, encoding="utf-8")
    if equipment is not None:
        write_equipment(recording / EQUIPMENT_FILE, equipment)
    if clinic.plan:
        table = recording / EVENTS_FILE
        table.write_text(events_table(clinic.plan), encoding="utf-8")
        sidecar_of(table).write_text(units_of_events(), encoding="utf-8")


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """The patient's visibility in each camera's images, in the order of the images' numbers."""

    patient_pixels: np.ndarray  # (t, cameras), number of pixels that show the patient
    seen_share: np.ndarray  # (t, 21, cameras), seen share of the camera-facing skin around each joint
    behind_passers: np.ndarray  # (t, cameras), share of the patient's pixels that passers-by hide
    in_hole: np.ndarray  # (t,) bool, frames with a hole

    def at(self, time_s: np.ndarray, records: tuple[Record, ...], within_s: float) -> Sight:
        """Return the visibility at times (t,). For each camera, the image taken nearest to the time counts, if it was
        taken within ``within_s``; a camera without such an image counts as a camera that sees nothing.
        """
        nearest = [record.nearest(time_s, within_s) for record in records]
        image, there = (np.stack(parts, axis=1) for parts in zip(*nearest, strict=True))  # (t, cameras)
        camera = np.arange(len(records))
        return Sight(
            np.where(there, self.patient_pixels[image, camera], 0),
            np.where(there[:, None], self.seen_share[image, :, camera].swapaxes(1, 2), 0.0),
            np.where(there, self.behind_passers[image, camera], 0.0),
            (self.in_hole[image] & there).any(axis=1),
        )


def _write_truth(path: Path, studio: Studio, records: tuple[Record, ...], sight: Sight, contacts: list[Touch]) -> None:
    """Write the truth with which tracking is compared. Its t frames are the frames of the first camera; places are in
    metres, world.

    occluded (t,): whether a hole was cut into the images, or passers-by hide over ``PASSER_HIDES`` of the patient's
    pixels from a camera. The arrays occluded, patient_pixels and seen_share describe the image on the disk that each
    camera took nearest to the frame's time, within half a frame period; a camera without such an image counts as a
    camera that sees nothing. In addition to the keys of the file format, the file has these arrays (n other people):

    - patient_pixels (t,): the patient's pixels of all cameras together
    - seen_share (t, 21, cameras): seen share of the camera-facing skin around each joint (``seen_shares``)
    - touched (t, 31): bones with another person's skin within 3 cm, named by part_names
    - touched_joints (t, n, 21): joints that each other person touches
    - on_equipment (t, parts, 31): bones with skin within 1 cm of each part of the equipment, named by equipment_names
    - held_joints (t, n, 2): the joint that each hand of each therapist holds, -1 = none
    - clock_late, clock_drift, clock_epoch (cameras,): an image with stamp s was taken at (s - epoch) + late +
      drift * (s - epoch), seconds
    - taken_s (cameras, t): time at which the image of that number on the disk was taken, NaN if it is missing
    - doubled (cameras, t): whether the image on the disk repeats an earlier image
    - camera_to_world (cameras, 4, 4): only for cluttered rooms, equal to T_world_camera
    - only for sessions, the arrays of ``truth_arrays``, and touched_regions (t, n, regions), named by region_names:
      regions that each other person touches; the knee is a region apart from thigh and shank
    """
    clinic, config, performance = studio.clinic, studio.clinic.config, studio.performances[0]
    person = clinic.patient.person
    time_s = np.arange(config.frames) / config.fps
    sight = sight.at(time_s, records, 0.5 / config.fps)
    poses = np.array([camera.require_pose() for camera in clinic.cameras])
    extra: dict[str, Any] = {} if clinic.scene is None else {"camera_to_world": poses}
    if isinstance(clinic.patient, SessionPatient):
        regions = np.array([contact.regions for contact in contacts])
        extra |= {"touched_regions": regions, "region_names": np.array(REGIONS)}
        extra |= truth_arrays(clinic.plan, clinic.patient)
    np.savez_compressed(
        path,
        joints=performance.joints_m(),
        names=np.array(JOINT_NAMES),
        time=time_s,
        occluded=sight.in_hole | (sight.behind_passers > PASSER_HIDES).any(axis=1),
        patient_pixels=sight.patient_pixels.sum(axis=1),
        seen_share=sight.seen_share.astype(np.float32),
        touched=np.array([contact.bones for contact in contacts]),
        touched_joints=np.array([contact.joints for contact in contacts]),
        on_equipment=np.array([contact.on_equipment for contact in contacts]),
        equipment_names=np.array([part.name for part in clinic.parts], dtype=np.str_),
        held_joints=performance.held_joints(),
        part_names=np.array(person.body.asset.bone_names),
        camera_names=np.array([camera.name for camera in clinic.cameras]),
        T_world_camera=poses,
        clock_late=np.array(config.clock_late_s or [0.0] * config.cameras),
        clock_drift=np.array(config.clock_drift or [0.0] * config.cameras),
        clock_epoch=np.array(config.clock_epoch_s or [0.0] * config.cameras),
        taken_s=np.array([np.where(record.kept, record.taken_s, np.nan) for record in records]),
        doubled=np.array([record.doubled for record in records]),
        shape_coefficients=person.coefficients,
        height_m=person.height_m,
        **extra,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """One camera's image files, by frame number. All arrays are (t,)."""

    kept: np.ndarray  # bool, whether the image is on the disk
    shown: np.ndarray  # int64, number of the image that the file contains; an earlier image if the file is doubled
    stamp_s: np.ndarray  # float64, time in timestamps.csv
    taken_s: np.ndarray  # float64, when the image in the file was taken

    @property
    def doubled(self) -> np.ndarray:
        """Return (t,) bool: whether the image on the disk repeats an earlier image."""
        return self.kept & (self.shown < np.arange(len(self.shown)))

    def nearest(self, time_s: np.ndarray, within_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the number (t,) of the image taken nearest to each time (t,), and whether (t,) it was taken within
        ``within_s`` of it. Missing images and repeats do not count.
        """
        images = np.flatnonzero(self.kept & ~self.doubled)
        away_s = np.abs(self.taken_s[images] - time_s[:, None])
        return images[away_s.argmin(axis=1)], away_s.min(axis=1) <= within_s


def draw_record(clinic: Clinic, index: int) -> Record:
    """Draw which images camera ``index`` writes. The first camera writes all of its images, since the truth has a row
    for each.
    """
    config = clinic.config
    nominal_s, taken_s = np.arange(config.frames) / config.fps, clinic.true_times_s(index)
    kept = _kept(clinic, index, nominal_s)
    shown = np.arange(config.frames)
    doubled = (random_stream(config, "doubles", index).random(config.frames) < config.doubled_share) & kept
    before = np.maximum.accumulate(np.where(kept, shown, -1))  # per frame, number of the image last kept
    for frame in np.flatnonzero(doubled):
        if frame > 0 and before[frame - 1] >= 0:
            shown[frame] = shown[before[frame - 1]]
    epoch_s = config.clock_epoch_s[index] if config.clock_epoch_s else 0.0
    stamp_s = nominal_s + epoch_s + _jitter_s(clinic, index)
    return Record(kept, shown, stamp_s, taken_s[shown])


def _kept(clinic: Clinic, index: int, nominal_s: np.ndarray) -> np.ndarray:
    config = clinic.config
    kept = random_stream(config, "drops", index).random(config.frames) >= config.dropped_share
    starts = config.starts_late_s[index] if config.starts_late_s else 0.0
    ends = config.ends_early_s[index] if config.ends_early_s else 0.0
    running = (nominal_s >= starts) & (nominal_s <= nominal_s[-1] - ends)
    running &= np.arange(config.frames) % (config.every[index] if config.every else 1) == 0
    kept[int(np.flatnonzero(running)[0])] = True
    return (kept | (index == 0)) & running


def _jitter_s(clinic: Clinic, index: int) -> np.ndarray:
    config = clinic.config
    if config.stamp_jitter_s == 0:
        return np.zeros(config.frames)
    limit_s = min(JITTER_SPREADS * config.stamp_jitter_s, JITTER_LIMIT / config.fps)
    late_s = random_stream(config, "stamps", index).normal(0.0, config.stamp_jitter_s, config.frames)
    return late_s.clip(-limit_s, limit_s)


def _write_shown(folder: Path, record: Record, frame: int, image: np.ndarray) -> None:
    """Write the image of a frame; if the recorder repeats an earlier image in this frame, copy the file of that image
    instead.
    """
    path = folder / f"{frame:06d}.png"
    if record.shown[frame] == frame:
        _write_png(path, image)
    else:
        shutil.copyfile(folder / f"{record.shown[frame]:06d}.png", path)


def _write_stamps(path: Path, record: Record) -> None:
    rows = [f"{frame},{record.stamp_s[frame]:.6f}" for frame in np.flatnonzero(record.kept)]
    path.write_text("\n".join(["frame,time_s", *rows]) + "\n", encoding="utf-8")


def _write_png(path: Path, image: np.ndarray) -> None:
    import cv2

    path.write_bytes(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, PNG_COMPRESSION])[1].tobytes())
