"""Make the recordings of the benchmark, and compare fingerprints of their content with the published fingerprints."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Final
from zlib import crc32

import numpy as np

from anchorpose.batch.cluster import Job, Place, run_jobs
from anchorpose.camera import transform_points
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.recording.depth_image import read_depth_image
from anchorpose.recording.document import LARGEST_BYTES, parse_json
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import Recording
from anchorpose.recording.regular_file import is_there, read_image, read_whole
from anchorpose.recording.writable import check_place, new_folder
from anchorpose.research.benchmark.plan import ALL_GROUPS, GAPS, NODES, TRACKING, VERSION, Group
from anchorpose.research.benchmark.truth import truth_of
from anchorpose.research.experiment.clips import cut_holes, draw_hole_frames
from anchorpose.research.experiment.correspondence import Skin
from anchorpose.results.folder import whole_or_nothing, write_text_whole
from anchorpose.results.truth import read_truth
from anchorpose.simulate.render import PATIENT
from anchorpose.simulate.write import simulate_recording
from anchorpose.threads import one_thread

DOCUMENT: Final = "benchmark.json"
FORMAT: Final = "anchorpose-benchmark"
REFERENCE: Final = "reference.json"  # file beside this module: fingerprints of recordings made on Linux, x86-64
HOLE_SHARE: Final = 0.5  # share of frames, drawn at random, that get a hole, as in the paper; the first frame gets none
STEP: Final = 2  # pixels between neighbouring nodes, as in the tracker's mesh
TRUTH_UNIT_M: Final = 1e-4  # m, true joints are rounded to multiples of this before their hash is computed


@dataclass(frozen=True, slots=True)
class Fingerprint:
    """The fingerprint of a recording's content. Recordings with equal fingerprints have the same content."""

    depth: str  # hash of all decoded depth images
    truth: str  # hash of the true joints, rounded to 0.1 mm
    readings: int  # number of depth readings
    mean_mm: float  # mean depth of the readings


@dataclass(frozen=True, slots=True)
class Benchmark:
    """The content of a benchmark folder."""

    folder: Path
    groups: tuple[Group, ...]  # groups (all recordings of a seed) that are complete in the folder
    # a sentence for each recording whose fingerprint differs from the published fingerprint
    other_bytes: tuple[str, ...]


def make_benchmark(
    out: Path, groups: Sequence[Group], processes: int | None, progress: Callable[[int, int], None]
) -> Benchmark:
    """Simulate groups of recordings (a group is made from one seed), write them to a folder, and compute the
    fingerprints of all recordings in this folder.

    Recordings that an earlier run has finished are kept, so a call for a finished benchmark only computes fingerprints
    and compares them with the published fingerprints.

    Raises InputError if the folder is not empty and is not a benchmark of this version.
    """
    check_place(out)
    if out.exists() and any(out.iterdir()):
        _read_document(out)
    else:
        _write_document(out, {})
    missing = [group for group in groups if not (out / group.name).is_dir()]
    jobs = [Job(group.name.replace("/", "-"), partial(make_group, group, out)) for group in missing]
    progress(0, len(jobs))
    for done, outcome in enumerate(run_jobs(jobs, Place(processes)), 1):
        if outcome.why is not None:
            raise AnchorposeError(f"{outcome.name} could not be made: {outcome.why}")
        progress(done, len(jobs))
    made = [group for group in ALL_GROUPS if (out / group.name).is_dir()]
    _write_document(out, {name: fingerprint(out / name) for group in made for name in group.recordings.values()})
    rows = [f"{p.task},{p.name},{p.first},{p.second}" for group in made for p in group.pairs]
    write_text_whole(out / "pairs.csv", "\n".join(["task,pair,first,second", *rows]) + "\n")
    return open_benchmark(out)


def open_benchmark(folder: Path) -> Benchmark:
    """Return the content of a folder that ``make_benchmark`` wrote; raises InputError for any other folder, and if a
    file of true joints has changed since then.
    """
    found = _read_document(folder)
    groups = tuple(group for group in ALL_GROUPS if set(group.recordings.values()) <= set(found))
    if not groups:
        raise InputError(folder, "holds no whole recording", "run 'anchorpose benchmark make' on it again")
    for group in groups:
        if _truth_hash(group.truth(folder)) != found[next(iter(group.recordings.values()))].truth:
            raise InputError(group.truth(folder), "is not as it was made", "delete its folder and make it again")
    return Benchmark(folder, groups, tuple(unlike_reference(found)))


def unlike_reference(found: dict[str, Fingerprint]) -> list[str]:
    """Return a sentence for each recording whose fingerprint differs from the published fingerprint.

    found: computed fingerprints by name of the recording; recordings without a published fingerprint are skipped.
    """
    known, sentences = reference(), list[str]()
    for name, mark in found.items():
        expected = known.get(name)
        if expected is None or mark == expected:
            continue
        wrong = [what for what in ("depth", "truth") if getattr(mark, what) != getattr(expected, what)]
        sentences.append(
            f"{name}: its {' and '.join(wrong)} differ from the reference ({mark.readings} readings instead of "
            f"{expected.readings}, {mark.mean_mm:.3f} mm on average instead of {expected.mean_mm:.3f})"
        )
    return sentences


def reference() -> dict[str, Fingerprint]:
    """Return the published fingerprints of all recordings, by name."""
    document = json.loads(files(__package__).joinpath(REFERENCE).read_text(encoding="utf-8"))
    return {name: Fingerprint(**mark) for name, mark in document["recordings"].items()}


def make_group(group: Group, out: Path) -> None:
    """Make all files of one seed: recordings and true joints; for a single recording (one person, one camera), also
    nodes (points of the patient's surface) and the nodes' true matches in the format of answers.
    """
    with one_thread(), whole_or_nothing(out / group.name) as work:
        simulated = work / "simulated"
        simulate_recording(simulated, group.simulation)
        names = [Path(name).name for name in group.recordings.values()]
        (simulated / "recording").rename(work / names[0])
        (simulated / "truth" / "truth.npz").rename(work / "truth.npz")
        if not group.is_clinic:
            _from_single(group, work, open_recording(work / names[0]), simulated / "truth" / "labels")
        shutil.rmtree(simulated)


def _from_single(group: Group, work: Path, recording: Recording, labels: Path) -> None:
    """Write a copy of the recording for each size of hole (removed depth readings around the body's centre), all with
    holes in the same frames; also write the nodes (points of the patient's surface) and their true matches.
    """
    camera, frames = recording.cameras[0].name, range(len(recording.streams[0].files))
    seen = [patient_pixels(recording, labels / camera, frame) for frame in frames]
    centre_m = np.array([points.mean(axis=0) for _, points in seen])
    chosen = draw_hole_frames(len(frames), HOLE_SHARE, crc32(group.name.encode()), (0,))
    for task, hole_m in TRACKING.items():
        if hole_m > 0:
            copy = work / Path(group.recordings[task]).name
            cut_holes(recording, copy, centre_m, chosen, hole_m)
            _without_links(copy)
    (work / NODES).mkdir()
    for frame in sorted({frame for pair in group.pairs for frame in (pair.first_frame, pair.second_frame)}):
        _write_nodes(work / NODES / f"{frame:06d}.csv", *seen[frame])
    _write_matches(group, work)


def patient_pixels(recording: Recording, labels: Path, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels that truly show the patient and have a reading: row and column (n, 2), point (n, 3) world."""
    camera = recording.cameras[0]
    depth_m = read_depth_image(recording.streams[0].files[frame], camera).depth_m
    label = read_image(labels / f"{frame:06d}.png")
    if depth_m is None or label is None:
        raise InputError(recording.folder, f"frame {frame} cannot be read", "make it again")
    pixel = np.argwhere((label == PATIENT) & (depth_m > 0))
    points = transform_points(camera.require_pose(), camera.back_project(depth_m)[tuple(pixel.T)].astype(np.float64))
    return pixel, points


def _without_links(folder: Path) -> None:
    """Replace links to depth images by copies of these images, so that the folder can be moved."""
    for path in folder.rglob("*.png"):
        if path.is_symlink():
            source = path.resolve()
            path.unlink()
            shutil.copyfile(source, path)


def _write_nodes(path: Path, pixel: np.ndarray, points_m: np.ndarray) -> None:
    on_grid = (pixel % STEP == 0).all(axis=1)
    table = np.column_stack([np.arange(on_grid.sum()), pixel[on_grid], points_m[on_grid]])
    head, form = "node,row,column,x_m,y_m,z_m", ["%d", "%d", "%d", "%.4f", "%.4f", "%.4f"]
    np.savetxt(path, table, form, delimiter=",", header=head, comments="")


def _write_matches(group: Group, work: Path) -> None:
    """Write true matches (the nodes nearest to the true places in the second frame) in the format of answers."""
    skin, rows = Skin(group.simulation), ["task,pair,node,match"]
    for pair in group.pairs:
        best = truth_of(work, pair, skin).nearest()
        rows += [f"{pair.task},{pair.name},{node},{'' if match < 0 else match}" for node, match in enumerate(best)]
    (work / "matches.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


def fingerprint(recording: Path) -> Fingerprint:
    """Compute the fingerprint of a recording folder: hashes of its depth images and true joints, and the number and
    mean of its depth readings. The recording's true joints are in truth.npz beside the folder.
    """
    digest, readings, total = hashlib.sha256(), 0, 0
    for path in sorted(recording.glob("*/depth/*.png")):
        image = read_image(path)
        if image is None:
            raise InputError(path, "cannot be read", "make the benchmark again")
        depth = np.ascontiguousarray(image, dtype="<u2")
        digest.update(f"{path.relative_to(recording).as_posix()} {depth.shape}".encode() + depth.tobytes())
        readings, total = readings + int((depth > 0).sum()), total + int(depth.sum(dtype=np.int64))
    mean_mm = round(total / max(readings, 1), 3)
    return Fingerprint(digest.hexdigest(), _truth_hash(recording.parent / "truth.npz"), readings, mean_mm)


def _truth_hash(path: Path) -> str:
    joints = np.rint(read_truth(path).position_m / TRUTH_UNIT_M).astype("<i4")
    return hashlib.sha256(joints.tobytes()).hexdigest()


def _write_document(out: Path, found: dict[str, Fingerprint]) -> None:
    document = {
        "format": FORMAT,
        "version": VERSION,
        "gaps": GAPS,
        "recordings": {name: asdict(mark) for name, mark in found.items()},
    }
    with new_folder(out.resolve(), out):
        write_text_whole(out / DOCUMENT, json.dumps(document, indent=1) + "\n")


def _read_document(folder: Path) -> dict[str, Fingerprint]:
    path = folder / DOCUMENT
    remedy = "give a folder made by 'anchorpose benchmark make', or to make one, an empty one"
    if not is_there(path):
        raise InputError(path, "there is no such file", remedy)
    try:
        document = parse_json(read_whole(path, LARGEST_BYTES, remedy))
        if document["format"] != FORMAT:
            raise ValueError("its format is another")
        if document["version"] != VERSION:
            raise InputError(path, f"is of version {document['version']}", f"make version {VERSION} in a new folder")
        return {str(name): Fingerprint(**mark) for name, mark in document["recordings"].items()}
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(path, f"is not a benchmark's ({error})", remedy) from None
