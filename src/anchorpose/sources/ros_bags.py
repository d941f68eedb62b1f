"""Read depth images from bags (files of ROS messages) in the formats of ROS 1 and ROS 2 (SQLite and MCAP), also from
bags that the software of RealSense and Orbbec records.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.sources.bag_file import (
    MCAP_MAGIC,
    ROS1_MAGIC,
    SQLITE_MAGIC,
    Bag,
    DamagedBag,
    Message,
    files_of,
    open_bag,
)
from anchorpose.sources.grey_images import grey_of_metres
from anchorpose.sources.ros_messages import (
    METRES,
    RECORD_AGAIN,
    DepthStream,
    Image,
    Streams,
    encoding_of,
    grey_of,
    metres_of,
)
from anchorpose.sources.ros_streams import find_streams
from anchorpose.sources.source import Reader, SourceCamera, SourceFrame
from anchorpose.sources.vendor_bags import device_time_ns, find_orbbec, find_realsense


def matches(path: Path, head: bytes) -> bool:
    """Return whether a file is a bag, by its first bytes, or a folder contains bags of ROS 2."""
    if path.is_dir():
        return bool(files_of(path))
    database = head.startswith(SQLITE_MAGIC) and b"CREATE TABLE topics" in head
    return database or head.startswith((ROS1_MAGIC, MCAP_MAGIC))


def open_source(path: Path) -> BagSource:
    """Open a bag; raises InputError if it has no depth images that can be read."""
    try:
        bag = open_bag(path)
        for find in (find_realsense, find_orbbec, find_streams):
            streams = find(bag, path)
            if streams is not None:
                break
    except DamagedBag as error:
        raise InputError(path, f"the bag is damaged: {error}", RECORD_AGAIN) from error
    except OSError as error:
        raise InputError(path, f"it cannot be read ({error.strerror})", "check the disk and the rights") from error
    if streams is None or not streams.streams:
        raise InputError(path, "none of its depth images can be read", RECORD_AGAIN)
    return BagSource(path, bag, streams)


class BagSource:
    """An opened bag, whose depth images are read one at a time."""

    def __init__(self, path: Path, bag: Bag, streams: Streams) -> None:
        self.path = path
        self.cameras: tuple[SourceCamera, ...] = tuple(stream.camera for stream in streams.streams)
        self._bag, self._streams, self._said = bag, streams.streams, streams.notes
        self._tallies = tuple(Counter[str]() for _ in self.cameras)

    @property
    def notes(self) -> tuple[str, ...]:
        """Return sentences for the user; they are complete once all frames were read."""
        counted = (
            sentence.format(tally[what], camera.name)
            for tally, camera in zip(self._tallies, self.cameras, strict=True)
            for what, sentence in COUNTED.items()
            if tally[what]
        )
        return (*self._said, *self._bag.notes, *counted)

    def frames(self) -> Iterator[SourceFrame]:
        """Yield the depth images. If a file is cut off, yield the images before the cut, and add a note. Raises OSError
        with the file's path if the disk cannot be read: such a file does not count as cut off.
        """
        self._tallies = tuple(Counter[str]() for _ in self.cameras)
        count = 0
        try:
            for frame in self._all_frames():
                count += 1
                yield frame
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path)) from error
        if not count:
            raise InputError(self.path, "none of its depth images can be read", RECORD_AGAIN)

    def _all_frames(self) -> Iterator[SourceFrame]:
        images = {stream.topic: camera for camera, stream in enumerate(self._streams)}
        stamps = {stream.metadata_topic: camera for camera, stream in enumerate(self._streams) if stream.metadata_topic}
        waiting: dict[int, tuple[int, np.ndarray]] = {}
        for message in self._bag.messages({*images, *stamps}):
            topic = message.channel.topic
            camera = images[topic] if topic in images else stamps[topic]
            try:
                if topic in stamps:
                    if camera in waiting:  # else the image of this time stamp was damaged, and is counted already
                        yield _stamped(camera, *waiting.pop(camera), message)
                    continue
                time_ns, depth = self._read(camera, message)
            except DamagedBag:
                self._tallies[camera]["damaged"] += 1
                continue
            if self._streams[camera].metadata_topic:
                self._tallies[camera]["damaged"] += camera in waiting
                waiting[camera] = message.received_ns, depth
            else:
                yield SourceFrame(camera, time_ns / 1e9, depth)
        for camera in waiting:
            self._tallies[camera]["damaged"] += 1

    def _read(self, camera: int, message: Message) -> tuple[int, np.ndarray]:
        """Read the time in nanoseconds and the image (height, width) uint16 of a message. Raises DamagedBag if the
        message is damaged, or the image differs in kind or size from the camera's first image.
        """
        stream = self._streams[camera]
        image = stream.read(message)
        encoding = encoding_of(image)
        if not encoding or (encoding == METRES) != stream.in_metres:
            raise DamagedBag("an image has another encoding than the first one")
        depth = self._depth(camera, stream, image)
        if depth.shape != (stream.camera.height, stream.camera.width):
            raise DamagedBag("an image has another size than the first one")
        return self._time_ns(camera, stream, image, message), depth

    def _depth(self, camera: int, stream: DepthStream, image: Image) -> np.ndarray:
        if not stream.in_metres:
            return grey_of(image)
        if stream.camera.depth_scale is None:
            raise DamagedBag("depth in metres has no grey values yet")
        depth, too_far = grey_of_metres(metres_of(image), stream.camera.depth_scale)
        self._tallies[camera]["too far"] += too_far
        return depth

    def _time_ns(self, camera: int, stream: DepthStream, image: Image, message: Message) -> int:
        if image.stamp_ns == 0 and not stream.metadata_topic:
            self._tallies[camera]["without stamp"] += 1
            return message.received_ns
        return image.stamp_ns


def _stamped(camera: int, received_ns: int, depth: np.ndarray, message: Message) -> SourceFrame:
    """Return an image of RealSense with its time stamp, which is in ``message``, the message that follows the image.
    received_ns: time of the image's receipt. Raises DamagedBag if the image and the message do not belong together.
    """
    time_ns = device_time_ns(message)
    if time_ns is None or received_ns != message.received_ns:
        raise DamagedBag("an image and its time stamp do not belong together")
    return SourceFrame(camera, time_ns / 1e9, depth)


COUNTED: Final = {
    "damaged": "{} depth images of {} are damaged: left out.",
    "without stamp": "{} depth images of {} have no time stamp: the time of their receipt is used.",
    "too far": "{} readings of {} are farther than its grey values reach: no reading.",
}
"""Template of the note on each kind of problem; the number of images or readings and the camera's name are inserted."""

READERS: Final = (Reader(matches, open_source),)
