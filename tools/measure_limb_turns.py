"""Measure how people hold arms and legs: ``src/anchorpose/body/data/limb_turns.npz``, the statistics of limbs.

    python tools/measure_limb_turns.py SKELETONS
    python tools/measure_limb_turns.py SKELETONS --check

SKELETONS: UI-PRMD (Data 2018, 3(1), 2; public domain, ODC PDDL 1.0) as an .npz file: ten rehabilitation exercises by
seven people, of whom the last two are kept for tests. The simulator puts them on bodies of its own; what it moves
itself, walking and standing at rails, is in it too. Mirrored poses count as well, so that both sides are alike.
--check: how far a limb that nothing shows is off in the two people kept for it, as the package's ranges expect it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag

from anchorpose.body.asset import BodyAsset
from anchorpose.body.joint_ranges import captured_turns, joint_range
from anchorpose.body.pose import MOVING_BONES, Pose, moving_bones
from anchorpose.body.skin_points import Body, body_points
from anchorpose.joints import JOINT_INDEX
from anchorpose.rotations import rotation_matrices, rotation_vectors
from anchorpose.simulate import config as presets
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import MOTIONS, SimulationConfig
from anchorpose.simulate.movement_file import MOVEMENTS
from anchorpose.tracker.bystanders import ordinary_body

SUBJECTS = (1, 2, 3, 4, 5)
KEPT = (6, 7)
REPEATS = 5  # of each movement, by another person or of each person
FIRST_SEED = 770_001  # far from the seeds of examples and tests
SECONDS, RATE_HZ = 8.0, 5.0
HIDDEN = {"leg": ("UpLeg", "Leg", "Foot"), "arm": ("Arm", "ForeArm", "Hand")}
JOINTS = {"leg": ("KneeLeft", "AnkleLeft", "FootLeft"), "arm": ("ElbowLeft", "WristLeft", "HandLeft")}
ORDINARY_STEPS = 34  # of 5 cm: 1.70 m
MIRRORED = np.array([-1.0, -1.0, 1.0])  # a rotation vector seen in a mirror between left and right


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("skeletons", type=Path)
    parser.add_argument("--out", type=Path, default=Path("src/anchorpose/body/data/limb_turns.npz"))
    parser.add_argument("--check", action="store_true")
    chosen = parser.parse_args()
    asset = body_points().asset
    if chosen.check:
        print_hidden(chosen.skeletons, asset)
        return
    vectors = np.concatenate([moving_vectors(config, asset) for config in recordings(chosen.skeletons)])
    both = np.concatenate([vectors, vectors[:, mirrored_bones()] * MIRRORED])
    turns = both.reshape(len(both), -1) @ captured_turns().T
    mean, covariance = turns.mean(axis=0), np.cov(turns.T)
    np.savez(chosen.out, mean=mean.astype(np.float32), covariance=covariance.astype(np.float32))
    print(f"{chosen.out}: {len(vectors)} poses, {len(mean)} turns, {chosen.out.stat().st_size / 1000:.0f} kB")


def mirrored_bones() -> list[int]:
    """(m,) the row of each moving bone's twin on the other side, of the trunk its own."""
    swap = {"Left": "Right", "Righ": "Left"}
    twins = [
        swap[name[:4]] + name.removeprefix("Left").removeprefix("Right") if name[:4] in swap else name
        for name in MOVING_BONES
    ]
    return [MOVING_BONES.index(name) for name in twins]


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


def print_hidden(skeletons: Path, asset: BodyAsset) -> None:
    """Print for each movement how far a hidden left leg and a hidden left arm are off, millimetres, by both ranges."""
    body, ranges = ordinary_body(body_points(), ORDINARY_STEPS), joint_range(asset)
    together = ranges.information[1:, :, 1:].reshape(3 * len(MOVING_BONES) - 3, -1)
    alone = block_diag(*(ranges.information[row, :, row] for row in range(1, len(MOVING_BONES))))
    errors: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for number, movement in enumerate(MOVEMENTS):
        for subject in KEPT:
            base = presets.single(FIRST_SEED + 20_000 + 100 * number + subject, SECONDS, RATE_HZ)
            config = presets.rehabilitation(replace(base, subjects=(subject,)), skeletons, movement, "none")
            for vectors in moving_vectors(config, asset)[::4]:
                for limb, bones in HIDDEN.items():
                    rows = [3 * MOVING_BONES.index(f"Left{bone}") - 3 + k for bone in bones for k in range(3)]
                    off = tuple(hidden_mm(body, vectors, ranges.mean, known, rows, limb) for known in (alone, together))
                    errors.setdefault((limb, movement), []).append((off[0], off[1]))
    print("| hidden | movement | each joint for itself, median mm | together |\n|---|---|--:|--:|")
    for limb in HIDDEN:
        every = [pair for (which, _), pairs in errors.items() if which == limb for pair in pairs]
        for name, pairs in [("all", every), *((m, p) for (which, m), p in errors.items() if which == limb)]:
            alone_mm, together_mm = np.median(np.array(pairs), axis=0)
            print(f"| {limb} | {name} | {alone_mm:.0f} | {together_mm:.0f} |")


def hidden_mm(
    body: Body, vectors: np.ndarray, mean: np.ndarray, information: np.ndarray, rows: list[int], limb: str
) -> float:
    """How far the limb's joints beyond its first are off where its rotation vectors are the most probable ones."""
    away = (vectors - mean)[1:].ravel()
    seen = np.setdiff1d(np.arange(len(away)), rows)
    expected = away.copy()
    expected[rows] = -np.linalg.solve(information[np.ix_(rows, rows)], information[np.ix_(rows, seen)] @ away[seen])
    filled = np.vstack([vectors[:1], mean[1:] + expected.reshape(-1, 3)])
    there, found = (body.joints(posed(body, turns)) for turns in (vectors, filled))
    return 1000.0 * float(np.linalg.norm(there - found, axis=1)[[JOINT_INDEX[name] for name in JOINTS[limb]]].mean())


def posed(body: Body, vectors: np.ndarray) -> Pose:
    rotations = np.tile(np.eye(3), (len(body.points.asset.bone_names), 1, 1))
    rotations[body.points.moving] = rotation_matrices(vectors)
    return Pose(rotations, np.zeros(3))


def moving_vectors(config: SimulationConfig, asset: BodyAsset) -> np.ndarray:
    """(t, m, 3) rotation vectors of the moving bones; the root's is 0."""
    turns = draw_clinic(config).act(np.arange(config.frames) / config.fps).bones[0][:, :, :3, :3]
    chosen = moving_bones(asset)
    own = np.swapaxes(turns[:, np.array(asset.bone_parents)[chosen]], 2, 3) @ turns[:, chosen]
    own[:, 0] = np.eye(3)
    return rotation_vectors(own.reshape(-1, 3, 3)).reshape(len(turns), len(chosen), 3)


if __name__ == "__main__":
    main()
