"""Compare the identity that a session's results state with the identity that a new run would have."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from anchorpose.batch.sessions import Session
from anchorpose.errors import AnchorposeError
from anchorpose.recording.recording_file import RECORDING_FILE
from anchorpose.recording.regular_file import is_there
from anchorpose.results.run_record import RUN_FILE, read_run


def done_identity(results: Path) -> str | None:
    """Return the identity in the run.json of a results folder; None if the folder has no such file or identity."""
    path = results / RUN_FILE
    return read_run(path).get("identity") if path.is_file() else None


def identity_of(session: Session, recording: Path, known: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return the identity that a new run would have. known: hashes of files of the recording that are not read."""
    from anchorpose.track_inputs import UserInputs, read_inputs

    options = session.options
    given = UserInputs(options.calibration, options.corrections, options.events)
    return read_inputs(recording, options.settings(), given, known).identity


def is_current(session: Session, results: Path) -> bool:
    """Return whether a new run would have the identity that the results state, without reading all depth images: the
    hash of an image that still exists is taken from ``run.json``.

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
