"""Compare results folders with the recordings of another system (``anchorpose evaluate --reference``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.agreement.matching import Match, match_results
from anchorpose.agreement.reference import exchanged, read_reference
from anchorpose.agreement.rows import (
    ALL,
    AS_MEASURED,
    INFERRED,
    MM,
    OFFSET_REMOVED,
    Agreement,
    agreement_rows,
    in_state,
)
from anchorpose.agreement.statistics import LEAST_SAMPLES
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.joints import JOINT_NAMES, JointState
from anchorpose.options import ReferenceSettings
from anchorpose.recording.document import read_json, require_rigid
from anchorpose.settings import Unfit

TRANSFORM_REMEDY: Final = 'write {"reference_to_world": four rows of four numbers}, in metres'


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Recordings side by side and what follows from all of them; subjects: of each match."""

    matches: tuple[Match, ...]
    subjects: tuple[str, ...]
    rows: tuple[Agreement, ...]


def compare_with_reference(
    results: Sequence[Path], references: Sequence[Path], subjects: Sequence[str], settings: ReferenceSettings
) -> Comparison:
    """One reference per results folder, in the same order; subjects: one per folder, or none: each is a person.

    Raises InputError or AnchorposeError where they do not belong together or cannot be used.
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
    named = tuple(subjects) or tuple(str(folder) for folder in results)
    rows = (*agreement_rows(matches, named), *distance_rows(matches, named))
    return Comparison(tuple(matches), named, rows)


def read_transform(path: Path) -> np.ndarray:
    """T_world_reference (4, 4) from a JSON file; raises InputError where it holds none."""
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
    """Of each joint, and of all; mean, root mean square and largest in millimetres."""
    rows = list[Agreement]()
    for offset in (AS_MEASURED, OFFSET_REMOVED):
        for column, name in (*enumerate(JOINT_NAMES), (None, "all joints")):
            for state in (ALL, INFERRED, *(each for each in JointState if each is not JointState.LOST)):
                found = [_distance(match, column, state, offset) for match in matches]
                distance = np.concatenate(found)
                if len(distance) >= LEAST_SAMPLES:
                    rows.append(_distance_row(name, str(state), offset, distance, len(set(subjects))))
    return rows


def _distance(match: Match, column: int | None, state: str, offset: str) -> np.ndarray:
    if match.placement is None:
        return np.empty(0)
    away = match.joints.position_m - match.theirs_m
    if offset == OFFSET_REMOVED:
        away = away - np.einsum("njik,jk->nji", match.axes, match.placement.offset_m)
    length = MM * np.linalg.norm(away, axis=2)
    chosen = np.isfinite(length) & in_state(match.joints.state_code.ravel(), state).reshape(length.shape)
    picked = slice(None) if column is None else slice(column, column + 1)
    return np.asarray(length[:, picked][chosen[:, picked]])


def _distance_row(name: str, state: str, offset: str, distance: np.ndarray, subjects: int) -> Agreement:
    return Agreement(
        kind="joint",
        name=name,
        axis="distance",
        state=state,
        offset=offset,
        unit="mm",
        samples=len(distance),
        repeated="subject",
        units=subjects,
        rmse=float(np.sqrt(np.mean(distance**2))),
        mean_abs=float(distance.mean()),
        largest=float(distance.max()),
    )
