"""Find contacts with people again in kept results, with this code but without tracking: seconds instead of minutes.

    python benchmarks/kept_contacts.py NAME... [--cache FOLDER]

NAME: recordings of the suites ``easy`` and ``hard``, as they are named in the cache. For each recording, the newest
results are taken whose depth images are in the cache. Poses, person labels and depth images are read for every second
frame. Results do not have the offsets of the skin's patches, so these contacts are less exact than those found during
tracking. The memory of skin that went out of sight is computed again from the labels.
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from run import CACHE
from scipy.spatial.transform import Rotation
from scores import contact_scores
from table import table

from anchorpose.body.config import VisibilityConfig
from anchorpose.body.contact_regions import Nearness, area_of_point, find_nearness, region_of_points
from anchorpose.body.kinematics import skin
from anchorpose.body.skin_points import CLOTHES, OFFSETS, Body, FittedShape, PosedPoints, body_points, build_body
from anchorpose.camera import Camera, transform_points
from anchorpose.isolation.bystander_memory import empty_memory, update_memory
from anchorpose.isolation.depth_noise import Sensor, neighbour_noise
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.reader import open_recording
from anchorpose.results.contact_intervals import ContactConfig, ContactIntervals
from anchorpose.results.contact_scores import evaluate_contacts
from anchorpose.results.records import PEOPLE_FILE, Contact, decode_labels, read_people
from anchorpose.results.run_record import RUN_FILE, read_run
from anchorpose.results.tables import POSES_FILE, PoseTable, read_poses
from anchorpose.results.truth import TrueTouch, read_true_touch

EVERY: Final = 2  # frames
FIRST: Final = 15  # number of frames at the start (a second) that are not scored: tracking may settle
UNKNOWN_SENSOR: Final = Sensor(edge_px=2.0, focal_px=365.0, noise_per_m=0.0, noise=neighbour_noise(0.0))  # not read


def kept(cache: Path, name: str) -> tuple[Path, Path]:
    """Return the newest results of a recording, and the recording. Raises SystemExit if the cache has none."""
    found = sorted(cache.glob(f"results/{name}-*/{RUN_FILE}"), key=lambda path: path.stat().st_mtime, reverse=True)
    for results in (path.parent for path in found if path.parent.name.rsplit("-", 1)[0] == name):
        sums = read_run(results / RUN_FILE)["inputs_sha256"]
        last = max(path for path in sums if path.endswith(".png") and "/depth/" in path)
        for folder in cache.glob(f"recordings/{name}-*"):
            recording = folder if (folder / "recording.json").is_file() else folder / "recording"
            if (recording / last).is_file() and _sha256(recording / last) == sums[last]:
                return results, recording
    raise SystemExit(f"{name}: {cache} has no results with their recording; run the suite that has it first.")


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def truth_of(cache: Path, name: str, recording: Path) -> Path:
    """Return the truth of a recording; for one by the front camera alone, that of the whole recording."""
    image = next(iter(sorted((recording / "front" / "depth").glob("*.png"))))
    for folder in cache.glob(f"recordings/{name.removesuffix('-front')}-*/truth"):
        same = folder.parent / "recording" / "front" / "depth" / image.name
        if same.is_file() and _sha256(same) == _sha256(image):
            return folder / "truth.npz"
    raise SystemExit(f"{name}: {cache} has no truth of this recording.")


def learnt_body(run: dict) -> Body:
    """Return the patient's body as run.json states it, with its clothes."""
    offset_m = np.zeros(OFFSETS)
    offset_m[: len(CLOTHES)] = [run["body"]["clothes_m"][piece] for piece in CLOTHES]
    return build_body(body_points(), FittedShape(np.array(run["body"]["coefficients"]), offset_m))


def posed_skin(body: Body, poses: PoseTable, row: int) -> PosedPoints | None:
    """Return the skin points in one frame; None where the patient is lost."""
    if not np.isfinite(poses.head_m[row]).all():
        return None
    points, parents = body.points, body.points.asset.bone_parents
    own = {int(bone): number for number, bone in enumerate(points.moving)}
    turns = Rotation.from_quat(np.roll(poses.quaternion[row].astype(np.float64), -1, axis=1)).as_matrix()
    T_world_rest = np.tile(np.eye(4), (len(parents), 1, 1))
    for bone, parent in enumerate(parents):
        head = body.mesh.bone_heads[bone]
        turn = turns[own[bone]] if bone in own else T_world_rest[parent, :3, :3]
        place = poses.head_m[row, own[bone]] if bone in own else turn @ head + T_world_rest[parent, :3, 3]
        T_world_rest[bone, :3, :3], T_world_rest[bone, :3, 3] = turn, place - turn @ head
    return PosedPoints(
        *skin(points.bones, points.influence, T_world_rest, body.rest_m, body.rest_normals), T_world_rest
    )


def people_pixels(view: View, camera: Camera) -> Pieces:
    """Return the pixels of people in the form that isolation and the bystander memory use."""
    row, column = np.nonzero((view.labels >= PixelLabel.PATIENT) & (view.depth_m > 0))
    index = np.full(view.labels.shape, -1, np.int32)
    index[row, column] = np.arange(len(row))
    depth = view.depth_m[row, column]
    in_camera = np.column_stack([camera.pixel_rays()[row, column] * depth[:, None], depth])
    points_m = transform_points(camera.require_pose(), in_camera).astype(np.float32)
    ones = np.ones(len(row), np.int32)
    where = (row.astype(np.int32), column.astype(np.int32))
    return Pieces(view.depth_m, view.labels, index, *where, ones, 1, points_m, ones.astype(np.float32), UNKNOWN_SENSOR)


def nearness(results: Path, recording: Path) -> Iterator[tuple[int, float, Nearness | None]]:
    """Yield, for every second frame, its number, its time, and how near other people are to the patient."""
    run, opened = read_run(results / RUN_FILE), open_recording(recording)
    pose_of = {one["name"]: np.array(one["camera_to_world"]) for one in run["cameras"]}
    cameras = [replace(camera, T_world_camera=pose_of[camera.name]) for camera in opened.cameras]
    body, poses, people = learnt_body(run), read_poses(results / POSES_FILE), read_people(results / PEOPLE_FILE)
    memory, before_s = empty_memory(), float(poses.time_s[0])
    for row in range(0, len(poses.frame), EVERY):
        frame, time_s = int(poses.frame[row]), float(poses.time_s[row])
        views = list[View | None]()
        for camera in cameras:
            image, labels = recording / camera.name / "depth" / f"{frame:06d}.png", people.get((frame, camera.name))
            depth = None if labels is None else cv2.imread(str(image), cv2.IMREAD_UNCHANGED)
            scaled = None if depth is None else depth * np.float32(camera.depth_scale)
            views.append(None if scaled is None else View(scaled, decode_labels(labels)))
        pieces = [None if view is None else people_pixels(view, one) for view, one in zip(views, cameras, strict=True)]
        memory, before_s = update_memory(memory, pieces, views, cameras, time_s - before_s), time_s
        posed = posed_skin(body, poses, row)
        yield frame, time_s, None if posed is None else find_nearness(posed, memory, views, cameras, VisibilityConfig())


def scores_of(cache: Path, name: str) -> dict[str, dict[str, float]]:
    """Return the scores of one recording: of all parts, by state and by part."""
    results, recording = kept(cache, name)
    truth = read_true_touch(truth_of(cache, name, recording))
    assert truth is not None
    points, contacts, frames = body_points(), list[Contact](), list[int]()
    intervals = ContactIntervals(region_of_points(points), area_of_point(points), ContactConfig())
    for frame, time_s, near in nearness(results, recording):
        contacts += intervals.push(frame, time_s, near)
        frames += [frame] if near is not None and frame >= FIRST else []
    chosen = np.array(frames)
    found = evaluate_contacts([*contacts, *intervals.finish()], chosen, TrueTouch(truth.bones[chosen], truth.names))
    rows = (
        ("all parts", found.overall),
        *((f"{state} alone", score) for state, score in found.per_state),
        *found.per_part,
    )
    return {part: contact_scores(score) for part, score in rows}


def main() -> None:
    """Print the tables of the recordings by three cameras and by the front camera alone."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+", metavar="NAME")
    parser.add_argument("--cache", type=Path, default=CACHE)
    chosen = parser.parse_args()
    rows: dict[str, list[dict[str, float]]] = {}
    for name in chosen.names:
        alone = name.endswith("-front") or name.startswith("easy-3")
        for part, scores in scores_of(chosen.cache, name).items():
            side_free = part.removesuffix("_left").removesuffix("_right")
            rows.setdefault(f"{'front camera alone' if alone else 'three cameras'}: {side_free}", []).append(scores)
    print(table(rows))


if __name__ == "__main__":
    main()
