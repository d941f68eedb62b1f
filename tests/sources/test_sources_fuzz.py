"""Whatever happens to a recorder's file: it is read as far as it goes, or refused by its name and nothing written."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

import numpy as np
import pytest
import sources_builder as build
from sources_builder import FORMATS, LENS, noise, nothing

from anchorpose.errors import InputError
from anchorpose.options import ConvertOptions
from anchorpose.recording.reader import open_recording, read_frames
from anchorpose.sources.convert import convert
from anchorpose.sources.source import open_source

CASES = 40  # of each format

FUZZED = [*FORMATS, "r3d"]


def write(name: str, path: Path) -> None:
    if name == "r3d":
        pytest.importorskip("lzfse")
        build.r3d(path, np.random.default_rng(0).uniform(0.3, 4.0, (3, 16, 12)).astype(np.float32))
    else:
        FORMATS[name](path, noise(3))


def damage(data: bytes, chance: random.Random) -> bytes:
    """Truncated, empty, bytes flipped, a piece doubled, a piece replaced."""
    kind, place = chance.randrange(6), chance.randrange(max(1, len(data)))
    if kind == 0:
        return data[:place]
    if kind == 1:
        return b""
    if kind in (2, 3):
        changed = bytearray(data)
        for _ in range(chance.choice([1, 3, 30])):
            near = chance.randrange(max(1, min(len(data), chance.choice([64, len(data) or 1]))))
            if data:
                changed[near] = chance.randrange(256)
        return bytes(changed)
    if kind == 4:
        return data[:place] + data[place // 2 :]
    return (
        data[:place] + chance.choice([b"\0" * 50, b"9" * 400, b"nan", b"-1e999", b"[" * 2000, b"\xff\n"]) + data[place:]
    )


def options_for(path: Path) -> ConvertOptions:
    """What the damaged file still lacks; raises InputError where it cannot be opened."""
    (camera,) = open_source(path).cameras
    return ConvertOptions(
        intrinsics=LENS if camera.intrinsics is None else None,
        depth_scale=0.001,
        fps=None if camera.has_times else 30.0,
    )


def outcome(path: Path, out: Path) -> str:
    """What a damaged input is refused with; empty where it became a recording, which then opens and can be read."""
    try:
        convert([path], out, options_for(path), nothing)
    except InputError as error:
        return str(error)
    assert list(read_frames(open_recording(out)))
    return ""


@pytest.mark.parametrize("name", FUZZED)
def test_a_damaged_file_is_read_or_refused_in_one_sentence(tmp_path, name):
    (tmp_path / "good").mkdir()
    write(name, tmp_path / "good" / "in")
    chance, path, out, read = random.Random(name), tmp_path / "bad" / "in", tmp_path / "out", 0
    for _ in range(CASES):
        shutil.rmtree(tmp_path / "bad", ignore_errors=True)
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(tmp_path / "good", tmp_path / "bad")
        files = sorted(file for file in (tmp_path / "bad").rglob("*") if file.is_file())
        for file in chance.sample(files, min(len(files), chance.choice([1, 1, 2]))):
            file.write_bytes(damage(file.read_bytes(), chance))
        refusal = outcome(path, out)
        assert "\n" not in refusal
        assert out.exists() == (refusal == "")
        assert refusal == "" or str(tmp_path / "bad") in refusal
        read += refusal == ""
    assert read > 0 or name == "mat"  # a compressed array is damaged everywhere
