"""Things that the learnt descriptor may take for people: no body explains them; a mannequin is a person in shape."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks" / "probes"))

from not_people import DISTANCES_M, THINGS, take

from anchorpose.simulate.config import single

pytest.importorskip("onnxruntime", reason="the learnt descriptor needs onnxruntime")

IN_SHAPE = ("mannequin", "person of cardboard")  # depth of one image shows a person


@pytest.mark.parametrize("name", [name for name in THINGS if name not in IN_SHAPE])
def test_no_body_explains_a_thing(name: str) -> None:
    for distance_m in DISTANCES_M:
        assert not take(name, single(902), distance_m).human


def test_a_mannequin_is_taken_for_a_person() -> None:
    taken = take("mannequin", single(902), 2.5)
    assert taken.found
    assert taken.human
