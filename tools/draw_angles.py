"""Draws the pictures of docs/angles.md: a stick figure in a pose, and its angle as the program computes it.

    python tools/draw_angles.py docs/figures/angles

The number in a panel is computed by the program for the pose drawn, so picture and formula cannot disagree.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from scipy.spatial.transform import Rotation

from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES, LIMBS
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.tables import JointTable

X, Y, Z = np.eye(3)
VIEWS = {  # what is drawn to the right and upwards
    "from the right": (X, Y),
    "from the front": (-Z, Y),
    "from above": (Z, X),
}
TRUNK = ("SpineMid", "SpineShoulder", "Neck", "Head", "Shoulder*", "Elbow*", "Wrist*", "Hand*")
CHEST, PELVIS = TRUNK[1:], ("SpineBase", "Hip*", *TRUNK)
LEG, SHANK = ("KneeRight", "AnkleRight", "FootRight"), ("AnkleRight", "FootRight")
ARM, FOREARM = ("ElbowRight", "WristRight", "HandRight"), ("WristRight", "HandRight")
NEUTRAL, BONE, SHOWN = "#b5b5b5", "#222222", "#0072B2"


class Panel(NamedTuple):
    """An angle, the view, the pose, and the arc: its vertex and where it starts and ends (points or directions)."""

    angle: str
    view: str
    pose: Callable[[np.ndarray], np.ndarray]
    vertex: Callable[[np.ndarray], np.ndarray]
    start: Callable[[np.ndarray], np.ndarray]
    end: Callable[[np.ndarray], np.ndarray]


def standing() -> np.ndarray:
    """(21, 3): upright, limbs straight down, facing X."""
    place = {
        "SpineBase": (0, 0.95, 0),
        "SpineMid": (0, 1.15, 0),
        "SpineShoulder": (0, 1.42, 0),
        "Neck": (0, 1.5, 0),
        "Head": (0, 1.62, 0),
    }
    for side, z in (("Left", -1.0), ("Right", 1.0)):
        place |= {
            f"{name}{side}": (0, y, 0.18 * z)
            for name, y in (("Shoulder", 1.4), ("Elbow", 1.1), ("Wrist", 0.85), ("Hand", 0.77))
        }
        place |= {f"{name}{side}": (0, y, 0.1 * z) for name, y in (("Hip", 0.92), ("Knee", 0.5), ("Ankle", 0.08))}
        place[f"Foot{side}"] = (0.145, 0.08 - 0.145 * np.tan(np.radians(19.3)), 0.1 * z)
    return np.array([place[name] for name in JOINT_NAMES], dtype=np.float64)


def turned(about: str, moved: tuple[str, ...], degrees: float, axis: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """A pose: joints turned about another; a star stands for both sides."""
    names = [n for m in moved for n in ((m[:-1] + "Left", m[:-1] + "Right") if m.endswith("*") else (m,))]
    rows = [JOINT_INDEX[name] for name in names]

    def apply(joints: np.ndarray) -> np.ndarray:
        after = joints.copy()
        centre = at(about)(joints)
        after[rows] = (joints[rows] - centre) @ Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix().T + centre
        return after

    return apply


def then(*poses: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    def apply(joints: np.ndarray) -> np.ndarray:
        for pose in poses:
            joints = pose(joints)
        return joints

    return apply


def at(name: str) -> Callable[[np.ndarray], np.ndarray]:
    """Where a joint is; "hips" and "shoulders" for their middles."""
    pairs = {"hips": ("HipLeft", "HipRight"), "shoulders": ("ShoulderLeft", "ShoulderRight")}
    names = pairs.get(name, (name,))
    return lambda joints: joints[[JOINT_INDEX[n] for n in names]].mean(axis=0)


def line(start: str, end: str, sign: float = 1.0) -> Callable[[np.ndarray], np.ndarray]:
    return lambda joints: sign * (at(end)(joints) - at(start)(joints))


def along(direction: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda joints: direction


def read(joints: np.ndarray, angle: str) -> float:
    """Degrees, as the program reads them."""
    shape = (1, JOINT_COUNT)
    table = JointTable(np.zeros(1, np.int32), np.zeros(1), joints[None], np.zeros(shape, np.int8), np.full(shape, 0.01))
    angles = joint_angles(table)
    return float(angles.degrees[0, angles.column(angle)])


LEAN, SIDE, TURN = (
    turned("SpineBase", TRUNK, -35, Z),
    turned("SpineBase", TRUNK, 25, X),
    turned("SpineMid", CHEST, 35, Y),
)
OUT = turned("ShoulderRight", ARM, 70, -X)
BENT_LEG, BENT_ARM = turned("KneeRight", SHANK, -60, Z), turned("ElbowRight", FOREARM, 80, Z)

FIGURES = {
    "pelvis": (
        Panel(
            "pelvis_tilt",
            "from the right",
            turned("hips", PELVIS, -20, Z),
            at("hips"),
            along(Y),
            line("hips", "SpineMid"),
        ),
        Panel(
            "pelvis_obliquity",
            "from the front",
            turned("hips", ("Hip*", "SpineBase", *TRUNK), -15, X),
            at("hips"),
            along(Z),
            line("HipLeft", "HipRight"),
        ),
        Panel(
            "pelvis_rotation",
            "from above",
            turned("hips", ("Hip*",), 30, Y),
            at("hips"),
            along(Z),
            line("HipLeft", "HipRight"),
        ),
    ),
    "trunk": (
        Panel("trunk_flexion", "from the right", LEAN, at("SpineBase"), along(Y), line("SpineBase", "SpineShoulder")),
        Panel("trunk_side_bend", "from the front", SIDE, at("SpineBase"), along(Y), line("SpineBase", "SpineShoulder")),
        Panel("trunk_rotation", "from above", TURN, at("shoulders"), along(Z), line("ShoulderLeft", "ShoulderRight")),
    ),
    "trunk_pelvis": (
        Panel(
            "trunk_pelvis_flexion",
            "from the right",
            turned("SpineMid", CHEST, -35, Z),
            at("SpineMid"),
            line("hips", "SpineMid"),
            line("SpineMid", "SpineShoulder"),
        ),
        Panel(
            "trunk_pelvis_side_bend",
            "from the front",
            turned("SpineMid", CHEST, 25, X),
            at("SpineMid"),
            line("hips", "SpineMid"),
            line("SpineMid", "SpineShoulder"),
        ),
        Panel(
            "trunk_pelvis_rotation",
            "from above",
            TURN,
            at("shoulders"),
            line("HipLeft", "HipRight"),
            line("ShoulderLeft", "ShoulderRight"),
        ),
    ),
    "neck": (
        Panel(
            "neck_flexion",
            "from the right",
            turned("Neck", ("Head",), -35, Z),
            at("Neck"),
            line("SpineMid", "SpineShoulder"),
            line("Neck", "Head"),
        ),
        Panel(
            "neck_side_bend",
            "from the front",
            turned("Neck", ("Head",), 30, X),
            at("Neck"),
            line("SpineMid", "SpineShoulder"),
            line("Neck", "Head"),
        ),
    ),
    "hip": (
        Panel(
            "hip_flexion_right",
            "from the right",
            turned("HipRight", LEG, 50, Z),
            at("HipRight"),
            line("SpineShoulder", "SpineBase"),
            line("HipRight", "KneeRight"),
        ),
        Panel(
            "hip_pelvis_flexion_right",
            "from the right",
            then(LEAN, turned("HipRight", LEG, 20, Z)),
            at("HipRight"),
            line("SpineMid", "hips"),
            line("HipRight", "KneeRight"),
        ),
        Panel(
            "hip_adduction_right",
            "from the front",
            turned("HipRight", LEG, 20, X),
            at("HipRight"),
            line("SpineMid", "hips"),
            line("HipRight", "KneeRight"),
        ),
        Panel(
            "hip_rotation_right",
            "from above",
            then(turned("KneeRight", SHANK, -90, Z), turned("HipRight", LEG, 25, Y)),
            at("KneeRight"),
            along(-X),
            line("KneeRight", "AnkleRight"),
        ),
    ),
    "knee_and_ankle": (
        Panel(
            "knee_flexion_right",
            "from the right",
            BENT_LEG,
            at("KneeRight"),
            line("HipRight", "KneeRight"),
            line("KneeRight", "AnkleRight"),
        ),
        Panel(
            "ankle_dorsiflexion_right",
            "from the right",
            turned("AnkleRight", ("FootRight",), 25, Z),
            at("AnkleRight"),
            along(X * np.cos(np.radians(19.3)) - Y * np.sin(np.radians(19.3))),
            line("AnkleRight", "FootRight"),
        ),
    ),
    "shoulder": (
        Panel(
            "shoulder_elevation_right",
            "from the front",
            OUT,
            at("ShoulderRight"),
            line("SpineShoulder", "SpineBase"),
            line("ShoulderRight", "ElbowRight"),
        ),
        Panel(
            "shoulder_plane_right",
            "from above",
            then(OUT, turned("ShoulderRight", ARM, 40, Y)),
            at("ShoulderRight"),
            along(Z),
            line("ShoulderRight", "ElbowRight"),
        ),
        Panel(
            "shoulder_rotation_right",
            "from above",
            then(turned("ElbowRight", FOREARM, 90, Z), turned("ShoulderRight", ARM, 35, Y)),
            at("ElbowRight"),
            along(X),
            line("ElbowRight", "WristRight"),
        ),
    ),
    "elbow": (
        Panel(
            "elbow_flexion_right",
            "from the right",
            BENT_ARM,
            at("ElbowRight"),
            line("ShoulderRight", "ElbowRight"),
            line("ElbowRight", "WristRight"),
        ),
    ),
}


def draw(axes: Axes, panel: Panel) -> None:
    before, after = standing(), panel.pose(standing())
    view = np.array(VIEWS[panel.view])
    for joints, colour, width in ((before, NEUTRAL, 2.0), (after, BONE, 2.5)):
        flat = joints @ view.T
        for a, b in LIMBS:
            axes.plot(*flat[[a, b]].T, color=colour, linewidth=width, solid_capstyle="round")
        axes.plot(*flat.T, "o", color=colour, markersize=3.5)
        head = flat[JOINT_INDEX["Head"]]
        axes.add_patch(plt.Circle(head, 0.09, fill=False, color=colour, linewidth=width))
    vertex = panel.vertex(after) @ view.T
    start, end = (direction(after) @ view.T for direction in (panel.start, panel.end))
    reach = 0.26
    begin, stop = (float(np.arctan2(d[1], d[0])) for d in (start, end))
    stop = begin + (stop - begin + np.pi) % (2.0 * np.pi) - np.pi
    arc = np.linspace(begin, stop, 40)
    axes.plot(
        *np.stack([vertex, vertex + 1.4 * reach * start / np.linalg.norm(start)]).T, "--", color=SHOWN, linewidth=1.5
    )
    axes.plot(*np.stack([vertex, vertex + 1.4 * reach * end / np.linalg.norm(end)]).T, "-", color=SHOWN, linewidth=1.5)
    curve = vertex[:, None] + reach * np.array([np.cos(arc), np.sin(arc)])
    axes.plot(*curve, color=SHOWN, linewidth=2.5)
    axes.annotate("", xy=curve[:, -1], xytext=curve[:, -4], arrowprops={"arrowstyle": "-|>", "color": SHOWN, "lw": 2})
    axes.set_title(f"{panel.angle}\n{read(after, panel.angle):+.0f}° ({panel.view})", fontsize=10)
    axes.set_aspect("equal")
    axes.margins(0.12)
    axes.axis("off")


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, panels in FIGURES.items():
        figure, row = plt.subplots(1, len(panels), figsize=(2.9 * len(panels), 3.9), squeeze=False)
        for axes, panel in zip(row[0], panels, strict=True):
            draw(axes, panel)
        figure.tight_layout()
        figure.savefig(folder / f"{name}.png", dpi=80, facecolor="white", metadata={"Software": None})
        plt.close(figure)


if __name__ == "__main__":
    plt.switch_backend("Agg")
    main(Path(sys.argv[1]))
