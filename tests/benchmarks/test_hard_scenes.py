"""The hard scenes: the held-out ones have subjects, movements and equipment that those for tuning lack."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from hard_scenes import HELD_OUT_EQUIPMENT, HELD_OUT_MOVEMENTS, hard_scenes, main

from anchorpose.simulate.clinic import draw_clinic

NOWHERE = Path("skeletons.npz")
MOVEMENTS = Path(__file__).resolve().parents[3] / "shared" / "data" / "uiprmd_kinect" / "skeletons.npz"


def test_there_are_24_of_each_kind_with_names_and_seeds_of_their_own():
    tuning, held_out = hard_scenes("tuning", NOWHERE), hard_scenes("held-out", NOWHERE)
    assert len(tuning) == len(held_out) == 24
    assert not set(tuning) & set(held_out)
    assert all(config.seed == seed for scenes in (tuning, held_out) for (_, seed), config in scenes.items())
    assert len({config.seed for config in (*tuning.values(), *held_out.values())}) == 48


def test_nothing_for_tuning_shows_what_is_held_out():
    tuning, held_out = (tuple(hard_scenes(use, NOWHERE).values()) for use in ("tuning", "held-out"))
    assert not {s for config in tuning for s in config.subjects} & {s for config in held_out for s in config.subjects}
    assert not {config.movement for config in tuning} & set(HELD_OUT_MOVEMENTS)
    assert HELD_OUT_EQUIPMENT not in {config.equipment for config in tuning}
    assert {config.movement for config in held_out} >= set(HELD_OUT_MOVEMENTS)
    assert HELD_OUT_EQUIPMENT in {config.equipment for config in held_out}


def test_both_kinds_have_the_scene_that_tracking_once_failed_on():
    for use in ("tuning", "held-out"):
        bars = [
            config for (name, _), config in hard_scenes(use, NOWHERE).items() if name == "parallel-bars-sit-to-stand"
        ]
        assert len(bars) >= 2
        assert all(config.chest_pad and config.passers_by and config.therapists_stay for config in bars)
        assert all(config.therapist_tasks == ("trunk from behind", "both knees from the front") for config in bars)


def test_without_the_movements_it_ends_in_one_sentence(tmp_path):
    with pytest.raises(SystemExit, match=r"^There is no file .* without\.$"):
        main(["--movements", str(tmp_path / "none.npz")])


@pytest.mark.parametrize("name", [("standing-frame-sit-to-stand", 41_011), ("sling-sit-to-stand", 42_009)])
def test_a_stool_is_as_high_as_the_thighs_whatever_the_heels_do(name):
    if not MOVEMENTS.is_file():
        pytest.skip(f"{MOVEMENTS} is not there")
    use = "tuning" if name[1] < 42_000 else "held-out"
    clinic = draw_clinic(hard_scenes(use, MOVEMENTS)[name])
    (seat,) = [part for part in clinic.equipment.parts if part.name == "seat"]
    assert 0.3 < seat.center_m[1] < 0.55
