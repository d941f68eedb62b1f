"""What becomes of recordings with wrong poses: python benchmarks/given_poses.py --clinics 12 --first-seed 61200.

Simulated clinics of different cameras and equipment (``camera_agreement.clinic``), or with --recordings recordings of
three cameras with right poses, spoilt: one camera shifted or
turned, two cameras' folders exchanged, one camera upside down, the equipment elsewhere than equipment.json has it. Each
is asked as ``anchorpose track`` asks it, once with all its cameras and once with the spoilt camera alone. The table has
in how many it is refused, noted or not noticed, and the displacement that was measured, in mm.

With --track, one more clinic and its spoilt copies are also tracked as far as they are not refused, among them a wrong
height and cameras that are blind for ten frames: the mean error in mm, and the share of axes within 1.96 sigma.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import cv2
import numpy as np
from camera_agreement import clinic
from scipy.spatial.transform import Rotation

from anchorpose.calibration.clocks import Clocks, settle_clocks
from anchorpose.errors import InputError
from anchorpose.pipeline import track_recording
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import align_clocks
from anchorpose.results.evaluate import evaluate
from anchorpose.simulate import config as presets
from anchorpose.simulate.write import simulate_recording
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.given_poses import agreeing_poses
from anchorpose.tracker.preparation import Settled, calibrate, sample_recording, scenes_of

SPOILT: Final = 1  # the camera that is off
BLIND: Final = range(20, 30)  # frames
BESIDE: Final = np.array([0.10, 0.0, 0.08])  # metres, from where equipment.json has the equipment to where it stands


Spoil = Callable[[Path, dict[str, Any]], None]
"""Changes a recording's folder and the document of its recording.json."""


def shifted(metres: float, along: str) -> Spoil:
    """The spoilt camera's pose shifted ``towards`` what it looks at, ``sideways`` or ``up``."""

    def spoil(folder: Path, document: dict[str, Any]) -> None:
        camera = _camera(document)
        T = np.array(camera["camera_to_world"])
        T[:3, 3] += metres * _axes(T)[along]
        camera["camera_to_world"] = T.tolist()

    return spoil


def turned(degrees: float, about: str) -> Spoil:
    """The spoilt camera's pose turned: ``up`` is yaw, ``sideways`` pitch, ``towards`` roll."""

    def spoil(folder: Path, document: dict[str, Any]) -> None:
        camera = _camera(document)
        T = np.array(camera["camera_to_world"])
        T[:3, :3] = Rotation.from_rotvec(np.radians(degrees) * _axes(T)[about]).as_matrix() @ T[:3, :3]
        camera["camera_to_world"] = T.tolist()

    return spoil


def _axes(T_world_camera: np.ndarray) -> dict[str, np.ndarray]:
    up, view = np.array([0.0, 1.0, 0.0]), T_world_camera[:3, 2] * [1.0, 0.0, 1.0]
    view /= np.linalg.norm(view)
    return {"up": up, "towards": view, "sideways": np.cross(up, view)}


def _camera(document: dict[str, Any]) -> dict[str, Any]:
    cameras: list[dict[str, Any]] = document["cameras"]
    return cameras[min(SPOILT, len(cameras) - 1)]


def exchanged(folder: Path, document: dict[str, Any]) -> None:
    """The folders of the first two cameras."""
    one, other = (folder / camera["name"] for camera in document["cameras"][:2])
    one.rename(folder / "other")
    other.rename(one)
    (folder / "other").rename(other)


def upside_down(folder: Path, document: dict[str, Any]) -> None:
    """The spoilt camera's images, the room's too."""
    own = folder / _camera(document)["name"]
    for path in [*own.glob("depth/*.png"), *own.glob("background.png")]:
        _rewrite(path, lambda grey: grey[::-1, ::-1])


def blind(which: slice) -> Spoil:
    """Some cameras have no reading in the frames of ``BLIND``."""

    def spoil(folder: Path, document: dict[str, Any]) -> None:
        for camera in document["cameras"][which]:
            for path in (folder / camera["name"] / "depth" / f"{number:06d}.png" for number in BLIND):
                _rewrite(path, np.zeros_like)

    return spoil


def _rewrite(path: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    changed = np.ascontiguousarray(change(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)))
    path.unlink()  # it may be a link to the recording that is spoilt
    cv2.imwrite(str(path), changed)


def equipment_elsewhere(folder: Path, document: dict[str, Any]) -> None:
    """All that stands in the room stays, and equipment.json has it elsewhere."""
    path = folder / "equipment.json"
    if path.exists():
        equipment = json.loads(path.read_text())
        for part in equipment["parts"]:
            part["center"] = (np.array(part["center"]) + BESIDE).tolist()
        path.unlink()
        path.write_text(json.dumps(equipment))


def height(metres: float) -> Spoil:
    """Another height of the subject."""
    return lambda folder, document: document.update(subject={"height_m": metres})


def published(folder: Path, document: dict[str, Any]) -> None:
    """Every camera 2 cm and 0.7 degrees off its pose, with a focal length 1.5 % wrong: as published data sets are."""
    rng = np.random.default_rng(len(document["cameras"]))
    for camera in document["cameras"]:
        T = np.array(camera["camera_to_world"])
        shift, axis = rng.normal(size=(2, 3))
        T[:3, 3] += 0.02 * shift / np.linalg.norm(shift)
        turn = Rotation.from_rotvec(np.radians(0.7) * axis / np.linalg.norm(axis)).as_matrix()
        T[:3, :3] = turn @ T[:3, :3]
        camera["camera_to_world"] = T.tolist()
        for name in ("fx", "fy"):
            camera["intrinsics"][name] *= 1.0 + rng.choice([-0.015, 0.015])


RIGHT: Final = "nothing"
PUBLISHED: Final = "all cameras 2 cm and 0.7 degrees off, focal lengths 1.5 %"
ASKED: Final[dict[str, Spoil]] = {
    RIGHT: lambda folder, document: None,
    PUBLISHED: published,
    "a camera shifted 2 cm sideways": shifted(0.02, "sideways"),
    "5 cm sideways": shifted(0.05, "sideways"),
    "20 cm towards the patient": shifted(0.20, "towards"),
    "a camera turned by 1 degree, yaw": turned(1.0, "up"),
    "5 degrees, yaw": turned(5.0, "up"),
    "5 degrees, pitch": turned(5.0, "sideways"),
    "5 degrees, roll": turned(5.0, "towards"),
    "two cameras' folders exchanged": exchanged,
    "a camera upside down": upside_down,
    "equipment 13 cm from where equipment.json has it": equipment_elsewhere,
}
TRACKED: Final[dict[str, Spoil]] = {
    **{
        name: ASKED[name]
        for name in (RIGHT, PUBLISHED, "a camera shifted 2 cm sideways", "a camera turned by 1 degree, yaw")
    },
    "height_m 0.5": height(0.5),
    "one of three cameras blind for ten frames": blind(slice(SPOILT, SPOILT + 1)),
    "all cameras blind for ten frames": blind(slice(None)),
}


def spoilt_copy(recording: Path, out: Path, spoil: Spoil, alone: bool = False) -> Path:
    """A spoilt copy of a recording; alone: of the spoilt camera only."""
    shutil.copytree(recording, out)
    document = json.loads((out / "recording.json").read_text())
    if alone:
        document["cameras"] = document["cameras"][SPOILT : SPOILT + 1]
    spoil(out, document)
    (out / "recording.json").write_text(json.dumps(document))
    return out


@dataclass(frozen=True, slots=True)
class Answer:
    """refused: the sentence, empty where it is not; noted_m: the largest displacement of the doubts, NaN without one
    that states it; doubts: how many."""

    refused: str
    noted_m: float
    doubts: int


def ask(folder: Path, clocks: Clocks) -> Answer:
    """As ``track`` asks before it looks for the patient; clocks: as found with the right poses."""
    config = TrackConfig()
    recording = open_recording(folder)
    timed = align_clocks(recording, clocks.clocks[: len(recording.cameras)])
    chosen, samples = sample_recording(timed, config)
    calibration = calibrate(timed, samples, config)
    scenes = scenes_of(Settled(timed, clocks, calibration, tuple(chosen), tuple(samples)), config)
    try:
        agreed = agreeing_poses(timed, calibration, clocks, scenes, samples)
    except InputError as refusal:
        return Answer(str(refusal), float("nan"), 0)
    off_m = [doubt.off_m for doubt in agreed.doubts if np.isfinite(doubt.off_m)]
    return Answer("", max(off_m, default=float("nan")), len(agreed.doubts))


def ask_clinic(config: presets.SimulationConfig, work: Path) -> dict[tuple[str, bool], Answer]:
    """One clinic, spoilt in every way; True: with the spoilt camera alone."""
    simulate_recording(work / "s", config)
    return ask_spoilt(work / "s" / "recording", work)


def ask_spoilt(recording: Path, work: Path) -> dict[tuple[str, bool], Answer]:
    """The same of a recording of three cameras, which is not changed."""
    opened, found = open_recording(recording), {}
    clocks = settle_clocks(opened, opened.cameras, TrackConfig().clocks)[1]
    for name, spoil in ASKED.items():
        for alone in (False, True) if spoil is not exchanged else (False,):
            copy = spoilt_copy(recording, work / "spoilt", spoil, alone)
            found[name, alone] = ask(copy, clocks)
            shutil.rmtree(copy)
    return found


def row(name: str, clinics: Sequence[dict[tuple[str, bool], Answer]]) -> str:
    """One line of the table of what is asked."""
    cells = [_counts([found[name, alone] for found in clinics if (name, alone) in found]) for alone in (False, True)]
    return f"| {name} | {' | '.join(cells)} |"


def _counts(answers: Sequence[Answer]) -> str:
    if not answers:
        return "– | –"
    refused, noted = sum(bool(one.refused) for one in answers), sum(one.doubts > 0 for one in answers)
    measured = [1000.0 * one.noted_m for one in answers if np.isfinite(one.noted_m)]
    reach = f"{min(measured):.0f} to {max(measured):.0f}" if measured else "–"
    return f"{refused} / {noted} / {len(answers) - refused - noted} | {reach}"


def tracked_rows(seed: int, work: Path) -> Iterable[str]:
    """The lines of the table of what is tracked."""
    config = presets.clinic(seed, 4.0)
    simulate_recording(work / "s", config)
    for name, spoil in TRACKED.items():
        copy, results = spoilt_copy(work / "s" / "recording", work / "spoilt", spoil), work / "results"
        results.mkdir()
        try:
            track_recording(copy, results, TrackConfig(), lambda done, of: None)
            found = evaluate(results, work / "s" / "truth" / "truth.npz").overall
            yield f"| {name} | {found.mean_mm:.1f} | {100 * (found.lost_share or 0.0):.1f} | {found.coverage_95:.3f} |"
        except InputError as refusal:
            yield f"| {name} | refused: {refusal.problem} | | |"
        shutil.rmtree(copy)
        shutil.rmtree(results)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=Path, nargs="*", default=[])
    parser.add_argument("--clinics", type=int, default=0)
    parser.add_argument("--first-seed", type=int, default=61200)
    parser.add_argument("--track", action="store_true")
    chosen = parser.parse_args()
    clinics = []
    with one_thread():
        for recording in chosen.recordings:
            with TemporaryDirectory() as work:
                clinics.append(ask_spoilt(recording, Path(work)))
            print(f"{recording}: {clinics[-1]}", file=sys.stderr, flush=True)
        for number in range(chosen.clinics):
            with TemporaryDirectory() as work:
                clinics.append(ask_clinic(clinic(chosen.first_seed + number, number), Path(work)))
            print(f"clinic {number} with right poses: {clinics[-1][RIGHT, False]}", file=sys.stderr)
        if clinics:
            print("| spoilt | refused / noted / not noticed, three cameras | mm | that camera alone | mm |")
            print("|---|--:|--:|--:|--:|\n" + "\n".join(row(name, clinics) for name in ASKED), flush=True)
        if chosen.track:
            print("| spoilt | mean mm | lost % | within 1.96 sigma |\n|---|--:|--:|--:|")
            with TemporaryDirectory() as work:
                for line in tracked_rows(chosen.first_seed + chosen.clinics, Path(work)):
                    print(line, flush=True)


if __name__ == "__main__":
    main()
