"""Write this project's answers to the public benchmark.

    python benchmarks/research/leader_board.py BENCHMARK OUT --methods tracker shot

BENCHMARK was made by `anchorpose benchmark make`. Each method gets a folder of answers in OUT, which `anchorpose
benchmark score` scores. tracker: `anchorpose track` with its defaults; results are kept in OUT/results, and a second
run goes on there. anchors: the paper's descriptor with subsets of three anchors; each subset gives one match (the
middle of psi), and the match nearest in place is taken, since the paper's track tree needs a prediction of the pose,
which two frames do not give. anchors-one: the match by all anchors found in both frames. anchors-similar: the node with
the most similar distances to these anchors. shot: SHOT over 20 cm. nearest: the node nearest in place. best: the true
matches.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
from pyarrow.csv import write_csv
from scipy.spatial import cKDTree

from anchorpose.geodesics.anchors import anchor_descriptor, find_anchors
from anchorpose.joints import ANCHOR_NAMES, JOINT_COUNT, JOINT_NAMES
from anchorpose.pipeline import track_recording
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.research.benchmark.answers import ABOUT, FORMAT, NO_MATCH
from anchorpose.research.benchmark.make import Benchmark, open_benchmark
from anchorpose.research.benchmark.plan import TRACKING, VERSION, Group, Part
from anchorpose.research.experiment.framework import PAPER_GATE
from anchorpose.research.features.nearest import nearest_descriptor
from anchorpose.research.features.shot import ShotConfig, shot
from anchorpose.results.run_record import RUN_FILE
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.surface.mesh import build_surface
from anchorpose.surface.surface import Surface
from anchorpose.threads import one_thread
from anchorpose.track_tree.hypotheses import anchor_subsets, match_hypotheses
from anchorpose.tracker.config import TrackConfig

UP, FACING = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
NEAR_M: Final = 0.03  # maximum distance from a node that the mesh lacks to the node that stands for it
TITLES: Final = {
    "tracker": "anchorpose track",
    "anchors": "anchor geodesics, subsets of three, the nearest in place",
    "anchors-one": "anchor geodesics, one hypothesis",
    "anchors-similar": "anchor geodesics, most similar node",
    "shot": "SHOT, 20 cm",
    "nearest": "nearest in place",
    "best": "true matches (the best possible)",
}


class Frame:
    """The data of a frame that every method gets: its nodes, and the mesh of its depth image at the nodes' pixels."""

    def __init__(self, folder: Path, group: Group, number: int) -> None:
        table = np.loadtxt(folder / group.nodes(number), delimiter=",", skiprows=1)
        self.points_m, self.pixel = table[:, 3:], table[:, 1:3].astype(int)
        recording = open_recording(folder / group.recordings[next(iter(TRACKING))])
        depth_m = read_frame(recording, number).depths_m[0]
        assert depth_m is not None
        self.node_at, mask = np.full(depth_m.shape, NO_MATCH), np.zeros(depth_m.shape, bool)
        self.node_at[tuple(self.pixel.T)] = np.arange(len(self.pixel))
        for step in ((0, 0), (0, 1), (1, 0), (1, 1)):  # a node stands for the pixels that the grid leaves out
            mask[tuple(np.minimum(self.pixel + step, np.array(mask.shape) - 1).T)] = True
        self.surface: Surface = build_surface(depth_m, mask & (depth_m > 0), recording.cameras[0])
        self.anchors = find_anchors(self.surface, UP, FACING)

    def on_surface(self) -> np.ndarray:
        """Return (n,) the node of the mesh nearest to each node of the frame, -1 if none is near."""
        distance, nearest = cKDTree(self.surface.points_m).query(self.points_m)
        return np.where(distance < NEAR_M, nearest, NO_MATCH)

    def node_of(self, surface_node: np.ndarray) -> np.ndarray:
        """Return (n,) the frame's node at the pixel of each given node of the mesh, -1 for -1."""
        found: np.ndarray = self.node_at[tuple(self.surface.pixel[surface_node].T)]
        return np.where(surface_node < 0, NO_MATCH, found)


Match = Callable[[Frame, Frame], np.ndarray]
"""Returns (m,) the node of the second mesh that matches each node of the first mesh, -1 = none."""


def by_anchors(first: Frame, second: Frame, size: int, similar: bool = False) -> np.ndarray:
    source, target = (anchor_descriptor(frame.surface, frame.anchors) for frame in (first, second))
    subsets = anchor_subsets(first.anchors.found & second.anchors.found, size)
    if len(subsets) == 0:
        return np.full(len(source), NO_MATCH)
    if similar:
        return nearest_descriptor(source[:, subsets[0]], target[:, subsets[0]])
    match = match_hypotheses(source, second.surface, target, subsets, config=PAPER_GATE).match
    away_m = np.linalg.norm(second.surface.points_m[match] - first.surface.points_m[:, None], axis=2)
    chosen = np.where(match < 0, np.inf, away_m).argmin(axis=1)
    return np.take_along_axis(match, chosen[:, None], axis=1)[:, 0]


def by_shot(first: Frame, second: Frame) -> np.ndarray:
    source, target = (
        shot(frame.surface.points_m, frame.surface.normals, ShotConfig(radius_m=0.20)) for frame in (first, second)
    )
    return nearest_descriptor(source, target)


ON_MESH: Final[dict[str, Match]] = {
    "anchors": partial(by_anchors, size=3),
    "anchors-one": partial(by_anchors, size=len(ANCHOR_NAMES)),
    "anchors-similar": partial(by_anchors, size=len(ANCHOR_NAMES), similar=True),
    "shot": by_shot,
}


def matched(first: Frame, second: Frame, method: str) -> np.ndarray:
    """Return (n,) the node of the second frame that matches each node of the first frame, -1 = none."""
    if method == "nearest":
        nearest: np.ndarray = cKDTree(second.points_m).query(first.points_m)[1]
        return nearest
    own, match = first.on_surface(), ON_MESH[method](first, second)
    return second.node_of(np.where(own < 0, NO_MATCH, match[own]))


def match_rows(benchmark: Benchmark, part: Part, method: str) -> Iterator[pa.Table]:
    """Yield the answers of one method, one table per pair of frames."""
    for group in benchmark.groups:
        if group.part is not part or not group.pairs:
            continue
        frames: dict[int, Frame] = {}
        for pair in group.pairs:
            for number in (pair.first_frame, pair.second_frame):
                frames.setdefault(number, Frame(benchmark.folder, group, number))
            match = matched(frames[pair.first_frame], frames[pair.second_frame], method)
            count = len(match)
            empty = pa.array(match, pa.int64(), mask=match < 0)
            columns = {"task": [pair.task] * count, "pair": [pair.name] * count, "node": np.arange(count)}
            yield pa.table({**columns, "match": empty})
        print(f"{method}: {group.name}", flush=True)


def track(recording: Path, results: Path) -> str:
    """Track one recording, unless it has been tracked before; return the line to print."""
    if not (results / RUN_FILE).exists():
        results.mkdir(parents=True, exist_ok=True)
        track_recording(recording, results, TrackConfig(), lambda done, total: None)
    return str(recording)


def joint_rows(benchmark: Benchmark, part: Part, results: Path, processes: int | None) -> Iterator[pa.Table]:
    """Track the recordings, and yield the joints with their sigma, one table per recording."""
    names = [name for group in benchmark.groups if group.part is part for name in group.recordings.values()]
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        for done in pool.map(track, [benchmark.folder / name for name in names], [results / name for name in names]):
            print(f"tracker: {done}", flush=True)
    for name in names:
        table = read_joints(results / name / JOINTS_FILE)
        place = table.position_m.reshape(-1, 3)
        columns = {
            "recording": [name] * len(place),
            "frame": np.repeat(table.frame, JOINT_COUNT),
            "joint": list(JOINT_NAMES) * len(table.frame),
            **{axis: pa.array(place[:, i].round(4), from_pandas=True) for i, axis in enumerate(("x_m", "y_m", "z_m"))},
            "sigma_m": pa.array(table.sigma_m.ravel().round(4), from_pandas=True),
        }
        yield pa.table(columns)


def write_answers(folder: Path, method: str, name: str, tables: Iterator[pa.Table]) -> None:
    """Write answers.json and one table into the folder of a method."""
    folder.mkdir(parents=True, exist_ok=True)
    about = {"format": FORMAT, "version": VERSION, "method": TITLES[method], "source": "anchorpose"}
    (folder / ABOUT).write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    write_csv(pa.concat_tables(tables), folder / f"{name}.csv")


def main() -> None:
    """Write a folder of answers for each method."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("benchmark", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--methods", nargs="+", choices=list(TITLES), default=list(TITLES))
    parser.add_argument("--part", type=Part, choices=list(Part), default=Part.TEST)
    parser.add_argument("--processes", type=int, help="of the tracker; by default one per core")
    asked = parser.parse_args()
    benchmark = open_benchmark(asked.benchmark)
    with one_thread():
        for method in asked.methods:
            folder = asked.out / method
            if method == "tracker":
                rows = joint_rows(benchmark, asked.part, asked.out / "results", asked.processes)
                write_answers(folder, method, "joints", rows)
            elif method == "best":
                files = [benchmark.folder / g.name / "matches.csv" for g in benchmark.groups if g.part is asked.part]
                write_answers(folder, method, "matches", (pa.csv.read_csv(path) for path in files if path.is_file()))
            else:
                write_answers(folder, method, "matches", match_rows(benchmark, asked.part, method))


if __name__ == "__main__":
    main()
