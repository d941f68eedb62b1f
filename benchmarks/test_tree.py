"""How long the track tree takes and how often it is pruned: pytest benchmarks/test_tree.py --benchmark-only.

Windows as tracking meets them in two simulated recordings (one camera and a hole of 0.15 m in half of the frames; a
clinic with three cameras), beside every branch of the same trees spelled out, which also proves the optimum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from anchorpose.motion.database_file import load_motions
from anchorpose.recording.reader import open_recording, read_frames
from anchorpose.simulate.config import clinic, holes
from anchorpose.simulate.write import simulate_recording
from anchorpose.track_tree import global_hypothesis
from anchorpose.track_tree.tree import Support, TreeConfig, best_branches
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.following import follow_patient
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Run

SCENES = {"holes": holes(101, 0.15, 1.5), "clinic": clinic(101, 1.5)}
UNLIMITED = TreeConfig(max_branches=10**9)


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """What one search is given; see ``best_branches``."""

    matches: list[np.ndarray]
    positions_m: list[np.ndarray]
    predicted_m: np.ndarray


@pytest.fixture(scope="module", params=list(SCENES))
def windows(request, tmp_path_factory) -> list[Window]:
    """Every window of three frames that tracking a recording meets."""
    folder, config = tmp_path_factory.mktemp("tree") / request.param, TrackConfig()
    simulate_recording(folder, SCENES[request.param])
    recording = open_recording(folder / "recording")
    room = prepare_room(recording, config)
    motions = load_motions(config.motion_file, recording.rate_hz, config.motion)
    met: list[Window] = []

    def noted(matches, positions_m, predicted_m, tree, costs_m):
        met.append(Window(list(matches), list(positions_m), predicted_m))
        return best_branches(matches, positions_m, predicted_m, tree, costs_m)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(global_hypothesis, "best_branches", noted)
        for _ in follow_patient(Run(room, config, motions), read_frames(recording), None):
            pass
    return [window for window in met if len(window.matches) == 3]


def every_branch(window: Window, missed_cost_m: float) -> np.ndarray:
    """(m,) the least score over all branches of each tree, none left out."""
    depth = len(window.matches)
    best = np.full(len(window.predicted_m), depth * missed_cost_m)
    node, score = np.arange(len(best))[:, None], np.zeros((len(best), 1))
    for level, (match, positions) in enumerate(zip(window.matches, window.positions_m, strict=True)):
        child = match[np.maximum(node, 0)].reshape(len(best), -1)
        child = np.where(np.repeat(node >= 0, match.shape[1], axis=1), child, -1)
        away = np.linalg.norm(positions[child] - window.predicted_m[:, level, None], axis=2)
        score = np.where(child >= 0, np.repeat(score, match.shape[1], axis=1) + away, np.inf)
        node = child
        if score.shape[1]:
            best = np.minimum(best, score.min(axis=1) + (depth - 1 - level) * missed_cost_m)
    return best


def test_branch_and_bound(benchmark, windows):
    config, turn = TreeConfig(), iter(range(10**9))
    searched = [best_branches(w.matches, w.positions_m, w.predicted_m, config) for w in windows]
    exact = [best_branches(w.matches, w.positions_m, w.predicted_m, UNLIMITED) for w in windows]
    trees = sum(len(result.match) for result in searched)
    benchmark.extra_info |= {
        "windows": len(windows),
        "trees": trees,
        "pruned": sum(result.pruned for result in searched),
        "not the optimum": sum(
            int((one.score > best.score + 1e-6).sum()) for one, best in zip(searched, exact, strict=True)
        ),
        "matched": sum(int((result.support == Support.MATCHED).sum()) for result in searched) / trees,
    }
    print(benchmark.extra_info)

    def search():
        window = windows[next(turn) % len(windows)]
        return best_branches(window.matches, window.positions_m, window.predicted_m, config)

    benchmark(search)


def test_every_branch_spelled_out(benchmark, windows):
    for window in windows:
        exact = best_branches(window.matches, window.positions_m, window.predicted_m, UNLIMITED)
        assert exact.pruned == 0
        assert exact.score == pytest.approx(every_branch(window, UNLIMITED.missed_cost_m), abs=1e-5)
    widest = max(windows, key=lambda window: window.matches[0].shape[1] * len(window.predicted_m))
    benchmark.pedantic(every_branch, (widest, UNLIMITED.missed_cost_m), rounds=3)
