"""Every number of a JSON document that a user or another program writes has a range within which nothing overflows."""

from collections.abc import Iterator
from importlib import import_module
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import pytest
from pydantic import TypeAdapter, ValidationError

from anchorpose.recording.document import Entry
from anchorpose.results.corrections import JointCorrection, NamedPatient, UnusableInterval
from anchorpose.results.reviewed_recording import ReviewedRecording
from anchorpose.settings import LARGEST, LEAST, Positive

for _module in ("recording.recording_file", "recording.equipment", "calibration.markers", "sources.image_folder"):
    import_module(f"anchorpose.{_module}")


def documents(kind: type) -> Iterator[type]:
    for each in kind.__subclasses__():
        yield each
        yield from documents(each)


def floats(hint: Any, about: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """What is declared about each float in a type."""
    if get_origin(hint) is Annotated:
        inner, *more = get_args(hint)
        yield from floats(inner, (*about, *more))
    elif hint is float:
        yield about
    else:
        for part in get_args(hint):
            yield from floats(part, about)


def limits(about: tuple[Any, ...]) -> dict[str, float]:
    """Bounds by their names (gt, ge, lt, le)."""
    parts = [part for each in about for part in (each, *getattr(each, "metadata", ()))]
    return {name: getattr(part, name) for part in parts for name in ("gt", "ge", "lt", "le") if hasattr(part, name)}


FIELDS = sorted(
    (f"{kind.__name__}.{name}", found)
    for kind in {*documents(Entry), JointCorrection, NamedPatient, ReviewedRecording, UnusableInterval}
    for name, hint in get_type_hints(kind, include_extras=True).items()
    for found in map(limits, floats(hint))
)


def test_a_setting_that_would_overflow_is_refused():
    for absurd in (1e-300, 1e300):
        with pytest.raises(ValidationError):
            TypeAdapter(Positive).validate_python(absurd)


@pytest.mark.parametrize(("name", "found"), FIELDS, ids=[name for name, _ in FIELDS])
def test_a_number_has_a_range(name, found):
    if "Position" in name or name.endswith("position_m"):  # their places are checked as a whole
        return
    least, largest = found.get("ge", found.get("gt")), found.get("le", found.get("lt"))
    assert max(abs(least), abs(largest)) <= 100 * LARGEST  # times since 1970
    assert least <= 0.0 or least >= LEAST
    assert found.get("gt") != 0.0, "just above 0 is the smallest float: its inverse overflows"
