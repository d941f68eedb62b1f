"""Write this project's answers on real depth, for the second track of the public benchmark.

    python benchmarks/research/real_answers.py OUT
    anchorpose benchmark score OUT/tracker --real RECORDINGS --labels benchmarks/labels
    anchorpose benchmark score OUT/descriptor --real RECORDINGS --labels benchmarks/labels

tracker: each labelled person is tracked from the place at which a user would point them out, with the settings of suite
``real``; kept results of this suite are used. descriptor: in each labelled frame alone, an ordinary body is fitted to
the learnt descriptor's matches of the found person who has most pixels in the label's box. Each folder gets
``answers.json`` and ``real.csv``: the labelled frames of each person.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
from pyarrow.csv import write_csv

sys.path.insert(0, str(Path(__file__).parents[1]))  # the runner's folder

from real_suites import PEOPLE
from recordings import Ready, Real
from run import CACHE, results_folder, tracked
from scores import LABELS, name_labelled, people_in
from versions import working_tree

from anchorpose.body.matched_places import LEAST_MATCHES, match_person, matches_of
from anchorpose.body.shape_prior import shape_of_height
from anchorpose.body.skin_points import body_points, build_body
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.descriptor.learnt import described
from anchorpose.descriptor.people import find_people
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_COUNT, JOINT_NAMES
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.research.benchmark.answers import ABOUT, FORMAT
from anchorpose.research.benchmark.labels import LABELLERS, read_labels
from anchorpose.research.benchmark.plan import VERSION
from anchorpose.research.benchmark.real import FILE
from anchorpose.results.run_record import RUN_FILE, read_run
from anchorpose.results.tables import JOINTS_FILE, read_joints

TITLES: Final = {"tracker": "anchorpose track", "descriptor": "learnt descriptor, one frame alone"}
Joints = Iterator[tuple[int, np.ndarray]]
"""Frame numbers, each with the joints (21, 3) of a person, metres in the camera's frame, NaN for a missing joint."""


def by_tracker(folder: str, person: str, cache: Path) -> Joints:
    """Yield the joints of a labelled person in the labelled frames; nothing where the person cannot be named."""
    ready = _ready(folder, cache)
    named = name_labelled(ready, person)
    if named is None:
        return
    version = working_tree()
    results = results_folder(ready, named, version, cache)
    if tracked(results, ready, named, version).refused:
        return
    table = read_joints(results / JOINTS_FILE)
    T_camera_world = invert_rigid(np.array(read_run(results / RUN_FILE)["cameras"][0]["camera_to_world"]))
    labelled = {frame for labeller in LABELLERS for frame in read_labels(LABELS, folder, labeller)}
    for row in np.flatnonzero(np.isin(table.frame, sorted(labelled))).tolist():
        yield int(table.frame[row]), transform_points(T_camera_world, table.position_m[row])


def by_descriptor(folder: str, person: str, cache: Path) -> Joints:
    """Yield the joints of a labelled person in each labelled frame, each computed from that frame alone."""
    recording = open_recording(_ready(folder, cache).recording)
    camera = replace(recording.cameras[0], T_world_camera=np.eye(4))
    for frame, people in sorted(read_labels(LABELS, folder, LABELLERS[0]).items()):
        row = int(np.flatnonzero(recording.streams[0].frame == frame)[0])
        depth_m = read_frame(recording, row).depths_m[0]
        for one in (one for one in people if one.person == person and depth_m is not None):
            found = _described(depth_m, camera, one.box)
            if found is not None:
                yield frame, found


def _described(depth_m: np.ndarray, camera: Camera, box: Sequence[float]) -> np.ndarray | None:
    """Return the joints (21, 3) of the person with most rays in a box of the image; None if the box has no person."""
    said = described(depth_m, camera)
    inside = (box[0] <= said.column) & (said.column <= box[2]) & (box[1] <= said.row) & (said.row <= box[3])
    rays = [one.rays[0] for one in find_people([said], [depth_m], [np.eye(4)]) if one.rays[0] is not None]
    own = max(rays, key=lambda mine: int((mine & inside).sum()), default=np.zeros_like(inside))
    if not (own & inside).any():
        return None
    labels = np.zeros(depth_m.shape, np.uint8)
    labels[said.row[own], said.column[own]] = PixelLabel.PATIENT
    matches = matches_of([View(depth_m, labels)], [camera], PixelLabel.PATIENT)
    if len(matches) < LEAST_MATCHES:
        return None
    found = match_person(matches)
    body = build_body(body_points(), shape_of_height(body_points().asset, found.stature_m))
    return body.joints(found.pose)


METHODS: Final[dict[str, Callable[[str, str, Path], Joints]]] = {"tracker": by_tracker, "descriptor": by_descriptor}


def _ready(folder: str, cache: Path) -> Ready:
    ready = Real(folder).ready(cache)
    if ready is None:
        raise SystemExit(f"{folder} is not here: the labelled recordings belong to others (docs/benchmark.md)")
    return ready


def rows_of(folder: str, person: str, joints: Joints) -> Iterator[pa.Table]:
    """Yield the rows of ``real.csv``."""
    for frame, joints_m in joints:
        places = {
            axis: pa.array(joints_m[:, i].round(4), from_pandas=True) for i, axis in enumerate(("x_m", "y_m", "z_m"))
        }
        columns = {"recording": [folder] * JOINT_COUNT, "person": [person] * JOINT_COUNT}
        yield pa.table({**columns, "frame": [frame] * JOINT_COUNT, "joint": list(JOINT_NAMES), **places})


def main() -> None:
    """Write a folder of answers for each method."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--cache", type=Path, default=CACHE)
    asked = parser.parse_args()
    people = [(folder, person) for folder in PEOPLE for person in people_in(folder)]
    for method, joints_of in METHODS.items():
        rows = [row for who in people for row in rows_of(*who, joints_of(*who, asked.cache))]
        folder = asked.out / method
        folder.mkdir(parents=True, exist_ok=True)
        about = {"format": FORMAT, "version": VERSION, "method": TITLES[method], "source": "anchorpose"}
        (folder / ABOUT).write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
        write_csv(pa.concat_tables(rows), folder / FILE)


if __name__ == "__main__":
    main()
