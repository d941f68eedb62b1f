"""Build ``src/anchorpose/tracking/data/motions.npz``: the reference movements of the scaled motion dynamics.

    python tools/build_motion_database.py

Every movement of the simulator, by a few people of different size, slow to fast: about as many samples as the paper
trained on for each of them (200, Section V). Only joints are kept, to the millimetre.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import MOTIONS, SimulationConfig

RATE_HZ = 15.0
SECONDS = 4.0
PEOPLE = 3
FIRST_SEED = 900_001  # far from the seeds of examples and tests


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("src/anchorpose/tracking/data/motions.npz"))
    arguments = parser.parse_args()
    clips, names = [], []
    for number, motion in enumerate(MOTIONS):
        for person in range(PEOPLE):
            config = SimulationConfig(
                seed=FIRST_SEED + 100 * number + person, seconds=SECONDS, fps=RATE_HZ, cameras=1, standing_frame=False,
                therapists=0, motions=(motion,), speed="mixed",
            )  # fmt: skip
            clinic = draw_clinic(config)
            joints_m = clinic.act(np.arange(config.frames) / RATE_HZ).joints_m()
            clips.append(np.rint(joints_m * 1000.0).astype(np.int16))
            names.append(motion)
    arguments.out.parent.mkdir(exist_ok=True)
    start = np.cumsum([0, *(len(clip) for clip in clips)])
    np.savez_compressed(
        arguments.out, joints_mm=np.concatenate(clips), start=start, names=np.array(names), rate_hz=RATE_HZ
    )
    size_kb = arguments.out.stat().st_size / 1000
    print(f"{arguments.out}: {start[-1]} samples of {len(MOTIONS)} movements, {size_kb:.0f} kB")


if __name__ == "__main__":
    main()
