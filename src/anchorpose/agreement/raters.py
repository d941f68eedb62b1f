"""Compute how well blinded raters agree on the scores of trials. The formulas are those of the module ``reliability``,
with trials in place of subjects and raters in place of repeats.

For two raters, quadratically weighted kappa equals ICC(2,1) except for terms of the order of 1 / number of trials:
Fleiss and Cohen 1973 (doi:10.1177/001316447303300309).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.agreement.reliability import Reliability, reliability_of
from anchorpose.errors import InputError
from anchorpose.results.ratings import RATING, RATING_UNIT, Ratings, read_ratings

REMEDY: Final = "give the scores of the same sessions from every rater, each file once"


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
        raise InputError(paths[0], "is listed beside a file that is given twice", REMEDY)
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
            raise InputError(path, f"has the scores of {ratings.rater} of the session of {held[key][0]} again", REMEDY)
        held[key] = path, ratings
    return held


def _grid(held: dict[tuple[str, str], tuple[Path, Ratings]], session: str, raters: Sequence[str]) -> np.ndarray:
    """Return the scores (trials, raters) of a session, NaN where a rater gave no score."""
    there = [held[key] for rater in raters if (key := (session, rater)) in held]
    path, first = there[0]
    missing = next((rater for rater in raters if (session, rater) not in held), None)
    if missing is not None:
        raise InputError(path, f"has scores of a session that {missing} did not score", REMEDY)
    for other, ratings in there:
        if set(ratings.scores) != set(first.scores):
            raise InputError(other, f"has other trials than {path}", REMEDY)
    scores = [[ratings.scores[trial] for _, ratings in there] for trial in sorted(first.scores)]
    return np.array(scores, dtype=np.float64)
