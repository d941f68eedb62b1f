"""Find the state of each session of a batch, and write two tables and the page index.html. The table of sessions has
the outcome of every session, and the table of measures has the measures of every session that is done; both are written
as parquet and as CSV. A session is done if the identity that its results state (a hash of inputs, settings, code and
libraries) is the identity that a new run would have.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final
from urllib.parse import quote

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq
from markupsafe import Markup

from anchorpose.batch.sessions import Session
from anchorpose.batch.worker import Outcome
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.joints import JointState
from anchorpose.recording.document import cell_text, read_json
from anchorpose.recording.recording_file import RECORDING_FILE
from anchorpose.recording.regular_file import is_there
from anchorpose.recording.writable import whole_file
from anchorpose.report.measure_section import title_of, value_text
from anchorpose.report.page import REPORT_FILE
from anchorpose.report.words import render_page
from anchorpose.results.folder import write_text_whole
from anchorpose.results.parquet import RecordTable, refuse_unreadable
from anchorpose.results.records import MEASURES_FILE, Measure, MeasureKey, read_measures
from anchorpose.results.run_record import RUN_FILE, read_run
from anchorpose.results.tables import JOINTS_FILE

DONE, FAILED, OPEN = "done", "failed", "open"
STATES: Final = (DONE, FAILED, OPEN)
RESULTS_FOLDER, LOGS_FOLDER = "sessions", "logs"
OTHER_RUN: Final = "tracked with other settings or inputs, or with another version of the program or its libraries"
AGAIN: Final = "write it again with 'anchorpose batch --summary'"


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionRow:
    """The row of a session in the table. state: one of ``STATES``; why: the reason why the session failed, or why it is
    open (still to be tracked) although it has results. The fields from ``frames`` on are None unless the session is
    done.

    length_s: time from the first frame to the last. The shares (observed, inferred, lost) refer to all joints in all
    frames. work_s: computing time of tracking, as in run.json.
    """

    session: str
    recording: str
    subject: str
    state: str
    why: str | None = None
    frames: int | None = None
    length_s: float | None = None
    seen_share: float | None = None
    inferred_share: float | None = None
    lost_share: float | None = None
    work_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureRow:
    """The row of one measure of one session in the table of measures. subject: the patient's name in the user's table;
    the fields from ``measure`` on are copied from the ``Measure``.
    """

    session: str
    subject: str
    measure: str
    side: str | None
    part: str | None
    value: float | None
    unit: str
    sigma: float | None
    why: str | None


_TEXT: Final = pa.string()
_TYPES: Final = {"str": _TEXT, "int": pa.int64(), "float": pa.float64()}


def _table(file: str, record: type, **known: tuple[str, ...]) -> RecordTable[Any]:
    """Return a table with a column for each field of the dataclass ``record``. known: the allowed texts of some
    columns, by the name of the column.
    """
    columns = [(field.name, _TYPES[str(field.type).partition(" ")[0]]) for field in fields(record)]
    return RecordTable(file=file, record=record, schema=pa.schema(columns), known=known, remedy=AGAIN)


SESSIONS: Final = _table("sessions.parquet", SessionRow, state=STATES)
MEASURES: Final = _table("measures.parquet", MeasureRow)
PAGE_FILE: Final = "index.html"
WRITTEN: Final = (".parquet", ".csv")  # endings of the two files of each table
MOVE_AWAY: Final = "move it away, or choose another folder for the batch"


def note_outcome(out: Path, outcome: Outcome) -> None:
    """Store the outcome of a session in a file beside its log, from which a later summary reads why the session
    failed.
    """
    path = _outcome_file(out, outcome.name)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text_whole(path, json.dumps({"why": outcome.why, "seconds": round(outcome.seconds, 1)}) + "\n")


def require_places(out: Path, sessions: Sequence[Session]) -> None:
    """Raise InputError if a path that the batch will write is a link, a file where a folder is needed, or a folder
    where a file is needed.
    """
    for name in (RESULTS_FOLDER, LOGS_FOLDER):
        if (out / name).is_symlink() or (is_there(out / name) and not (out / name).is_dir()):
            raise InputError(out / name, "is a link, or no folder", MOVE_AWAY)
    logs = (out / LOGS_FOLDER / f"{session.name}{ending}" for session in sessions for ending in (".log", ".json"))
    tables = (out / Path(table.file).with_suffix(ending) for table in (SESSIONS, MEASURES) for ending in WRITTEN)
    for path in (*logs, *tables, out / PAGE_FILE):
        if path.is_symlink() or (is_there(path) and not path.is_file()):
            raise InputError(path, "is a link, or no file", MOVE_AWAY)


def _outcome_file(out: Path, name: str) -> Path:
    return out / LOGS_FOLDER / f"{name}.json"


def done_identity(results: Path) -> str | None:
    """Return the identity (a hash of inputs, settings, code and libraries) that the run.json of a results folder
    states; None if the folder has no such file or identity.
    """
    path = results / RUN_FILE
    return read_run(path).get("identity") if path.is_file() else None


def identity_of(session: Session, recording: Path, known: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return the identity (a hash of inputs, settings, code and libraries) that a new run of the session would have.
    known: SHA-256 by path within ``recording``, for files that need not be read again.
    """
    from anchorpose.track_inputs import UserInputs, read_inputs

    options = session.options
    given = UserInputs(options.calibration, options.corrections, options.events)
    return read_inputs(recording, options.settings(), given, known).identity


def is_current(session: Session, results: Path) -> bool:
    """Return whether the results are current: whether a new run would have the identity (a hash of inputs, settings,
    code and libraries) that they state. Depth images are not hashed again if ``run.json`` has their hashes.

    Return True if nothing can be compared: the recording is at an address, does not exist, was not converted, or cannot
    be read.
    """
    from anchorpose.sources.convert import ENDING

    if session.place is None:
        return True
    places = (session.place, session.place.with_name(session.place.name + ENDING))
    recording = next((place for place in places if is_there(place / RECORDING_FILE)), None)
    if recording is None:
        return True
    hashes = read_run(results / RUN_FILE).get("inputs_sha256", {})
    images = {name: digest for name, digest in hashes.items() if name.endswith(".png")}
    try:
        return identity_of(session, recording, images) == done_identity(results)
    except AnchorposeError:
        return True  # the recording was damaged after it had been tracked


def row_of(
    out: Path, session: Session, outcomes: Mapping[str, str | None] = MappingProxyType({})
) -> tuple[SessionRow, tuple[Measure, ...]]:
    """Return the row of a session from the files in the batch's folder, and the session's measures if it is done.

    A session that failed in its last run counts as failed even if results exist. A session whose results a new run
    would replace counts as open (still to be tracked). outcomes: for each session that has just run, by name, why it
    failed; None if it did not fail.
    """
    results = out / RESULTS_FOLDER / session.name
    who: dict[str, Any] = {"session": session.name, "recording": session.shown, "subject": session.subject}
    try:
        why = outcomes[session.name] if session.name in outcomes else _noted(out, session.name)
        if why is not None:
            return SessionRow(**who, state=FAILED, why=why), ()
        if not is_there(results / RUN_FILE):
            return SessionRow(**who, state=OPEN), ()
        if session.name not in outcomes and not is_current(session, results):
            return SessionRow(**who, state=OPEN, why=OTHER_RUN), ()
        return SessionRow(**who, state=DONE, **_figures(results)), _measures(results)
    except (AnchorposeError, OSError) as error:
        return SessionRow(**who, state=FAILED, why=str(error)), ()


def _noted(out: Path, name: str) -> str | None:
    """Return the reason why a session failed in its last run; None if it did not fail or has not run."""
    path = _outcome_file(out, name)
    if not is_there(path):
        return None
    try:
        why = read_json(path).get("why")
    except InputError as error:
        raise InputError(path, f"is damaged: it {error.problem}", "run the batch again, without --summary") from None
    return None if why is None else str(why)


def _figures(results: Path) -> dict[str, Any]:
    """Return the fields of ``SessionRow`` from ``frames`` on, for a finished session. The joints are read in batches of
    rows, since the joints of many hours do not fit in memory.
    """
    path, counts, first_s, last_s, frames = results / JOINTS_FILE, dict[str, int](), None, None, 0
    with refuse_unreadable(path), pq.ParquetFile(path, page_checksum_verification=True) as file:
        for batch in file.iter_batches(columns=["frame", "time_s", "state"]):
            for entry in pc.value_counts(batch["state"]).to_pylist():
                counts[entry["values"]] = counts.get(entry["values"], 0) + entry["counts"]
            span = pc.min_max(batch["time_s"]).as_py()
            first_s = span["min"] if first_s is None else min(first_s, span["min"])
            last_s = span["max"] if last_s is None else max(last_s, span["max"])
    run = read_run(results / RUN_FILE)
    joints, frames = sum(counts.values()), int(run.get("frame_count", 0))
    if not joints:
        raise InputError(path, "holds no joint", "run the batch again")
    seen, lost = counts.get(JointState.OBSERVED, 0), counts.get(JointState.LOST, 0)
    return {
        "frames": frames,
        "length_s": float(last_s) - float(first_s),  # type: ignore[arg-type]
        "seen_share": seen / joints,
        "inferred_share": (joints - seen - lost) / joints,
        "lost_share": lost / joints,
        "work_s": sum(stage["seconds"] for stage in run.get("timings", [])),
    }


def _measures(results: Path) -> tuple[Measure, ...]:
    """Return the measures of a session, except measures that refer to one particular person besides the patient; empty
    if the session was not measured.
    """
    path = results / MEASURES_FILE
    return tuple(measure for measure in read_measures(path) if measure.person is None) if is_there(path) else ()


def write_tables(out: Path, rows: Sequence[SessionRow], measures: Iterable[tuple[SessionRow, Measure]]) -> None:
    """Write the tables of sessions and of measures, each completely or not at all."""
    _write(out, SESSIONS, rows)
    names = ("measure", "side", "part", "value", "unit", "sigma", "why")
    _write(
        out,
        MEASURES,
        [
            MeasureRow(session=row.session, subject=row.subject, **{name: getattr(one, name) for name in names})
            for row, one in measures
        ],
    )


def _write(out: Path, table: RecordTable[Any], rows: Sequence[Any]) -> None:
    path = out / table.file
    with whole_file(path) as partial, whole_file(path.with_suffix(".csv")) as in_csv:
        table.write(partial, rows)
        pyarrow.csv.write_csv(_for_spreadsheets(pq.read_table(partial)), in_csv)


def _for_spreadsheets(table: pa.Table) -> pa.Table:
    """Return the table with changed texts, so that spreadsheets do not run any text as a formula."""
    for index, column in enumerate(table.schema):
        if column.type == _TEXT:
            cells = [cell and cell_text(cell) for cell in table[column.name].to_pylist()]
            table = table.set_column(index, column, pa.array(cells, _TEXT))
    return table


MOST_COMPARED: Final = 300  # maximum number of sessions whose measures are on the page; the tables have all sessions

UNKNOWN: Final = Markup('<span title="{}">–</span>')


def write_page(out: Path, rows: Sequence[SessionRow], measures: dict[str, tuple[Measure, ...]]) -> Path:
    """Write index.html. measures: by session name, the measures of the session."""
    counts = Counter(row.state for row in rows)
    compared = [row for row in rows if row.state == DONE][:MOST_COMPARED]
    page = render_page(
        "anchorpose.batch",
        "page.html",
        title=f"{len(rows)} sessions",
        counts=[(state, counts[state]) for state in STATES if counts[state]],
        sessions=[(_name(row), _cells(row)) for row in rows],
        explained=[row for row in rows if row.why],
        measure_titles=list(_titles(compared, measures).values()),
        measures=_measure_rows(compared, measures),
        left_out=counts[DONE] - len(compared),
    )
    write_text_whole(out / PAGE_FILE, page)
    return out / PAGE_FILE


def _name(row: SessionRow) -> Markup:
    if row.state != DONE:
        return Markup("{}").format(row.session)
    return Markup('<a href="{}">{}</a>').format(quote(f"{RESULTS_FOLDER}/{row.session}/{REPORT_FILE}"), row.session)


def _cells(row: SessionRow) -> list[str]:
    shares = (row.seen_share, row.inferred_share, row.lost_share)
    return [
        row.subject,
        row.state,
        _clock(row.length_s),
        "" if row.frames is None else str(row.frames),
        *("" if share is None else f"{100 * share:.1f}" for share in shares),
        _clock(row.work_s),
    ]


def _clock(seconds: float | None) -> str:
    if seconds is None:
        return ""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


def _titles(rows: Sequence[SessionRow], measures: dict[str, tuple[Measure, ...]]) -> dict[MeasureKey, str]:
    return {one.key: title_of(one) for row in rows for one in measures[row.session] if one.part is None}


def _measure_rows(
    rows: Sequence[SessionRow], measures: dict[str, tuple[Measure, ...]]
) -> list[tuple[Markup, list[Markup]]]:
    """Return the rows of the page's table of measures: the session's name, and a cell per measure."""
    keys = list(_titles(rows, measures))
    found = [{one.key: one for one in measures[row.session]} for row in rows]
    return [(_name(row), [_value(own.get(key)) for key in keys]) for row, own in zip(rows, found, strict=True)]


def _value(measure: Measure | None) -> Markup:
    if measure is None or measure.value is None:
        return UNKNOWN.format("did not occur" if measure is None else measure.why)
    return Markup("{}").format(value_text(measure))
