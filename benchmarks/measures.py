"""How far angles, centre of mass and measures are from those of the true joints, and whether their ranges hold it.

    python benchmarks/measures.py RESULTS TRUTH.npz [RESULTS TRUTH.npz ...]

The truth's own measures are taken by the same formulas from the true joints, so what is judged is what tracking adds,
and its uncertainty; the formulas themselves are judged by the tests.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

from anchorpose.recording.pairing import half_period_s, nearest_within
from anchorpose.results.kinematics.joint_angles import joint_angles
from anchorpose.results.records import CONTACTS_FILE, Measure, read_contacts
from anchorpose.results.stand_training.assistance import CONTACT_MEASURES
from anchorpose.results.stand_training.centre_of_mass import centre_of_mass
from anchorpose.results.stand_training.measure import MeasureConfig, measure_session
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.results.truth import read_truth
from anchorpose.results.uncertainty import NORMAL_95

OF_CONTACTS = {name for name, _ in CONTACT_MEASURES}
"""Both sides have them from the same contacts, so that they would hold whatever the joints are."""

SKIP_S = 1.0  # as in the accuracy table


def pair(results: Path, truth: Path) -> tuple[JointTable, JointTable]:
    """Tracked joints, and the true ones at the same times with next to no uncertainty."""
    joints, known = read_joints(results / JOINTS_FILE), read_truth(truth)
    row = nearest_within(known.time_s, joints.time_s, half_period_s(known.time_s))
    kept = (row >= 0) & (known.time_s >= known.time_s[0] + SKIP_S)
    found = JointTable(*(getattr(joints, name)[row[kept]] for name in JointTable.__slots__))
    exact = np.zeros_like(found.state_code), np.full_like(found.sigma_m, 1e-6)
    return found, JointTable(found.frame, found.time_s, known.position_m[kept], *exact)


def angle_lines(pairs: list[tuple[JointTable, JointTable]]) -> list[str]:
    """Left and right together: mean error, share within the range, share of the squared error that lasts."""
    rows = defaultdict(list)
    for found, true in pairs:
        ours, theirs = joint_angles(found), joint_angles(true)
        away = ours.degrees - theirs.degrees
        away -= 360.0 * np.round(away / 360.0)
        for column, name in enumerate(ours.names):
            error, sigma = away[:, column], ours.sigma_deg[:, column]
            known = np.isfinite(error)
            if known.sum() > 5:
                error, sigma = error[known], sigma[known]
                lasts = error.mean() ** 2 / np.mean(error**2)
                held = np.mean(np.abs(error) <= NORMAL_95 * sigma)
                rows[name.removesuffix("_left").removesuffix("_right")].append((np.abs(error).mean(), held, lasts))
    mean = {name: np.mean(values, axis=0) for name, values in rows.items()}
    return [f"| {n} | {v[0]:.1f} | {100 * v[1]:.0f} | {100 * v[2]:.0f} |" for n, v in mean.items()]


def mass_line(found: JointTable, true: JointTable) -> str:
    """Mean error of the centre of mass, what of it comes and goes, sigma, and the share within the range."""
    ours = centre_of_mass(found)
    error = ours.position_m - centre_of_mass(true).position_m
    known = np.isfinite(error).all(axis=1)
    error, sigma = 1000.0 * error[known], 1000.0 * ours.sigma_m[known]
    held = np.mean(np.abs(error) <= NORMAL_95 * sigma[:, None])
    bias, moves = np.linalg.norm(error.mean(axis=0)), np.sqrt((error.var(axis=0)).mean())
    return f"{bias:.1f} mm, changing by {moves:.1f} mm an axis; sigma {sigma.mean():.1f} mm, held {100 * held:.0f} %"


def measures_of(joints: JointTable, results: Path) -> dict[tuple[str | None, ...], Measure]:
    contacts = read_contacts(results / CONTACTS_FILE) if (results / CONTACTS_FILE).exists() else None
    rows = measure_session(joints, joint_angles(joints), contacts, MeasureConfig())[1]
    return {(row.measure, row.side, row.part, row.person): row for row in rows}


def judge(results: Path, found: JointTable, true: JointTable) -> tuple[int, int]:
    """How many measures with a sigma hold the truth's value, of how many; prints those that do not.

    Left out are those of contacts, and those whose sigma is nought, which nothing measured.
    """
    held = judged = 0
    theirs = measures_of(true, results)
    for key, row in measures_of(found, results).items():
        exact = theirs.get(key)
        if exact is None or not row.sigma or None in (row.value, exact.value) or key[0] in OF_CONTACTS:
            continue
        if key[0].startswith("sway") and row.frames != exact.frames:
            continue  # a lost joint ended a bout: other sway, not other measurement
        judged += 1
        inside = abs(row.value - exact.value) <= NORMAL_95 * row.sigma + 1e-3
        held += inside
        if not inside:
            print(f"  {key}: {row.value:.3g} ± {NORMAL_95 * row.sigma:.2g}, true {exact.value:.3g} {row.unit}")
    return held, judged


def main(arguments: list[str]) -> None:
    folders = [Path(name) for name in arguments[::2]]
    pairs = [pair(folder, Path(truth)) for folder, truth in zip(folders, arguments[1::2], strict=True)]
    print("| angle | mean error, degrees | in 95 % band | lasting share % |\n|---|--:|--:|--:|")
    print("\n".join(angle_lines(pairs)))
    scores = []
    for folder, (found, true) in zip(folders, pairs, strict=True):
        print(f"{folder}: centre of mass {mass_line(found, true)}")
        scores.append(judge(folder, found, true))
    print("measures that hold the truth: {} of {}".format(*np.sum(scores, axis=0)))


if __name__ == "__main__":
    main(sys.argv[1:])
