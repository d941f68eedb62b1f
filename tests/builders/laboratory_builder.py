"""A simulated laboratory: another system's markers of a simulated patient, with another clock, another frame and gaps.

The patient moves as in simulated recordings and turns on the spot. Results are the true joints with errors such as the
tracker's: constant in each segment, slow in time, and larger where a joint is inferred. The laboratory sees markers:
pelvis by four, knees, ankles, elbows and wrists by two each. They lie on skin that slides over the bone: slowly at
random, at the knee with its bend, up to 15 mm (Leardini et al. 2005, doi:10.1016/j.gaitpost.2004.05.002), and have
noise of 0.3 mm. Its clock starts anywhere and drifts, its axes are Z up, lengths are millimetres, and markers get lost.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from anchorpose.agreement.matching import Match
from anchorpose.agreement.placement import segment_axes
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JointState
from anchorpose.results.tables import JOINTS_FILE, JointFrame, write_joints
from anchorpose.simulate.config import single
from anchorpose.simulate.patient import draw_patient
from anchorpose.simulate.person import draw_person

RATE_HZ: Final = 100.0
RESULTS_HZ: Final = 30.0
NOISE_MM: Final = 0.3
SLIDE_MM: Final = 4.0  # slow, at random, per axis
BEND_MM: Final = 10.0  # at a right angle of the nearest joint
SIDES: Final = (("L", "Left"), ("R", "Right"))
CONSTANT_M: Final = 0.004  # of a joint of the results, per axis, in its segment's axes
OBSERVED_M, INFERRED_M, INFERRED_SHARE = 0.006, 0.015, 0.15
SLOW_S: Final = 0.2  # standard deviation of the kernel that makes errors slow
SLIDE_S: Final = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class Laboratory:
    """What is true: clock ``t * (1 + drift) + offset_s`` and T_world_reference (4, 4); the two files to compare."""

    results: Path
    reference: Path
    offset_s: float
    drift: float
    T_world_reference: np.ndarray


def make_laboratory(folder: Path, seed: int, seconds: float = 60.0) -> Laboratory:
    """A results folder and the laboratory's ``mocap.trc`` of the same patient."""
    rng = np.random.default_rng(seed)
    offset_s, drift = float(rng.uniform(-30.0, 300.0)), float(rng.uniform(-1e-4, 1e-4))
    times_s = np.arange(0.0, seconds, 1.0 / RESULTS_HZ)
    started_s, stopped_s = rng.uniform(0.0, 0.1 * seconds, 2)  # the laboratory starts later and stops earlier
    theirs_s = np.arange(started_s, seconds - stopped_s, 1.0 / RATE_HZ)
    both = _true_joints(seed, np.concatenate([times_s, theirs_s]), seconds)
    results = _write_results(folder / "results", rng, times_s, both[: len(times_s)])
    markers = _markers(rng, both[len(times_s) :])
    T_reference_world = np.eye(4)
    yaw = Rotation.from_euler("z", rng.uniform(0.0, 360.0), degrees=True)
    T_reference_world[:3, :3] = (yaw * Rotation.from_euler("x", 90.0, degrees=True)).as_matrix()
    T_reference_world[:3, 3] = rng.uniform(-3.0, 3.0, 3)
    clock_s = theirs_s * (1.0 + drift) + offset_s
    reference = _write_trc(folder / "mocap.trc", rng, clock_s, markers, T_reference_world)
    return Laboratory(results, reference, offset_s, drift, np.linalg.inv(T_reference_world))


def _true_joints(seed: int, times_s: np.ndarray, seconds: float) -> np.ndarray:
    """(t, 21, 3) of a patient who squats, reaches, and turns on the spot by up to a third of a turn."""
    rng = np.random.default_rng([seed, 1])
    config = single(seed, seconds=seconds)
    person = draw_person(rng, config.clothing_m)
    actor = draw_patient(rng, config, person, None)
    order = np.argsort(times_s, kind="stable")
    joints = np.empty((len(times_s), JOINT_COUNT, 3))
    joints[order] = [person.body.joints(bones) for bones in actor.bones(times_s[order])]
    turn = 1.0 * np.sin(2.0 * np.pi * times_s / 23.0)
    middle = joints.mean(axis=(0, 1)) * [1.0, 0.0, 1.0]
    rotation = Rotation.from_euler("y", turn[:, None]).as_matrix()
    return np.einsum("tij,tkj->tki", rotation, joints - middle) + middle


def _write_results(folder: Path, rng: np.random.Generator, times_s: np.ndarray, true_m: np.ndarray) -> Path:
    """Errors as a tracker has them; sigma is right for their random part and about right for the rest."""
    folder.mkdir(parents=True)
    axes = segment_axes(true_m)
    constant = np.einsum("tkij,kj->tki", axes, rng.normal(scale=CONSTANT_M, size=(JOINT_COUNT, 3)))
    inferred = gaussian_filter1d(rng.normal(size=(len(times_s), JOINT_COUNT)), 30.0, axis=0)
    inferred = inferred > np.quantile(inferred, 1.0 - INFERRED_SHARE)
    sigma = np.where(inferred, INFERRED_M, OBSERVED_M)
    places = true_m + np.nan_to_num(constant) + sigma[..., None] * _slow(rng, true_m.shape, SLOW_S * RESULTS_HZ)
    with write_joints(folder / JOINTS_FILE) as table:
        for row, time_s in enumerate(times_s):
            states = tuple(JointState.HIDDEN if each else JointState.OBSERVED for each in inferred[row])
            table.append(
                JointFrame(frame=row, time_s=float(time_s), position_m=places[row], state=states, sigma_m=sigma[row])
            )
    return folder


def _slow(rng: np.random.Generator, shape: tuple[int, ...], frames: float) -> np.ndarray:
    """Noise of unit variance that changes over so many frames."""
    noise = gaussian_filter1d(rng.normal(size=shape), frames, axis=0)
    return np.asarray(noise / noise.std(axis=0))


def _markers(rng: np.random.Generator, true_m: np.ndarray) -> dict[str, np.ndarray]:
    """(t, 3) metres, world, of each label: on the bone by the true joints, then on sliding skin."""
    axes, found = segment_axes(true_m), dict[str, np.ndarray]()

    def put(label: str, joint: str, place_m: tuple[float, float, float] | np.ndarray) -> None:
        index = JOINT_INDEX[joint]
        found[label] = true_m[:, index] + axes[:, index] @ np.asarray(place_m, dtype=np.float64)

    hips = [true_m[:, JOINT_INDEX[f"Hip{side}"]] for _, side in SIDES]
    half = 0.5 * float(np.linalg.norm(hips[1] - hips[0], axis=1).mean())
    width, depth = (half - 0.0073) / 0.33, 0.15  # so that Harrington's regression gives this patient's hips
    ahead, up = 0.24 * depth + 0.0099, 0.30 * width + 0.0109
    for (letter, side), sign in zip(SIDES, (-1.0, 1.0), strict=True):
        put(f"{letter}ASI", f"Hip{side}", (ahead, up, sign * (0.5 * width - half)))
        put(f"{letter}PSI", f"Hip{side}", (ahead - depth, up, sign * (0.045 - half)))
        for joint, outer, inner, breadth in (
            ("Knee", "KNE", "KNM", 0.05),
            ("Ankle", "ANK", "MED", 0.035),
            ("Elbow", "ELB", "ELM", 0.035),
            ("Wrist", "WRA", "WRB", 0.028),
        ):
            put(f"{letter}{outer}", f"{joint}{side}", (0.0, 0.0, sign * breadth))
            put(f"{letter}{inner}", f"{joint}{side}", (0.0, 0.0, -sign * breadth))
    bend = {side: _knee_bend(true_m, side) for _, side in SIDES}
    for label, place in found.items():
        slide = SLIDE_MM * _slow(rng, place.shape, SLIDE_S * RATE_HZ)
        if label[1:] in ("KNE", "KNM"):
            along = axes[:, JOINT_INDEX["KneeLeft" if label[0] == "L" else "KneeRight"], :, 1]
            slide += BEND_MM * bend["Left" if label[0] == "L" else "Right"][:, None] * along
        found[label] = place + 0.001 * (slide + NOISE_MM * rng.normal(size=place.shape))
    return found


def _knee_bend(true_m: np.ndarray, side: str) -> np.ndarray:
    """(t,) 1 at a right angle."""
    hip, knee, ankle = (true_m[:, JOINT_INDEX[f"{name}{side}"]] for name in ("Hip", "Knee", "Ankle"))
    thigh, shank = knee - hip, ankle - knee
    cosine = (thigh * shank).sum(axis=1) / np.linalg.norm(thigh, axis=1) / np.linalg.norm(shank, axis=1)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)) / (0.5 * np.pi))


def _write_trc(
    path: Path, rng: np.random.Generator, clock_s: np.ndarray, markers: dict[str, np.ndarray], T: np.ndarray
) -> Path:
    """Millimetres in the laboratory's axes; each marker is missing in a few stretches of 0.1 to 1 s."""
    labels, count = list(markers), len(clock_s)
    places = 1000.0 * (np.stack(list(markers.values()), axis=1) @ T[:3, :3].T + T[:3, 3])
    for column in range(len(labels)):
        for start in rng.integers(0, count, max(1, round(0.03 * count / (0.5 * RATE_HZ)))):
            places[start : start + int(rng.uniform(0.1, 1.0) * RATE_HZ), column] = np.nan
    head = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{RATE_HZ:g}\t{RATE_HZ:g}\t{count}\t{len(labels)}\tmm\t{RATE_HZ:g}\t1\t{count}",
        "Frame#\tTime\t" + "\t\t\t".join(labels) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{number + 1}" for number in range(len(labels)) for axis in "XYZ"),
        "",
    ]
    body = [
        "\t".join([str(row + 1), repr(float(clock_s[row])), *("" if np.isnan(x) else f"{x:.4f}" for x in flat)])
        for row, flat in enumerate(places.reshape(count, -1).tolist())
    ]
    path.write_text("\n".join([*head, *body]) + "\n", encoding="utf-8")
    return path


@dataclass(frozen=True, slots=True)
class Missed:
    """How far what was found is from the truth. time_ms: largest in the recording, of its clock."""

    time_ms: float
    stated_time_ms: float
    translation_mm: float
    rotation_deg: float


def missed(lab: Laboratory, match: Match) -> Missed:
    """Errors of clock and frame; the frame is compared at the middle of the patient."""
    ends = np.array(match.clock.overlap_s)
    off_s = match.clock.reference_time_s(ends) - (ends * (1.0 + lab.drift) + lab.offset_s)
    found, true = match.placement.T_world_reference, lab.T_world_reference
    turn = Rotation.from_matrix(found[:3, :3] @ true[:3, :3].T).magnitude()
    middle = np.linalg.inv(true) @ np.append(np.nanmean(match.joints.position_m, axis=(0, 1)), 1.0)
    return Missed(
        1000.0 * float(np.abs(off_s).max()),
        1000.0 * match.clock.offset_sigma_s,
        1000.0 * float(np.linalg.norm((found - true) @ middle)),
        float(np.degrees(turn)),
    )
