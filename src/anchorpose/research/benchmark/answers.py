"""Read and check a folder of a method's answers: answers.json, and tables of joints and of matches (CSV or Parquet)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.csv

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_NAMES
from anchorpose.recording.document import read_json, require_distinct
from anchorpose.recording.regular_file import open_regular
from anchorpose.research.benchmark.make import Benchmark
from anchorpose.research.benchmark.plan import ALL_GROUPS, FPS, GAPS, SECONDS, VERSION, Pair
from anchorpose.research.benchmark.truth import read_nodes
from anchorpose.results.parquet import read_any_parquet

FORMAT: Final = "anchorpose-benchmark-answers"
ABOUT: Final = "answers.json"
ABOUT_REMEDY: Final = f'give {{"format": "{FORMAT}", "version": {VERSION}, "method": "...", "source": "..."}}'
PLACE: Final = {"x_m": pa.float64(), "y_m": pa.float64(), "z_m": pa.float64()}
JOINTS: Final = {"recording": pa.string(), "frame": pa.int64(), "joint": pa.string(), **PLACE, "sigma_m": pa.float64()}
MATCHES: Final = {"task": pa.string(), "pair": pa.string(), "node": pa.int64(), "match": pa.int64()}
OPTIONAL: Final = "sigma_m"
MAY_BE_EMPTY: Final = frozenset((*PLACE, OPTIONAL, "match"))
FARTHEST_M: Final = 100.0  # m, maximum coordinate; no room is as large, so greater coordinates must be in millimetres
NO_ROW, NO_MATCH = -2, -1
"""Values in ``Answers.matches``. ``NO_ROW``: the answers have no row for the node; ``NO_MATCH``: the answers state that
the node has no match.
"""


@dataclass(frozen=True, slots=True, eq=False)
class JointAnswers:
    """The answers about the joints of one recording; values that the answers do not give are NaN."""

    position_m: np.ndarray  # (t, 21, 3), metres, world, in t frames
    sigma_m: np.ndarray  # (t, 21), metres, standard deviation of the position's error along each axis


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """All answers about the recordings of a benchmark folder."""

    method: str  # name of the method
    source: str  # reference to a description of the method
    joints: Mapping[str, JointAnswers]  # by name of the recording
    # by task and name of the pair of frames, (n,) int64: for each node of the first frame, the number of its match
    # among the nodes of the second frame; ``NO_MATCH`` if the answer is that no match exists, ``NO_ROW`` if the answers
    # have no row for the node
    matches: Mapping[tuple[str, str], np.ndarray]
    elsewhere: int  # number of rows about recordings that are not in the benchmark folder


def read_answers(folder: Path, benchmark: Benchmark) -> Answers:
    """Return the answers about recordings in the benchmark folder; raises InputError about the first fault found."""
    method, source = _read_about(folder / ABOUT)
    joints, matches = (_table_file(folder, name) for name in ("joints", "matches"))
    if joints is None and matches is None:
        raise InputError(folder, "has no answers", "add joints.csv, joints.parquet, matches.csv or matches.parquet")
    by_recording, absent = ({}, 0) if joints is None else _read_joints(joints, benchmark)
    by_pair, absent_too = ({}, 0) if matches is None else _read_matches(matches, benchmark)
    return Answers(method, source, by_recording, by_pair, absent + absent_too)


def _read_about(path: Path) -> tuple[str, str]:
    """Return the name and source of the method."""
    try:
        document = read_json(path)
        form, version, method = (document[key] for key in ("format", "version", "method"))
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(path, f"cannot be used ({error})", ABOUT_REMEDY) from None
    if form != FORMAT or version != VERSION or not (isinstance(method, str) and method.strip()):
        raise InputError(path, f"is not about answers to version {VERSION} of the benchmark", ABOUT_REMEDY)
    return " ".join(method.split()), " ".join(str(document.get("source", "")).split())


def _table_file(folder: Path, name: str) -> Path | None:
    found = [path for ending in ("csv", "parquet") if (path := folder / f"{name}.{ending}").is_file()]
    if len(found) > 1:
        raise InputError(found[1], f"is beside {found[0].name}", "keep one of the two")
    return found[0] if found else None


def read_table(path: Path, columns: Mapping[str, pa.DataType]) -> dict[str, np.ndarray]:
    """Return the columns of a CSV or Parquet file by their names, as arrays of texts, int64 or float64.

    An empty cell is ``NO_MATCH`` in the column ``match``, and NaN in a column of float64. The column sigma_m (standard
    deviation of a position's error) may be left out. Raises InputError if a column is missing, unknown or of another
    type, or if a required cell is empty.
    """
    remedy = f"give the columns {', '.join(columns)}" + (" (sigma_m may be left out)" if OPTIONAL in columns else "")
    try:
        table = _csv(path, columns) if path.suffix == ".csv" else read_any_parquet(path)
        require_distinct(path, table.column_names)
        missing = [name for name in columns if name not in table.column_names and name != OPTIONAL]
        unknown = [name for name in table.column_names if name not in columns]
        if missing or unknown:
            raise ValueError(f"it has no column {missing[0]}" if missing else f"it has an unknown column {unknown[0]}")
        found = {name: table[name].cast(columns[name]).combine_chunks() for name in table.column_names}
    except InputError as error:
        raise InputError(path, error.problem, remedy) from None
    except (ValueError, pa.ArrowException, OSError) as error:
        raise InputError(path, f"cannot be read ({str(error).splitlines()[0][:120]})", remedy) from None
    for name, column in found.items():
        if column.null_count and name not in MAY_BE_EMPTY:
            row = int(np.flatnonzero(column.is_null().to_numpy(zero_copy_only=False))[0])
            raise InputError(path, f"has no {name} in {_row(row)}", "fill it in, or leave the row out")
    return {name: _as_numpy(name, column) for name, column in found.items()}


def _csv(path: Path, columns: Mapping[str, pa.DataType]) -> Any:
    convert = pyarrow.csv.ConvertOptions(column_types=dict(columns), strings_can_be_null=True)
    with open_regular(path) as file:
        return pyarrow.csv.read_csv(file, convert_options=convert)


def _as_numpy(name: str, column: Any) -> np.ndarray:
    values: np.ndarray = (column.fill_null(NO_MATCH) if name == "match" else column).to_numpy(zero_copy_only=False)
    return values


def _row(index: int) -> str:
    return f"row {index + 1} after the header"


def codes_of(path: Path, name: str, values: np.ndarray, known: Sequence[str]) -> np.ndarray:
    """Return (rows,): for each text in ``values``, its index in ``known``; raises InputError for a text not in
    ``known``.
    """
    texts = pa.array(values, pa.string()).dictionary_encode()
    place = {text: index for index, text in enumerate(known)}
    codes = np.array([place.get(text, -1) for text in texts.dictionary.to_pylist()], np.int64)[texts.indices.to_numpy()]
    if (codes < 0).any():
        row = int(np.flatnonzero(codes < 0)[0])
        raise InputError(path, f"names the unknown {name} '{values[row]}' in {_row(row)}", f"use one like '{known[0]}'")
    return codes


def refuse_row(path: Path, wrong: np.ndarray, problem: str, remedy: str) -> None:
    """Raise InputError about the first row where ``wrong`` (rows,) is true."""
    if wrong.any():
        raise InputError(path, f"{problem} in {_row(int(np.flatnonzero(wrong)[0]))}", remedy)


def repeated(*keys: np.ndarray) -> np.ndarray:
    """Return (rows,) bool: rows that have the same values in all ``keys`` as an earlier row."""
    one = np.zeros(len(keys[0]), np.int64)
    for key in keys:
        one = np.unique(one, return_inverse=True)[1] * (key.max(initial=0) + 1) + key
    again = np.ones(len(one), bool)
    again[np.unique(one, return_index=True)[1]] = False
    return again


def _read_joints(path: Path, benchmark: Benchmark) -> tuple[dict[str, JointAnswers], int]:
    table, frames = read_table(path, JOINTS), round(SECONDS * FPS)
    known = [name for group in ALL_GROUPS for name in group.recordings.values()]
    named = (("recording", known), ("joint", JOINT_NAMES))
    recording, joint = (codes_of(path, name, table[name], names) for name, names in named)
    frame, place = table["frame"], np.column_stack([table[name] for name in PLACE])
    sigma = table.get(OPTIONAL, np.full(len(frame), np.nan))
    refuse_row(path, (frame < 0) | (frame >= frames), "has a frame out of range", f"frames are 0 to {frames - 1}")
    check_places(path, place)
    refuse_row(
        path,
        ~np.isnan(sigma) & ~((sigma > 0) & (sigma < np.inf)),
        "has a sigma_m that is not above 0",
        "give metres, or leave it empty",
    )
    refuse_row(path, repeated(recording, frame, joint), "repeats an earlier row", "give each joint and frame once")
    present = {name for group in benchmark.groups for name in group.recordings.values()}
    found = dict[str, JointAnswers]()
    for code in np.unique(recording).tolist():
        rows = recording == code
        position, spread = np.full((frames, JOINT_COUNT, 3), np.nan), np.full((frames, JOINT_COUNT), np.nan)
        position[frame[rows], joint[rows]], spread[frame[rows], joint[rows]] = place[rows], sigma[rows]
        if known[code] in present:
            found[known[code]] = JointAnswers(position, spread)
    return found, int(sum(known[code] not in present for code in recording))


def check_places(path: Path, place_m: np.ndarray) -> None:
    """Raise InputError if a position in ``place_m`` (rows, 3) lacks some but not all of its coordinates (NaN), or is
    farther than ``FARTHEST_M`` metres along an axis.
    """
    empty, finite = np.isnan(place_m), np.isfinite(place_m).all(axis=1)
    refuse_row(path, ~finite & ~empty.all(axis=1), "has part of a position", "give x_m, y_m and z_m, or none of them")
    far = finite & (np.abs(place_m) > FARTHEST_M).any(axis=1)
    refuse_row(path, far, f"has a position over {FARTHEST_M:g} m away", "give metres")


def _read_matches(path: Path, benchmark: Benchmark) -> tuple[dict[tuple[str, str], np.ndarray], int]:
    table = read_table(path, MATCHES)
    pairs = {pair.name: pair for group in ALL_GROUPS for pair in group.pairs if pair.task == next(iter(GAPS))}
    task, pair = (codes_of(path, n, table[n], names) for n, names in (("task", list(GAPS)), ("pair", list(pairs))))
    node, match = table["node"], table["match"]
    refuse_row(path, node < 0, "has a node below 0", "count nodes from 0")
    refuse_row(path, repeated(task, pair, node), "repeats an earlier row", "give each node of a pair once")
    present = {(one.task, one.name): one for group in benchmark.groups for one in group.pairs}
    found, absent, sizes = dict[tuple[str, str], np.ndarray](), 0, dict[str, int]()
    for number in np.unique(task * len(pairs) + pair).tolist():
        key = (list(GAPS)[number // len(pairs)], list(pairs)[number % len(pairs)])
        rows = np.flatnonzero(task * len(pairs) + pair == number)
        if key not in present:
            absent += len(rows)
            continue
        first, second = _sizes(benchmark.folder, present[key], sizes)
        wrong = np.zeros(len(node), bool)
        wrong[rows] = (node[rows] >= first) | (match[rows] < NO_MATCH) | (match[rows] >= second)
        refuse_row(
            path,
            wrong,
            f"{key[1]} has {first} nodes, and {second} in its second frame: no such node",
            "count from 0, and leave match empty where there is none",
        )
        found[key] = np.full(first, NO_ROW, np.int64)
        found[key][node[rows]] = match[rows]
    return found, absent


def _sizes(folder: Path, pair: Pair, known: dict[str, int]) -> tuple[int, int]:
    """Return the numbers of nodes of the two frames of a pair; ``known`` caches the numbers by file name."""
    for name in (pair.first, pair.second):
        if name not in known:
            known[name] = len(read_nodes(folder / name))
    return known[pair.first], known[pair.second]
