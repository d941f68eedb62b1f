"""Make and convert damaged files of every format that ``convert`` reads, for ``fuzz.py``."""

from __future__ import annotations

import random
import shutil
import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "builders"))
import sources_builder

from anchorpose.errors import InputError
from anchorpose.options import ConvertOptions
from anchorpose.recording.reader import open_recording
from anchorpose.sources import convert as convert_module
from anchorpose.sources.convert import Converted, convert
from anchorpose.sources.source import open_source

PIECE: Final = 64  # bytes: half of all damage is in the first or last pieces of a file, with headers and indices
Make = Callable[[Path], None]


class Fault(Exception):
    """An outcome that damaged input must not have."""


def require(right: bool, otherwise: str) -> None:
    """Raise Fault with the text ``otherwise`` unless ``right``."""
    if not right:
        raise Fault(otherwise)


@dataclass
class Files:
    """Files of one recorder's format. whole: all images of the undamaged file, if it was only cut; otherwise None."""

    folder: Path
    name: str
    longest_s: int = 10
    most_bytes: int = 1 << 30
    whole: list[bytes] | None = None

    def __post_init__(self) -> None:
        convert_module.one_thread = nullcontext  # finding the libraries takes longer than such a small conversion
        self.good, self.bad, self.out = (self.folder / name for name in ("good", "bad", "out"))
        for leftover in (self.good, self.out):
            shutil.rmtree(leftover, ignore_errors=True)
        self.good.mkdir()
        readers()[self.name](self.good / "in")
        converted(self.good / "in", self.out)
        self.images = depth_images(self.out)

    def damage(self, number: int) -> str:
        for leftover in (self.bad, self.out):
            shutil.rmtree(leftover, ignore_errors=True)
        shutil.copytree(self.good, self.bad)
        chance = random.Random(f"{self.name} {number}")
        files = sorted(file for file in self.bad.rglob("*") if file.is_file())
        cuts = []
        for file in chance.sample(files, min(len(files), chance.choice([1, 1, 2]))):
            content, cut = damaged(file.read_bytes(), chance)
            file.write_bytes(content)
            cuts.append(cut)
        self.whole = self.images if all(cuts) else None
        return self.name

    def outcome(self) -> str:
        return file_outcome(self.bad / "in", self.out, self.whole)


def damaged(data: bytes, chance: random.Random) -> tuple[bytes, bool]:
    """Return the damaged bytes, and whether they were only cut."""
    content = bytearray(data)
    for _ in range(chance.choice([1, 1, 2, 5])):
        place, other, length = _place(content, chance), _place(content, chance), chance.choice([1, 4, 8, 40, 2000])
        match chance.randrange(7):
            case 0:
                return bytes(data[:place]), True
            case 1:
                for spot in [_place(content, chance) for _ in range(chance.choice([1, 8]))]:
                    content[spot] ^= 1 << chance.randrange(8)
            case 2:
                content[place : place + 4] = chance.choice([0, 1, 2**31 - 1, 2**32 - 1]).to_bytes(4, "little")
            case 3:
                content[place : place + length] = bytes(len(content[place : place + length]))
            case 4:
                content[place:place] = content[other : other + length]
            case 5:
                del content[place : place + length]
            case _:
                size = chance.choice([4, 8])
                here, there = content[place : place + size], content[other : other + size]
                content[place : place + size], content[other : other + size] = there, here
        content = content or bytearray(b"\0")
    return bytes(content), False


def _place(content: bytearray, chance: random.Random) -> int:
    near, length = min(len(content), PIECE * chance.choice([1, 8, 64])), len(content)
    return chance.choice([chance.randrange(near), length - 1 - chance.randrange(near), *2 * [chance.randrange(length)]])


def converted(path: Path, out: Path) -> Converted:
    """Convert a file, with options for the values that a damaged file may lack."""
    cameras = open_source(path).cameras
    options = ConvertOptions(
        intrinsics=sources_builder.LENS if any(camera.intrinsics is None for camera in cameras) else None,
        depth_scale=0.001 if any(camera.depth_scale is None for camera in cameras) else None,
        fps=30.0 if any(not camera.has_times for camera in cameras) else None,
    )
    return convert([path], out, options, lambda done, total: None)


def depth_images(recording: Path) -> list[bytes]:
    """Return the grey values of all images. The recording must open, or be refused only since its images are noise."""
    try:
        open_recording(recording)
    except InputError as error:
        require("measured nothing from first to last" in str(error), f"what was written is refused: {error}")
    files = sorted(recording.glob("*/depth/*.png"))
    return [cv2.imread(str(file), cv2.IMREAD_UNCHANGED).tobytes() for file in files]


def file_outcome(path: Path, out: Path, whole: list[bytes] | None) -> str:
    """Convert a file; return the outcome or raise Fault. whole: images before the damage, if the file was only cut."""
    try:
        done = converted(path, out)
    except InputError as error:
        require("\n" not in str(error) and str(path.parent) in str(error), f"no sentence that names the file: {error}")
        require(not out.exists(), "a refusal has left a folder")
        return "refused"
    found = depth_images(out)
    require(bool(found), "a recording without an image")
    require(not any("\n" in note for note in done.notes), "a note of several lines")
    require(whole is None or set(found) <= set(whole), "an image that was not recorded")
    return "read"


def readers() -> dict[str, Make]:
    """Return for each format, by name, the function that writes an undamaged file."""
    import azure_builder
    import bags_builder
    import scipy.io
    import vendor_bags_builder as vendor

    def built(build: Callable[[Path], Path]) -> Make:
        return lambda path: build(path.parent).rename(path)

    def images(write: Callable[[Path, np.ndarray], None]) -> Make:
        return lambda path: write(path, sources_builder.noise(3))

    def unpacked(path: Path, grey: np.ndarray) -> None:
        with path.open("wb") as file:
            scipy.io.savemat(file, {"depth": np.moveaxis(grey, 0, 2), "note": "x"})

    depth_m = np.random.default_rng(0).uniform(0.3, 4.0, (3, 16, 12)).astype(np.float32)
    return {
        "azure": lambda path: path.write_bytes(azure_builder.recording(2)),
        **{form: built(partial(bags_builder.depth_bag, form=form)) for form in bags_builder.FORMATS},
        "realsense": built(vendor.realsense_bag),
        "realsense-db3": built(vendor.realsense_database),
        "orbbec": built(vendor.orbbec_bag),
        "orbbec-2.3": built(partial(vendor.orbbec_bag, sdk="2.3")),
        "record3d": lambda path: sources_builder.r3d(path, depth_m),
        **{name: images(write) for name, write in sources_builder.FORMATS.items()},
        "mat-unpacked": images(unpacked),
    }
