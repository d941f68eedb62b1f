"""How far off predicted joints are: python benchmarks/motions.py SKELETONS.npz (the Kinect skeletons of UI-PRMD).

The numbers of ``MotionConfig`` were chosen on subjects 1 to 4, each left out in turn; the figures are of subjects 5, 6
and 7, who took no part in that. Each is predicted by a database of the six others: with all ten movements, with this
one left out of it (unseen), and by the movements that ship with the package. Then simulated people, whose
joints are without noise: 30 Hz, another person than in the shipped movements, with theirs of the same kind and without.
Mean distance over the joints that the skeletons hold, after 1, 3 and 10 frames of 33 ms.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_NAMES
from anchorpose.motion.database import MotionDatabase
from anchorpose.motion.database_file import DERIVED, SHIPPED, ReferenceClips, read_motions, read_skeletons
from anchorpose.motion.prediction import MotionConfig, MotionRule, joint_database, predict_joints
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import MOTIONS, SimulationConfig

RATE_HZ: Final = 30.0
AHEAD: Final = np.array([1, 3, 10])
HISTORY: Final = 12  # frames, as ``FollowConfig.history``
SUBJECTS: Final = (5, 6, 7)
MEASURED: Final = [number for number, name in enumerate(JOINT_NAMES) if name not in DERIVED or name == "Neck"]

OURS: Final = MotionConfig()
PAPERS: Final = replace(OURS, rule=MotionRule.BEST_SUBLIST, displacement_weight=0.0)
VELOCITY: Final = replace(OURS, rule=MotionRule.VELOCITY)

Predictor = Callable[[np.ndarray], np.ndarray]  # (HISTORY, 21, 3) -> (3, 21, 3)


def by(config: MotionConfig, database: MotionDatabase | None) -> Predictor:
    return lambda past: predict_joints(past, int(AHEAD[-1]), database, config).joints_m[AHEAD - 1]


def constant_velocity(span: int) -> Predictor:
    return lambda past: past[-1] + AHEAD[:, None, None] * (past[-1] - past[-1 - span]) / span


def constant_position(past: np.ndarray) -> np.ndarray:
    return np.repeat(past[-1:], len(AHEAD), axis=0)


VELOCITIES: Final[Mapping[str, Predictor]] = {
    "own velocity, damped (no database)": by(VELOCITY, None),
    "constant velocity over 4 frames": constant_velocity(4),
    "constant velocity": constant_velocity(1),
    "constant position": constant_position,
}


def errors_mm(clips: Iterable[np.ndarray], predictor: Predictor, every: int) -> np.ndarray:
    """(n, 3) mean distance over the measured joints at each horizon."""
    found = [
        np.linalg.norm(predictor(clip[k - HISTORY : k]) - clip[k - 1 + AHEAD], axis=2)[:, MEASURED].mean(axis=1)
        for clip in clips
        for k in range(HISTORY, len(clip) - int(AHEAD[-1]), every)
    ]
    return 1000.0 * np.array(found)


def database(clips: ReferenceClips, wanted: Callable[[str], bool]) -> MotionDatabase:
    """Of the clips whose names are wanted."""
    chosen = [number for number, name in enumerate(clips.names) if wanted(name)]
    rates = [clips.rate_hz[number] for number in chosen]
    return joint_database([clips.joints_m[number] for number in chosen], rates, RATE_HZ, OURS)


def movement(name: str) -> str:
    """Of a clip of UI-PRMD, such as ``c_m03_s05_e01``."""
    return name.split("_")[1]


def subject(name: str) -> int:
    return int(name.split("_")[2][1:])


def of_skeletons(clips: ReferenceClips, every: int) -> dict[str, list[np.ndarray]]:
    """Errors of each way of predicting, for each left-out subject."""
    shipped = database(read_motions(SHIPPED), lambda name: True)
    ways: dict[str, list[np.ndarray]] = {}
    for person in SUBJECTS:
        print(f"subject {person}", file=sys.stderr)
        tests = {name: clip for name, clip in zip(clips.names, clips.joints_m, strict=True) if subject(name) == person}
        others = database(clips, lambda name, person=person: subject(name) != person)
        predictors = {
            "**ours**": by(OURS, others),
            "the paper's rule": by(PAPERS, others),
            "ours, shipped movements": by(OURS, shipped),
            **VELOCITIES,
        }
        for way, predictor in predictors.items():
            ways.setdefault(way, []).append(errors_mm(tests.values(), predictor, every))
        unseen: dict[str, list[np.ndarray]] = {"ours, movement unseen": [], "the paper's rule, movement unseen": []}
        for kind in sorted({movement(name) for name in tests}):
            rest = database(clips, lambda n, person=person, kind=kind: subject(n) != person and movement(n) != kind)
            same = [clip for name, clip in tests.items() if movement(name) == kind]
            for way, config in zip(unseen, (OURS, PAPERS), strict=True):
                unseen[way].append(errors_mm(same, by(config, rest), every))
        for way, found in unseen.items():
            ways.setdefault(way, []).append(np.concatenate(found))
    return ways


def simulated(kind: str, seconds: float = 5.0) -> np.ndarray:
    """A movement by a person who is not in the shipped file."""
    config = SimulationConfig(
        seed=777_000 + MOTIONS.index(kind), seconds=seconds, fps=RATE_HZ, cameras=1, equipment="none",
        therapists=0, motions=(kind,), speed="mixed",
    )  # fmt: skip
    return draw_clinic(config).act(np.arange(config.frames) / RATE_HZ).joints_m()


def of_simulation(every: int) -> dict[str, list[np.ndarray]]:
    shipped, ways = read_motions(SHIPPED), dict[str, list[np.ndarray]]()
    for kind in MOTIONS:
        test, rest = [simulated(kind)], database(shipped, lambda name, kind=kind: name != kind)
        everything = database(shipped, lambda name: True)
        for way, predictor in {
            "**ours**": by(OURS, everything),
            "the paper's rule": by(PAPERS, everything),
            "ours, movement unseen": by(OURS, rest),
            "the paper's rule, movement unseen": by(PAPERS, rest),
            **VELOCITIES,
        }.items():
            ways.setdefault(way, []).append(errors_mm(test, predictor, every))
    return {way: [np.concatenate(found)] for way, found in ways.items()}


def table(ways: Mapping[str, Sequence[np.ndarray]], columns: Sequence[str]) -> str:
    """Markdown; one column a group, each with the mean at the three horizons."""
    lines = [f"| mean mm after 1 / 3 / 10 frames | {' | '.join(columns)} |", "|---|" + "--:|" * len(columns)]
    for way, found in ways.items():
        groups = [*found, np.concatenate(found)] if len(found) > 1 else found
        cells = (" / ".join(f"{value:.1f}" for value in group.mean(axis=0)) for group in groups)
        lines.append(f"| {way} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("skeletons", type=Path, help="skeletons.npz of UI-PRMD: joints_mm, offsets, names, joint_names")
    parser.add_argument("--every", type=int, default=25, help="predict from every so many frames of each clip")
    chosen = parser.parse_args()
    if chosen.skeletons.exists():
        clips = read_skeletons(chosen.skeletons, RATE_HZ)
        columns = [*(f"subject {person}" for person in SUBJECTS), "all three"]
        print(table(of_skeletons(clips, chosen.every), columns), end="\n\n")
    else:
        print(f"skipped: {chosen.skeletons} is absent; the UI-PRMD skeletons are not part of this project")
    print(table(of_simulation(max(1, chosen.every // 5)), ["simulated, no noise"]))


if __name__ == "__main__":
    main()
