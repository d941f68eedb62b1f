"""Damaged files of every format that `anchorpose convert` reads: what becomes of each.

    .venv/bin/python benchmarks/fuzz_readers.py [--files 10000] [--reader NAME...] [--first NUMBER] [--state FOLDER]

Each file is damaged in its own way (flipped bits, cut, zeroed, a piece doubled or taken out, lengths exchanged) and
converted.
Counted are recordings, refusals in one sentence, and faults, each with the number of its file, which --first repeats:
another error, a crash of native code, more than 10 s of the processor or 1 GB for one file, a folder left half-written,
an image written that cannot be read or, from a file that was only cut, one that was not recorded. With --state, a run
that was stopped goes on where it ended, and counts add up.
"""

from __future__ import annotations

import argparse
import random
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "builders"))
import azure_builder
import bags_builder
import sources_builder
import vendor_bags_builder
from fuzz_recordings import SAVED_EVERY, State, describe, limit_time, load_state, name_place_of_death, run_apart

from anchorpose.errors import InputError
from anchorpose.recording.reader import open_recording
from anchorpose.sources import convert as convert_module
from anchorpose.sources.convert import Converted, convert
from anchorpose.sources.plan import ConvertOptions
from anchorpose.sources.source import open_source

LONGEST_S, MOST_BYTES = 10, 1 << 30
PIECE = 64  # bytes: half of all damage is in the first or last pieces of a file, where headers and indices are


def azure(path: Path) -> None:
    path.write_bytes(azure_builder.recording(2))


def bag(form: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        bags_builder.depth_bag(path.parent, form).rename(path)

    return write


def vendor(build: Callable[[Path], Path]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        build(path.parent).rename(path)

    return write


def record3d(path: Path) -> None:
    sources_builder.r3d(path, np.random.default_rng(0).uniform(0.3, 4.0, (3, 16, 12)).astype(np.float32))


def images(write: Callable[[Path, np.ndarray], None]) -> Callable[[Path], None]:
    return lambda path: write(path, sources_builder.noise(3))


READERS: dict[str, Callable[[Path], None]] = {
    "azure": azure,
    **{form: bag(form) for form in bags_builder.FORMATS},
    "realsense": vendor(vendor_bags_builder.realsense_bag),
    "realsense-db3": vendor(vendor_bags_builder.realsense_database),
    "orbbec": vendor(vendor_bags_builder.orbbec_bag),
    "orbbec-2.3": vendor(partial(vendor_bags_builder.orbbec_bag, sdk="2.3")),
    "record3d": record3d,
    **{name: images(write) for name, write in sources_builder.FORMATS.items()},
}


def damage(data: bytes, chance: random.Random) -> tuple[bytes, bool]:
    """The damaged bytes, and whether they were only cut."""
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
    near = min(len(content), PIECE * chance.choice([1, 8, 64]))
    return chance.choice(
        [chance.randrange(near), len(content) - 1 - chance.randrange(near)] + 2 * [_any(content, chance)]
    )


def _any(content: bytearray, chance: random.Random) -> int:
    return chance.randrange(len(content))


def damaged_copy(good: Path, bad: Path, chance: random.Random) -> bool:
    """Whether its files were only cut."""
    shutil.copytree(good, bad)
    files = sorted(file for file in bad.rglob("*") if file.is_file())
    cuts = []
    for file in chance.sample(files, min(len(files), chance.choice([1, 1, 2]))):
        content, cut = damage(file.read_bytes(), chance)
        file.write_bytes(content)
        cuts.append(cut)
    return all(cuts)


def converted(path: Path, out: Path) -> Converted:
    """With what the damaged file still lacks."""
    cameras = open_source(path).cameras
    options = ConvertOptions(
        intrinsics=sources_builder.LENS if any(camera.intrinsics is None for camera in cameras) else None,
        depth_scale=0.001 if any(camera.depth_scale is None for camera in cameras) else None,
        fps=30.0 if any(not camera.has_times for camera in cameras) else None,
    )
    return convert([path], out, options, lambda done, total: None)


def depth_images(recording: Path) -> list[bytes]:
    """The grey values of all images of a recording that opens, or is refused only since its images are noise."""
    try:
        open_recording(recording)
    except InputError as error:
        require("measured nothing from first to last" in str(error), f"what was written is refused: {error}")
    files = sorted(recording.glob("*/depth/*.png"))
    return [cv2.imread(str(file), cv2.IMREAD_UNCHANGED).tobytes() for file in files]


def outcome(path: Path, out: Path, whole: list[bytes] | None) -> str:
    """ "read" or "refused"; raises Fault where neither is right. whole: all images, of a file that was only cut."""
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


class Fault(Exception):
    """What a conversion must not do."""


def require(right: bool, otherwise: str) -> None:
    if not right:
        raise Fault(otherwise)


def run_reader(name: str, stop: int, folder: Path, path: Path) -> None:
    """Files up to ``stop`` in this process; path: where the state is kept."""
    convert_module.one_thread = nullcontext  # to find the libraries takes longer than so small a conversion
    state, good, bad, out = load_state(path), folder / "good", folder / "bad" / "in", folder / "out"
    shutil.rmtree(good, ignore_errors=True)
    shutil.rmtree(out, ignore_errors=True)
    good.mkdir()
    READERS[name](good / "in")
    converted(good / "in", out)
    whole = depth_images(out)
    limit = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + MOST_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    while state.next < stop:
        (folder / "number").write_text(f"{state.next} {name}")
        shutil.rmtree(bad.parent, ignore_errors=True)
        shutil.rmtree(out, ignore_errors=True)
        cut = damaged_copy(good, bad.parent, random.Random(f"{name} {state.next}"))
        start = time.process_time()
        limit_time(LONGEST_S)
        try:
            state.count(outcome(bad, out, whole if cut else None))
        except Exception as error:
            state.fault(name, error)
        limit_time(0)
        state.end_case(time.process_time() - start)
        if state.next % SAVED_EVERY == 0:
            state.save(path)
    state.save(path)


def main() -> None:
    """Each reader in a process of its own, so that a crash of one is seen and named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", type=int, default=10000)
    parser.add_argument("--reader", nargs="*", choices=READERS, default=list(READERS))
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--state", type=Path)
    parser.add_argument("--here", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.here is not None:
        name_place_of_death()
        run_reader(given.reader[0], given.first + given.files, given.here, given.state)
        return
    faults = 0
    with tempfile.TemporaryDirectory() as folder:
        states = given.state or Path(folder)
        states.mkdir(exist_ok=True)
        for name in given.reader:
            path, stop = states / f"{name}.json", given.first + given.files
            if not path.exists():
                State(next=given.first).save(path)
            state = run_apart([__file__, "--files", str(stop), "--reader", name], path, stop)
            print(f"{name}: {describe(state)}", flush=True)
            faults += len(state.faults)
    sys.exit(faults > 0)


if __name__ == "__main__":
    main()
