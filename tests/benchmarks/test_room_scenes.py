"""The rooms by name: forty for tuning, forty others that are held out."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from room_scenes import main, room_scenes


def test_no_room_is_for_both_uses():
    tuning, held_out = room_scenes("tuning"), room_scenes("held-out")
    assert len(tuning) == len(held_out) == 40
    assert [config.seed for config in tuning.values()] == list(range(51_000, 51_040))
    assert [config.seed for config in held_out.values()] == list(range(52_000, 52_040))
    assert not set(tuning) & set(held_out)


def test_a_room_is_listed_and_written(tmp_path, capsys):
    main(["--seeds", "1", "--seconds", "0.4", "--fps", "5", "--out", str(tmp_path)])
    assert capsys.readouterr().out.startswith("room-51000 ")
    assert (tmp_path / "room-51000/recording/recording.json").is_file()
    assert (tmp_path / "room-51000/truth/truth.npz").is_file()


def test_more_rooms_than_there_are_is_refused():
    with pytest.raises(SystemExit, match="1 to 40"):
        main(["--seeds", "41"])
