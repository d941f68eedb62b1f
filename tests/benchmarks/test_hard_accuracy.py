"""The table of the hard scenes: how scenes add up, and a recording of several cameras as one of them made it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from hard_accuracy import COLUMNS, Row, front_alone, table, totals

NAN = float("nan")
ROWS = (
    Row("short", (10.0, 40.0, 0.0, 0.1, 0.9, 1.0), (100, 10)),
    Row("long", (20.0, NAN, 1.0, 0.7, 0.95, NAN), (300, 0)),
)


def test_scenes_count_by_their_joints_and_the_longest_time_is_the_longest():
    found = totals(ROWS)
    assert found == pytest.approx((17.5, 40.0, 0.75, 0.7, (90 * 0.9 + 300 * 0.95) / 390, 1.0))


def test_what_no_scene_has_is_not_made_up():
    assert np.isnan(totals(ROWS[1:])[1])
    assert "| 20.0 | – | 1.00 | 0.70 | 0.95 | – |" in table(ROWS[1:])
    assert len(table(ROWS).splitlines()) == 2 + len(ROWS) + 1
    assert all(column in table(ROWS) for column in COLUMNS)


def test_the_front_camera_alone_has_its_images_and_the_equipment(tmp_path):
    recording = tmp_path / "recording"
    for name in ("front", "left"):
        (recording / name).mkdir(parents=True)
    (recording / "front" / "image").write_text("depth")
    (recording / "equipment.json").write_text("{}")
    (recording / "recording.json").write_text(
        json.dumps({"cameras": [{"name": "front"}, {"name": "left"}], "rate": 15})
    )
    alone = front_alone(recording, tmp_path / "alone")
    assert json.loads((alone / "recording.json").read_text()) == {"cameras": [{"name": "front"}], "rate": 15}
    assert (alone / "front" / "image").read_text() == "depth"
    assert (alone / "equipment.json").exists()
    assert not (alone / "left").exists()
    assert front_alone(recording, tmp_path / "alone") == alone
