"""Compare what tracking suggests after an occlusion with the likeliest scene hypothesis, on simulated recordings.

    python tools/compare_scene_hypotheses.py FOLDER...

Each folder has ``recording/`` and ``truth/truth.npz``. The tool tracks each recording and prints a row for each frame
in which another scene hypothesis replaced the suggestion: the mean error of the patient's 21 joints in both, in mm. The
pose of a patient who is hidden is the predicted pose. A frame is listed as often as it was tracked: while the body is
learnt, in the passes, and when tracking back. Of the frames without a replacement only the number is printed.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from anchorpose.body.registration import Registration
from anchorpose.pipeline import track_recording
from anchorpose.results.truth import read_truth
from anchorpose.tracker import patient
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.scene_hypotheses import KnownPeople, SceneHypothesis, likeliest_scene

ALIKE_MM = 20.0  # errors that differ by less count as equal


def compare(folder: Path) -> list[tuple[int, float, float]]:
    """Track a recording; return, for each comparison of scene hypotheses, the frame, the error of the pose that
    tracking suggests, and the error of the pose in the likeliest scene hypothesis, both in mm.
    """
    truth, rows = read_truth(folder / "truth" / "truth.npz"), list[tuple[int, float, float]]()

    def error_mm(found: Registration, known: KnownPeople, position: int) -> float:
        away_m = known.body.joints(found.belief.pose) - truth.position_m[position]
        return 1000.0 * float(np.linalg.norm(away_m, axis=1).mean())

    def watched(now: Observation, found: Registration, known: KnownPeople) -> SceneHypothesis:
        best, frame_set = likeliest_scene(now, found, known), now.frame_set
        position = frame_set.frame if frame_set.position is None else frame_set.position
        suggested_mm = error_mm(found, known, position)
        rows.append(
            (
                frame_set.frame,
                suggested_mm,
                suggested_mm if best.seen is now else error_mm(best.registration, known, position),
            )
        )
        return best

    patient.likeliest_scene = watched
    with tempfile.TemporaryDirectory() as out:
        track_recording(folder / "recording", Path(out), TrackConfig(), lambda done, total: None)
    return rows


def main() -> None:
    """Print the comparisons of all folders given on the command line."""
    totals = {"likelihood right": 0, "tracking right": 0, "alike": 0, "kept": 0}
    for folder in map(Path, sys.argv[1:]):
        for frame, suggested_mm, best_mm in compare(folder):
            gain = suggested_mm - best_mm
            verdict = "likelihood right" if gain > ALIKE_MM else "tracking right" if gain < -ALIKE_MM else "alike"
            verdict = "kept" if suggested_mm == best_mm else verdict
            totals[verdict] += 1
            if verdict != "kept":
                print(f"{folder.name}, frame {frame}: {suggested_mm:.0f} -> {best_mm:.0f} mm, {verdict}", flush=True)
    print(", ".join(f"{name}: {count}" for name, count in totals.items()))


if __name__ == "__main__":
    main()
