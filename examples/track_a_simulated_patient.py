"""From nothing to joints, angles and their errors: simulate a patient, track him, compare with the truth.

python examples/track_a_simulated_patient.py OUT [--seconds 3]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from anchorpose.pipeline import track_recording
from anchorpose.results.evaluate import evaluate
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import TrackConfig


def main() -> None:
    """Writes OUT/simulated and OUT/results and prints what evaluate finds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--seconds", type=float, default=3.0)
    given = parser.parse_args()

    simulated, results = given.out / "simulated", given.out / "results"
    simulate_recording(simulated, single(seed=7, seconds=given.seconds))
    results.mkdir()
    track_recording(simulated / "recording", results, TrackConfig(), lambda done, total: None)

    evaluation = evaluate(results, simulated / "truth/truth.npz")
    print(f"joints are {evaluation.overall.mean_mm:.1f} mm off on average")
    for name, angle in evaluation.angles:
        if name.startswith("knee") and angle.mean_abs_deg is not None:
            print(f"{name}: {angle.mean_abs_deg:.1f} degrees off")


if __name__ == "__main__":
    main()
