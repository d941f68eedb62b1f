"""Bags with depth images: ROS 1, ROS 2 (SQLite and MCAP), and the recordings of RealSense's and Orbbec's software."""

from __future__ import annotations

from pathlib import Path

from anchorpose.errors import InputError
from anchorpose.sources import mcap_file, orbbec_bags, realsense_bags, ros1_file, ros2_database, ros_streams
from anchorpose.sources.bag_file import ZSTD_MAGIC, BagFile, DamagedBag
from anchorpose.sources.bag_folder import BagFolder, files_of
from anchorpose.sources.bag_source import BagSource
from anchorpose.sources.depth_stream import RECORD_AGAIN


def matches(path: Path, head: bytes) -> bool:
    """See ``Reader``: a bag by its first bytes, a folder of ROS 2 by the bags in it."""
    if path.is_dir():
        return bool(files_of(path))
    database = head.startswith(ros2_database.MAGIC) and b"CREATE TABLE topics" in head
    return database or head.startswith((ros1_file.MAGIC, mcap_file.MAGIC))


def open_source(path: Path) -> BagSource:
    """See ``Reader``."""
    try:
        bag = _open_bag(path)
        for find in (realsense_bags.find_streams, orbbec_bags.find_streams, ros_streams.find_streams):
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


def _open_bag(path: Path) -> BagFile:
    if path.is_dir():
        return BagFolder([_open_file(file) for file in files_of(path)])
    return _open_file(path)


def _open_file(path: Path) -> BagFile:
    with path.open("rb") as file:
        head = file.read(16)
    if head.startswith(ros1_file.MAGIC):
        return ros1_file.Ros1File(path)
    if head.startswith(mcap_file.MAGIC):
        return mcap_file.McapFile(path)
    if head.startswith(ros2_database.MAGIC):
        return ros2_database.Ros2Database(path)
    if head.startswith(ZSTD_MAGIC):
        raise InputError(path, "it is packed as a whole", "unpack it first: zstd -d FILE")
    raise DamagedBag(f"{path.name} is no bag")
