"""The table of a run: one row per scene class, and where two versions ran, their differences with intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from intervals import paired_difference, wilson

Scores = Mapping[str, float]
Measured = Sequence[Scores]
"""The scores of all recordings of one row."""


@dataclass(frozen=True, slots=True)
class Column:
    """A score that has a column of its own. scale: what the score is multiplied by; worst: which of the recordings'
    values stands in brackets."""

    name: str
    title: str
    scale: float = 1.0
    digits: int = 1
    worst: Callable[[np.ndarray], float] | None = None


COLUMNS: Final = (
    Column("mean_mm", "mean mm", worst=np.max),
    Column("p95_mm", "95 % mm"),
    Column("hidden_mm", "hidden mm"),
    Column("confident", "confident errors %", 100.0, 2),
    Column("cover_seen", "coverage seen", digits=2),
    Column("cover_hidden", "hidden", digits=2),
    Column("lost", "lost %", 100.0),
    Column("frame_ms", "ms a frame", digits=0, worst=np.max),
    Column("start_s", "start s", digits=1),
    Column("peak_mb", "MB", digits=0, worst=np.max),
)
PAIRED: Final = (
    *COLUMNS,
    Column("right", "right %", 100.0),
    Column("within_100", "in 100 mm %", 100.0),
    Column("tilt_deg", "tilt deg"),
    Column("precision", "precision", digits=2),
    Column("recall", "recall", digits=2),
)
OTHERWISE_SHOWN: Final = frozenset({"trials", "refused"})  # by ``also``
WORSE_IF_LARGER: Final = ("_mm", "_deg", "_ms", "error")  # ends of the names of probes' scores


def columns_of(rows: Mapping[str, Measured], known: Sequence[Column]) -> Sequence[Column]:
    """Return the known columns; of rows without a score of ``COLUMNS``, as most probes give, one column per score."""
    names = dict.fromkeys(name for measured in rows.values() for one in measured for name in one)
    if not names or not {column.name for column in COLUMNS}.isdisjoint(names):
        return known
    own = {column.name: column for column in PAIRED}
    return tuple(own.get(name) or _column(name) for name in names if name not in OTHERWISE_SHOWN)


def _column(name: str) -> Column:
    worst = np.max if name.endswith(WORSE_IF_LARGER) else None
    return Column(name, name.replace("_", " "), digits=1 if name.endswith("_mm") else 2, worst=worst)


def table(rows: Mapping[str, Measured]) -> str:
    """Return Markdown: the number of recordings, the mean of each column with the worst in brackets, and the rest."""
    columns = columns_of(rows, COLUMNS)
    titles = ["scene", "recordings", *(column.title for column in columns), "also"]
    lines = [f"| {' | '.join(titles)} |", "|---|" + "--:|" * (len(titles) - 2) + "---|"]
    for row, measured in rows.items():
        cells = [row, str(len(measured)), *(_cell(column, measured) for column in columns), also(measured)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def differences(now: Mapping[str, Measured], before: Mapping[str, Measured], title: str) -> str:
    """Return Markdown: now less ``before`` on the same recordings, mean and 95 % interval; both in the same order."""
    columns = columns_of(now, PAIRED)
    titles = ["scene", *(column.title for column in columns)]
    lines = [f"Now less {title}:", "", f"| {' | '.join(titles)} |", "|---|" + "--:|" * len(columns)]
    for row, measured in now.items():
        cells = [_difference(column, measured, before.get(row, ())) for column in columns]
        lines.append(f"| {row} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _values(name: str, measured: Measured) -> np.ndarray:
    return np.array([one.get(name, np.nan) for one in measured], dtype=np.float64)


def _cell(column: Column, measured: Measured) -> str:
    values = column.scale * _values(column.name, measured)
    known = values[np.isfinite(values)]
    if not known.size:
        return "–"
    worst = "" if column.worst is None or known.size < 2 else f" ({column.worst(known):.{column.digits}f})"
    return f"{known.mean():.{column.digits}f}{worst}"


def _difference(column: Column, now: Measured, before: Measured) -> str:
    if len(now) != len(before):
        return "–"
    found = paired_difference(*(column.scale * _values(column.name, measured) for measured in (now, before)))
    if found is None:
        return "–"
    digits = column.digits
    bounds = "" if found.low is None else f" ({found.low:+.{digits}f} to {found.high:+.{digits}f})"
    return f"{found.mean:+.{digits}f}{bounds}"


def also(measured: Measured) -> str:
    """Return what else a row has, in words."""
    parts = []
    right, trials = _values("right", measured), np.nan_to_num(_values("trials", measured), nan=1.0)
    if (known := np.isfinite(right)).any():
        count, of = round((right * trials)[known].sum()), round(trials[known].sum())
        low, high = wilson(count, of)
        parts.append(f"right {count} of {of} ({100 * low:.0f} to {100 * high:.0f} %)")
    if (wrong := _known("accepted_wrong", measured)).size:
        parts.append(f"wrong accepted {wrong.sum():.0f}")
    if (seconds := _known("wrong_s", measured)).size:
        parts.append(f"limb wrong in view {seconds.max():.1f} s at most")
    if (weights := _known("labels", measured)).size:
        shares = (100 * np.average(_known(name, measured), weights=weights) for name in ("within_60", "within_100"))
        parts.append("within 60, 100 mm {:.0f}, {:.0f} % of {:.0f} labels".format(*shares, weights.sum()))
        parts.append(f"median {np.median(_known('median_mm', measured)):.0f} mm")
    if (tracked := _known("tracked", measured)).size:
        parts.append(f"tracked {100 * tracked.mean():.0f} % of frames in plain view")
        parts.append(f"another person {_known('another', measured).sum():.0f}")
    if (tilt := _known("tilt_deg", measured)).size:
        kinect = _known("kinect_deg", measured)
        parts.append(f"thigh against sensor {np.median(tilt):.1f} deg, worst {tilt.max():.1f}")
        parts.append(f"Kinect's skeleton {np.median(kinect):.1f}, {kinect.max():.1f}")
    if (reported := _known("reported", measured)).sum() + (touched := _known("touched", measured)).sum() > 0:
        precision, recall = (
            f"{_known(part, measured).sum() / whole.sum():.2f}" if whole.sum() else "–"
            for part, whole in (("reported_right", reported), ("touched_found", touched))
        )
        parts.append(f"contacts {precision} / {recall} of {reported.sum():.0f} / {touched.sum():.0f}")
    if (bones := _known("bone_mm", measured)).size:
        parts.append(f"bones {np.median(bones):.0f} mm, {100 * _known('bone_cover', measured).mean():.0f} % in band")
    if (skin := _known("skin_mm", measured)).size:
        parts.append(f"skin {skin.mean():.1f} mm, {100 * _known('skin_near', measured).mean():.0f} % within 12 mm")
    if refused := sum(one.get("refused", 0.0) for one in measured):
        parts.append(f"refused {refused:.0f}")
    return "; ".join(parts)


def _known(name: str, measured: Measured) -> np.ndarray:
    values = _values(name, measured)
    return values[np.isfinite(values)]
