"""Export a results folder: write each format into a separate folder. If one format cannot be written, no format is
written. This module also writes the format CSV.

The CSV export has every table of the results, wide tables of joints and angles, a long table of the measures of all
trials, and a dictionary of all columns.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from glob import escape
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from anchorpose import __version__
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.exports.bids import write_bids
from anchorpose.exports.bvh import write_bvh
from anchorpose.exports.c3d import write_c3d
from anchorpose.exports.formats import Format, Product, Source, number_text, read_source, write_text
from anchorpose.exports.opensim_coordinates import write_mot
from anchorpose.exports.opensim_trc import write_trc
from anchorpose.joints import JOINT_NAMES, STATE_NAMES
from anchorpose.options import ExportConfig
from anchorpose.recording.document import cell_text, read_json
from anchorpose.recording.events import Trial, TrialColumn, Trials
from anchorpose.recording.writable import check_place
from anchorpose.report.words import read_words
from anchorpose.results.folder import FolderKind, check_results_path, whole_or_nothing
from anchorpose.results.frame_time import blocks
from anchorpose.results.parquet import opened_parquet, pieces
from anchorpose.results.ratings import rating_measures
from anchorpose.results.records import MEASURES, MEASURES_FILE, Measure, read_trial_measures
from anchorpose.results.run_record import RUN_FILE, hash_files, read_run
from anchorpose.results.trial_table import FIXED, TRIALS_FILE, read_trial_table

_MEANING: Final = {
    row["column"]: (row["unit"], row["meaning"]) for row in read_words("anchorpose.exports", "columns.csv")
}
"""The unit and the meaning of each column; a column has the same unit and meaning in every table."""

DICTIONARY_FILE: Final = "data_dictionary.csv"
DICTIONARY_HEAD: Final = ("file", "column", "type", "unit", "meaning", "missing")


BY_TRIAL_FILE: Final = "measures_by_trial.csv"
TRIAL_HEAD: Final = ("trial", "condition", "onset_s", "duration_s")
TRIAL_MEASURE: Final = tuple(field.name for field in MEASURES.schema if field.name not in TRIAL_HEAD)


def _described(
    file: str, name: str, kind: str, column: str, thing: str = "", own: Mapping[str, TrialColumn] | None = None
) -> tuple[str, ...]:
    """Return a row of the data dictionary; unit and meaning are empty for a column that is in neither ``_MEANING`` nor
    ``own``. thing: joint or angle of a column in a wide table; own: columns that the user added to the trials, by name.
    """
    unit, meaning = _MEANING.get(column, ("", ""))
    if own and column in own:
        unit, meaning = own[column].unit or "", own[column].description or "as given in the events file"
    return file, name, kind, unit, f"{thing}: {meaning}" if thing else meaning, "empty cell"


def write_csv(folder: Path, source: Source, config: ExportConfig) -> Product:
    """Write joints_wide.csv, angles_wide.csv (if the results have angles), data_dictionary.csv, and a CSV for each
    table of the results that holds no images.

    If the results have trials, also write measures_by_trial.csv, with a row per trial and measure.
    """
    dictionary, notes, rows = list[tuple[str, ...]](), list[str](), 0
    trials = read_trial_table(source.folder / TRIALS_FILE) if (source.folder / TRIALS_FILE).exists() else None
    own = {} if trials is None else {column.name: column for column in trials.columns}
    for path in sorted(source.folder.glob("*.parquet")):
        with opened_parquet(path) as file:
            schema, count = file.schema_arrow, file.metadata.num_rows
        if any(pa.types.is_binary(kind) or pa.types.is_large_binary(kind) for kind in schema.types):
            continue  # leaves out tables with images of person labels, which only the viewer uses
        name = f"{path.stem}.csv"
        rows += count
        _write(folder / name, schema.names, _rows(path))
        of_user = own if path.name == TRIALS_FILE else {}
        dictionary += [_described(name, field.name, _kind(field.type), field.name, own=of_user) for field in schema]
        notes += _metadata(name, schema)
    samples = source.samples
    joints = {f"{axis}_m": samples.position_m[..., place] for place, axis in enumerate("xyz")}
    joints |= {"sigma_m": samples.joint_sigma_m, "state": samples.joint_state_code}
    angles = {"degrees": samples.degrees, "sigma_deg": samples.sigma_deg, "state": samples.angle_state_code}
    dictionary += _write_wide(folder / "joints_wide.csv", source, JOINT_NAMES, joints)
    if samples.angles:
        dictionary += _write_wide(folder / "angles_wide.csv", source, samples.angles, angles)
    if trials is not None:
        dictionary += _write_by_trial(folder / BY_TRIAL_FILE, source, trials)
    _write(folder / DICTIONARY_FILE, DICTIONARY_HEAD, dictionary)
    return Product(
        axes="X forward, Y up, Z to the patient's right",
        units="in the names of the columns (_m metres, _s seconds, _deg and degrees) and in the data dictionary",
        time="as recorded",
        missing="an empty cell; state says why",
        counts=(("frames", len(source.frame)), ("rows_of_long_tables", rows)),
        notes=(f"{DICTIONARY_FILE} explains each column.", "UTF-8, commas, decimal points, one line of names.", *notes),
    )


def _write_by_trial(path: Path, source: Source, trials: Trials) -> list[tuple[str, ...]]:
    """Write a table for mixed (statistical) models, and return the rows that describe it in the data dictionary. The
    table has a row per trial and measure, and rows for the raters' scores of each trial. Every row repeats the trial's
    condition and times, and the values of the columns that the user added to ``events.tsv``.
    """
    names = [*TRIAL_HEAD, *(column.name for column in trials.columns), *TRIAL_MEASURE]
    by_number = {trial.number: trial for trial in trials.rows}
    rated = rating_measures(source.folder, read_run(source.folder / RUN_FILE), trials)
    measures = [*read_trial_measures(source.folder / MEASURES_FILE), *rated]
    _write(path, names, (_by_trial_row(by_number[row.trial], row) for row in measures if row.trial in by_number))
    kinds = {field.name: _kind(field.type) for field in (*MEASURES.schema, *FIXED)}
    kinds |= {column.name: "text" if column.unit is None else "number" for column in trials.columns}
    own = {column.name: column for column in trials.columns}
    return [_described(path.name, name, kinds[name], name, own=own) for name in names]


def _by_trial_row(trial: Trial, measure: Measure) -> list[str]:
    about = (trial.number, trial.condition, trial.onset_s, trial.duration_s, *trial.cells)
    return [_cell(value) for value in (*about, *(getattr(measure, name) for name in TRIAL_MEASURE))]


def _metadata(name: str, schema: pa.Schema) -> list[str]:
    """Return the metadata of a table, such as its smoothing, as notes, since a CSV cannot hold metadata."""
    texts = {key.decode(): value.decode(errors="replace") for key, value in (schema.metadata or {}).items()}
    return [f"{name}, {key}: {value}" for key, value in texts.items() if key != "pandas"]


def _kind(kind: pa.DataType) -> str:
    if pa.types.is_boolean(kind):
        return "true or false"
    if pa.types.is_integer(kind):
        return "whole number"
    return "number" if pa.types.is_floating(kind) else "text"


def _cells(column: pa.ChunkedArray) -> list[str]:
    if pa.types.is_float32(column.type):  # write the shortest text that gives the same float32 when read
        return ["" if value is None or value != value else str(np.float32(value)) for value in column.to_pylist()]
    return [_cell(value) for value in column.to_pylist()]


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return number_text(value) if isinstance(value, float) else str(value)


def _rows(path: Path) -> Iterator[tuple[str, ...]]:
    """Yield the rows of a table as texts; raises InputError if it cannot be read."""
    with opened_parquet(path) as file:
        for piece in pieces(file):
            yield from zip(*(_cells(column) for column in piece.columns), strict=True)


def _write_wide(
    path: Path, source: Source, things: Sequence[str], parts: dict[str, np.ndarray]
) -> list[tuple[str, ...]]:
    """Write a wide table, with a row per frame and the columns ``parts`` for each of ``things`` (joints or angles);
    return the rows that describe the table in the data dictionary.
    """
    columns = {"frame": source.frame, "time_s": source.samples.time_s}
    dictionary = [_described(path.name, "frame", "whole number", "frame")]
    dictionary.append(_described(path.name, "time_s", "number", "time_s"))
    for number, thing in enumerate(things):
        for part, values in parts.items():
            name, kind = f"{thing}_{'deg' if part == 'degrees' else part}", "text" if part == "state" else "number"
            columns[name] = values[:, number]
            dictionary.append(_described(path.name, name, kind, part, thing))
    _write(path, list(columns), _wide_rows(list(columns.values())))
    return dictionary


def _wide_rows(columns: Sequence[np.ndarray]) -> Iterator[tuple[str, ...]]:
    """Yield the rows of columns (n,) as texts; state codes (int8) become the names of the states."""
    for rows in blocks(len(columns[0])):
        some = (values[rows] for values in columns)
        texts = ([STATE_NAMES[v] if each.dtype == np.int8 else _cell(v) for v in each.tolist()] for each in some)
        yield from zip(*texts, strict=True)


def _write(path: Path, names: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\r\n")  # RFC 4180
        writer.writerow(names)
        writer.writerows([cell_text(cell) for cell in row] for row in rows)


RECORD_FILE: Final = "export.json"
EXPORT: Final = FolderKind("an export", (RECORD_FILE,), (RECORD_FILE,))
EXPORTS_FOLDER: Final = "exports"

_WRITERS: Final[dict[Format, Callable[[Path, Source, ExportConfig], Product]]] = {
    Format.TRC: write_trc,
    Format.MOT: write_mot,
    Format.C3D: write_c3d,
    Format.CSV: write_csv,
    Format.BVH: write_bvh,
    Format.BIDS: write_bids,
}


def export_results(
    results: Path, formats: Sequence[Format], config: ExportConfig, out: Path | None = None, overwrite: bool = False
) -> tuple[tuple[Path, Product], ...]:
    """Write ``out``/trc, ``out``/csv and so on, each with its export.json; return each folder with the report on its
    files.

    out: by default the folder ``exports`` in the results. Folders of earlier exports are replaced only with
    ``overwrite``; other folders and files are never touched. If InputError or MissingPackage is raised, no file was
    written.
    """
    target = out if out is not None else results / EXPORTS_FOLDER
    if not results.is_dir():
        raise InputError(results, "there is no such folder", "give a results folder made by 'anchorpose track'")
    check_place(target)
    sha256 = hash_files(sorted(results.glob("*.parquet")), results)
    for kind in formats:
        if (target / kind).resolve() == results.resolve():
            raise InputError(target / kind, "is the results folder itself", "choose another folder with -o")
        check_results_path(target / kind, None, overwrite, EXPORT)
    done = []
    with ExitStack() as places:
        for kind in formats:
            folder = places.enter_context(whole_or_nothing(target / kind, _own_files(target / kind)))
            product = _WRITERS[kind](folder, read_source(results, kind), config)
            _write_record(folder, kind, sha256, product)
            done.append((target / kind, product))
    return tuple(done)


def parse_formats(text: str) -> tuple[Format, ...]:
    """Parse a text such as ``trc,csv`` as formats, each once; raises AnchorposeError for an unknown name."""
    names = [name.strip().lower() for name in text.split(",")]
    for name in names:
        if name not in tuple(Format):
            raise AnchorposeError(
                f"--to '{name}' is not a format; choose from {', '.join(Format)}, with commas between."
            )
    return tuple(dict.fromkeys(Format(name) for name in names))


def _own_files(folder: Path) -> tuple[str, ...]:
    """Return patterns of the files in a folder that may be replaced, since an earlier export wrote them; the result is
    empty without such files. Raises InputError if export.json, the record of the earlier export, cannot be read.
    """
    record = folder / RECORD_FILE
    files = read_json(record).get("files", []) if record.is_file() else []
    if not isinstance(files, list):
        raise InputError(record, "'files' is not a list of names", "remove this folder, or choose another with -o")
    return (RECORD_FILE, *(escape(str(file)) for file in files)) if files else ()


def _write_record(folder: Path, kind: Format, sha256: tuple[tuple[str, str], ...], product: Product) -> None:
    """Write export.json into ``folder``. sha256: name and hash of each table of the results, sorted by name."""
    files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    document: dict[str, Any] = {
        "format": "anchorpose-export",
        "version": 1,
        "to": str(kind),
        "versions": {"anchorpose": __version__, **{name: metadata.version(name) for name in product.tools}},
        **{name: getattr(product, name) for name in ("axes", "units", "time", "missing")},
        "counts": dict(product.counts),
        "notes": product.notes,
        "files": files,
        "sources_sha256": dict(sha256),
    }
    write_text(folder / RECORD_FILE, json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
