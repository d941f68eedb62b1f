"""How far off the joints are on the hard scenes: python benchmarks/hard_accuracy.py SCENES --results RESULTS.

SCENES is what ``hard_scenes.py --out`` wrote. Each recording is tracked with the defaults, by all its cameras, or with
--front by its first camera alone; a scene whose results are there is not tracked again. The table has, in mm, the mean
of all joints and of those called hidden (H); the share of joints over 100 mm off and outside of four sigma; the
longest time that a limb is over 150 mm off while some camera sees most of it (not known for one camera of several); and
how often the truth lies within 1.96 sigma, of joints called observed and of those called hidden.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.pipeline import TrackConfig, track_recording
from anchorpose.results.evaluate import Evaluation, evaluate
from anchorpose.threads import one_thread

COLUMNS: Final = ("mean", "H mean", "confident errors %", "longest wrong s", "coverage", "H coverage")


@dataclass(frozen=True, slots=True)
class Row:
    """One scene; NaN where it has no such joints, or where it is not known."""

    scene: str
    values: tuple[float, ...]
    joint_frames: tuple[int, int]  # that the means are over, lost ones too: all, hidden


def front_alone(recording: Path, out: Path) -> Path:
    """The recording as its first camera made it; its images are linked, not copied."""
    if not out.exists():
        out.mkdir(parents=True)
        document = json.loads((recording / "recording.json").read_text())
        document["cameras"] = document["cameras"][:1]
        (out / "recording.json").write_text(json.dumps(document, indent=1))
        for name in (document["cameras"][0]["name"], "equipment.json"):
            if (recording / name).exists():
                (out / name).symlink_to((recording / name).resolve())
    return out


def track_scene(scene: Path, results: Path, front: bool) -> Row:
    """Track one scene, unless that was done before, and compare it with its truth."""
    out = results / f"{scene.name}{'-front' if front else ''}"
    if not (out / "run.json").exists():
        recording = (
            front_alone(scene / "recording", results / "recordings" / scene.name) if front else scene / "recording"
        )
        out.mkdir(parents=True, exist_ok=True)
        began = time.perf_counter()
        with one_thread():
            track_recording(recording, out, TrackConfig(), lambda done, total: None)
        print(f"{out.name}: {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)
    return _row(scene.name, evaluate(out, scene / "truth" / "truth.npz"), front)


def _row(scene: str, found: Evaluation, front: bool) -> Row:
    wrong_s = max((wrong.seconds for _, wrong in found.wrong_in_view), default=float("nan"))
    values = (
        found.overall.mean_mm,
        found.hidden.mean_mm,
        None if found.confident_errors is None else 100.0 * found.confident_errors,
        None if front else wrong_s,
        found.observed.coverage_95,
        found.hidden.coverage_95,
    )
    counts = found.overall.joint_frames, found.hidden.joint_frames
    return Row(scene, tuple(float("nan") if value is None else float(value) for value in values), counts)


def totals(rows: Sequence[Row]) -> tuple[float, ...]:
    """Over all joints and frames of all scenes; of the longest times the longest."""
    values = np.array([row.values for row in rows])
    every, hidden = np.array([row.joint_frames for row in rows], float).T
    weights = (every, hidden, every, None, every - hidden, hidden)
    found = []
    for column, weight in zip(values.T, weights, strict=True):
        known = np.isfinite(column)
        if not known.any():
            found.append(float("nan"))
        elif weight is None:
            found.append(float(column[known].max()))
        else:
            found.append(float(np.average(column[known], weights=weight[known])))
    return tuple(found)


def table(rows: Sequence[Row]) -> str:
    """Markdown: a row for each scene, then all together."""
    lines = [f"| scene | {' | '.join(COLUMNS)} |", "|---|" + "--:|" * len(COLUMNS)]
    for name, values in [*((row.scene, row.values) for row in rows), ("**all**", totals(rows))]:
        lines.append(f"| {name} | {' | '.join(_cell(value, column) for column, value in enumerate(values))} |")
    return "\n".join(lines)


def _cell(value: float, column: int) -> str:
    return "–" if np.isnan(value) else f"{value:.{1 if column < 2 else 2}f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=Path, help="folder of hard_scenes.py --out")
    parser.add_argument("--results", type=Path, required=True, help="where the results go, and stay")
    parser.add_argument("--front", action="store_true", help="the first camera of each scene alone")
    parser.add_argument("--only", nargs="+", default=[""], help="scenes whose names contain one of these")
    parser.add_argument("--jobs", type=int, default=2, help="recordings at a time")
    options = parser.parse_args()
    chosen = [
        scene
        for scene in sorted(options.scenes.iterdir())
        if (scene / "truth").is_dir() and any(part in scene.name for part in options.only)
    ]
    if not chosen:
        sys.exit(f"{options.scenes} holds no scene; write some with hard_scenes.py --out {options.scenes}.")
    work = partial(track_scene, results=options.results, front=options.front)
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        print(table(list(pool.map(work, chosen))))


if __name__ == "__main__":
    main()
