"""One session of a batch, in a process of its own: tracked, gone on with, or left as it is where it is done."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from anchorpose.batch.sessions import Session
from anchorpose.remote import local_copy
from anchorpose.results.run_record import RUN_FILE, read_run
from anchorpose.results.unfinished import begun_identity, wait_until_free

ENDING_S: Final = 30.0  # for the child of a killed worker to end


def track_session(session: Session, results: Path) -> bool:
    """Tracks a session into a folder that appears when it is whole; returns whether there was anything to do.

    It is done where ``run.json`` has the identity of its inputs, settings, code and libraries. Results of another
    identity are replaced; an unfinished run of the same one goes on, of another it begins again. Raises what
    ``anchorpose track`` raises.
    """
    from anchorpose.cli.recording_verbs import as_recording
    from anchorpose.cli.track_verbs import track_locally

    results.parent.mkdir(parents=True, exist_ok=True)
    wait_until_free(results, ENDING_S)
    with local_copy(session.recording) as source:
        recording, begun = as_recording(source), begun_identity(results)
        resume = False
        if begun is not None or (results / RUN_FILE).is_file():
            identity = _identity(session, recording)
            if done_identity(results) == identity:
                return False
            resume = begun == identity
        track_locally(recording, results, replace(session.options, overwrite=True, resume=resume), "the same command")
    return True


def done_identity(results: Path) -> str | None:
    """The identity in the run.json of a results folder; None where there is none."""
    path = results / RUN_FILE
    return read_run(path).get("identity") if path.is_file() else None


def _identity(session: Session, recording: Path) -> str:
    from anchorpose.track_inputs import UserInputs, read_inputs

    options = session.options
    given = UserInputs(options.calibration, options.corrections)
    return read_inputs(recording, options.settings(), given).identity
