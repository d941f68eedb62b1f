"""Configuration files: what fits is taken as it is, what does not is refused by place."""

import json
from dataclasses import field, is_dataclass
from enum import Enum
from typing import Literal, get_type_hints

import pytest

from anchorpose.errors import InputError
from anchorpose.recording.document import load_config
from anchorpose.research.experiment.config import ExperimentConfig
from anchorpose.settings import Positive, settings
from anchorpose.tracker.config import TrackConfig


class Mode(Enum):
    FAST = "fast"
    EXACT = "exact"


@settings
class Inner:
    radius_m: Positive = 0.5
    count: int = 3
    mode: Mode = Mode.EXACT
    sensor: Literal["kinect", "realsense"] = "kinect"

    def __post_init__(self) -> None:
        if self.radius_m > self.count:
            raise ValueError(f"radius_m must not exceed count, got {self.radius_m}")


@settings
class Outer:
    inner: Inner = field(default_factory=Inner)
    place: tuple[float, float] | None = None
    names: tuple[str, ...] = ()
    strict: bool = False


@settings
class Demanding:
    height_m: float


def _load(tmp_path, text, kind=Outer, name="c.toml"):
    (tmp_path / name).write_text(text)
    return load_config(tmp_path / name, kind)


def test_toml_and_json_give_the_same(tmp_path):
    text = 'place = [1, 2.5]\nnames = ["a", "b"]\nstrict = true\n[inner]\nradius_m = 1\nmode = "fast"\n'
    document = {"place": [1, 2.5], "names": ["a", "b"], "strict": True, "inner": {"radius_m": 1, "mode": "fast"}}
    wanted = Outer(inner=Inner(radius_m=1.0, mode=Mode.FAST), place=(1.0, 2.5), names=("a", "b"), strict=True)
    assert _load(tmp_path, text) == wanted
    assert _load(tmp_path, json.dumps(document), name="c.json") == wanted
    assert isinstance(_load(tmp_path, text).inner.radius_m, float)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[inner]\nradius = 1", "unknown key 'inner.radius'; did you mean 'radius_m'"),
        ("[iner]\n", "did you mean 'inner'"),
        ("zzz = 1", "remove it, known keys are inner, names, place, strict"),
        ('[inner]\nradius_m = "wide"', 'inner.radius_m is "wide"; it must be a number'),
        ("[inner]\nradius_m = nan", "inner.radius_m is NaN; it must be a finite number"),
        ("[inner]\nradius_m = true", "inner.radius_m is true"),
        ("[inner]\ncount = 3.0", "inner.count is 3.0; it must be a whole number"),
        ("[inner]\nradius_m = -1", "inner.radius_m is -1; it must be at least 0.000001"),
        ("[inner]\nradius_m = 9", "inner is refused: radius_m must not exceed count, got 9"),
        ('[inner]\nmode = "slow"', "it must be 'fast' or 'exact'"),
        ('[inner]\nsensor = "lidar"', "it must be 'kinect' or 'realsense'"),
        ("strict = 1", "strict is 1; it must be true or false"),
        ("place = [1]", "the key 'place[1]' is missing"),
        ("place = [1, inf]", "place[1] is Infinity"),
        ("names = [1]", "names[0] is 1"),
        ("inner = 3", "inner is 3; it must be an object or a table"),
        ("inner = ", "is not TOML"),
        ("[inner]\ncount = 1" + "0" * 400, "64 bits"),
        ("inner = " + "[" * 100_000, "is not TOML"),
        ('names = ["a\\u0000b"]', "no meaning"),
    ],
)
def test_what_does_not_fit_is_refused_by_place(tmp_path, text, sentence):
    with pytest.raises(InputError) as refusal:
        _load(tmp_path, text)
    assert str(refusal.value).startswith(str(tmp_path / "c.toml"))
    assert sentence in str(refusal.value)


def test_a_missing_setting_a_missing_file_and_an_unknown_kind_are_refused(tmp_path):
    with pytest.raises(InputError, match="'height_m' is missing"):
        _load(tmp_path, "", Demanding)
    for name in ("none.toml", "none.json", "none.yaml"):
        with pytest.raises(InputError, match=name):
            load_config(tmp_path / name, Outer)


@pytest.mark.parametrize("text", ["a = " + "[" * 5000 + "]" * 5000, "a = " + "9" * 5000, "start = " + "9" * 400])
def test_a_file_beyond_all_limits_is_one_sentence(tmp_path, text):
    with pytest.raises(InputError) as refusal:
        _load(tmp_path, text)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 400


@pytest.mark.parametrize("kind", [TrackConfig, ExperimentConfig])
def test_every_class_of_settings_refuses_unknown_names(kind):
    for one in (kind, *(hint for hint in get_type_hints(kind).values() if is_dataclass(hint))):
        assert one.__pydantic_config__["extra"] == "forbid", one
