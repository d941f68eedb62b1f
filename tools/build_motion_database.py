"""Build ``src/anchorpose/motion/data/motions.npz``: the reference movements of the scaled motion dynamics.

    python tools/build_motion_database.py

Every movement of the simulator, by a few people of different size, slow to fast: about as many samples as the paper
trained on for each of them (200, Section V). Only joints are kept, to the millimetre.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from anchorpose.motion.database import SHIPPED, ReferenceClips, write_motions
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import MOTIONS, SimulationConfig

RATE_HZ = 15.0
SECONDS = 4.0
PEOPLE = 3
FIRST_SEED = 900_001  # far from the seeds of examples and tests


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=SHIPPED)
    out = parser.parse_args().out
    clips, names = [], []
    for number, motion in enumerate(MOTIONS):
        for person in range(PEOPLE):
            config = SimulationConfig(
                seed=FIRST_SEED + 100 * number + person,
                seconds=SECONDS,
                fps=RATE_HZ,
                cameras=1,
                equipment="none",
                therapists=0,
                motions=(motion,),
                speed="mixed",
            )
            clinic = draw_clinic(config)
            clips.append(clinic.act(np.arange(config.frames) / RATE_HZ).joints_m())
            names.append(motion)
    note = f"{len(MOTIONS)} simulated movements of stand training by {PEOPLE} people each"
    movements = ReferenceClips(tuple(clips), tuple(names), (RATE_HZ,) * len(clips), (note,))
    write_motions(out, movements)
    print(f"{out}: {movements.frame_count} samples; {note}; {out.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
