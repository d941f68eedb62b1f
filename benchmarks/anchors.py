"""Anchors against the true limb ends, by how good the prediction is: python benchmarks/anchors.py --seeds 7.

Simulated recordings; the patient's pixels are the true ones, so that isolation is not measured here. The prediction is
the true skin of the frame before: *good* as it is, *moved* with one arm turned until its hand is 0.4 m away,
*exchanged* with each arm turned until its hand points where the other one is; *none*: no prediction at all. A limb's
end counts as visible where some camera sees half of what it would see of it alone. *Found*: visible ends that have
their anchor on them (nearest true skin); *60 mm*, *100 mm*: visible ends whose anchor is so near the true joint (Head,
HandLeft, ..., which lie deeper in the limb than the surface); *mis-named*: anchors on another part of the body.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial.transform import Rotation
from surface import visible_limbs
from true_body import TrueBody

from anchorpose.body.constraints import anchor_points
from anchorpose.body.kinematics import BodyMesh
from anchorpose.body.own_surface import map_body
from anchorpose.body.pose import MOVING_BONES, descendants
from anchorpose.body.skin_points import FittedShape, body_points, build_body, even_clothes
from anchorpose.geodesics.anchors import Anchors, find_anchors
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import ANCHOR_NAMES, JOINT_INDEX
from anchorpose.simulate.clinic import Performance, draw_clinic
from anchorpose.simulate.config import SimulationConfig, clinic, holes, single
from anchorpose.simulate.person import skin_points
from anchorpose.simulate.render import EQUIPMENT, PATIENT, TrueImage
from anchorpose.simulate.shoot import Studio, set_up
from anchorpose.surface.border import Border, border
from anchorpose.surface.patient_surface import patient_surface
from anchorpose.surface.surface import BodyMap, ExpectedSkin, Surface
from anchorpose.threads import one_thread

UP: Final = np.array([0.0, 1.0, 0.0])
AHEAD: Final = np.array([1.0, 0.0, 0.0])
PREDICTIONS: Final = ("good", "none", "moved", "exchanged")
SCENES: Final[dict[str, Callable[[int, float], SimulationConfig]]] = {
    "single": single,
    "holes": lambda seed, seconds: holes(seed, 0.15, seconds),
    "clinic": clinic,
}
MOVED_M: Final = 0.4
IN_FRONT_M: Final = 0.05  # of the empty room
OUTLINE_PX: Final = 4
LIMITS_M: Final = (0.06, 0.10)
COLUMNS: Final = ("frames", "visible ends", "found %", "60 mm %", "100 mm %", "mis-named %")
ARMS: Final = ("LeftArm", "RightArm")


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Expected skin, anchors_m (5, 3) and heading (3,); all None where nothing is predicted."""

    skin: ExpectedSkin | None = None
    anchors_m: np.ndarray | None = None
    facing: np.ndarray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One frame as it is seen with one prediction, and what is true of it.

    surface, cut (n,) bool, prediction, height_m: what ``find_anchors`` takes; body, joints_m (5, 3) and visible (5,)
    bool: the truth. kind: of the prediction.
    """

    kind: str
    surface: Surface
    cut: np.ndarray
    prediction: Prediction
    height_m: float
    body: TrueBody
    joints_m: np.ndarray
    visible: np.ndarray

    def anchors(self) -> Anchors:
        """Those that are found."""
        facing = AHEAD if self.prediction.facing is None else self.prediction.facing
        return find_anchors(self.surface, UP, facing, self.height_m, self.cut, self.prediction.anchors_m)


def cases(config: SimulationConfig, every: int) -> Iterator[Case]:
    """Every few frames of a recording with each prediction; of a recording with holes, only frames that have one."""
    studio = set_up(draw_clinic(config))
    person, act = studio.clinic.patient.person, studio.performances[0]
    body_map = map_body(build_body(body_points(), FittedShape(person.coefficients, even_clothes(0.0))))
    joints = act.joints_m()[:, [JOINT_INDEX[name] for name in ANCHOR_NAMES]]
    empty_m = [
        (studio.background_mm(index) * camera.depth_scale).astype(np.float32)
        for index, camera in enumerate(studio.clinic.cameras)
    ]
    for frame in range(2, config.frames, every):
        if config.hole_radius_m > 0 and not studio.in_hole[frame]:
            continue
        shot, cameras = studio.shoot(frame), studio.clinic.cameras
        views = [
            labelled(
                (shot.depths_mm[k] * camera.depth_scale).astype(np.float32),
                empty_m[k],
                shot.images[k],
                studio.stills[k],
            )
            for k, camera in enumerate(cameras)
        ]
        body, visible = TrueBody(shot.figures[0].skin_m, person.body.asset), visible_limbs(shot, studio)
        for kind in PREDICTIONS:
            prediction = predict(studio, act, frame, kind, body_map)
            surface = patient_surface(views, cameras, prediction.skin)
            cut = border(surface, views) == Border.CUT
            yield Case(kind, surface, cut, prediction, person.height_m, body, joints[frame], visible)


def labelled(depth_m: np.ndarray, empty_m: np.ndarray, image: TrueImage, still: TrueImage) -> View:
    """The reading with each person label as good as it can be: what stands in front of the empty room is a person, and
    whose it is, mixed pixels around the outline included, the nearest truly visible person says.

    empty_m (height, width): the empty room's depth, 0 = unknown; still: the empty room.
    """
    person = image.label >= PATIENT
    away_px, (row, col) = distance_transform_edt(~person, return_indices=True)
    in_front = (depth_m > 0) & ((empty_m == 0) | (depth_m < empty_m - IN_FRONT_M)) & (away_px <= OUTLINE_PX)
    labels = np.where(still.label == EQUIPMENT, PixelLabel.EQUIPMENT, PixelLabel.BACKGROUND).astype(np.uint8)
    nearest = np.where(image.label[row, col] == PATIENT, PixelLabel.PATIENT, PixelLabel.OTHER_PERSON)
    labels[in_front] = nearest[in_front]
    labels[depth_m == 0] = PixelLabel.NO_READING
    return View(depth_m, labels)


def predict(studio: Studio, act: Performance, frame: int, kind: str, body_map: BodyMap) -> Prediction:
    """What would be expected of a frame."""
    if kind == "none":
        return Prediction()
    person, bones = studio.clinic.patient.person, act.bones[0][frame - 1]
    hands_m = person.body.joints(bones)[[JOINT_INDEX["HandLeft"], JOINT_INDEX["HandRight"]]]
    if kind == "moved":
        rng = np.random.default_rng([studio.clinic.config.seed, frame])
        side = int(rng.integers(2))
        bones = arm_turned(person.body, bones, side, hands_m[side], elsewhere(rng, person.body, bones, side, hands_m))
    elif kind == "exchanged":
        for side in (0, 1):
            bones = arm_turned(person.body, bones, side, hands_m[side], hands_m[1 - side])
    points = body_points()
    place, normals = skin_points(person, bones[None], points.vertex)
    trunk = bones[points.asset.bone("Spine1"), :3, 0]
    level = np.array([trunk[0], 0.0, trunk[2]])
    skin = ExpectedSkin(place[0].astype(np.float32), normals[0].astype(np.float32), body_map)
    return Prediction(skin, place[0][anchor_points(points)], level / np.linalg.norm(level))


def shoulder_m(body: BodyMesh, bones: np.ndarray, side: int) -> np.ndarray:
    """(3,) where an arm turns."""
    arm = body.asset.bone(ARMS[side])
    return bones[arm, :3, :3] @ body.bone_heads[arm] + bones[arm, :3, 3]


def elsewhere(
    rng: np.random.Generator, body: BodyMesh, bones: np.ndarray, side: int, hands_m: np.ndarray
) -> np.ndarray:
    """(3,) a place ``MOVED_M`` from a hand, as far from its shoulder as the hand is, on a side drawn at random."""
    shoulder = shoulder_m(body, bones, side)
    arm_m = hands_m[side] - shoulder
    reach = float(np.linalg.norm(arm_m))
    axis = np.cross(arm_m, rng.normal(size=3))
    angle = 2.0 * np.arcsin(min(0.5 * MOVED_M / reach, 1.0))
    return shoulder + Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).apply(arm_m)


def arm_turned(body: BodyMesh, bones: np.ndarray, side: int, hand_m: np.ndarray, to_m: np.ndarray) -> np.ndarray:
    """The bones with one arm turned about its shoulder until its hand lies in the direction of another place."""
    shoulder = shoulder_m(body, bones, side)
    turn, _ = Rotation.align_vectors([to_m - shoulder], [hand_m - shoulder])
    T = np.eye(4)
    T[:3, :3] = turn.as_matrix()
    T[:3, 3] = shoulder - T[:3, :3] @ shoulder
    moved = np.flatnonzero(descendants(body.asset)[MOVING_BONES.index(ARMS[side])])
    bones = bones.copy()
    bones[moved] = T @ bones[moved]
    return bones


@dataclass(slots=True)
class Score:
    """What the frames of one scene with one kind of prediction add up to."""

    frames: int = 0
    visible: int = 0
    right: int = 0
    within: list[int] = field(default_factory=lambda: [0, 0])
    found: int = 0
    wrong: int = 0

    def add(self, case: Case) -> None:
        """Compare one frame."""
        anchors = case.anchors()
        limb = np.array(
            [
                case.body.limb_at(place) if found else -1
                for place, found in zip(anchors.position_m, anchors.found, strict=True)
            ]
        )
        right = limb == np.arange(len(limb))
        away = np.linalg.norm(anchors.position_m - case.joints_m, axis=1)
        self.frames += 1
        self.visible += int(case.visible.sum())
        self.right += int((right & case.visible).sum())
        for number, limit_m in enumerate(LIMITS_M):
            self.within[number] += int((case.visible & (away < limit_m)).sum())
        self.found += int(anchors.found.sum())
        self.wrong += int((anchors.found & ~right).sum())

    def row(self) -> list[float]:
        """In the order of ``COLUMNS``."""
        share = [100 * number / max(self.visible, 1) for number in (self.right, *self.within)]
        return [
            self.frames,
            self.visible,
            *share,
            100 * self.wrong / max(self.found, 1),
        ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=7)
    parser.add_argument("--first-seed", type=int, default=31)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--every", type=int, default=9, help="frames from one that is looked at to the next")
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES))
    chosen = parser.parse_args()
    print(f"| scene | prediction | {' | '.join(COLUMNS)} |\n|---|---|{'--:|' * len(COLUMNS)}")
    with one_thread():
        for scene in chosen.scenes:
            scores = {kind: Score() for kind in PREDICTIONS}
            for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
                for case in cases(SCENES[scene](seed, chosen.seconds), chosen.every):
                    scores[case.kind].add(case)
            for kind, score in scores.items():
                print(f"| {scene} | {kind} | {' | '.join(f'{value:.4g}' for value in score.row())} |", flush=True)


if __name__ == "__main__":
    main()
