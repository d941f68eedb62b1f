"""Whether the tables of a results folder are those that were written into it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from anchorpose.errors import InputError
from anchorpose.recording.regular_file import is_there
from anchorpose.results.event_log import LOG_FILE, read_log
from anchorpose.results.parquet import MEASURE_AGAIN
from anchorpose.results.records import EPISODES_FILE, MEASURES_FILE
from anchorpose.results.run_document import read_run
from anchorpose.results.run_record import RUN_FILE, hash_files
from anchorpose.results.tables import ANGLES_FILE, POSTURE_FILE, PROCESSED_FILE

MEASURED: Final = frozenset({ANGLES_FILE, POSTURE_FILE, PROCESSED_FILE, EPISODES_FILE, MEASURES_FILE})
"""Tables that 'anchorpose measure' writes again from the joints."""


def require_own(results: Path, files: Iterable[str], run: Mapping[str, Any] | None = None) -> None:
    """Raises InputError where one of the files is another than the one whose hash the folder's log or run.json has.

    run: the run.json, where it was read already. Files of which no hash is known are accepted, as in older results.
    """
    known = _known(results, run)
    there = [results / name for name in files if name in known and (results / name).is_file()]
    for name, digest in hash_files(there, results):
        if digest != known[name]:
            remedy = MEASURE_AGAIN if name in MEASURED else "copy that folder again, or track the recording again"
            problem = (
                "is not the table that was written into this folder: its hash is another than in run.json or the log"
            )
            raise InputError(results / name, problem, remedy)


def _known(results: Path, run: Mapping[str, Any] | None) -> dict[str, str]:
    """The hash of each file as it was written last. The log alone knows of tables that were measured again."""
    if run is None:
        run = read_run(results / RUN_FILE) if is_there(results / RUN_FILE) else {}
    written = run.get("outputs_sha256", {})
    logged: dict[str, str | None] = {name: digest for name, digest in written.items() if name not in MEASURED}
    log = read_log(results) if is_there(results / LOG_FILE) else None
    for event in log.events if log else ():
        logged |= event.files
    return {name: digest for name, digest in logged.items() if digest is not None}
