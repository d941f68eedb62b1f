"""Depth images that ROS drivers publish: which topics are one camera's, and which ``CameraInfo`` belongs to them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.lens import Intrinsics
from anchorpose.sources.bag_file import BagFile, Channel, DamagedBag
from anchorpose.sources.depth_stream import COMPRESSED, IMAGE, READ_BY_HAND, DepthStream, Streams, first, read_any_image
from anchorpose.sources.metres import scale_of
from anchorpose.sources.ros_camera import StaticTransforms, image_size, lens_of
from anchorpose.sources.ros_depth import METRES, encoding_of, metres_of, size_of
from anchorpose.sources.ros_messages import CameraInfo, CompressedMessage, ImageMessage, read_camera_info
from anchorpose.sources.source import SourceCamera

_INFO: Final = "sensor_msgs/CameraInfo"
_MOVED: Final = frozenset({"registered", "aligned", "rgb", "color", "hd", "qhd"})
"""Words of a topic whose depth was moved into the colour camera's image, which loses some of it."""
_RECTIFIED: Final = frozenset({"rect", "rectified"})
_OF_DEPTH: Final = _MOVED | _RECTIFIED | {"depth", "image", "raw", "to", "compressed", "compresseddepth", "sd"}
"""Words of a topic that say what its images are, and not whose."""
_LONGEST_NAME: Final = 60


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A topic with depth images; words: of its name; message: its first image."""

    channel: Channel
    words: tuple[str, ...]
    message: ImageMessage | CompressedMessage

    @property
    def in_metres(self) -> bool:
        return encoding_of(self.message) == METRES

    @property
    def rectified(self) -> bool:
        return not _RECTIFIED.isdisjoint(self.words)

    @property
    def cost(self) -> tuple[bool, ...]:
        """The lowest is the most direct: as the sensor saw it, in its own numbers, not moved into the colour image."""
        moved = not _MOVED.isdisjoint(self.words)
        return moved, self.in_metres, self.rectified, self.channel.kind == COMPRESSED

    @property
    def camera(self) -> str:
        """A name for the camera: the words that are left, suitable for a folder."""
        words = (re.sub(r"[^A-Za-z0-9-]", "", word) for word in self.words if word.lower() not in _OF_DEPTH)
        return "_".join(filter(None, words))[:_LONGEST_NAME] or "depth"


@dataclass(slots=True)
class _Search:
    """What is looked up for every camera of a bag, and what is noted."""

    bag: BagFile
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
        scale = None
        for message in self.bag.messages((candidate.channel.topic,)):
            try:
                scale = scale_of(metres_of(read_any_image(message)))
            except DamagedBag:
                continue
            if scale is not None:
                break
        scale = scale or 0.001  # no image has a reading
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
        """The info beside the images where its size fits, otherwise those of the same optical frame and size."""
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
            self.notes.append(f"/tf_static places {name} in {frame!r}, which is no fixed world: its pose is not known.")
        return T_world_camera


def find_streams(bag: BagFile, path: Path) -> Streams:
    """The most direct depth images of each camera. Raises InputError where there are none."""
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


def _candidates(bag: BagFile, notes: list[str]) -> list[_Candidate]:
    """Topics that say depth in their name and have images of an encoding for it; infrared has the same encodings."""
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


def _described(bag: BagFile, notes: list[str]) -> str:
    topics = [channel.topic for channel in bag.channels if channel.kind in (IMAGE, COMPRESSED)]
    return " ".join(notes).rstrip(".") or "its images: " + (", ".join(topics[:5]) or "none")
