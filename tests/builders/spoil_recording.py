"""One way to spoil a recording folder per number: the same number does the same.

Nothing outside of the folder is ever written to: files are looked for without following links.
"""

import json
import os
import random
import shutil
import stat
import struct
import zlib
from collections.abc import Callable
from fnmatch import fnmatch
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from recording_builder import HEIGHT, WIDTH, camera_entry

NUMERIC = (None, True, 0, -1, 1, 2**31, 2**63, 10**400, 1e-300, -1e-12, 1e308, -1e308, float("nan"), float("inf"))
TEXTS = ("", "x" * 5000, "a\0b", "\ud800", "../front", "/etc/passwd", "C:\\x", "front/../../x", "a\nb", ".")
EXTREME: tuple[Any, ...] = (*NUMERIC, *TEXTS, [], {}, [[]], [1e308] * 5, [[1e308] * 4] * 4)
NUMBERS = ("0", "-0", "1e308", "-1e308", "1e-12", "nan", "inf", "-inf", "1e999", "9" * 400, "0x10", "", " ", "١", "1_0")
MOST_FRAMES = 1 << 12
LARGEST_BYTES = 1 << 24


def spoil(folder: Path, number: int) -> str:
    """Spoils a copy of a recording in one to three ways; says in which."""
    chance = random.Random(number)
    done = []
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        way = chance.choice(WAYS)
        done.append(way.__name__)
        way(folder, chance)
    return ", ".join(done)


def own_files(folder: Path) -> list[Path]:
    """Files that are in the folder itself: never what a link leads to, which is not ours to spoil."""
    found = [Path(place) / name for place, _, names in os.walk(folder, followlinks=False) for name in names]
    return sorted(path for path in found if is_own(path))


def is_own(path: Path) -> bool:
    """Whether this is a regular file, not a link to one, and of an ordinary size; its folder is no link either."""
    status = path.lstat() if os.path.lexists(path) else None
    return status is not None and stat.S_ISREG(status.st_mode) and status.st_size < LARGEST_BYTES


def _any_file(folder: Path, chance: random.Random, pattern: str = "*") -> Path | None:
    files = [path for path in own_files(folder) if fnmatch(path.relative_to(folder).as_posix(), pattern)]
    return chance.choice(files) if files else None


def damaged_bytes(folder: Path, chance: random.Random) -> None:
    """Flipped bits, a cut, zeros, a piece doubled or taken out."""
    path = _any_file(folder, chance)
    if path is None:
        return
    content = bytearray(path.read_bytes()) or bytearray(b"\0")
    place, length = chance.randrange(len(content)), chance.choice([1, 4, 40, 2000])
    match chance.randrange(5):
        case 0:
            del content[place:]
        case 1:
            for _ in range(chance.choice([1, 8])):
                content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
        case 2:
            content[place : place + length] = bytes(length)
        case 3:
            content[place:place] = content[: chance.choice([1, 100, 5000])]
        case _:
            del content[place : place + length]
    path.write_bytes(content)


def extreme_value(folder: Path, chance: random.Random) -> None:
    """Any value in any place of a JSON document, a key twice, foreign, or missing."""
    path = _any_file(folder, chance, "*.json")
    document = None if path is None else _document(path)
    if path is None or document is None:
        return
    owner, key = chance.choice(_places(document))
    kind = chance.randrange(8)
    if kind == 0 and isinstance(owner, dict):
        del owner[key]
    elif kind == 1 and isinstance(owner, dict):
        owner[chance.choice(["", "fx ", "Camera", "x" * 3000, "\0"])] = chance.choice(EXTREME)
    elif kind == 2 and isinstance(owner, list):
        owner *= _often_few(chance)
    else:
        owner[key] = chance.choice(EXTREME)
    text = json.dumps(document)
    if kind == 3:
        text = text.replace("{", '{"format": "rgbd-recording", ', 1)
    if kind == 4:
        text = text.replace("1", chance.choice(["[" * 3000, "1" * 500, '{"a":' * 200 + "1" + "}" * 200]), 1)
    path.write_text(text, encoding="utf-8", errors="surrogatepass")


def _often_few(chance: random.Random) -> int:
    """Seldom thousands: such a case takes a hundred times as long as another."""
    return 3000 if chance.random() < 0.02 else chance.choice([1, 2, 17, 50])


def _document(path: Path) -> Any:
    try:
        found = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) and found else None


def _places(value: Any) -> list[tuple[Any, Any]]:
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [pair for key, child in list(children) for pair in ((value, key), *_places(child))]


def other_kind_of_file(folder: Path, chance: random.Random) -> None:
    """A pipe, a device, a folder or a link in place of a file or a folder."""
    walked = os.walk(folder, followlinks=False)
    paths = sorted(Path(place) / name for place, folders, files in walked for name in (*folders, *files))
    if not paths:
        return
    path = chance.choice(paths)
    shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
    match chance.randrange(7):
        case 0:
            os.mkfifo(path)
        case 1:
            path.mkdir()
        case 2:
            path.symlink_to(chance.choice(["/dev/zero", "/dev/null", "/dev/full", "/proc/self/mem"]))
        case 3:
            path.symlink_to(chance.choice(["nowhere", path.name, ".."]))
        case 4:
            path.touch()
        case 5:
            with path.open("wb") as file:
                file.truncate(chance.choice([1 << 33, 1 << 40]))  # sparse
        case _:
            pass


def odd_times(folder: Path, chance: random.Random) -> None:
    """Times of another unit, epoch or order, no numbers, more rows or fewer."""
    path = _any_file(folder, chance, "*/timestamps.csv")
    if path is None:
        return
    rows = [line.split(",") for line in path.read_text("utf-8", "replace").splitlines()[1:]]
    times, epoch = 10.0 ** chance.randrange(-14, 12), chance.choice([0.0, 1.7e9, -1e308, 1.7e18])
    match chance.randrange(5):
        case 0:
            rows = [[str(k), repr(epoch + 0.1 * times * k)] for k in range(len(rows))]
        case 1 if rows:
            chance.choice(rows)[-1] = chance.choice(NUMBERS)
        case 2 if rows:
            chance.choice(rows)[0] = chance.choice(NUMBERS)
        case 3:
            chance.shuffle(rows)
        case _:
            rows = (rows * chance.choice([0, 2, MOST_FRAMES]))[: 2 * MOST_FRAMES]
    path.write_text("\n".join(["frame,time_s", *(",".join(row) for row in rows)]), encoding="utf-8")


def odd_image(folder: Path, chance: random.Random) -> None:
    """An image of another size or kind, one that holds no measurement, or a header that lies."""
    path = _any_file(folder, chance, "*/*.png")
    if path is None:
        return
    noise = np.random.default_rng(chance.randrange(1000)).integers(0, 65536, (HEIGHT, WIDTH)).astype(np.uint16)
    kinds = (noise, 0 * noise, 0 * noise + 65535, noise.astype(np.uint8), np.stack([noise] * 3, axis=2), noise[:3])
    data = cv2.imencode(".png", chance.choice(kinds))[1].tobytes()
    if chance.random() < 0.5:
        header = bytearray(data[16:29])
        header[chance.randrange(13)] = chance.choice([0, 1, 3, 16, 127, 255])
        data = data[:16] + header + struct.pack(">I", zlib.crc32(data[12:16] + header)) + data[33:]
    if chance.random() < 0.2:
        name = chance.choice([b"acTL", b"NEED", b"tRNS", b"IHDR", b"PLTE"])
        content = bytes(chance.choice([0, 2, 8, 1000]))
        chunk = struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
        data = data[:33] + chunk + data[33:]
    path.write_bytes(data)


def bomb(folder: Path, chance: random.Random) -> None:
    """An image that is much larger when it is decompressed than its header says, or than its file."""
    path = _any_file(folder, chance, "*/*.png")
    if path is None:
        return
    size = chance.choice([(WIDTH, HEIGHT), (16384, 16384), (2**31 - 1, 2**31 - 1), (1, 2**31 - 1)])
    content = _zeros_packed(1 << chance.choice([16, 22]))
    header = struct.pack(">IIBBBBB", *size, 16, 0, 0, 0, chance.choice([0, 1]))
    chunks = [(b"IHDR", header), (b"IDAT", content), (b"IEND", b"")]
    packed = (struct.pack(">I", len(c)) + n + c + struct.pack(">I", zlib.crc32(n + c)) for n, c in chunks)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(packed))


@cache
def _zeros_packed(size: int) -> bytes:
    return zlib.compress(bytes(size), 1)


def many_cameras(folder: Path, chance: random.Random) -> None:
    """Up to thousands of cameras, most without a folder, some of huge images."""
    path = folder / "recording.json"
    document = _document(path) if is_own(path) else None
    if document is None:
        return
    names = [f"c{k}" for k in range(_often_few(chance))]
    known = document.get("cameras")
    document["cameras"] = [*chance.choice([known if isinstance(known, list) else [], []]), *map(camera_entry, names)]
    if chance.random() < 0.3:
        document["cameras"][0] = {**camera_entry("front"), "width": 16384, "height": 16384}
    path.write_text(json.dumps(document))


def lying_mesh(folder: Path, chance: random.Random) -> None:
    """Equipment with a mesh whose header lies."""
    count = chance.choice([3, -1, 10**6, 10**12, 2**63, 10**30])
    kind = chance.choice(["ascii", "binary_little_endian", "binary_big_endian", "x"])
    head = f"ply\nformat {kind} 1.0\nelement vertex {count}\n"
    head += "".join(f"property {chance.choice(['float', 'double', 'list uchar int', 'x'])} {axis}\n" for axis in "xyz")
    head += f"element face {chance.choice([1, 10**9])}\nproperty list uchar int vertex_indices\nend_header\n"
    body = chance.choice([b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", bytes(60), b"3 " * 200_000, b"nan inf 1e308\n" * 3])
    mesh, path = folder / "seat.ply", folder / "equipment.json"
    part = {"name": "seat", "shape": "mesh", "file": mesh.name}
    if is_own(path) and (is_own(mesh) or not os.path.lexists(mesh)):
        mesh.write_bytes(head.encode() + body)
        path.write_text(json.dumps({"format": "equipment-model", "version": 1, "parts": [part]}))


WAYS: tuple[Callable[[Path, random.Random], None], ...] = (damaged_bytes, extreme_value, extreme_value)
WAYS += (other_kind_of_file, odd_times, odd_image, bomb, many_cameras, lying_mesh)
