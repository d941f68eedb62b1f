"""A C3D whose frames we write is the file that ezc3d writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anchorpose.exports import c3d_frames
from anchorpose.exports.c3d_frames import frame_numbers, replace_frames

ezc3d = pytest.importorskip("ezc3d")

POINTS, CHANNELS, FRAMES = 3, 2, 64  # of 56 bytes: they fill whole blocks


def random_frames() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (n, p, 3), residuals (n, p) and channels (n, c); some points are missing."""
    rng = np.random.default_rng(5)
    places = rng.normal(scale=1e3, size=(FRAMES, POINTS, 3))
    residual = np.ceil(rng.uniform(0.0, 255.0, (FRAMES, POINTS)))
    missing = rng.random((FRAMES, POINTS)) < 0.3
    places[missing], residual[missing] = np.nan, -1.0
    return places, residual, rng.normal(size=(FRAMES, CHANNELS))


def described_file() -> Any:
    """Without frames; another group has a parameter FRAMES, and a locked one stands before POINT:FRAMES."""
    file = ezc3d.c3d()
    file.add_parameter("ANCHORPOSE", "FRAMES", [7])
    for group, names in (("POINT", "p" * POINTS), ("ANALOG", "c" * CHANNELS)):
        file["parameters"][group]["RATE"]["value"] = [30.0]
        file["parameters"][group]["LABELS"]["value"] = [f"{name}{k} FRAMES" for k, name in enumerate(names)]
    file["parameters"]["POINT"]["USED"]["is_locked"] = True
    return file


def write_by_ezc3d(path: Path, count: int) -> bytes:
    file, (places, residual, channels) = described_file(), (some[:count] for some in random_frames())
    points = np.ones((4, POINTS, count))
    points[:3] = places.transpose(2, 1, 0)
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = residual.T[None]
    file["data"]["analogs"] = channels.T[None]
    file.write(str(path))
    return path.read_bytes()


def write_empty(path: Path, points: int = POINTS) -> Path:
    """With one frame of zeros."""
    file = described_file()
    file["parameters"]["POINT"]["LABELS"]["value"] = file["parameters"]["POINT"]["LABELS"]["value"][:points]
    file["data"]["points"], file["data"]["analogs"] = np.zeros((4, points, 1)), np.zeros((1, CHANNELS, 1))
    file.write(str(path))
    return path


@pytest.mark.parametrize("ends", [(1,), (50,), (20, 50), (1, 2, FRAMES)])
def test_the_file_is_byte_for_byte_that_of_ezc3d(tmp_path, ends):
    numbers = frame_numbers(*random_frames())[: ends[-1]]
    replace_frames(write_empty(tmp_path / "ours.c3d"), np.split(numbers, ends[:-1]))
    assert (tmp_path / "ours.c3d").read_bytes() == write_by_ezc3d(tmp_path / "theirs.c3d", ends[-1])


def test_frames_of_other_points_do_not_fit(tmp_path):
    with pytest.raises(ValueError, match=r"64 frames of 14 numbers do not fit into two\.c3d"):
        replace_frames(write_empty(tmp_path / "two.c3d", points=2), [frame_numbers(*random_frames())])


def test_no_file_has_more_frames_than_the_format_counts(tmp_path, monkeypatch):
    monkeypatch.setattr(c3d_frames, "LARGEST_FRAMES", FRAMES - 1)
    with pytest.raises(ValueError, match="64 frames of 14 numbers do not fit"):
        replace_frames(write_empty(tmp_path / "a.c3d"), [frame_numbers(*random_frames())])
