"""How fast the patient moves by himself, measured over as many frames as his own last frames show to be best."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

_CHECKED: Final = 6  # one-frame predictions that each span is judged by: times some 60 columns, enough
_SHARPNESS: Final = 4  # a span whose squared error is a fifth larger counts half


def span_shares(history: np.ndarray, spans: Sequence[int]) -> np.ndarray:
    """(s,) float64, sum 1: how much the velocity over each span (frames, rising) is to be believed.

    A short span follows the movement, a long one averages the noise out; which is better is seen in how well each would
    have predicted the newest frames from the ones before, all columns together. A span that the history (k, d), newest
    last, is too short to judge has no share; with two frames the shortest has all. Columns with missing values are left
    out.
    """
    known = history[:, np.isfinite(history).all(axis=0)]
    squared = np.full(len(spans), np.inf)
    for number, span in enumerate(spans):
        if len(history) < span + 2:
            break
        velocity = (known[span:-1] - known[: -1 - span]) / span
        missed = known[span + 1 :] - known[span:-1] - velocity
        squared[number] = (missed[-_CHECKED:] ** 2).sum(axis=1).mean() if known.size else np.inf
    if not np.isfinite(squared).any():
        return np.eye(len(spans))[0]
    share = ((squared.min() + 1e-12) / (squared + 1e-12)) ** _SHARPNESS
    return share / share.sum()


def velocity(poses: np.ndarray, spans: Sequence[int], shares: np.ndarray, at: int = -1) -> np.ndarray:
    """(..., d) a frame: at pose ``at`` (from the end) of (..., k, d), newest last; a span that does not fit is cut."""
    total = np.zeros(poses.shape[:-2] + poses.shape[-1:])
    for span, share in zip(spans, shares, strict=True):
        if share > 0:
            reach = min(span, poses.shape[-2] + at)
            total += share * (poses[..., at, :] - poses[..., at - reach, :]) / reach
    return total
