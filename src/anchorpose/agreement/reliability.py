"""Compute how well measures repeat: intraclass correlations, standard error of measurement, minimal detectable change;
and, by the same formulas with trials in place of subjects and raters in place of repeats, how well blinded raters agree
on the scores of trials.

Sources: ICC(2,1) and ICC(3,1) of Shrout and Fleiss 1979
(doi:10.1037/0033-2909.86.2.420) with the intervals of McGraw and Wong 1996 (doi:10.1037/1082-989X.1.1.30); standard
error of measurement and minimal detectable change of Weir 2005 (doi:10.1519/15184.1). For two raters, quadratically
weighted kappa equals ICC(2,1) except for terms of the order of 1 / number of trials: Fleiss and Cohen 1973
(doi:10.1177/001316447303300309).
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy import stats

from anchorpose.agreement.statistics import LEAST_UNITS, Estimate
from anchorpose.errors import InputError
from anchorpose.options import plain_number
from anchorpose.recording.document import cell_text, read_rows, require_distinct
from anchorpose.recording.regular_file import is_there
from anchorpose.results.ratings import RATING, RATING_UNIT, Ratings, read_ratings
from anchorpose.results.records import MEASURES_FILE, read_definition, read_measures
from anchorpose.results.run_record import RUN_FILE, read_run, recording_digest
from anchorpose.results.tables import JOINTS_FILE
from anchorpose.results.uncertainty import CONFIDENCE, NORMAL_95
from anchorpose.results.verify import require_own
from anchorpose.settings import LARGEST


@dataclass(frozen=True, slots=True, kw_only=True)
class Reliability:
    """The reliability of one measure; values are None if ``why`` states why they are missing. sem (standard error of
    measurement) and mdc95 (minimal detectable change) are in ``unit``.
    """

    measure: str
    side: str | None
    unit: str
    subjects: int
    repeats: int
    mean: float | None = None
    icc_2_1: float | None = None
    icc_2_1_low: float | None = None
    icc_2_1_high: float | None = None
    icc_3_1: float | None = None
    icc_3_1_low: float | None = None
    icc_3_1_high: float | None = None
    sem: float | None = None
    mdc95: float | None = None
    why: str | None = None


COLUMNS: Final = tuple(each.name for each in fields(Reliability))
HEAD: Final = ",".join(COLUMNS)  # the first line of the table


@dataclass(frozen=True, slots=True)
class MeanSquares:
    """Mean squares of a two-way analysis of variance: between subjects, between repeats, and of the residuals."""

    subjects: float
    repeats: float
    rest: float


def mean_squares(values: np.ndarray) -> MeanSquares:
    """Return the mean squares of values (subjects, repeats), all finite.

    Every subject has a value in every repeat, so the mean squares are simple sums (Shrout and Fleiss). A fit by the
    package statsmodels would solve for one unknown per subject, which takes gigabytes of memory for some thousand
    subjects.
    """
    subjects, repeats = values.shape
    centred = values - values.mean()  # without this step, squares of values with a large mean would lose digits
    by_subject, by_repeat = centred.mean(axis=1), centred.mean(axis=0)
    rest = centred - by_subject[:, None] - by_repeat
    return MeanSquares(
        float(repeats * (by_subject**2).sum() / (subjects - 1)),
        float(subjects * (by_repeat**2).sum() / (repeats - 1)),
        float((rest**2).sum() / ((subjects - 1) * (repeats - 1))),
    )


def absolute_agreement(ms: MeanSquares, subjects: int, repeats: int) -> Estimate:
    """Compute ICC(2,1) with its 95 % interval: repeats are regarded as a random sample, so differences between repeats
    count as error.
    """
    n, k = subjects, repeats
    value = (ms.subjects - ms.rest) / (ms.subjects + (k - 1) * ms.rest + k * (ms.repeats - ms.rest) / n)
    a = k * value / (n * (1.0 - value))
    b = 1.0 + k * value * (n - 1) / (n * (1.0 - value))
    freedom = (a * ms.repeats + b * ms.rest) ** 2 / (
        (a * ms.repeats) ** 2 / (k - 1) + (b * ms.rest) ** 2 / ((n - 1) * (k - 1))
    )
    tail = 0.5 + CONFIDENCE / 2.0
    above, below = stats.f.ppf(tail, n - 1, freedom), stats.f.ppf(tail, freedom, n - 1)
    other = k * ms.repeats + (k * n - k - n) * ms.rest
    low = n * (ms.subjects - above * ms.rest) / (above * other + n * ms.subjects)
    high = n * (below * ms.subjects - ms.rest) / (other + n * below * ms.subjects)
    return Estimate(float(value), float(low), float(high))


def consistency(ms: MeanSquares, subjects: int, repeats: int) -> Estimate:
    """Compute ICC(3,1) with its 95 % interval: a constant difference between repeats does not count as error."""
    n, k = subjects, repeats
    tail = 0.5 + CONFIDENCE / 2.0
    ratio, freedom = ms.subjects / ms.rest, (n - 1) * (k - 1)
    low, high = ratio / stats.f.ppf(tail, n - 1, freedom), ratio * stats.f.ppf(tail, freedom, n - 1)
    value, below, above = ((each - 1.0) / (each + k - 1.0) for each in (ratio, low, high))
    return Estimate(float(value), float(below), float(above))


def reliability_of(measure: str, side: str | None, unit: str, values: np.ndarray) -> Reliability:
    """Compute the reliability of values (subjects, repeats); subjects with NaN are left out."""
    whole = values[np.isfinite(values).all(axis=1)]
    subjects, repeats = whole.shape
    empty = Reliability(measure=measure, side=side, unit=unit, subjects=subjects, repeats=repeats)
    if (why := _why_not(whole)) is not None:
        return replace(empty, why=why)
    ms = mean_squares(whole)
    if ms.rest <= 1e-12 * ms.subjects:
        return replace(empty, why="all repeats are equal but for a constant: not measured")
    agreement, same = absolute_agreement(ms, subjects, repeats), consistency(ms, subjects, repeats)
    sem = float(np.sqrt(max((ms.repeats - ms.rest) / subjects, 0.0) + ms.rest))
    return replace(
        empty,
        mean=float(whole.mean()),
        icc_2_1=agreement.value,
        icc_2_1_low=agreement.low,
        icc_2_1_high=agreement.high,
        icc_3_1=same.value,
        icc_3_1_low=same.low,
        icc_3_1_high=same.high,
        sem=sem,
        mdc95=float(NORMAL_95 * np.sqrt(2.0) * sem),  # 5 % of the differences between two repeats are larger than this
    )


def _why_not(whole: np.ndarray) -> str | None:
    if whole.shape[1] < 2:
        return "only one session was given"
    if len(whole) < LEAST_UNITS:
        return f"{len(whole)} subjects have a value in every session; at least {LEAST_UNITS} are needed"
    return "the value never differs" if np.ptp(whole) == 0.0 else None


REPEATED: Final = ("session", "rater", "device")
REMEDY: Final = (
    "give the columns subject, session (or rater, or device) and results, or in place of results measure, value, and "
    "if wanted side and unit; or the scores of two raters or more"
)

OTHER_UNIT: Final = 100.0
"""Minimum ratio between the values of two sessions from which the program concludes that their units differ (such as
metres and centimetres), since no person changes by this ratio.
"""

Key = tuple[str, str | None, str]  # measure, side, unit
Values = dict[tuple[str, str], dict[Key, float]]  # the values of all measures, for each subject and repeat


def session_reliability(path: Path) -> tuple[Reliability, ...]:
    """Return the reliability of every measure in a CSV table of sessions, in the order in which measures first occur.

    Raises InputError if the table or a results folder cannot be used, or measures have different definitions.
    """
    rows = _read(path)
    repeated = next(name for name in REPEATED if name in rows[0])
    subjects = list(dict.fromkeys(row["subject"] for row in rows))
    repeats = list(dict.fromkeys(row[repeated] for row in rows))
    values = _of_folders(path, rows, repeated) if "results" in rows[0] else _of_numbers(path, rows, repeated)
    found = []
    for key in dict.fromkeys(key for each in values.values() for key in each):
        grid = np.array([[values.get((s, r), {}).get(key, np.nan) for r in repeats] for s in subjects])
        row = reliability_of(*key, grid)
        doubt = _other_unit(grid, subjects, repeats) if row.why is None else None
        if doubt is not None:
            about = {name: getattr(row, name) for name in ("measure", "side", "unit", "subjects", "repeats")}
            row = Reliability(**about, why=f"{doubt} of the others: is it in another unit?")
        found.append(row)
    return tuple(found)


def _other_unit(grid: np.ndarray, subjects: Sequence[str], repeats: Sequence[str]) -> str | None:
    """Return a text, the beginning of a sentence, that names a session whose values seem to be in another unit: they
    differ from the values of the other sessions by a factor of ``OTHER_UNIT`` or more, either over all subjects or for
    one subject. Return None if no session has such values. grid (subjects, repeats): the values.

    A correct value may be near zero by chance. So small values are reported only if the median over all subjects of a
    session is small; large values are reported also for a single subject.
    """
    size = np.abs(grid[np.isfinite(grid).all(axis=1)])
    names = [name for name, row in zip(subjects, grid, strict=True) if np.isfinite(row).all()]
    column = [_times(size[:, k], np.delete(size, k, axis=1)) for k in range(len(repeats))]
    most, least = int(np.argmax(column)), int(np.argmin(column))
    if column[most] >= OTHER_UNIT:
        return f"session '{repeats[most]}' has values {column[most]:.3g} times those"
    if column[least] <= 1.0 / OTHER_UNIT:
        return f"session '{repeats[least]}' has values {column[least]:.3g} times those"
    for row, repeat in np.argwhere(size >= OTHER_UNIT * np.median(size)):
        own = _times(size[row, repeat], np.delete(size[row], repeat))
        if own >= OTHER_UNIT:
            return f"session '{repeats[repeat]}' of subject '{names[row]}' has {own:.3g} times the value"
    return None


def _times(some: np.ndarray, others: np.ndarray) -> float:
    """Return the median of ``some`` divided by that of ``others``; 1 if either median is 0."""
    own, rest = float(np.median(some)), float(np.median(others))
    return own / rest if own > 0.0 and rest > 0.0 else 1.0


def reliability_text(rows: Sequence[Reliability]) -> str:
    """Return the rows as CSV text, with an empty cell for each missing value."""
    return csv_text(COLUMNS, (astuple(row) for row in rows))


def csv_text(head: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table with a line of column names (``head``) as CSV text."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([head, *([cell_text(cell) for cell in row] for row in rows)])
    return text.getvalue()


def _read(path: Path) -> list[dict[str, str]]:
    lines = read_rows(path)
    head = [cell.lower() for cell in lines[0][1]] if lines else []
    whole = {"results"} <= set(head) or {"measure", "value"} <= set(head)
    if "subject" not in head or not any(name in head for name in REPEATED) or not whole:
        raise InputError(path, "does not have the columns of a table of sessions", REMEDY)
    require_distinct(path, head)
    for number, line in lines[1:]:
        if len(line) != len(head):
            raise InputError(path, f"line {number} has {len(line)} cells, not {len(head)}", REMEDY)
    if len(lines) < 2:
        raise InputError(path, "holds no sessions", REMEDY)
    return [dict(zip(head, line, strict=True)) for _, line in lines[1:]]


def _of_folders(path: Path, rows: list[dict[str, str]], repeated: str) -> Values:
    found: Values = {}
    first, used = None, dict[str, Path]()
    for row in rows:
        file = path.parent / row["results"] / MEASURES_FILE
        run = read_run(file.parent / RUN_FILE) if is_there(file.parent / RUN_FILE) else {}
        require_own(file.parent, (JOINTS_FILE, MEASURES_FILE), run)
        _require_different(file.parent, run, row["subject"] if repeated == "session" else None, used)
        definition = read_definition(file) if file.is_file() else None
        first = first or definition
        measures = read_measures(file)
        if definition != first:
            raise InputError(file, "has measures of another version or definition", "run 'anchorpose measure' on all")
        key = (row["subject"], row[repeated])
        if key in found:
            raise InputError(path, f"has subject '{key[0]}' with {repeated} '{key[1]}' twice", "name each session once")
        found[key] = {
            (m.measure, m.side, m.unit): float("nan") if m.value is None else m.value
            for m in measures
            if m.part is None and m.person is None
        }
    return found


def _require_different(folder: Path, run: Mapping[str, Any], subject: str | None, used: dict[str, Path]) -> None:
    """Raise InputError if an earlier row of the table names the same results folder, or results of the same recording
    for the same subject. used: the folders and recordings of earlier rows, to which folder and recording of this row
    are added. subject: None for raters and devices, who may analyse the same recording, each with its own folder.
    """
    keys, digest = {str(folder.resolve()): "is given twice"}, recording_digest(run.get("inputs_sha256", {}).items())
    if digest is not None and subject is not None:
        recording = f"{subject} {digest}"
        keys[recording] = f"was made from the same recording as {used.get(recording)}"
    for key, problem in keys.items():
        if key in used:
            raise InputError(folder, problem, "give another recording, or leave the line out")
        used[key] = folder


def _of_numbers(path: Path, rows: list[dict[str, str]], repeated: str) -> Values:
    found: Values = {}
    for row in rows:
        key = (row["measure"], row.get("side") or None, row.get("unit", ""))
        try:
            value = plain_number(row["value"]) if row["value"] else float("nan")
            if row["value"] and not abs(value) <= LARGEST:
                raise ValueError("it would overflow")
        except ValueError:
            raise InputError(
                path, f"has the value '{row['value'][:40]}', which is not a number of at most {LARGEST:g}", REMEDY
            ) from None
        values = found.setdefault((row["subject"], row[repeated]), {})
        if key in values:
            raise InputError(path, f"has {key[0]} of {row['subject']} twice in {row[repeated]}", "give each value once")
        values[key] = value
    return found


RATER_REMEDY: Final = "give the scores of the same sessions from every rater, each file once"


@dataclass(frozen=True, slots=True)
class RaterAgreement:
    """The agreement of raters. reliability: reliability of one rater's score. raters: the raters' initials. left_out:
    number of trials that are left out because at least one rater gave no score.
    """

    reliability: Reliability
    raters: tuple[str, ...]
    left_out: int


def rater_agreement(paths: Sequence[Path]) -> RaterAgreement:
    """Return the agreement of two or more raters. paths: one file of 'anchorpose view --rate' per rater and session.

    Raises InputError if a file cannot be used, or the raters did not score the same trials.
    """
    files = {path: read_ratings(path) for path in paths}
    if len(files) < len(paths):
        raise InputError(paths[0], "is listed beside a file that is given twice", RATER_REMEDY)
    raters = tuple(dict.fromkeys(each.rater for each in files.values()))
    sessions = tuple(dict.fromkeys(each.session for each in files.values()))
    if len(raters) < 2:
        raise InputError(paths[0], f"has the scores of {raters[0]}, the only rater", "give those of another rater too")
    held = _by_session_and_rater(files)
    grids = [_grid(held, session, raters) for session in sessions]
    values = np.concatenate(grids)
    left_out = int((~np.isfinite(values).all(axis=1)).sum())
    return RaterAgreement(reliability_of(RATING, None, RATING_UNIT, values), raters, left_out)


def _by_session_and_rater(files: dict[Path, Ratings]) -> dict[tuple[str, str], tuple[Path, Ratings]]:
    held: dict[tuple[str, str], tuple[Path, Ratings]] = {}
    for path, ratings in files.items():
        key = ratings.session, ratings.rater
        if key in held:
            raise InputError(
                path, f"has the scores of {ratings.rater} of the session of {held[key][0]} again", RATER_REMEDY
            )
        held[key] = path, ratings
    return held


def _grid(held: dict[tuple[str, str], tuple[Path, Ratings]], session: str, raters: Sequence[str]) -> np.ndarray:
    """Return the scores (trials, raters) of a session, NaN where a rater gave no score."""
    there = [held[key] for rater in raters if (key := (session, rater)) in held]
    path, first = there[0]
    missing = next((rater for rater in raters if (session, rater) not in held), None)
    if missing is not None:
        raise InputError(path, f"has scores of a session that {missing} did not score", RATER_REMEDY)
    for other, ratings in there:
        if set(ratings.scores) != set(first.scores):
            raise InputError(other, f"has other trials than {path}", RATER_REMEDY)
    scores = [[ratings.scores[trial] for _, ratings in there] for trial in sorted(first.scores)]
    return np.array(scores, dtype=np.float64)
