"""Store the scores that blinded raters give to trials. Each rater has a table beside the results folder, with a row per
trial in the order in which the rater sees the trials.

The table is written, with all trials, before the first score is given. So a rater who was interrupted continues in the
same order. The table does not name the conditions, so raters who open it stay blinded.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from glob import escape
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.document import read_rows
from anchorpose.recording.events import LARGEST_EVENTS, MISSING, MOST_TRIALS, Trials
from anchorpose.results.folder import write_text_whole
from anchorpose.results.records import Measure
from anchorpose.results.reviewed_recording import recording_of_run
from anchorpose.results.trial_measures import condition_measures

RATING: Final = "blinded_rating"
RATING_UNIT: Final = "score"

BEST_SCORE: Final = 10
"""Highest score on a numerical rating scale of 11 points, as used for pain or effort; scores are whole numbers from 0.
"""

MOST_INITIALS: Final = 8  # maximum number of letters of a rater's initials
COLUMNS: Final = ("shown", "trial", "score", "time", "rater", "seed", "session")
REMEDY: Final = "give the file that 'anchorpose view --rate' wrote, as it was"


@dataclass(frozen=True, slots=True)
class Rating:
    """The score of a trial. shown: place of the trial in the order of showing, from 1. score: 0 to 10; time: when the
    score was given, in UTC. score and time are None if the trial has no score yet.
    """

    shown: int
    trial: int
    score: int | None = None
    time: str | None = None


@dataclass(frozen=True, slots=True)
class Ratings:
    """The scores of one rater of one session. seed: random seed of the order in which the trials are shown; session:
    hash that identifies the rated session (``rated_session``).
    """

    rater: str
    seed: int
    session: str
    rows: tuple[Rating, ...]

    @property
    def scores(self) -> dict[int, int | None]:
        """Return the score of each trial by the trial's number, None without a score."""
        return {row.trial: row.score for row in self.rows}

    def with_score(self, shown: int, score: int, time: str) -> Ratings:
        """Return the ratings with a score for the trial at a place in the order; an earlier score is replaced."""
        rows = [replace(row, score=score, time=time) if row.shown == shown else row for row in self.rows]
        return replace(self, rows=tuple(rows))


def parse_initials(text: str) -> str:
    """Return the rater's initials in capitals; raises ValueError unless they are 1 to 8 letters."""
    initials = text.strip().upper()
    if not (initials.isalpha() and len(initials) <= MOST_INITIALS):
        raise ValueError(f"'{text[:40]}' are not 1 to {MOST_INITIALS} letters")
    return initials


def ratings_beside(results: Path, rater: str) -> Path:
    """Return ``RESULTS.rating_AB.tsv``, a path beside the results folder, since a new run replaces that folder."""
    folder = results.resolve()
    return folder.with_name(f"{folder.name}.rating_{rater}.tsv")


def rated_session(run: dict[str, Any], trials: Trials) -> str:
    """Return the identity of the rated session: a hash of the recording's depth images and times, and of the times of
    its trials.

    Settings of tracking and names of conditions do not affect the hash.
    """
    times = [f"{trial.onset_s!r} {trial.duration_s!r}\n" for trial in trials.rows]
    return hashlib.sha256("".join([recording_of_run(run).sha256, "\n", *times]).encode()).hexdigest()


def draw_order(rater: str, seed: int, session: str, trials: Sequence[int]) -> Ratings:
    """Return an empty rating form, with the trials' numbers in a random order."""
    order = np.random.default_rng(seed).permutation(np.array(trials, dtype=int)).tolist()
    return Ratings(rater, seed, session, tuple(Rating(shown, trial) for shown, trial in enumerate(order, 1)))


def write_ratings(path: Path, ratings: Ratings) -> None:
    """Write a rater's table completely or leave the file as it was."""
    text, common = io.StringIO(), (ratings.rater, ratings.seed, ratings.session)
    rows = ([MISSING if cell is None else cell for cell in (*astuple(row), *common)] for row in ratings.rows)
    csv.writer(text, delimiter="\t", lineterminator="\n").writerows([COLUMNS, *rows])
    write_text_whole(path, text.getvalue())


def read_ratings(path: Path) -> Ratings:
    """Read the scores of one rater; raises InputError if the file is not such a table."""
    lines = read_rows(path, delimiter="\t", largest_bytes=LARGEST_EVENTS)
    if not lines or tuple(lines[0][1]) != COLUMNS:
        raise InputError(path, "does not have the columns of a rater's scores", REMEDY)
    rows = [_rating(path, number, cells) for number, cells in lines[1:]]
    common = {tuple(cells[4:]) for _, cells in lines[1:]}
    in_order = [row.shown for row in rows] == list(range(1, len(rows) + 1))
    if not rows or len(common) > 1 or not in_order or len({row.trial for row in rows}) < len(rows):
        raise InputError(path, "does not have one row per trial, in the order shown, of one rater and session", REMEDY)
    rater, seed, session = common.pop()
    if not seed.isdecimal():
        raise InputError(path, f"has the seed '{seed[:40]}'", REMEDY)
    return Ratings(rater, int(seed), session, tuple(rows))


def _rating(path: Path, line: int, cells: Sequence[str]) -> Rating:
    """Parse a row; raises InputError unless it has a place in the order, a trial, a score of 0 to 10 or no score, and a
    rater.
    """
    if len(cells) != len(COLUMNS):
        raise InputError(path, f"line {line} has {len(cells)} cells, not {len(COLUMNS)}", REMEDY)
    shown, trial, score, time, rater = cells[:5]
    numbers = all(text.isdecimal() and 1 <= int(text[:9]) <= MOST_TRIALS for text in (shown, trial))
    if (
        not numbers
        or score not in (MISSING, *map(str, range(BEST_SCORE + 1)))
        or (score == MISSING) != (time == MISSING)
    ):
        problem = f"line {line} is not a place, a trial, a whole score of 0 to {BEST_SCORE} (or {MISSING}), and a time"
        raise InputError(path, problem, REMEDY)
    try:
        parse_initials(rater)
    except ValueError as error:
        raise InputError(path, f"line {line} has a rater with invalid initials ({error})", REMEDY) from None
    return Rating(int(shown), int(trial), *((None, None) if score == MISSING else (int(score), time)))


def require_session(path: Path, ratings: Ratings, session: str) -> None:
    """Raise InputError if the scores read from ``path`` are about another session."""
    if ratings.session != session:
        problem = "has scores of another session (other depth images, or other trials)"
        raise InputError(path, problem, "move that file away, or give the results that were rated")


def read_ratings_beside(results: Path, session: str) -> list[Ratings]:
    """Return the scores of all raters of a results folder, in the order of their initials."""
    folder = results.resolve()
    found = list[Ratings]()
    for path in sorted(folder.parent.glob(f"{escape(folder.name)}.rating_*.tsv")):
        found.append(read_ratings(path))
        require_session(path, found[-1], session)
    return found


def rating_measures(results: Path, run: dict[str, Any], trials: Trials) -> list[Measure]:
    """Return the scores as measures of the trials, then of the conditions; the list is empty if no rater has given a
    score.

    Each rater has a row per trial and per condition, with the rater's initials as ``person``. A row without a person is
    the mean of all raters; its value is None unless every rater has given a score.
    """
    raters = read_ratings_beside(results, rated_session(run, trials))
    rows = [row for each in raters for row in _of_rater(each.rater, each.scores, trials)]
    if not rows:
        return []
    rows += [_mean([row for row in rows if row.trial == trial.number]) for trial in trials.rows]
    return [*rows, *condition_measures(trials, rows)]


def _of_rater(rater: str, scores: dict[int, int | None], trials: Trials) -> list[Measure]:
    return [
        Measure(
            measure=RATING,
            person=rater,
            value=None if (score := scores.get(trial.number)) is None else float(score),
            unit=RATING_UNIT,
            frames=0,
            why=f"{rater} has not scored this trial" if score is None else None,
            condition=trial.condition,
            trial=trial.number,
        )
        for trial in trials.rows
    ]


def _mean(rows: Sequence[Measure]) -> Measure:
    """Return the mean of all raters' scores of one trial."""
    values, missing = [row.value for row in rows if row.value is not None], [row.why for row in rows if row.why]
    if missing:
        return replace(rows[0], person=None, value=None, why="; ".join(missing))
    return replace(rows[0], person=None, value=float(np.mean(values)), why=None)
