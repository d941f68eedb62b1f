"""Choose among the depth images that ROS drivers publish: find the topics of each camera, the best of these topics, and
the ``CameraInfo`` that describes the images on the best topic.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.lens import COEFFICIENTS, Intrinsics, LensModel
from anchorpose.rotations import rigid
from anchorpose.sources.bag_file import Bag, Channel
from anchorpose.sources.grey_images import scale_of
from anchorpose.sources.ros_messages import (
    COMPRESSED,
    IMAGE,
    METRES,
    READ_BY_HAND,
    CameraInfo,
    DepthStream,
    Image,
    ImageMessage,
    Streams,
    encoding_of,
    first,
    metres_of,
    read_any_image,
    read_camera_info,
    read_transforms,
    readable,
    size_of,
)
from anchorpose.sources.source import SourceCamera

_INFO: Final = "sensor_msgs/CameraInfo"
_MOVED: Final = frozenset({"registered", "aligned", "rgb", "color", "hd", "qhd"})
"""Words by which the name of a topic shows that depth was converted to the colour camera's view (registered). This
conversion loses some readings.
"""
_RECTIFIED: Final = frozenset({"rect", "rectified"})
_OF_DEPTH: Final = _MOVED | _RECTIFIED | {"depth", "image", "raw", "to", "compressed", "compresseddepth", "sd"}
"""Words that, in the name of a topic, describe the kind of its images and not their camera."""
_LONGEST_NAME: Final = 60  # maximum number of characters of a camera's name

_MODELS: Final = {
    "plumb_bob": LensModel.BROWN_CONRADY,
    "rational_polynomial": LensModel.RATIONAL,
    "equidistant": LensModel.KANNALA_BRANDT,
    "fisheye": LensModel.KANNALA_BRANDT,
}
_LARGEST: Final = 1e6  # maximum absolute value of a lens parameter, and of a coordinate in metres
_SHORTEST_PX: Final = 1.0  # minimum focal length
_TOPIC: Final = "/tf_static"
_WORLDS: Final = frozenset({"world", "map", "odom"})  # names of fixed coordinate frames
_LONGEST: Final = 100  # maximum number of transforms from a camera to its world, since a damaged file may have a cycle
T_WORLD_ROS: Final = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])
"""Rotation (4, 4) from the world of ROS (REP 103: x forward, z up) to this project's world (x forward, y up)."""


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A topic with depth images. words: the words of the topic's name; message: the topic's first image."""

    channel: Channel
    words: tuple[str, ...]
    message: Image

    @property
    def in_metres(self) -> bool:
        return encoding_of(self.message) == METRES

    @property
    def rectified(self) -> bool:
        return not _RECTIFIED.isdisjoint(self.words)

    @property
    def cost(self) -> tuple[bool, ...]:
        """Return a sort key. The sort key is lowest for the topic whose images are closest to the sensor's raw images:
        not registered to the colour image, in whole numbers, not rectified, not compressed.
        """
        moved = not _MOVED.isdisjoint(self.words)
        return moved, self.in_metres, self.rectified, self.channel.kind == COMPRESSED

    @property
    def camera(self) -> str:
        """Return a name for the camera: the words of the topic that do not describe the kind of its images."""
        words = (re.sub(r"[^A-Za-z0-9-]", "", word) for word in self.words if word.lower() not in _OF_DEPTH)
        return "_".join(filter(None, words))[:_LONGEST_NAME] or "depth"


@dataclass(slots=True)
class _Search:
    """The search for each camera's lens, pose and unit in a bag. infos: the ``CameraInfo`` of each topic; notes:
    sentences for the user.
    """

    bag: Bag
    infos: dict[str, CameraInfo]
    transforms: StaticTransforms
    notes: list[str] = field(default_factory=list)

    def stream(self, candidate: _Candidate) -> DepthStream:
        name, topic = candidate.camera, candidate.channel.topic
        width, height = size_of(candidate.message)
        camera = SourceCamera(
            name=name,
            width=width,
            height=height,
            depth_scale=self._scale(candidate, name) if candidate.in_metres else 0.001,  # REP 118: millimetres
            intrinsics=self._lens(candidate, name, (width, height)),
            T_world_camera=self._place(candidate, name),
            count=self.bag.count(topic),
        )
        return DepthStream(topic=topic, camera=camera, in_metres=candidate.in_metres)

    def _scale(self, candidate: _Candidate, name: str) -> float:
        topic = candidate.channel.topic
        scales = readable(self.bag, topic, lambda message: scale_of(metres_of(read_any_image(message))))
        scale = next(filter(None, scales), 0.001)  # assume millimetres if no image has a reading
        self.notes.append(f"Depth of {name} is in metres: it is written in steps of {scale * 1000:g} mm.")
        return scale

    def _lens(self, candidate: _Candidate, name: str, size: tuple[int, int]) -> Intrinsics | None:
        infos = self._infos_of(candidate, size)
        lenses = {lens_of(info, candidate.rectified) for info in infos}
        usable = {lens for lens in lenses if lens.intrinsics is not None}
        if len(usable) == 1:
            return usable.pop().intrinsics
        problem = next(iter(lenses)).problem if len(lenses) == 1 else "several infos fit it, and they differ"
        if not infos:
            problem = f"no camera info in the bag fits its {size[0]} x {size[1]} images"
        self.notes.append(f"The lens of {name} is not known: {problem}; {READ_BY_HAND}.")
        return None

    def _infos_of(self, candidate: _Candidate, size: tuple[int, int]) -> list[CameraInfo]:
        """Return the ``CameraInfo`` on the topic ``camera_info`` beside the topic of the images, if that message states
        the images' size; otherwise every ``CameraInfo`` with the optical frame and the size of the images.
        """
        topic = re.sub(r"/compressed(Depth)?$", "", candidate.channel.topic)
        beside = self.infos.get(f"{topic.rpartition('/')[0]}/camera_info")
        if beside is not None and image_size(beside) == size:
            return [beside]
        frame = candidate.message.frame_id
        return [info for info in self.infos.values() if frame and info.frame_id == frame and image_size(info) == size]

    def _place(self, candidate: _Candidate, name: str) -> np.ndarray | None:
        T_world_camera, frame = self.transforms.place(candidate.message.frame_id)
        if T_world_camera is not None:
            self.notes.append(f"The pose of {name} is that of /tf_static, its world turned so that y is up.")
        elif not {"/tf", "/tf_static"}.isdisjoint(channel.topic for channel in self.bag.channels):
            self.notes.append(f"/tf_static places {name} in {frame!r}, not in a fixed world: its pose is not known.")
        return T_world_camera


def find_streams(bag: Bag, path: Path) -> Streams:
    """Find each camera's depth topic that is closest to the sensor's own images. Raises InputError if the bag has no
    depth topic.
    """
    notes: list[str] = []
    candidates = _candidates(bag, notes)
    if not candidates:
        raise InputError(
            path, f"it has no depth images that can be read ({_described(bag, notes)})", "record the depth topic"
        )
    best: dict[str, _Candidate] = {}
    for candidate in sorted(candidates, key=lambda candidate: (candidate.cost, candidate.channel.topic)):
        chosen = best.setdefault(candidate.camera, candidate)
        if chosen is not candidate:
            notes.append(f"{candidate.channel.topic} is left out: {chosen.channel.topic} is the same camera's depth.")
    topics = (channel.topic for channel in bag.channels if channel.kind == _INFO)
    infos = {topic: info for topic in topics if (info := first(bag, topic, read_camera_info)) is not None}
    search = _Search(bag, infos, StaticTransforms(bag), notes)
    return Streams(tuple(search.stream(best[name]) for name in sorted(best)), tuple(notes))


def _candidates(bag: Bag, notes: list[str]) -> list[_Candidate]:
    """List the topics whose name contains "depth" and whose images have an encoding of depth. The encoding alone does
    not identify depth, since infrared images have the same encodings.
    """
    candidates = []
    for channel in bag.channels:
        if channel.kind not in (IMAGE, COMPRESSED) or "depth" not in channel.topic.lower():
            continue
        message = first(bag, channel.topic, read_any_image)
        if message is not None and encoding_of(message):
            candidates.append(_Candidate(channel, tuple(filter(None, re.split("[/_]+", channel.topic))), message))
        elif message is not None:
            encoding = message.encoding if isinstance(message, ImageMessage) else message.format
            notes.append(f"{channel.topic} is left out: its encoding {encoding[:40]!r} is not read as depth.")
    return candidates


def _described(bag: Bag, notes: list[str]) -> str:
    topics = [channel.topic for channel in bag.channels if channel.kind in (IMAGE, COMPRESSED)]
    return " ".join(notes).rstrip(".") or "its images: " + (", ".join(topics[:5]) or "none")


@dataclass(frozen=True, slots=True)
class Lens:
    """A camera's intrinsics, or None and the reason why they are missing."""

    intrinsics: Intrinsics | None
    problem: str = ""


def image_size(info: CameraInfo) -> tuple[int, int]:
    """Return width and height of the images that ``info`` describes, after cropping to its region and binning."""
    _, _, height, width = info.roi
    across, down = _binning(info)
    return (width or info.width) // across, (height or info.height) // down


def lens_of(info: CameraInfo, rectified: bool) -> Lens:
    """Return the lens of the images that ``info`` describes. rectified: whether distortion was removed from the images;
    the lens is then read from the projection matrix P in ``info``, or from its camera matrix K if P is missing and
    ``info`` has no distortion.
    """
    if rectified and info.P[0] > 0.0:
        focal_centre = info.P[0], info.P[5], info.P[2], info.P[6]
    elif rectified and any(info.D):
        return Lens(None, "its images are rectified, but their projection P is missing")
    else:
        focal_centre = info.K[0], info.K[4], info.K[2], info.K[5]
    lens = lens_with(focal_centre, () if rectified else info.D, info.model)
    return lens if lens.intrinsics is None else Lens(_of_part(info, lens.intrinsics))


def lens_with(focal_centre: tuple[float, float, float, float], D: tuple[float, ...], model: str) -> Lens:
    """Return the lens with the focal lengths and centre (fx, fy, cx, cy) and the distortion coefficients ``D``. model:
    name of the distortion model in ROS. If the numbers are impossible for a lens, such as zeros and damaged numbers, or
    if the model with this number of coefficients is unknown, the result states the problem instead.
    """
    fx, fy, cx, cy = focal_centre
    if not (all(abs(value) < _LARGEST for value in (*focal_centre, *D)) and min(fx, fy) >= _SHORTEST_PX):
        return Lens(None, "the camera was not calibrated")
    if not any(D):
        return Lens(Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy))
    known = _MODELS.get(model)
    if known is LensModel.BROWN_CONRADY and len(D) == 4:
        D = (*D, 0.0)
    if known is LensModel.BROWN_CONRADY and len(D) in COEFFICIENTS[LensModel.RATIONAL]:
        known = LensModel.RATIONAL  # some drivers give eight coefficients but the model name for five
    if known is None or len(D) not in COEFFICIENTS[known]:
        return Lens(None, f"its lens model {model!r} with {len(D)} coefficients is not known")
    return Lens(Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, distortion=D, model=known))


def _of_part(info: CameraInfo, full: Intrinsics) -> Intrinsics:
    """Convert the lens of the full image to the lens of the published images, which may show only a region of the full
    image, with binned pixels.

    Half pixels are added because the centre of a binned pixel lies between the centres of its parts.
    """
    column, row, _, _ = info.roi
    across, down = _binning(info)
    cx, cy = (full.cx - column + 0.5) / across - 0.5, (full.cy - row + 0.5) / down - 0.5
    return replace(full, fx=full.fx / across, fy=full.fy / down, cx=cx, cy=cy)


def _binning(info: CameraInfo) -> tuple[int, int]:
    """Return the numbers of pixels that are binned across and down; ROS may write 0 instead of 1."""
    return max(info.binning[0], 1), max(info.binning[1], 1)


class StaticTransforms:
    """The constant transforms between coordinate frames that are stored in a bag."""

    def __init__(self, bag: Bag) -> None:
        # damaged messages are left out, so a chain of coordinate frames that needs a transform from such a message
        # reaches no fixed world
        messages = readable(bag, _TOPIC, read_transforms)
        self._parents = {child: (parent, values) for message in messages for parent, child, values in message}

    def place(self, frame: str) -> tuple[np.ndarray | None, str]:
        """Return T_world_camera (4, 4) of a camera's optical frame, None if the chain of parent frames reaches no fixed
        world; and the name of the last frame in this chain.
        """
        T_frame_camera, found = np.eye(4), None
        frame = frame.lstrip("/")
        for _ in range(_LONGEST):
            if frame in _WORLDS:
                found = T_frame_camera
            if frame not in self._parents:
                break
            frame, values = self._parents[frame]
            T_parent_frame = _matrix(values)
            if T_parent_frame is None:
                return None, frame
            T_frame_camera = T_parent_frame @ T_frame_camera
        return (None if found is None else T_WORLD_ROS @ found), frame


def _matrix(values: np.ndarray) -> np.ndarray | None:
    """Return the transform (4, 4) of translation in metres and quaternion x, y, z, w; None if they are invalid."""
    if not (np.abs(values) < _LARGEST).all():  # also false for NaN
        return None
    length = np.linalg.norm(values[3:])
    if not 0.99 < length < 1.01:  # tolerance of ROS for a unit quaternion
        return None
    x, y, z, w = values[3:] / length
    turn = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return rigid(np.array(turn), values[:3])
