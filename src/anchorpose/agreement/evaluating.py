"""Compare results folders with the recordings of another system (``anchorpose evaluate --reference``).

In the table of agreement, each coordinate of a joint and each angle has two rows per joint state: as measured, and with
a constant offset removed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.agreement.matching import Match, match_results
from anchorpose.agreement.reference import exchanged, read_reference
from anchorpose.agreement.statistics import (
    LEAST_SAMPLES,
    LEAST_UNITS,
    calibration_error,
    coverage_95,
    limits_of_agreement,
    waveform_correlation,
)
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.joints import JOINT_NAMES, LOST, STATE_CODE, JointState
from anchorpose.options import ReferenceSettings
from anchorpose.recording.document import read_json, require_rigid
from anchorpose.settings import Unfit

AXES: Final = ("x", "y", "z")
AS_MEASURED, OFFSET_REMOVED = "as_measured", "offset_removed"
ALL, INFERRED = "all", "inferred"
STATES: Final = (ALL, INFERRED, *(str(state) for state in JointState if state is not JointState.LOST))


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """One row of the table of agreement; fields are None where undefined. Values are in ``unit``. Differences are this
    program's value minus the other system's. ``lower`` and ``upper`` are the limits of agreement; ``cmc`` is the
    coefficient of multiple correlation. A field with the ending ``_low`` or ``_high`` is an end of the 95 % interval of
    the field without this ending.

    kind: joint (joint centres), angle (computed from the joints of both systems by this program's formula) or
    given_angle (as the other system computes it). axis: x, y, z of the world, distance, or degrees. state: all,
    inferred (neither observed nor lost), or one of ``JointState``. offset: ``as_measured``, or ``offset_removed`` if
    the constant difference due to different definitions of the joint or angle is subtracted. repeated: the kind of unit
    that counts as one repetition (a subject, or a stretch of time); units: number of repetitions.
    """

    kind: str
    name: str
    axis: str
    state: str
    offset: str
    unit: str
    samples: int
    repeated: str
    units: int
    bias: float | None = None
    bias_low: float | None = None
    bias_high: float | None = None
    lower: float | None = None
    lower_low: float | None = None
    lower_high: float | None = None
    upper: float | None = None
    upper_low: float | None = None
    upper_high: float | None = None
    within_sd: float | None = None
    between_sd: float | None = None
    rmse: float
    mean_abs: float
    largest: float
    cmc: float | None = None
    range_ours: float | None = None
    range_theirs: float | None = None
    range_error: float | None = None
    coverage_95: float | None = None
    calibration_error: float | None = None


COLUMNS: Final = tuple(each.name for each in fields(Agreement))


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """The compared values of one quantity in one recording, NaN where unknown. ours (n,): values of the results, with
    sigma (n,) and state_code (n,); theirs (n,): values of the other system; time_s (n,): times of both systems' values.

    offset (n,): the part of the difference ``ours`` minus ``theirs`` that is due to different definitions of the joint
    or angle.
    """

    ours: np.ndarray
    theirs: np.ndarray
    sigma: np.ndarray
    offset: np.ndarray
    state_code: np.ndarray
    time_s: np.ndarray

    def chosen(self, state: str) -> np.ndarray:
        """Return (n,) bool: True for frames in which all values are known and the joint has the given state. For an
        angle, the worst state of its joints counts.
        """
        known = np.isfinite(self.ours + self.theirs + self.offset) & (self.state_code != LOST)
        return np.asarray(known & in_state(self.state_code, state))


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity to be compared. take: function that returns the quantity's values in a match (a recording that both
    systems measured), or None if one of the systems lacks the quantity.
    """

    kind: str
    name: str
    axis: str
    unit: str
    take: Callable[[Match], Compared | None]


def quantities(matches: Sequence[Match]) -> list[Quantity]:
    """Return all quantities that can be compared: coordinates and angles of joints, and angles in the other system's
    file.
    """
    given = dict.fromkeys(name for match in matches for name in match.reference.angles)
    return [
        *(
            Quantity("joint", name, axis, "mm", partial(_joint, joint=joint, axis=column))
            for joint, name in enumerate(JOINT_NAMES)
            for column, axis in enumerate(AXES)
        ),
        *(Quantity("angle", name, "degrees", "deg", partial(_angle, name=name)) for name in matches[0].ours.names),
        *(Quantity("given_angle", name, "degrees", "deg", partial(_given, name=name)) for name in given),
    ]


def agreement_rows(matches: Sequence[Match], subjects: Sequence[str]) -> list[Agreement]:
    """Return the rows of the table of agreement, each computed over all recordings. subjects: the name of the person in
    each match; matches with the same name count as matches of one person.
    """
    rows = list[Agreement]()
    for quantity in quantities(matches):
        taken = [(quantity.take(match), subject) for match, subject in zip(matches, subjects, strict=True)]
        series = [(each, subject) for each, subject in taken if each is not None]
        for offset, state in product((AS_MEASURED, OFFSET_REMOVED), STATES):
            parts = [(each, subject, each.chosen(state)) for each, subject in series]
            parts = [part for part in parts if part[2].any()]
            if sum(int(chosen.sum()) for _, _, chosen in parts) >= LEAST_SAMPLES:
                rows.append(_row(quantity, parts, state, offset))
    return rows


Parts = Sequence[tuple[Compared, str, np.ndarray]]
"""The data behind one row of the table of agreement, one entry per recording: the compared values, the subject, and the
chosen frames (n,) bool.
"""


def _row(quantity: Quantity, parts: Parts, state: str, offset: str) -> Agreement:
    differences = [_difference(each, offset)[chosen] for each, _, chosen in parts]
    units = [stretches(each.time_s[chosen], d) for (each, _, chosen), d in zip(parts, differences, strict=True)]
    repeated, unit = _repeated([subject for _, subject, _ in parts], units)
    error = np.concatenate(differences)
    sigma = np.concatenate([each.sigma[chosen] for each, _, chosen in parts])
    independent = min(len(error), PER_STRETCH * sum(len(np.unique(each)) for each in units))
    limits = limits_of_agreement(error, unit, independent)
    ends = {"bias": limits.bias, "lower": limits.lower, "upper": limits.upper}
    return _error_row(
        (quantity.kind, quantity.name, quantity.axis, quantity.unit),
        error,
        state=state,
        offset=offset,
        repeated=repeated,
        units=limits.units,
        within_sd=limits.within_sd,
        between_sd=limits.between_sd,
        coverage_95=coverage_95(error, sigma),
        calibration_error=calibration_error(error, sigma),
        **{name: end.value for name, end in ends.items()},
        **{f"{name}_low": end.low for name, end in ends.items()},
        **{f"{name}_high": end.high for name, end in ends.items()},
        **(_shape(parts, offset) if state == ALL else {}),
    )


def _error_row(about: tuple[str, str, str, str], error: np.ndarray, **values: Any) -> Agreement:
    """Return a row with the statistics of ``error`` (n,). about: kind, name, axis and unit of the quantity."""
    size, (kind, name, axis, unit) = np.abs(error), about
    return Agreement(
        kind=kind,
        name=name,
        axis=axis,
        unit=unit,
        samples=len(error),
        rmse=float(np.sqrt(np.mean(error**2))),
        mean_abs=float(size.mean()),
        largest=float(size.max()),
        **values,
    )


def _shape(parts: Parts, offset: str) -> dict[str, Any]:
    """Return the coefficient of multiple correlation, both systems' ranges (largest minus smallest value), and the
    difference of the ranges, each as the mean over recordings. If ``offset`` is ``offset_removed``, the other system's
    values are converted to this program's definition of the joint or angle.
    """
    pairs = [
        (each.ours[chosen], (each.theirs + each.offset if offset == OFFSET_REMOVED else each.theirs)[chosen])
        for each, _, chosen in parts
    ]
    cmc = [waveform_correlation(*pair) for pair in pairs]
    ranges = [tuple(float(np.ptp(values)) for values in pair) for pair in pairs]
    ours, theirs = np.mean(ranges, axis=0)
    return {
        "cmc": None if None in cmc else float(np.mean(np.array(cmc, dtype=np.float64))),
        "range_ours": float(ours),
        "range_theirs": float(theirs),
        "range_error": float(np.mean([a - b for a, b in ranges])),
    }


PER_STRETCH: Final = 2
"""Length of a stretch of time, as a multiple of the correlation time of the errors. A stretch counts as this many
independent differences.
"""


def stretches(time_s: np.ndarray, difference: np.ndarray) -> np.ndarray:
    """Return the index (n,) of the stretch of time to which each frame belongs. A stretch lasts ``PER_STRETCH``
    correlation times of the errors, at least one second, so that errors of different stretches are independent.
    """
    step_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    centred = difference - difference.mean()
    most = min(len(centred) - 1, round(10.0 / step_s))
    variance = float((centred**2).mean())
    correlation = (
        [float((centred[:-lag] * centred[lag:]).mean()) / variance for lag in range(1, most)] if variance else []
    )
    below = next((k for k, r in enumerate(correlation) if r < 0.1), len(correlation))
    length_s = max(1.0, PER_STRETCH * step_s * (1.0 + 2.0 * sum(correlation[:below])))
    return np.floor((time_s - time_s[0]) / length_s).astype(np.int64)


def _repeated(subjects: Sequence[str], units: Sequence[np.ndarray]) -> tuple[str, np.ndarray]:
    if len(set(subjects)) >= LEAST_UNITS:
        names = sorted(set(subjects))
        return "subject", np.concatenate(
            [np.full(len(unit), names.index(subject)) for subject, unit in zip(subjects, units, strict=True)]
        )
    start, parts = 0, list[np.ndarray]()
    for unit in units:
        parts.append(unit + start)
        start += int(unit.max()) + 1
    return "stretch of time", np.concatenate(parts)


def _difference(each: Compared, offset: str) -> np.ndarray:
    difference = each.ours - each.theirs
    return difference - each.offset if offset == OFFSET_REMOVED else difference


def in_state(state_code: np.ndarray, state: str) -> np.ndarray:
    """Return (...) bool: True where the state code belongs to ``state``, which is one of ``STATES``."""
    if state == ALL:
        return np.ones(state_code.shape, dtype=bool)
    if state == INFERRED:
        return np.asarray((state_code > 0) & (state_code < LOST))
    return np.asarray(state_code == STATE_CODE[JointState(state)])


def _joint(match: Match, joint: int, axis: int) -> Compared | None:
    if match.placement is None or not np.isfinite(match.placement.offset_m[joint]).all():
        return None
    offset_m = (match.axes[:, joint] @ match.placement.offset_m[joint])[:, axis]
    joints = match.joints
    return Compared(
        1000.0 * joints.position_m[:, joint, axis],
        1000.0 * match.theirs_m[:, joint, axis],
        1000.0 * joints.sigma_m[:, joint],
        1000.0 * offset_m,
        joints.state_code[:, joint],
        joints.time_s,
    )


def _angle(match: Match, name: str) -> Compared | None:
    theirs = match.theirs
    return None if theirs is None else _of_angle(match, name, theirs.degrees[:, theirs.column(name)])


def _given(match: Match, name: str) -> Compared | None:
    names = match.reference.angles
    return _of_angle(match, name, match.given_deg[:, names.index(name)]) if name in names else None


def _of_angle(match: Match, name: str, theirs: np.ndarray) -> Compared | None:
    column = match.ours.column(name)
    ours = match.ours.degrees[:, column]
    theirs = ours - (ours - theirs + 180.0) % 360.0 + 180.0  # shifted by whole turns, to within 180 degrees of ``ours``
    known = np.isfinite(ours - theirs)
    if not known.any():
        return None
    offset = np.full(len(ours), float(np.median((ours - theirs)[known])))
    return Compared(
        ours, theirs, match.ours.sigma_deg[:, column], offset, match.ours.state_code[:, column], match.joints.time_s
    )


NOT_NAMED: Final = "not named"
"""Name that stands for the person of every recording if the user names no person."""

TRANSFORM_REMEDY: Final = 'write {"reference_to_world": four rows of four numbers}, in metres'


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Matched recordings, the name of the person in each recording (``subjects``; ``NOT_NAMED`` if no names are given),
    and the rows of agreement over all recordings.
    """

    matches: tuple[Match, ...]
    subjects: tuple[str, ...]
    rows: tuple[Agreement, ...]


def compare_with_reference(
    results: Sequence[Path], references: Sequence[Path], subjects: Sequence[str], settings: ReferenceSettings
) -> Comparison:
    """Compare each results folder with the reference at the same index of ``references``. subjects: the person of each
    folder; if empty, all folders count as recordings of one person, so the result does not claim to be valid for other
    people.

    Raises InputError or AnchorposeError if a folder and its reference do not belong together or cannot be used.
    """
    if len(references) != len(results):
        raise AnchorposeError(
            f"{len(results)} results and {len(references)} references were given; give --reference once per folder."
        )
    if subjects and len(subjects) != len(results):
        raise AnchorposeError(
            f"{len(results)} results and {len(subjects)} subjects were given; give --subject once per folder, or never."
        )
    given = None if settings.transform is None else read_transform(settings.transform)
    matches = []
    for folder, path in zip(results, references, strict=True):
        reference = read_reference(path, settings.unit, settings.names, settings.hip)
        reference = exchanged(reference) if settings.exchange_sides else reference
        matches.append(match_results(folder, reference, given))
    named = tuple(subjects) or (NOT_NAMED,) * len(results)
    rows = (*agreement_rows(matches, named), *distance_rows(matches, named))
    return Comparison(tuple(matches), named, rows)


def read_transform(path: Path) -> np.ndarray:
    """Read the reference's pose T_world_reference (4, 4) from a file; raises InputError if it has no such matrix."""
    document: Any = read_json(path)
    rows = document.get("reference_to_world") if isinstance(document, dict) else None
    try:
        matrix = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise InputError(path, "has no reference_to_world of four rows of four numbers", TRANSFORM_REMEDY)
    try:
        return require_rigid(matrix)
    except Unfit as error:
        raise InputError(path, f"its reference_to_world {error}", TRANSFORM_REMEDY) from None


def distance_rows(matches: Sequence[Match], subjects: Sequence[str]) -> list[Agreement]:
    """Return rows with the mean, root mean square and largest distance (mm) between the joint positions of both
    systems, per joint and for all joints together.
    """
    rows, named = list[Agreement](), [(name, slice(k, k + 1)) for k, name in enumerate(JOINT_NAMES)]
    for offset, (name, column), state in product(
        (AS_MEASURED, OFFSET_REMOVED), (*named, ("all joints", slice(None))), STATES
    ):
        distance = np.concatenate([_distance(match, column, state, offset) for match in matches])
        if len(distance) >= LEAST_SAMPLES:
            people = {"repeated": "subject", "units": len(set(subjects))}
            about = ("joint", name, "distance", "mm")
            rows.append(_error_row(about, distance, state=state, offset=offset, **people))
    return rows


def _distance(match: Match, column: slice, state: str, offset: str) -> np.ndarray:
    if match.placement is None:
        return np.empty(0)
    away = match.joints.position_m - match.theirs_m
    if offset == OFFSET_REMOVED:
        away = away - np.einsum("njik,jk->nji", match.axes, match.placement.offset_m)
    length = 1000.0 * np.linalg.norm(away, axis=2)
    chosen = np.isfinite(length) & in_state(match.joints.state_code, state)
    return np.asarray(length[:, column][chosen[:, column]])
