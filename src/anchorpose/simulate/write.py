"""Writing a simulated recording and, beside it, its truth."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_NAMES
from anchorpose.simulate.clinic import Clinic, draw_clinic
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.documents import write_documents
from anchorpose.simulate.recorder import Record
from anchorpose.simulate.render import PATIENT
from anchorpose.simulate.shoot import Studio, set_up
from anchorpose.simulate.touch import Touch, touches

PNG_COMPRESSION = 2  # noise does not compress; more effort triples the time for 3 % of the size


def simulate_recording(out: Path, config: SimulationConfig, progress: Callable[[int, int], None] | None = None) -> None:
    """Write ``out/recording/`` and ``out/truth/``; all of it or nothing.

    ``progress(done, total)`` is called after every frame. Raises InputError where ``out`` is there and not empty.
    """
    out = Path(out)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(out, "is there already and not empty", "choose another folder or remove it first")
    out.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    try:
        _write_all(work, draw_clinic(config), progress)
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
    write_documents(recording, clinic)
    studio = set_up(clinic)
    for index, camera in enumerate(clinic.cameras):
        _write_png(recording / camera.name / "background.png", studio.background_mm(index))
        _write_stamps(recording / camera.name / "timestamps.csv", studio.records[index])
    patient_pixels, contacts = [], []
    for frame in range(config.frames):
        shot = studio.shoot(frame)
        for index, camera in enumerate(clinic.cameras):
            name, picture = f"{frame:06d}.png", shot.pictures[index]
            _write_reading(recording / camera.name / "depth", studio.records[index], frame, shot.depths_mm[index])
            _write_png(truth / "labels" / camera.name / name, picture.label)
            _write_png(truth / "parts" / camera.name / name, picture.part)
        patient_pixels.append(sum(int((picture.label == PATIENT).sum()) for picture in shot.pictures))
        contacts.append(touches(clinic, studio.performances[0], shot.figures, frame))
        if progress is not None:
            progress(frame + 1, config.frames)
    _write_truth(truth / "truth.npz", studio, np.array(patient_pixels), contacts)


def _write_truth(path: Path, studio: Studio, patient_pixels: np.ndarray, contacts: list[Touch]) -> None:
    """Everything that a tracker should find out, by frame of the first camera, world frame, metres.

    Beyond the format's own keys: patient_pixels (t,) of all cameras together; touched (t, 31) bones whose skin a
    therapist's is within 3 cm of, named by part_names; touched_joints (t, n, 21) the same by therapist and joint;
    held_joints (t, n, 2) the joint in each hand of each therapist, -1 none; clock_late, clock_drift, clock_epoch by
    camera: stamp s was taken at (s - epoch) + late + drift (s - epoch), and taken_s (cameras, t), when the picture of
    that number on the disk was taken, NaN where there is none; doubled (cameras, t), it is an earlier one once more.
    """
    clinic, config, performance = studio.clinic, studio.clinic.config, studio.performances[0]
    person = clinic.patient.person
    np.savez_compressed(
        path,
        joints=performance.joints_m(),
        names=np.array(JOINT_NAMES),
        time=np.arange(config.frames) / config.fps,
        occluded=studio.in_hole,
        patient_pixels=patient_pixels,
        touched=np.array([contact.bones for contact in contacts]),
        touched_joints=np.array([contact.joints for contact in contacts]),
        held_joints=performance.held_joints(),
        part_names=np.array(person.body.asset.bone_names),
        camera_names=np.array([camera.name for camera in clinic.cameras]),
        T_world_camera=np.array([camera.require_pose() for camera in clinic.cameras]),
        clock_late=np.array(config.clock_late_s or [0.0] * config.cameras),
        clock_drift=np.array(config.clock_drift or [0.0] * config.cameras),
        clock_epoch=np.array(config.clock_epoch_s or [0.0] * config.cameras),
        taken_s=np.array([np.where(record.kept, record.taken_s, np.nan) for record in studio.records]),
        doubled=np.array([record.kept & (record.shown < np.arange(config.frames)) for record in studio.records]),
        shape_coefficients=person.coefficients,
        height_m=person.height_m,
    )


def _write_reading(depth: Path, record: Record, frame: int, reading_mm: np.ndarray) -> None:
    if record.kept[frame] and record.shown[frame] == frame:
        _write_png(depth / f"{frame:06d}.png", reading_mm)
    elif record.kept[frame]:
        shutil.copyfile(depth / f"{record.shown[frame]:06d}.png", depth / f"{frame:06d}.png")


def _write_stamps(path: Path, record: Record) -> None:
    rows = [f"{frame},{record.stamp_s[frame]:.6f}" for frame in np.flatnonzero(record.kept)]
    path.write_text("\n".join(["frame,time_s", *rows]) + "\n", encoding="utf-8")


def _write_png(path: Path, picture: np.ndarray) -> None:
    import cv2

    path.write_bytes(cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, PNG_COMPRESSION])[1].tobytes())
