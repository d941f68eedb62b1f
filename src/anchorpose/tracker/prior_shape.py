"""Collect the prior knowledge of the patient's body shape: stature by age and sex, the user's statements, bodies to try
first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Final, Literal

import numpy as np

from anchorpose.body.initial import FirstShape
from anchorpose.body.matched_places import STATURES_M
from anchorpose.body.shape_prior import ShapeBelief, adult_belief, child_belief, shape_of_height, standing_height
from anchorpose.body.skin_points import FittedShape, body_points
from anchorpose.recording.recording import Recording, Subject
from anchorpose.tracker.config import TrackConfig

Sex = Literal["female", "male"]

LAST_YEARS: Final = 19.0  # years, last age of the table below; from this age on, a person has an adult's stature
YOUNGEST_YEARS: Final = 3.0  # years, first age of the table below; younger children count as this old
_GROWTH_M: Final[dict[Sex, tuple[float, ...]]] = {
    "female": (
        0.951,
        1.027,
        1.094,
        1.151,
        1.208,
        1.266,
        1.325,
        1.386,
        1.450,
        1.512,
        1.564,
        1.598,
        1.617,
        1.625,
        1.629,
        1.631,
        1.632,
    ),
    "male": (
        0.961,
        1.033,
        1.100,
        1.160,
        1.217,
        1.273,
        1.326,
        1.378,
        1.431,
        1.491,
        1.560,
        1.632,
        1.690,
        1.729,
        1.752,
        1.761,
        1.765,
    ),
}
"""Median statures in metres at 3, 4, ... 19 years: WHO growth standards (to 5 years) and WHO reference 2007 (de Onis et
al. 2007, doi:10.2471/BLT.07.043497).
"""

_SPREAD: Final = 0.045  # standard deviation of statures, divided by their median; the WHO states 4 to 5 % for every age
_ADULT_M: Final[dict[Sex, tuple[float, float]]] = {"female": (1.629, 0.064), "male": (1.756, 0.069)}
"""Mean and standard deviation (m) of the stature of 1,986 women and 4,082 men: ANSUR II (Gordon et al. 2014,
NATICK/TR-15/007).
"""


def stature_m(age_years: float | None, sex: Sex | None) -> tuple[float, float]:
    """Return mean and standard deviation of the stature in metres. Without an age, an adult is assumed; an age below 3
    years counts as 3 years.
    """
    sexes: tuple[Sex, ...] = ("female", "male") if sex is None else (sex,)
    if age_years is None or age_years >= LAST_YEARS:
        mean, spread = np.mean([_ADULT_M[one] for one in sexes], axis=0).tolist()
    else:
        years = np.arange(YOUNGEST_YEARS, LAST_YEARS + 1.0)
        mean = float(np.mean([np.interp(age_years, years, _GROWTH_M[one]) for one in sexes]))
        spread = _SPREAD * mean
    apart = 0.0 if sex else abs(_ADULT_M["male"][0] - _ADULT_M["female"][0]) / 2.0 * mean / _ADULT_M["female"][0]
    return mean, float(np.hypot(spread, apart if age_years is None or age_years > 12.0 else 0.0))


# factors on the stature that is estimated by the learnt descriptor; bodies of both statures are tried, since real
# people are often 5 to 10 % shorter than this estimate
TALLER = (1.0, 0.92)
ADULT_HEIGHTS_M = (1.45, 2.0)  # m, limits of the height of an adult body that is tried
CHILD_HEIGHTS_M = (0.95, 1.55)  # m, limits of the height of a child's body that is tried
ORDINARY_HEIGHT_M = 1.70  # m, assumed height of an adult whose height is not given
# standard deviations; a stated height is not used if it differs by more than this from the visible height
CONTRADICTS = 3.0
# m, systematic error of a height from images, due to shoes, hair and bodies that differ from the model
SYSTEMATIC_M = 0.02
TRIED_SIGMA_M = 0.01  # m, assumed error of a tried height; small, so that the fitted body gets this height


def ordinary_height_m(recording: Recording) -> float:
    """Return the patient's height if it is given, else the mean height for the given age and sex."""
    subject = recording.subject
    if subject.height_m is not None:
        return subject.height_m
    return ORDINARY_HEIGHT_M if subject.age_years is None else stature_m(subject.age_years, subject.sex)[0]


def known_beliefs(subject: Subject, config: TrackConfig) -> tuple[ShapeBelief, ...]:
    """Return the prior beliefs in the patient's shape: first an adult's, then a child's unless the patient is known to
    be an adult.

    A measured height is included as an observation. Without a measured height, the height follows from age and sex if
    they are stated.
    """
    asset = body_points().asset
    groups = (adult_belief,) if subject.grown else (adult_belief, child_belief)
    beliefs = [group(asset).covering(asset, subject.covered).lacking(tuple(subject.missing)) for group in groups]
    if subject.height_m is not None:
        return tuple(belief.standing(asset, subject.height_m, config.learning.height_sigma_m) for belief in beliefs)
    if subject.grown is not None and (subject.age_years is not None or subject.sex is not None):
        beliefs[-1] = beliefs[-1].standing(asset, *stature_m(subject.age_years, subject.sex))
    return tuple(beliefs)


def likeliest(beliefs: Sequence[ShapeBelief], shape: FittedShape) -> ShapeBelief:
    """Return the belief (adult or child) under which a shape's whole-body coefficients and clothes are likeliest."""
    asset = body_points().asset
    return min(beliefs, key=lambda belief: belief.common(asset).cost(shape))


def shape_cost(shape: FittedShape, subject: Subject, config: TrackConfig) -> float:
    """Return the sum of a shape's squared deviations, in standard deviations, from the mean of its likeliest group
    (adults or children). Half of this sum is the cost in nats, as for a normal distribution.
    """
    likely = likeliest(known_beliefs(subject, config), shape)
    return float(likely.common(body_points().asset).cost(shape))


def shapes_to_try(stature_m: float, subject: Subject, config: TrackConfig) -> FirstShape:
    """Return the bodies to try first. These bodies have the stated stature or, if none is stated, the visible stature,
    and agree with the other statements about the patient.

    A child's body is included only if a child may have this stature, or if the stated age is a child's.
    """
    asset, tried = body_points().asset, list[ShapeBelief]()
    heights_m = [share * stature_m for share in TALLER] if subject.height_m is None else [subject.height_m]
    for belief, seen_m in product(known_beliefs(subject, config), heights_m):
        child = belief.mean[0] != 0.0
        shortest, tallest = CHILD_HEIGHTS_M if child else ADULT_HEIGHTS_M
        if child and subject.age_years is None and not shortest <= seen_m <= tallest:
            continue
        height_m = seen_m if subject.height_m is not None else float(np.clip(seen_m, shortest, tallest))
        shape = belief.standing(asset, height_m, TRIED_SIGMA_M).shape if child else shape_of_height(asset, height_m)
        tried.append(replace(belief.common(asset), shape=replace(shape, missing=belief.shape.missing)))
    return FirstShape(tried, config.learning.own_shape)


def contradiction(subject: Subject, seen: ShapeBelief, config: TrackConfig) -> str:
    """Return how the user's statements contradict a body that was learnt without them; empty if they agree."""
    if subject == subject.unmeasured or (
        subject.height_m is None and subject.age_years is None and subject.sex is None
    ):
        return ""
    seen_m, row = standing_height(body_points().asset, seen.shape)
    spread_m = float(np.sqrt(seen.variance(row[None])[0]))
    if subject.height_m is not None:
        stated_m, sigma_m, what = subject.height_m, config.learning.height_sigma_m, "height"
    else:
        stated_m, sigma_m = stature_m(subject.age_years, subject.sex)
        what = "age or sex"
    if abs(seen_m - stated_m) <= CONTRADICTS * np.hypot(np.hypot(spread_m, sigma_m), SYSTEMATIC_M):
        return ""
    return (
        f"the stated {what} of the patient ({stated_m:.2f} m tall) contradicts the images, which show a person of "
        f"{seen_m:.2f} m; it was not used: correct recording.json"
    )


def is_human(shape: FittedShape) -> bool:
    """Return whether a person may be as tall as this shape; if not, the shape was probably fitted to a part of a
    person.
    """
    shortest, tallest = STATURES_M
    return shortest < standing_height(body_points().asset, shape)[0] < tallest
