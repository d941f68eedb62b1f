"""Measure how people hold arms and legs: ``src/anchorpose/body/data/limb_turns.npz``, the statistics of limbs.

    python tools/measure_limb_turns.py SKELETONS

SKELETONS: UI-PRMD (Data 2018, 3(1), 2; public domain, ODC PDDL 1.0) as an .npz file: ten rehabilitation exercises by
seven people, of whom the last two are kept for tests. The simulator puts them on bodies of its own; what it moves
itself, walking and standing at rails, is in it too. Mirrored poses count as well, so that both sides are alike.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from anchorpose.body.asset import BodyAsset
from anchorpose.body.pose import MOVING_BONES, moving_bones
from anchorpose.body.skin_points import body_points
from anchorpose.rotations import rotation_vectors
from anchorpose.simulate import config as presets
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import MOTIONS, SimulationConfig
from anchorpose.simulate.movement_file import MOVEMENTS

SUBJECTS = (1, 2, 3, 4, 5)
REPEATS = 5  # of each movement, by another person or of each person
FIRST_SEED = 770_001  # far from the seeds of examples and tests
SECONDS, RATE_HZ = 8.0, 5.0
BONES = tuple(f"{side}{bone}" for side in ("Left", "Right") for bone in ("Arm", "ForeArm", "UpLeg", "Leg", "Foot"))
MIRRORED = np.array([-1.0, -1.0, 1.0])  # a rotation vector seen in a mirror between left and right


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("skeletons", type=Path)
    parser.add_argument("--out", type=Path, default=Path("src/anchorpose/body/data/limb_turns.npz"))
    chosen = parser.parse_args()
    asset = body_points().asset
    vectors = np.concatenate([limb_vectors(config, asset) for config in recordings(chosen.skeletons)])
    half = len(BONES) // 2
    mirrored = np.concatenate([vectors[:, half:], vectors[:, :half]], axis=1) * MIRRORED
    flat = np.concatenate([vectors, mirrored]).reshape(2 * len(vectors), -1)
    mean, covariance = flat.mean(axis=0).reshape(-1, 3), np.cov(flat.T)
    np.savez(chosen.out, bones=np.array(BONES), mean=mean.astype(np.float32), covariance=covariance.astype(np.float32))
    print(f"{chosen.out}: {len(vectors)} poses of {len(BONES)} bones, {chosen.out.stat().st_size / 1000:.0f} kB")


def recordings(skeletons: Path) -> Iterator[SimulationConfig]:
    """Yield the settings of every movement by every person; nothing of them is rendered."""
    for repeat in range(REPEATS):
        for number, motion in enumerate(MOTIONS):
            base = presets.single(FIRST_SEED + 100 * number + repeat, SECONDS, RATE_HZ)
            yield replace(base, motions=(motion,), speed="mixed")
        for number, movement in enumerate(MOVEMENTS):
            base = presets.single(FIRST_SEED + 10_000 + 100 * number + repeat, SECONDS, RATE_HZ)
            base = replace(base, subjects=(SUBJECTS[repeat % len(SUBJECTS)],))
            for more in range(3):  # exercises are three quarters: they show how limbs bend far
                seeded = replace(base, seed=base.seed + 50_000 * more)
                yield presets.rehabilitation(seeded, skeletons, movement, "none")


def limb_vectors(config: SimulationConfig, asset: BodyAsset) -> np.ndarray:
    """(t, k, 3) rotation vectors of ``BONES`` against their parents."""
    turns = draw_clinic(config).act(np.arange(config.frames) / config.fps).bones[0][:, :, :3, :3]
    chosen = moving_bones(asset)[[MOVING_BONES.index(bone) for bone in BONES]]
    parents = np.array(asset.bone_parents)[chosen]
    own = np.swapaxes(turns[:, parents], 2, 3) @ turns[:, chosen]
    return rotation_vectors(own.reshape(-1, 3, 3)).reshape(len(turns), len(BONES), 3)


if __name__ == "__main__":
    main()
