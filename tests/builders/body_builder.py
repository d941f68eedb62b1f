"""Bodies of known shape and pose, and what depth cameras would see of them, for the tests of body and tracker."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset
from anchorpose.body.constraints import no_constraints
from anchorpose.body.evidence import Evidence, gather_evidence
from anchorpose.body.joint_ranges import joint_range
from anchorpose.body.pose import DEGREE, MOVING_BONES, POSE_SIZE, Pose
from anchorpose.body.segments import load_body_asset
from anchorpose.body.shape_prior import child_belief, shape_of_height
from anchorpose.body.skin_points import (
    CLOTHES,
    OFFSETS,
    Body,
    FittedShape,
    PosedPoints,
    SkinPoints,
    build_body,
    even_clothes,
    pose_points,
    shape_offsets,
    skin_points,
)
from anchorpose.camera import Camera, transform_points
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.lens import Intrinsics
from anchorpose.simulate.clinic import look_at
from anchorpose.simulate.person import vertex_normals
from anchorpose.simulate.render import Figure, TrueImage, draw_figures
from anchorpose.surface.mesh import build_surface
from anchorpose.surface.patient_surface import fuse

NOTHING = no_constraints()
"""No pairs, no anchors: the surface alone."""


@cache
def asset() -> BodyAsset:
    return load_body_asset()


@cache
def points() -> SkinPoints:
    return skin_points(asset())


def true_shape(coefficients: np.ndarray, clothing_m: float) -> FittedShape:
    """The shape of a simulated person: statistical coefficients, nothing of their own, clothes of one thickness."""
    own = np.zeros(asset().shape_count - len(coefficients))
    return FittedShape(np.append(coefficients, own), even_clothes(clothing_m))


@cache
def adult(height_m: float = 1.72, clothing_m: float = 0.0) -> FittedShape:
    return FittedShape(shape_of_height(asset(), height_m).coefficients, even_clothes(clothing_m))


@cache
def adult_body(height_m: float = 1.72, clothing_m: float = 0.0) -> Body:
    return build_body(points(), adult(height_m, clothing_m))


@cache
def child_body(height_m: float) -> Body:
    """A naked child of ordinary shape."""
    shape = child_belief(asset()).standing(asset(), height_m, 0.01).shape
    return build_body(points(), replace(shape, offset_m=even_clothes(0.0)))


def standing(root_m: Sequence[float] = (0.0, 0.95, 0.0), **turns_deg: tuple[float, float, float]) -> Pose:
    """The rest pose with the named bones turned by a rotation vector in degrees, X forward, Y up, Z right."""
    rotations = np.tile(np.eye(3), (len(asset().bone_names), 1, 1))
    for bone, turn in turns_deg.items():
        rotations[asset().bone(bone)] = Rotation.from_rotvec(np.array(turn) * DEGREE).as_matrix()
    return Pose(rotations, np.array(root_m, dtype=np.float64))


def random_pose(seed: int, spread: float = 0.4) -> Pose:
    """A standing person's pose, ``spread`` standard deviations of the joint range wide; hinges bend forward only."""
    rng = np.random.default_rng(seed)
    ranges = joint_range(asset())
    rotations = np.tile(np.eye(3), (len(asset().bone_names), 1, 1))
    for row, name in enumerate(MOVING_BONES):
        vector = np.zeros(3)
        if row:  # each bone for itself: more poses than people take
            whiten = np.linalg.cholesky(ranges.information[row, :, row]).T
            vector = ranges.mean[row] + np.linalg.solve(whiten, spread * rng.normal(size=3))
        short = ranges.hinge_limit[row] + 3.0 * DEGREE - vector @ ranges.hinge[row]
        vector = vector + max(short, 0.0) * ranges.hinge[row]
        rotations[asset().bone(name)] = Rotation.from_rotvec(vector).as_matrix()
    rotations[0] = Rotation.from_rotvec(rng.normal(size=3) * np.array([4.0, 12.0, 4.0]) * DEGREE).as_matrix()
    return Pose(rotations, np.array([0.0, 0.95, 0.0]) + rng.normal(0.0, 0.03, 3))


def stepped(pose: Pose, *shift_m: float) -> Pose:
    """The same pose in another place."""
    return Pose(pose.rotations, pose.root_m + np.array(shift_m))


def shaken(pose: Pose, seed: int, turn_deg: float, shift_m: float) -> Pose:
    """A pose near another: every moving bone turned, the root shifted, by so much (one standard deviation an axis)."""
    rng = np.random.default_rng(seed)
    change = np.append(rng.normal(0.0, turn_deg * DEGREE, POSE_SIZE - 3), rng.normal(0.0, shift_m, 3))
    return pose.moved(change, points().moving)


def joints_of(body: Body, pose: Pose) -> np.ndarray:
    return body.mesh.joints(pose_points(body, pose).transforms)


def joint_errors_m(body: Body, pose: Pose, truth: Pose) -> np.ndarray:
    return np.linalg.norm(joints_of(body, pose) - joints_of(body, truth), axis=1)


def camera_at(position_m: Sequence[float], look_at_m: Sequence[float], name: str = "front", shrink: int = 1) -> Camera:
    """A level Kinect v2 that looks at a place, with 1/shrink of its pixels each way."""
    T_world_camera = look_at(np.array(position_m, float), np.array(look_at_m, float))
    lens = Intrinsics(fx=365.0 / shrink, fy=365.0 / shrink, cx=256.0 / shrink, cy=212.0 / shrink)
    size = {"width": 512 // shrink, "height": 424 // shrink, "depth_scale": 0.001}
    return Camera(name=name, **size, intrinsics=lens, T_world_camera=T_world_camera)


FRONT = camera_at((2.4, 1.1, 0.0), (0.0, 0.9, 0.0))
LEFT = camera_at((0.9, 1.2, -2.2), (0.0, 0.9, 0.0), "left")


def blank(camera: Camera) -> TrueImage:
    nothing = np.zeros((camera.height, camera.width), np.uint8)
    return TrueImage(nothing.astype(np.float32), np.ones(nothing.shape, np.float32), nothing, nothing.copy())


def photograph(skin_m: np.ndarray, camera: Camera) -> TrueImage:
    """Depth and parts (1 + bone) of the asset's skin (v, 3) in the world, free of noise, with nothing behind it."""
    part = (asset().main_bone()[asset().faces[:, 0]] + 1).astype(np.uint8)
    figure = Figure(skin_m.astype(np.float32), asset().faces, part, int(PixelLabel.PATIENT))
    return draw_figures(camera, blank(camera), (figure,))


def before_wall(picture: TrueImage, camera: Camera) -> View:
    """The picture as isolation would label it, a wall 4 m away behind the body."""
    body = picture.depth_m > 0
    labels = np.where(body, PixelLabel.PATIENT, PixelLabel.BACKGROUND).astype(np.uint8)
    return View(np.where(body, picture.depth_m, np.float32(4.0)), labels)


def skin_in(pose: Pose, body: Body) -> np.ndarray:
    """(v, 3) naked skin in the world."""
    return body.mesh.skin(body.transforms(pose))


def dressed_in(pose: Pose, shape: FittedShape) -> np.ndarray:
    """(v, 3) skin in the world with each piece of clothing as thick as the shape's; its patches are left out."""
    body, main = shape.mesh(asset()), np.array(asset().bone_names)[asset().main_bone()]
    thick_m = np.zeros(len(main))
    for thickness_m, bones in zip(shape.offset_m, CLOTHES.values(), strict=False):
        thick_m[np.isin(main, bones)] = thickness_m
    dressed = body.vertices + thick_m[:, None] * vertex_normals(body.vertices, asset().faces)
    return replace(body, vertices=dressed).skin(body.bone_transforms(pose.rotations, pose.root_m))


def evidence_of(views: Sequence[View], cameras: Sequence[Camera]) -> Evidence:
    """What the stages before registration make of labelled pictures."""
    meshes = [build_surface(view.depth_m, view.patient, camera) for view, camera in zip(views, cameras, strict=True)]
    return gather_evidence(fuse(meshes, cameras), views, cameras)


Change = Callable[[View, TrueImage], View]


def seen_body(pose: Pose, body: Body, cameras: Sequence[Camera] = (FRONT,), change: Change | None = None) -> Evidence:
    """The evidence that cameras gather of a naked body in a pose; ``change`` may hide some of it."""
    views = []
    for camera in cameras:
        picture = photograph(skin_in(pose, body), camera)
        view = before_wall(picture, camera)
        views.append(view if change is None else change(view, picture))
    return evidence_of(views, cameras)


def hide_bones(*names: str) -> Callable[[View, TrueImage], View]:
    """A change for ``seen_body``: the pixels of these bones return no reading."""
    numbers = [asset().bone(name) + 1 for name in names]

    def change(view: View, picture: TrueImage) -> View:
        gone = np.isin(picture.part, numbers)
        labels = np.where(gone, PixelLabel.NO_READING, view.labels).astype(np.uint8)
        return View(np.where(gone, np.float32(0.0), view.depth_m), labels)

    return change


def winding_numbers(vertices: np.ndarray, faces: np.ndarray, places: np.ndarray) -> np.ndarray:
    """How often a surface wraps each place: 1 inside, 0 outside (van Oosterom and Strackee 1983)."""
    wraps = []
    for place in places:
        a, b, c = (vertices[faces[:, k]] - place for k in range(3))
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        volume = np.einsum("ni,ni->n", a, np.cross(b, c))
        dots = ((a * b).sum(1) * lc, (b * c).sum(1) * la, (c * a).sum(1) * lb)
        wraps.append(2.0 * np.arctan2(volume, la * lb * lc + sum(dots)).sum() / (4.0 * np.pi))
    return np.array(wraps)


@dataclass(frozen=True, slots=True)
class Motion:
    """A rigid motion of the world."""

    T: np.ndarray

    def of_camera(self, camera: Camera) -> Camera:
        return replace(camera, T_world_camera=self.T @ camera.require_pose())

    def of_pose(self, pose: Pose) -> Pose:
        rotations = pose.rotations.copy()
        rotations[0] = self.T[:3, :3] @ rotations[0]
        return Pose(rotations, transform_points(self.T, pose.root_m))


def turned_about_y(degrees: float, shift_m: Sequence[float]) -> Motion:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    T[:3, 3] = shift_m
    return Motion(T)


def shape_jacobian(body: Body, posed: PosedPoints, index: np.ndarray, direction: np.ndarray, count: int) -> np.ndarray:
    """Return (n, count + OFFSETS), like ``pose_jacobian``: derivatives by ``count`` coefficients, then by all
    offsets.
    """
    asset, transforms = body.points.asset, posed.transforms
    offset = shape_offsets(asset, posed, count)
    weights = body.points.weights[index]
    blended = (weights @ transforms[:, :3, :3].reshape(-1, 9)).reshape(-1, 3, 3)
    local = np.einsum("nij,ni->nj", blended, direction)
    jacobian = np.empty((len(index), count + OFFSETS))
    jacobian[:, :count] = np.einsum("nj,knj->nk", local, asset.vertex_basis[:count, body.points.vertex[index]])
    jacobian[:, :count] += np.einsum("nki,ni->nk", np.einsum("nb,bki->nki", weights, offset), direction)
    outward = (posed.normals[index] * direction).sum(axis=1)
    jacobian[:, count:] = body.points.covered[index] * outward[:, None]
    return jacobian
