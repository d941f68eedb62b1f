"""Serve the page for blinded raters (people who score trials without knowing their condition). The page shows the
trials in random order, and nothing that reveals the condition or number of a trial.

The server sends the trials to the page, in the order shown, as if they were a single recording, whose frame numbers and
times begin at 0. So no request of the page contains the number of a trial, a frame number of the recording, or a time
of the session.
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.events import Trial, Trials
from anchorpose.recording.regular_file import is_there
from anchorpose.recording.writable import check_place
from anchorpose.results.corrections import now_utc
from anchorpose.results.frame_table import cut_rows
from anchorpose.results.ratings import (
    BEST_SCORE,
    Ratings,
    draw_order,
    parse_initials,
    rated_session,
    ratings_beside,
    read_ratings,
    require_session,
    write_ratings,
)
from anchorpose.results.trial_measures import LEAST_FRAMES
from anchorpose.results.trial_table import TRIALS_FILE, read_trial_table, trial_rows
from anchorpose.results.verify import require_own
from anchorpose.viewer.guarded_server import RATING_PAGE, Response, json_response
from anchorpose.viewer.review import Review, describe_scene, locked, open_review
from anchorpose.viewer.server import ReviewApi, ReviewServer

APART_S: Final = 1.0
"""Gap in s between two trials in the times that the page gets, since these times must increase from trial to trial. The
page does not play the gap.
"""

SEED_BITS: Final = 32


# the first and the last row of each trial in the blinded frames, in the order shown
Spans = tuple[tuple[int, int], ...]


def blind(review: Review, trials: Sequence[Trial]) -> tuple[Review, Spans]:
    """Return the frames of all trials in the given order, without names, angles, contacts, anchors and the table of how
    well poses explain the depth images, and with other frame numbers and times than in the session. Also return the
    first and the last row of each trial in these frames.
    """
    parts = [trial_rows(trial, review.joints.time_s) for trial in trials]
    ends = np.cumsum([part.stop - part.start for part in parts]).tolist()
    rows = np.concatenate([np.arange(part.start, part.stop) for part in parts])
    joints, angles = cut_rows(review.joints, rows), cut_rows(review.angles, rows)
    hidden = replace(
        review,
        name="",
        joints=replace(joints, frame=np.arange(len(rows)), time_s=_page_time_s(review.joints.time_s, parts)),
        angles=replace(
            angles,
            names=(),
            degrees=angles.degrees[:, :0],
            state_code=angles.state_code[:, :0],
            sigma_deg=angles.sigma_deg[:, :0],
        ),
        contacts=(),
        poses=None if review.poses is None else cut_rows(review.poses, rows),
        anchors=None,
        explained=None,
        depth_frames=None if review.depth_frames is None else cut_rows(review.depth_frames, rows),
    )
    return hidden, tuple((end - (part.stop - part.start), end - 1) for end, part in zip(ends, parts, strict=True))


def _page_time_s(time_s: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
    """Return the times (n,) for the page; each trial begins ``APART_S`` after the end of the previous trial."""
    found, now_s = list[np.ndarray](), 0.0
    for part in parts:
        found.append(now_s + time_s[part] - time_s[part.start])
        now_s = float(found[-1][-1]) + APART_S
    return np.concatenate(found)


class ScoreFile:
    """A writer of one rater's scores to the rater's file. For each score, the file is locked and read again. If the
    file does not exist, it is made with a random order of the trials.

    Raises InputError if the file cannot be used, or contains scores of another session or another rater.
    """

    def __init__(self, path: Path, rater: str, session: str, trials: Sequence[int]) -> None:
        self.path, self.rater, self.session = path, rater, session
        with locked(path):
            if not is_there(path):
                write_ratings(path, draw_order(rater, secrets.randbits(SEED_BITS), session, trials))
        if set(self.current().scores) != set(trials):
            problem = "was begun when other trials could be shown"
            raise InputError(path, problem, "move that file away to begin again")

    def current(self) -> Ratings:
        """Return the present content of the rater's file."""
        found = read_ratings(self.path)
        require_session(self.path, found, self.session)
        if found.rater != self.rater:
            raise InputError(self.path, f"has the scores of the rater '{found.rater}'", "give their initials")
        return found

    def give(self, shown: Any, score: Any) -> Ratings:
        """Write a score to the rater's file. shown: position of the scored trial in the order shown, counted from 1.
        Raises ValueError if this position or the score is invalid.
        """
        if type(score) is not int or not 0 <= score <= BEST_SCORE:
            raise ValueError(f"a score is a whole number from 0 to {BEST_SCORE}")
        with locked(self.path):
            held = self.current()
            if type(shown) is not int or not 1 <= shown <= len(held.rows):
                raise ValueError(f"there are {len(held.rows)} trials")
            after = held.with_score(shown, score, now_utc())
            write_ratings(self.path, after)
        return after


class RatingApi(ReviewApi):
    """The answers to requests of the page for raters. No answer contains the condition or the number of a trial."""

    def __init__(self, review: Review, spans: Spans, scores: ScoreFile) -> None:
        super().__init__(review)
        self.spans, self.scores = spans, scores
        self._get |= {"description": self._describe}
        self._post |= {"score": lambda body: json_response(_in_order(self.scores.give(body["shown"], body["score"])))}

    def _describe(self, query: Mapping[str, str]) -> Response:
        return json_response(
            {**describe_scene(self.review), "rater": self.scores.rater, "spans": self.spans, "best": BEST_SCORE}
            | _in_order(self.scores.current())
        )


def _in_order(ratings: Ratings) -> dict[str, Any]:
    return {"scores": [row.score for row in ratings.rows]}


class RatingServer(ReviewServer):
    """The server of the page for raters."""

    page = RATING_PAGE
    api: RatingApi


def open_rating(results: Path, recording: Path | None, rater: str, host: str, port: int) -> RatingServer:
    """Return a server, already listening, of the page on which a rater scores the trials of results. The scores are
    written to the file that ``ratings_beside`` names, beside the results folder.

    Raises InputError if results, recording or scores cannot be used or the results have no trials, AnchorposeError if
    the server cannot listen on ``host`` and ``port``.
    """
    initials = require_initials(results, rater)
    review = open_review(results, recording)
    trials = _trials_of(results, review)
    path = ratings_beside(results, initials)
    check_place(path, results, recording)
    scores = ScoreFile(path, initials, rated_session(review.run, trials), _shown(results, trials, review))
    by_number = {trial.number: trial for trial in trials.rows}
    hidden, spans = blind(review, [by_number[row.trial] for row in scores.current().rows])
    return RatingServer(RatingApi(hidden, spans, scores), host, port)


def require_initials(results: Path, rater: str) -> str:
    """Return the rater's initials in capital letters. Raises InputError for invalid initials; the error states the
    results folder that was to be rated.
    """
    try:
        return parse_initials(rater)
    except ValueError as error:
        raise InputError(results, f"cannot be rated: the rater's initials {error}", "give --rater AB") from None


def _trials_of(results: Path, review: Review) -> Trials:
    if not is_there(results / TRIALS_FILE):
        remedy = "run 'anchorpose measure' on it with --events first"
        raise InputError(results, "has no trials that could be rated", remedy)
    require_own(results, (TRIALS_FILE,), review.run)
    return read_trial_table(results / TRIALS_FILE)


def _shown(results: Path, trials: Trials, review: Review) -> list[int]:
    """Return the numbers of the trials that have at least two tracked frames; raises InputError if no trial has two."""
    parts = {trial.number: trial_rows(trial, review.joints.time_s) for trial in trials.rows}
    found = [number for number, part in parts.items() if part.stop - part.start >= LEAST_FRAMES]
    if not found:
        raise InputError(results / TRIALS_FILE, "has no trial of which two frames were tracked", "track them as well")
    return found
