"""Whatever happens to a recorder's file: it is read as far as it goes, or refused by its name and nothing written."""

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

FUZZED = dict.fromkeys([*FORMATS, "r3d", "ros1", "ros1-lz4", "ros1-bz2", "db3", "db3-zstd", "mcap", "mcap-zstd"], 40)
FUZZED |= {"mkv": 150}  # much of it is not its header


def write(name: str, path: Path) -> None:
    if name == "r3d":
        pytest.importorskip("lzfse")
        build.r3d(path, np.random.default_rng(0).uniform(0.3, 4.0, (3, 16, 12)).astype(np.float32))
    elif name == "mkv":
        azure = pytest.importorskip("azure_builder")
        slope = (1500 + np.add.outer(np.arange(288), np.arange(320))).astype(np.uint16)
        path.write_bytes(azure.mkv([slope + k for k in range(3)], azure.TIMES_US[:3], attached=azure.calibration()))
    elif name in FORMATS:
        FORMATS[name](path, noise(3))
    else:
        pytest.importorskip("bags_builder").rich_bag(path.parent, name).rename(path)


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
            near = chance.randrange(max(1, min(len(data), chance.choice([64, 4096, len(data) or 1]))))
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
    cameras = open_source(path).cameras
    lens = LENS if all(camera.intrinsics is None for camera in cameras) else None
    return ConvertOptions(intrinsics=lens, depth_scale=0.001, fps=None if cameras[0].has_times else 30.0)


def outcome(path: Path, out: Path) -> str:
    """What a damaged input is refused with; empty where it became a recording, which then opens and can be read."""
    try:
        convert([path], out, options_for(path), nothing)
    except InputError as error:
        return str(error)
    assert list(read_frames(open_recording(out)))
    return ""


@pytest.mark.parametrize("name", FUZZED)
def test_a_damaged_file_is_read_or_refused_in_one_sentence(tmp_path, name, capfd):
    (tmp_path / "good").mkdir()
    write(name, tmp_path / "good" / "in")
    chance, path, out, read = random.Random(name), tmp_path / "bad" / "in", tmp_path / "out", 0
    for _ in range(FUZZED[name]):
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
    assert capfd.readouterr() == ("", "")
