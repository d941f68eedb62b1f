"""The tables of the model card, in Markdown: figures by group, calibration, and what is called people."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import numpy as np
from card import SURE, THINGS, Measured, Rows
from people import POSTURES
from scenes import MOST_PEOPLE
from sensors import KINDS

from anchorpose.descriptor.people import LEAST_AREA_M2

SURE_CM, WRONG_CM = 6.0, 20.0  # expected and true error of a place that is sure and wrong
LEAST_SIDED: Final = 50  # pixels with a side, by which a person's sides are judged
EXPECTED_CM: Final = (0.0, 4.0, 8.0, 16.0, np.inf)


def groups_of(people: Rows) -> Iterator[tuple[str, np.ndarray]]:
    """Yield each group's title and which people (p,) are in it."""
    yield "everybody", np.ones(len(people["image"]), dtype=bool)
    for number, posture in enumerate(POSTURES):
        yield f"posture: {posture}", people["posture"] == number
    adult = ~people["child"]
    yield "child", ~adult
    for title, own in (
        ("shorter than 1.60 m", people["stature_m"] < 1.6),
        ("taller than 1.85 m", people["stature_m"] > 1.85),
        ("light, below 18 kg/m²", people["mass_index"] < 18.0),
        ("heavy, above 25 kg/m²", people["mass_index"] > 25.0),
    ):
        yield f"adult, {title}", adult & own
    for title, low, high in (("close to the skin, below 3 mm", 0.0, 0.003), ("thick, above 12 mm", 0.012, 1.0)):
        yield f"clothes {title}", _between(people["cloth_m"], low, high)
    upright = np.isin(people["posture"], [POSTURES.index(name) for name in ("stands", "sits", "squats", "lunges")])
    for title, low, high in (("front", 0, 60), ("side", 60, 120), ("back", 120, 181)):
        yield f"shows the {title}", upright & _between(people["away_deg"], low, high)
    for low, high in ((0.0, 1.5), (1.5, 2.5), (2.5, 4.0), (4.0, np.inf)):
        yield (
            f"distance {low:g} to {high:g} m" if high < np.inf else f"distance over {low:g} m",
            _between(people["distance_m"], low, high),
        )
    for low, high in ((0.0, 0.25), (0.25, 0.5), (0.5, 0.75), (0.75, 1.1)):
        yield f"seen: {100 * low:.0f} to {min(100, 100 * high):.0f} %", _between(people["seen"], low, high)
    for count in range(1, MOST_PEOPLE + 1):
        yield f"people in the image: {count}", people["number"] == count
    for number, kind in enumerate(KINDS):
        yield f"sensor: {kind}", people["sensor"] == number
    yield "background removed", people["cut_out"]


def _between(values: np.ndarray, low: float, high: float) -> np.ndarray:
    return np.asarray((values >= low) & (values < high))


def card(measured: Measured) -> str:
    """Return the tables in Markdown."""
    images = measured.images
    titles = ("group", "people", "people found %", "pixels found %", "others called people %", "place, median cm")
    titles += ("other side %", "sure and wrong %", "pelvis, median cm")
    groups = [(title, *_group(measured, own)) for title, own in groups_of(measured.people)]
    title = f"{len(images['things'])} images; things found as people: {images['things'].mean():.2f} an image"
    tables = (_table(titles, groups), _calibration(measured.pixels), _taken(images))
    return "\n\n".join([title, *tables, _whole_people(measured)])


def _table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(cells)} |" for cells in (titles, *rows)]
    return "\n".join([lines[0], "|---|" + "--:|" * (len(titles) - 1), *lines[1:]])


def _group(measured: Measured, own: np.ndarray) -> Iterator[str]:
    people, pixels = measured.people, measured.pixels
    mine = {name: values[own[pixels["person"]]] for name, values in pixels.items()}
    found = {name: values[mine["found"]] for name, values in mine.items()}
    plain = own & (people["area_m2"] >= LEAST_AREA_M2)
    sure = found["expected_cm"] < SURE_CM
    yield str(int(own.sum()))
    yield _percent(people["person_found"][plain])
    yield _percent(mine["found"])
    yield _wrong(measured, np.isin(np.arange(len(measured.images["things"])), people["image"][own]))
    yield _median(found["error_cm"])
    yield _percent(found["crossed"])
    yield _percent(found["error_cm"][sure] > WRONG_CM)
    yield _median(found["vote_cm"])


def _wrong(measured: Measured, images: np.ndarray) -> str:
    """Pixels that show nobody and are called people, in some images."""
    wrong, others = (measured.images[name][images].sum() for name in ("wrong", "others"))
    return f"{100.0 * wrong / others:.1f}" if others else "–"


def _percent(values: np.ndarray) -> str:
    """The mean of what is known."""
    known = np.asarray(values, dtype=float)[~np.isnan(np.asarray(values, dtype=float))]
    return f"{100.0 * known.mean():.1f}" if len(known) else "–"


def _median(values: np.ndarray) -> str:
    return f"{np.median(values):.1f}" if len(values) else "–"


def _calibration(pixels: Rows) -> str:
    """Return the table of expected against true errors."""
    titles = ("expected error", "of the pixels found %", "expected, mean cm", "true, mean cm")
    titles += ("true, median cm", "95 % below, cm")
    expected, true, crossed = (pixels[name][pixels["found"]] for name in ("expected_cm", "error_cm", "crossed"))
    rows = []
    for low, high in itertools.pairwise(EXPECTED_CM):
        own = _between(expected, low, high)
        title = f"{low:g} to {high:g} cm" if high < np.inf else f"over {low:g} cm"
        mean, median = expected[own].mean(), np.median(true[own])
        worst = np.percentile(true[own], 95)
        cells = [f"{value:.1f}" for value in (mean, true[own].mean(), median, worst)]
        rows.append((title, _percent(own), *cells, f"{median / mean:.2f}", _percent(crossed[own])))
    return _table((*titles, "median over expected", "other side %"), rows)


def _taken(images: Rows) -> str:
    """Return the table of what is called people and shows nobody."""
    titles = ("what pixels show", "of the pixels of nobody %", "called people %", f"probability from {SURE:g} %")
    titles += ("of all that are called people %",)
    others, wrong, sure = (images[name].sum(axis=0) for name in ("others", "wrong", "sure"))
    columns = others / others.sum(), wrong / np.maximum(1, others), sure / np.maximum(1, others), wrong / wrong.sum()
    shares = np.stack(columns, axis=1)
    rows = [(title, *(f"{100.0 * share:.2f}" for share in row)) for title, row in zip(THINGS, shares, strict=True)]
    return _table(titles, rows)


def _whole_people(measured: Measured) -> str:
    """Return a sentence on people who are missed, and one on people whose sides are exchanged as a whole."""
    people, pixels = measured.people, measured.pixels
    missed = (people["area_m2"] >= LEAST_AREA_M2) & ~people["person_found"]
    several, hidden = (missed & (people["number"] > 1)).sum(), (missed & (people["seen"] < 0.5)).sum()
    sided = ~np.isnan(pixels["crossed"])
    owner, crossed = pixels["person"][sided], pixels["crossed"][sided]
    number = np.bincount(owner, minlength=len(missed))
    share = np.bincount(owner, crossed, minlength=len(missed)) / np.maximum(1, number)
    turned, judged = share > 0.5, number >= LEAST_SIDED
    held = crossed[turned[owner]].sum() / crossed.sum()
    return (
        f"{missed.sum()} people missed: {several} in images of several people, {hidden} seen to less than a half. "
        f"{(turned & judged).sum()} of {judged.sum()} people have most sides exchanged, "
        f"{100.0 * held:.0f} % of all exchanged pixels."
    )
