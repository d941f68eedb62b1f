"""Scores of made-up raters, in files as 'anchorpose view --rate' writes them."""

from collections.abc import Sequence
from pathlib import Path

from anchorpose.results.ratings import Ratings, draw_order, write_ratings


def rated(rater: str, scores: Sequence[int | None], session: str = "s1", seed: int = 1) -> Ratings:
    """The scores of the trials 1, 2 and so on."""
    ratings = draw_order(rater, seed, session, range(1, len(scores) + 1))
    for row in ratings.rows:
        if (score := scores[row.trial - 1]) is not None:
            ratings = ratings.with_score(row.shown, score, "2026-03-01T09:00:00Z")
    return ratings


def write_scores(path: Path, rater: str, scores: Sequence[int | None], session: str = "s1", seed: int = 1) -> Path:
    """A rater's file."""
    write_ratings(path, rated(rater, scores, session, seed))
    return path
