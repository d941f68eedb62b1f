"""Time a prediction with 100,000 frames of reference movements: pytest benchmarks/test_motions.py.

Movements of one subject of UI-PRMD are predicted from those of the other subjects; the benchmark is skipped if
ANCHORPOSE_SKELETONS does not name the file with the skeletons. ``plain`` compares with every sub-list of the database,
as the search does if joints are missing.
"""

from __future__ import annotations

import os
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

from anchorpose.motion.database import SHIPPED, pose_vectors, read_skeletons, write_motions
from anchorpose.motion.prediction import MotionConfig, best_sublists, joint_database, load_motions, predict_joints

ASKED, FRAMES = 7, 100_000
CONFIG = MotionConfig()


@pytest.fixture(scope="module")
def skeletons():
    path = Path(os.environ.get("ANCHORPOSE_SKELETONS", "skeletons.npz"))
    if not path.exists():
        pytest.skip(f"{path} is absent: name the skeletons of UI-PRMD in ANCHORPOSE_SKELETONS")
    return read_skeletons(path, 30.0)


@pytest.fixture(scope="module")
def searched(skeletons):
    """Return the database of the other subjects' clips, some of them used twice, so that it has enough frames."""
    others = [
        clip for clip, name in zip(skeletons.joints_m, skeletons.names, strict=True) if f"_s{ASKED:02d}_" not in name
    ]
    clips, again = [], cycle(others)
    while sum(len(clip) for clip in clips) < FRAMES:
        clips.append(next(again))
    return joint_database(clips, [30.0] * len(clips), 30.0, CONFIG)


@pytest.fixture(scope="module")
def histories(skeletons):
    return [
        clip[20:32]
        for clip, name in zip(skeletons.joints_m, skeletons.names, strict=True)
        if f"_s{ASKED:02d}_" in name and len(clip) > 32
    ]


@pytest.mark.parametrize("count", [1, CONFIG.neighbours])
@pytest.mark.parametrize("way", ["index", "plain"])
def test_search(benchmark, searched, histories, way, count):
    asked = cycle([pose_vectors(history)[-CONFIG.history :] for history in histories])
    lacking = cycle([np.where(np.arange(67) == 62, np.nan, pose) for pose in map(next, [asked] * len(histories))])
    source = asked if way == "index" else lacking  # one of 63 columns is missing, so the search has no bounds
    benchmark.extra_info["sub-lists"] = len(searched.sublists.place)
    benchmark.pedantic(
        lambda: best_sublists(next(source), searched, 3, count, CONFIG.displacement_weight),
        rounds=200 if way == "index" else 20,
        warmup_rounds=2,
    )


def test_predict(benchmark, searched, histories):
    asked = cycle(histories)
    benchmark.pedantic(lambda: predict_joints(next(asked), 3, searched, CONFIG), rounds=200, warmup_rounds=2)


def test_load_100000_frames(benchmark, skeletons, tmp_path):
    write_motions(tmp_path / "m.npz", skeletons)
    benchmark.pedantic(load_motions, (tmp_path / "m.npz", 30.0, CONFIG), rounds=3)


def test_load_shipped(benchmark):
    benchmark(load_motions, SHIPPED, 30.0, CONFIG)
