"""Which bodies are measured well: python benchmarks/bodies.py PEOPLE --results RESULTS.

PEOPLE: folder for the simulated recordings, made where absent: a grid of builds, seen by one camera, in a clinic by
three, and in the same clinic by the front camera alone. Tracking knows nothing of the bodies. Each row is one kind of
person in one scene: mean error of all joints and of knees, hips, elbows and ankles, the worst person's mean, how many
true positions lie within 1.96 sigma of an axis, the error of the eight limb bones' lengths (median, worst) and how many
lie within 1.96 of their sigma. The first second is left out.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from anchorpose.body.learning import BONES
from anchorpose.errors import AnchorposeError
from anchorpose.joints import JOINT_INDEX
from anchorpose.pipeline import TrackConfig, track_recording
from anchorpose.results.run_record import RUN_FILE
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.threads import one_thread

if TYPE_CHECKING:
    from anchorpose.simulate.config import SimulationConfig

SKIP_S: Final = 1.0
SEEDS: Final = {"tuning": 61000, "held-out": 63000}
SCENES: Final = ("one", "clinic", "front")
JUDGED: Final = ("Knee", "Hip", "Elbow", "Ankle")
TITLES: Final = {"one": "one camera", "clinic": "clinic, three cameras", "front": "clinic, front alone"}
LEAST_SIGMA_M: Final = 1e-9


def _people() -> dict[str, Callable[[SimulationConfig], SimulationConfig]]:
    """Each kind of person, as a change of a recording's settings."""
    from anchorpose.simulate.bodies import BUILDS, OtherBody

    def changed(config: SimulationConfig, build: str = "varied", body: dict[str, Any] | None = None, **settings: Any):
        return replace(config, body=OtherBody(build=build, **(body or {})), **settings)

    return {
        **{build: partial(changed, build=build) for build in BUILDS},
        "small": partial(changed, height_m=1.47),
        "tall": partial(changed, height_m=1.93),
        "tight-clothes": partial(changed, clothing_m=0.002),
        "loose-clothes": partial(changed, clothing_m=0.015),
        "braces": partial(changed, body={"braces": ("left shank", "right thigh")}),
        "corset": partial(changed, body={"braces": ("trunk",)}),
        "no-left-shank": partial(changed, body={"missing": ("shank_left",)}),
        "no-right-forearm": partial(changed, body={"missing": ("forearm_right",)}),
    }


def make(job: tuple[str, str, int], folder: Path, seconds: float) -> Path:
    """A recording of a kind of person in a scene by a seed, made unless it is there."""
    person, scene, seed = job
    out = folder / f"{person}-{scene}-{seed}"
    if not (out / "truth" / "truth.npz").exists():
        from anchorpose.simulate import config as presets
        from anchorpose.simulate.write import simulate_recording

        config = presets.single(seed, seconds) if scene == "one" else presets.clinic(seed, seconds)
        config = replace(config, cameras=1) if scene == "front" else config
        simulate_recording(out, _people()[person](config))
    return out


@dataclass(frozen=True, slots=True)
class Row:
    """One recording. off_m, inside (t, 21): error, and share of axes within 1.96 sigma; bones (8, 2): error, sigma."""

    person: str
    scene: str
    seed: int
    off_m: np.ndarray
    inside: np.ndarray
    bones: np.ndarray
    notes: tuple[str, ...]


def score(job: tuple[str, str, int], folder: Path, results: Path, seconds: float) -> Row:
    """Tracks one recording, unless its results are there, and compares it with its truth."""
    simulated = make(job, folder, seconds)
    out = results / simulated.name
    if not (out / RUN_FILE).exists():
        out.mkdir(parents=True, exist_ok=True)
        with one_thread():
            track_recording(simulated / "recording", out, TrackConfig(), lambda done, total: None)
    joints, run = read_joints(out / JOINTS_FILE), json.loads((out / RUN_FILE).read_text())
    with np.load(simulated / "truth" / "truth.npz") as stored:
        truth_m, time_s = stored["joints"], stored["time"]
    kept = np.searchsorted(time_s, joints.time_s - 1e-4)
    away = (joints.position_m - truth_m[kept])[joints.time_s >= SKIP_S]
    sigma = joints.sigma_m[joints.time_s >= SKIP_S]
    known = np.isfinite(away).all(axis=2)
    inside = np.where(known, (np.abs(away) < 1.96 * sigma[..., None]).mean(axis=2), np.nan)
    bones = np.full((len(BONES), 2), np.nan)
    if run["body"] is not None:
        learnt = {bone["bone"]: (bone["length_m"], bone["sigma_m"]) for bone in run["body"]["bones"]}
        for row, (name, start, end) in enumerate(BONES):
            true_m = np.linalg.norm(truth_m[0, JOINT_INDEX[end]] - truth_m[0, JOINT_INDEX[start]])
            if name in learnt:
                bones[row] = learnt[name][0] - true_m, learnt[name][1]
    return Row(*job, np.linalg.norm(away, axis=2), inside, bones, tuple(run.get("notes", ())))


def table(rows: Sequence[Row]) -> str:
    """One line per kind of person and scene."""
    lines = [
        "| person | scene | n | mean mm | knees | hips | elbows | ankles | worst person | lost % | in 95 % band "
        "| bones: median mm | worst | in 95 % |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for scene in SCENES:
        of_scene = [row for row in rows if row.scene == scene]
        people = dict.fromkeys(row.person for row in of_scene)
        for person in (*people, *(["all"] if len(people) > 1 else [])):
            lines.append(_line(person, scene, [row for row in of_scene if person in ("all", row.person)]))
    return "\n".join(lines)


def _line(person: str, scene: str, rows: Sequence[Row]) -> str:
    def mean_mm(columns: Sequence[int]) -> float:
        return 1000 * float(np.mean([np.nanmean(row.off_m[:, columns]) for row in rows]))

    every = list(range(len(JOINT_INDEX)))
    judged = [mean_mm([JOINT_INDEX[f"{joint}{side}"] for side in ("Left", "Right")]) for joint in JUDGED]
    worst = max(1000 * float(np.nanmean(row.off_m)) for row in rows)
    lost = 100 * float(np.mean([np.isnan(row.off_m)[:, ~np.isnan(row.off_m).all(axis=0)].mean() for row in rows]))
    inside = 100 * float(np.mean([np.nanmean(row.inside) for row in rows]))
    bones = np.concatenate([row.bones for row in rows])
    off, sigma = np.abs(bones[:, 0]), np.maximum(bones[:, 1], LEAST_SIGMA_M)
    cells = [person, scene, str(len(rows))]
    cells += [f"{value:.1f}" for value in (mean_mm(every), *judged, worst, lost, inside)]
    cells += [f"{1000 * value:.1f}" for value in (np.nanmedian(off), np.nanmax(off))]
    cells.append(f"{100 * np.mean(off[np.isfinite(off)] < 1.96 * sigma[np.isfinite(off)]):.0f}")
    return "| " + " | ".join(cells) + " |"


def draw(rows: Sequence[Row], path: Path) -> None:
    """A picture: one line per kind of person, one dot per person and scene at the mean error."""
    import matplotlib.pyplot as plt

    people, scenes = (
        list(dict.fromkeys(row.person for row in rows)),
        [s for s in SCENES if s in {r.scene for r in rows}],
    )
    figure, axes = plt.subplots(figsize=(7.0, 0.8 + 0.32 * len(people)), layout="constrained")
    for number, scene in enumerate(scenes):
        of_scene = [row for row in rows if row.scene == scene]
        off_mm = [1000 * float(np.nanmean(row.off_m)) for row in of_scene]
        line = [people.index(row.person) + 0.2 * (number - 0.5) for row in of_scene]
        axes.scatter(off_mm, line, s=18, label=TITLES[scene])
    axes.set_yticks(range(len(people)), people)
    axes.invert_yaxis()
    axes.set_xlim(0.0)
    axes.grid(axis="x", alpha=0.4)
    axes.set_xlabel("mean joint error of one person, mm")
    axes.legend(fontsize="small")
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("people", type=Path)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--use", choices=list(SEEDS), default="tuning")
    parser.add_argument("--picture", type=Path, help="draw every person's mean error")
    parser.add_argument("--persons", nargs="+", default=["ordinary", "varied", "wasted-legs", "heavy"])
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--seeds", type=int, default=4, help="people of each kind")
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--processes", type=int, default=2)
    chosen = parser.parse_args()
    first = SEEDS[chosen.use]
    jobs = [(p, s, first + k) for s in chosen.scenes for p in chosen.persons for k in range(chosen.seeds)]
    rows = []
    work = partial(score, folder=chosen.people, results=chosen.results, seconds=chosen.seconds)
    with ProcessPoolExecutor(chosen.processes, mp_context=get_context("spawn")) as pool:
        for job, done in zip(jobs, [pool.submit(work, job) for job in jobs], strict=True):
            try:
                rows.append(done.result())
            except AnchorposeError as problem:
                print(*job, f"refused: {problem}", file=sys.stderr)
                continue
            print(_line(f"{job[0]} {job[2]}", job[1], rows[-1:]), file=sys.stderr)
    print(table(rows))
    if chosen.picture:
        draw(rows, chosen.picture)


if __name__ == "__main__":
    main()
