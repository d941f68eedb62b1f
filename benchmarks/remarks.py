"""Describe scores of a row in words: for a column of a page's table, or for a part of the column ``also``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from intervals import wilson
from scipy.stats import median_abs_deviation

from anchorpose.results.uncertainty import NORMAL_95

Scores = Mapping[str, float]
Measured = Sequence[Scores]
"""The scores of all recordings of one row."""
NOTHING: Final = "–"  # shown if a row does not have the score


@dataclass(frozen=True, slots=True)
class Remark:
    """A summary of scores that is not their mean. words: returns that of one row; empty without these scores."""

    name: str
    title: str
    words: Callable[[Measured], str]
    align: ClassVar[str] = "---"

    def cell(self, measured: Measured) -> str:
        """Return the words, or a dash."""
        return self.words(measured) or NOTHING


def values_of(name: str, measured: Measured) -> np.ndarray:
    """Return a score of every recording, NaN for a recording without it."""
    return np.array([one.get(name, np.nan) for one in measured], dtype=np.float64)


def known_values(name: str, measured: Measured) -> np.ndarray:
    """Return a score of the recordings that have it."""
    values = values_of(name, measured)
    return values[np.isfinite(values)]


def _right(measured: Measured) -> str:
    right, trials = values_of("right", measured), np.nan_to_num(values_of("trials", measured), nan=1.0)
    if not (known := np.isfinite(right)).any():
        return ""
    count, of = round((right * trials)[known].sum()), round(trials[known].sum())
    low, high = wilson(count, of)
    return f"{count} of {of} ({100 * low:.0f} to {100 * high:.0f} %)"


def _labels(measured: Measured) -> str:
    if not (weights := known_values("labels", measured)).size:
        return ""
    within = (100 * np.average(known_values(name, measured), weights=weights) for name in ("within_60", "within_100"))
    return "{:.0f}, {:.0f} % of {:.0f} labels".format(*within, weights.sum())


def _confident_labels(measured: Measured) -> str:
    if not (weights := known_values("labels", measured)).size:
        return ""
    return f"{100 * np.average(known_values('label_confident', measured), weights=weights):.1f}"


def _contacts(measured: Measured) -> str:
    reported, touched = known_values("reported", measured), known_values("touched", measured)
    if reported.sum() + touched.sum() == 0:
        return ""
    shares = (
        f"{known_values(part, measured).sum() / whole.sum():.2f}" if whole.sum() else NOTHING
        for part, whole in (("reported_right", reported), ("touched_found", touched))
    )
    return "{} / {} of {:.0f} / {:.0f}".format(*shares, reported.sum(), touched.sum())


def _median(form: str, name: str) -> Callable[[Measured], str]:
    """Return the words for a median and a worst value over the recordings."""

    def words(measured: Measured) -> str:
        known = known_values(name, measured)
        return form.format(np.median(known), known.max()) if known.size else ""

    return words


def _middle(name: str) -> Callable[[Measured], str]:
    def words(measured: Measured) -> str:
        known = known_values(name, measured)
        return f"{np.median(known):.0f}" if known.size else ""

    return words


def _with_share(form: str, name: str, share: str) -> Callable[[Measured], str]:
    """Return the words for a median, and a mean share in per cent."""

    def words(measured: Measured) -> str:
        known = known_values(name, measured)
        return form.format(np.median(known), 100 * known_values(share, measured).mean()) if known.size else ""

    return words


def _mean_percent(name: str) -> Callable[[Measured], str]:
    def words(measured: Measured) -> str:
        known = known_values(name, measured)
        return f"{100 * known.mean():.0f}" if known.size else ""

    return words


def _sum(name: str) -> Callable[[Measured], str]:
    def words(measured: Measured) -> str:
        known = known_values(name, measured)
        return f"{known.sum():.0f}" if known.size else ""

    return words


def _about_median(name: str, measured: Measured) -> np.ndarray:
    values = values_of(name, measured)
    return values - np.nanmedian(values)


def _spread(measured: Measured) -> str:
    """Return the standard deviation per axis of joints about their median place beside the label, computed from the
    median absolute deviation: few large errors do not change it."""
    if not known_values("right_mm", measured).size:
        return ""
    away = np.concatenate([_about_median(name, measured) for name in ("right_mm", "below_mm")])
    return f"{median_abs_deviation(away, scale='normal', nan_policy='omit'):.0f}"


def label_sigma(measured: Measured) -> float:
    """Return sigma per axis (mm) of the mean of both labellers' positions of a joint; NaN without labels."""
    apart = known_values("apart_mm", measured)
    return float(np.sqrt(np.mean(apart**2) / 2.0) / 2.0) if apart.size else np.nan


def _of_labels(measured: Measured) -> str:
    return f"{sigma:.0f}" if np.isfinite(sigma := label_sigma(measured)) else ""


def _label_band(measured: Measured) -> str:
    """Return the share of axes on which a joint is within 1.96 sigma of its median place beside the label; this sigma
    combines the sigmas of the joint and of the labels."""
    if not known_values("right_mm", measured).size:
        return ""
    sigma = np.hypot(values_of("stated_mm", measured), label_sigma(measured))
    ratio = np.concatenate([_about_median(name, measured) / sigma for name in ("right_mm", "below_mm")])
    return f"{100 * np.mean(np.abs(ratio[np.isfinite(ratio)]) < NORMAL_95):.0f}"


def _refused(measured: Measured) -> str:
    return f"{sum(one.get('refused', 0.0) for one in measured):.0f} of {len(measured)}"


REFUSED: Final = Remark("refused_of", "refused", _refused)
REMARKS: Final = (
    Remark("right_of", "right", _right),
    Remark("wrong_accepted_of", "wrong accepted", _sum("accepted_wrong")),
    Remark("limb_wrong", "limb wrong in view, at most s", _median("{1:.1f}", "wrong_s")),
    Remark("within", "within 60, 100 mm", _labels),
    Remark("confident_labels", "confident errors %", _confident_labels),
    Remark("median_label", "median mm", _middle("median_mm")),
    Remark("tracked_plain", "tracked, % of frames in plain view", _mean_percent("tracked")),
    Remark("another_person", "another person", _sum("another")),
    Remark("thigh", "thigh against sensor, degrees", _median("{:.1f}, worst {:.1f}", "tilt_deg")),
    Remark("thigh_band", "within 1.96 sigma, %", _mean_percent("tilt_cover")),
    Remark("kinect", "Kinect's skeleton", _median("{:.1f}, worst {:.1f}", "kinect_deg")),
    Remark("contacts_of", "contacts: precision / recall", _contacts),
    Remark("bones", "bones mm", _with_share("{:.0f}, {:.0f} % in band", "bone_mm", "bone_cover")),
    Remark("skin", "skin mm", _with_share("{:.1f}, {:.0f} % within 12 mm", "skin_mm", "skin_near")),
    Remark("below", "below the label, mm", _middle("below_mm")),
    Remark("spread", "spread per axis, mm", _spread),
    Remark("labellers", "of the labels, mm", _of_labels),
    Remark("stated", "stated sigma, mm", _middle("stated_mm")),
    Remark("label_band", "within 1.96 sigma, %", _label_band),
    REFUSED,
)


def also(measured: Measured) -> str:
    """Return all remarks that a row has, in words."""
    shown = (one for one in REMARKS if one != REFUSED or any(scores.get("refused") for scores in measured))
    return "; ".join(f"{one.title} {words}" for one in shown if (words := one.words(measured)))


ALL_REMARKS: Final = Remark("also", "also", also)
