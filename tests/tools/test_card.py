"""The model card of the learnt descriptor: what is known of drawn people, and figures of a group."""

import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("onnxruntime", reason="the learnt descriptor needs onnxruntime")
torch = pytest.importorskip("torch", reason="only those who train need PyTorch")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools" / "descriptor"))

import card  # noqa: E402
import card_tables  # noqa: E402
from scenes import MOST_PEOPLE, Scenes  # noqa: E402


def test_what_is_known_fits_the_people_that_were_drawn() -> None:
    scenes = Scenes(torch.device("cpu"), 5)
    drawn = scenes.scene(8)
    known = card.known_of(scenes, drawn)
    there = known["there"]
    assert there.sum() == len(drawn.kept)
    assert known["stature_m"][there & known["child"]].max() < known["stature_m"][there & ~known["child"]].mean()
    assert 0.0 < known["seen"][there].max() <= 1.0
    assert not known["seen"][~there].any()
    pixels = [(drawn.person[:, ::2, ::2] == person).sum(dim=(1, 2)).numpy() for person in range(MOST_PEOPLE)]
    assert ((known["seen"] > 0) == (np.stack(pixels, axis=1) > 0)).all()


def test_the_same_seed_gives_the_same_figures_and_no_batch_is_drawn_twice() -> None:
    once, again = (card.measure(1, first_seed=7) for _ in range(2))
    assert card_tables.card(once) == card_tables.card(again)
    assert len(once.images["things"]) == card.SCENES * card.LOOKS


def test_figures_of_a_group_are_of_its_own_people() -> None:
    people = {
        "area_m2": np.array([1.0, 1.0, 0.01]),
        "person_found": np.array([True, False, False]),
        "image": np.array([0, 0, 1]),
    }
    pixels = {
        "person": np.array([0, 0, 1, 2]),
        "found": np.array([True, False, True, True]),
        "error_cm": np.array([30.0, np.nan, 4.0, 8.0]),
        "expected_cm": np.array([5.0, np.nan, 50.0, 5.0]),
        "crossed": np.array([1.0, np.nan, np.nan, 0.0]),
        "vote_cm": np.array([10.0, np.nan, 20.0, 30.0]),
    }
    images = {"others": np.array([[100], [100]]), "wrong": np.array([[1], [9]]), "things": np.zeros(2)}
    measured = card.Measured(images, people, pixels)
    first = list(card_tables._group(measured, np.array([True, False, False])))
    assert first == ["1", "100.0", "50.0", "1.0", "30.0", "100.0", "100.0", "10.0"]
    everybody = list(card_tables._group(measured, np.ones(3, dtype=bool)))
    assert everybody == ["3", "50.0", "75.0", "5.0", "8.0", "50.0", "50.0", "20.0"]
