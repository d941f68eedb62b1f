"""Compute each camera's depth images, without error and as the sensor reads them, and the truth about the patient."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from anchorpose.body.skin_points import SkinPoints, body_points
from anchorpose.body.visibility import GRAZING, skin_around_joints
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.joints import JOINT_COUNT
from anchorpose.rotations import rotate
from anchorpose.simulate.clinic import Clinic, Performance, random_stream
from anchorpose.simulate.librealsense import MEMORY
from anchorpose.simulate.person import Person
from anchorpose.simulate.reading import Reader
from anchorpose.simulate.render import PATIENT, Figure, TrueImage, draw_figures, render_still
from anchorpose.simulate.rigged_body import sampled_vertices
from anchorpose.simulate.rooms.reflections import RoomPicture, take_picture
from anchorpose.simulate.sensor import SENSORS, draw_wiggle

# m, the curtain's distance from the patient (more than an arm's length), half its width, and its height
CURTAIN_M, CURTAIN_HALF_WIDTH_M, CURTAIN_HEIGHT_M = 1.0, 1.3, 2.2
BACKGROUND_FRAMES = 9  # number of images of the empty room; the median of these images is stored
# m; maximum difference between the depth of seen skin and the depth in its pixel; about four times the width of a pixel
# (7 mm at 2.5 m), since the depth of slanted skin varies within a pixel
SAME_SKIN_M: Final = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """The images of all cameras at one moment."""

    figures: tuple[Figure, ...]  # people at the time of the first camera's image
    images: tuple[TrueImage, ...]  # per camera, the image without errors
    depths_mm: tuple[np.ndarray, ...]  # per camera, (height, width) uint16 mm, the image that the recorder stores
    seen_share: np.ndarray  # (21, cameras), seen share of the camera-facing skin around each joint (``seen_shares``)
    behind_passers: np.ndarray  # (cameras,), share of the patient's pixels that passers-by hide


@dataclass(frozen=True, slots=True, eq=False)
class Studio:
    """A clinic, with everything that is computed once before the images of its frames."""

    clinic: Clinic
    stills: tuple[TrueImage, ...]  # one per camera: the empty room
    readers: tuple[Reader, ...]  # one per camera
    performances: tuple[Performance, ...]  # per camera, movements at its image times; shared if times are equal
    in_hole: np.ndarray  # (t,) bool, frames with a hole
    stills_after: tuple[TrueImage, ...]  # one per camera: the empty room after the equipment was moved
    stills_curtained: tuple[TrueImage, ...]  # one per camera: the empty room while a curtain hangs
    room_picture: RoomPicture | None = None  # a cluttered room without people; None for a plain training room

    def shoot(self, frame: int) -> Shot:
        """Return the images of all cameras with the same frame number."""
        clinic = self.clinic
        figures = {id(p): p.figures(frame) for p in self.performances}
        images, depths, seen, behind = [], [], [], []
        for index, camera in enumerate(clinic.cameras):
            performance = self.performances[index]
            people = figures[id(performance)]
            still = self._without_people(index, frame, people)
            image = draw_figures(camera, still, people)
            images.append(image)
            depths.append(self._reading_mm(index, frame, image))
            behind.append(share_behind(camera, still, people, clinic.config.passers_by, image))
            seen.append(
                seen_shares(clinic.patient.person, performance.bones[0][frame], people[0].skin_m, camera, image)
            )
        if self.in_hole[frame]:
            depths = _with_hole(clinic, images, depths)
        return Shot(
            figures[id(self.performances[0])], tuple(images), tuple(depths), np.stack(seen, axis=1), np.array(behind)
        )

    def _without_people(self, index: int, frame: int, people: tuple[Figure, ...]) -> TrueImage:
        """Return the true image of one camera without people. The mirror of a cluttered room still reflects the
        people.
        """
        clinic, time_s = self.clinic, float(self.performances[index].times_s[frame])
        if clinic.scene is not None and self.room_picture is not None:
            return self.room_picture.with_movers(tuple(m.figure(time_s) for m in clinic.scene.movers), people)
        moves_at_s = clinic.config.equipment_moves_at_s
        if _curtain_hangs(clinic, time_s):
            return self.stills_curtained[index]
        return (self.stills_after if moves_at_s is not None and time_s >= moves_at_s else self.stills)[index]

    def _reading_mm(self, index: int, frame: int, image: TrueImage) -> np.ndarray:
        """Return the image that the recorder stores. A recorder that smooths over time also needs earlier frames."""
        reader = self.readers[index]
        first = max(0, frame - MEMORY + 1) if reader.spec.filtered else frame
        raw = []
        for number in range(first, frame + 1):
            if number not in reader.recent or number == frame:
                seen = image if number == frame else self._image(index, number)
                reader.keep(number, reader.raw_mm(random_stream(self.clinic.config, "sensor", index, number), seen))
            raw.append(reader.recent[number])
        return reader.stored_mm(raw)

    def _image(self, index: int, frame: int) -> TrueImage:
        people = self.performances[index].figures(frame)
        return draw_figures(self.clinic.cameras[index], self._without_people(index, frame, people), people)

    def background_mm(self, index: int) -> np.ndarray:
        """Return (height, width) uint16 mm: the empty room with its equipment, the median of several images."""
        config, still = self.clinic.config, self.stills[index]
        reader, frames = self.readers[index], range(config.frames, config.frames + BACKGROUND_FRAMES)
        raw = [reader.raw_mm(random_stream(config, "sensor", index, frame), still) for frame in frames]
        empty = [reader.stored_mm([reading]) for reading in raw]
        return np.median(empty, axis=0).astype(np.uint16)


def set_up(clinic: Clinic) -> Studio:
    """Prepare a clinic: render the empty room as each camera sees it, and compute the movements of all people."""
    config = clinic.config
    equipment = equipment_triangles(clinic, moved=False)
    performances: list[Performance] = []
    for index in range(config.cameras):
        times_s = clinic.true_times_s(index)
        same = [p for p in performances if np.array_equal(p.times_s, times_s)]
        performances.append(same[0] if same else clinic.act(times_s))
    scene = clinic.scene
    picture = None if scene is None else take_picture(scene.camera, scene.triangles, scene.shiny, scene.mirror)
    stills = (picture.image,) if picture is not None else empty_rooms(clinic, equipment)
    pushed = config.equipment_moves_at_s is not None
    return Studio(
        clinic=clinic,
        stills=stills,
        stills_after=empty_rooms(clinic, equipment_triangles(clinic, moved=True)) if pushed else stills,
        stills_curtained=stills if config.curtain_s is None else empty_rooms(clinic, equipment, curtain=True),
        readers=tuple(_reader(clinic, index, picture) for index in range(config.cameras)),
        performances=tuple(performances),
        in_hole=_draw_hole_frames(clinic),
        room_picture=picture,
    )


def _reader(clinic: Clinic, index: int, picture: RoomPicture | None) -> Reader:
    spec = SENSORS[clinic.config.sensor_of(index)]
    wiggle_m = draw_wiggle(random_stream(clinic.config, "sensor", index), spec)
    if clinic.scene is None or picture is None:
        return Reader(spec, wiggle_m)
    return Reader(spec, wiggle_m, clinic.scene.spoil, picture.shiny)


def empty_rooms(clinic: Clinic, equipment: np.ndarray, curtain: bool = False) -> tuple[TrueImage, ...]:
    """Return each camera's image without people. equipment: (n, 3, 3) triangles; curtain: whether curtains hang."""
    hung = [[curtain_triangles(camera)] if curtain else [] for camera in clinic.cameras]
    rooms = [np.concatenate([clinic.room, *triangles]) for triangles in hung]
    return tuple(render_still(camera, room, equipment) for camera, room in zip(clinic.cameras, rooms, strict=True))


def equipment_triangles(clinic: Clinic, moved: bool) -> np.ndarray:
    """Return triangles (n, 3, 3) of the equipment, world, before or after it was pushed."""
    if clinic.equipment is None:
        return np.zeros((0, 3, 3))
    vertices, faces = clinic.equipment.triangles()
    if moved:
        x, z = clinic.config.equipment_shift_m
        vertices = vertices + np.array([x, 0.0, z])
    triangles: np.ndarray = vertices[faces]
    return triangles


def _curtain_hangs(clinic: Clinic, time_s: float) -> bool:
    span = clinic.config.curtain_s
    return span is not None and span[0] <= time_s < span[1]


def curtain_triangles(camera: Camera) -> np.ndarray:
    """Return (2, 3, 3) world metres: a curtain from the floor up that hides the patient's place from one camera."""
    towards = camera.position_m * [1.0, 0.0, 1.0]
    towards /= np.linalg.norm(towards)
    middle, aside = CURTAIN_M * towards, CURTAIN_HALF_WIDTH_M * np.cross(towards, [0.0, 1.0, 0.0])
    low, high = [0.0, 0.01, 0.0], [0.0, CURTAIN_HEIGHT_M, 0.0]
    corners = [middle - aside + low, middle + aside + low, middle + aside + high, middle - aside + high]
    return np.array([[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]])


def body_centre_m(cameras: tuple[Camera, ...], images: list[TrueImage]) -> np.ndarray | None:
    """Return the mean (3,) of the patient's visible points of all cameras, world frame; None without such points."""
    seen = [
        transform_points(camera.require_pose(), camera.back_project(image.depth_m)[image.label == PATIENT])
        for camera, image in zip(cameras, images, strict=True)
    ]
    points_world = np.concatenate(seen)
    return points_world.mean(axis=0) if len(points_world) else None


def _with_hole(clinic: Clinic, images: list[TrueImage], depths_mm: list[np.ndarray]) -> list[np.ndarray]:
    """Remove all readings within ``hole_radius_m`` of the body's centre, as in Section VI of the paper that README.md
    cites.
    """
    centre_m = body_centre_m(clinic.cameras, images)
    if centre_m is None:
        return depths_mm
    holed = []
    for camera, depth in zip(clinic.cameras, depths_mm, strict=True):
        points = camera.back_project(depth * camera.depth_scale)
        distance_m = np.linalg.norm(transform_points(camera.require_pose(), points) - centre_m, axis=2)
        holed.append(np.where(distance_m < clinic.config.hole_radius_m, 0, depth).astype(np.uint16))
    return holed


def _draw_hole_frames(clinic: Clinic) -> np.ndarray:
    config = clinic.config
    if config.hole_radius_m == 0:
        return np.zeros(config.frames, dtype=bool)
    return random_stream(config, "holes").random(config.frames) < config.hole_share


def seen_shares(person: Person, bones: np.ndarray, skin_m: np.ndarray, camera: Camera, image: TrueImage) -> np.ndarray:
    """Return, for each joint (21,), the share of skin that the camera sees among the skin around the joint that faces
    the camera.

    Skin may be hidden by other skin of the patient, people or equipment, or lie outside the image. The share is 0 if no
    skin around the joint faces the camera. bones (b, 4, 4), skin_m (v, 3): the patient at the time of the image.
    """
    points = _points()
    vertex = sampled_vertices(person.body.asset)
    place = skin_m[vertex].astype(np.float64)
    normals = rotate(bones[points.part, :3, :3], person.normals[vertex])
    towards = camera.position_m - place
    facing = (normals * towards).sum(axis=1) > GRAZING * np.linalg.norm(towards, axis=1)
    seen = facing & _unhidden(transform_points(invert_rigid(camera.require_pose()), place), camera, image)
    shares = np.zeros(JOINT_COUNT)
    for joint, around in enumerate(skin_around_joints(points)):
        shares[joint] = seen[around].sum() / max(facing[around].sum(), 1)
    return shares


def share_behind(
    camera: Camera, still: TrueImage, figures: tuple[Figure, ...], passers: int, image: TrueImage
) -> float:
    """Return the share of the patient's pixels in a camera's image that passers-by hide: the last ``passers`` of the
    figures.
    """
    if not passers or not (image.label >= PATIENT + len(figures) - passers).any():
        return 0.0
    without = int((draw_figures(camera, still, figures[:-passers]).label == PATIENT).sum())
    return 1.0 - int((image.label == PATIENT).sum()) / without if without else 0.0


def _unhidden(inside_m: np.ndarray, camera: Camera, image: TrueImage) -> np.ndarray:
    """Return (p,) bool: whether each point (p, 3), camera frame, is the surface that the camera sees: the point's pixel
    shows the patient, at the point's depth within ``SAME_SKIN_M``.
    """
    columns, rows, inside = camera.pixel_of(inside_m)
    near = np.abs(image.depth_m[rows, columns] - inside_m[:, 2]) < SAME_SKIN_M
    return inside & near & (image.label[rows, columns] == PATIENT)


@cache
def _points() -> SkinPoints:
    return body_points()
