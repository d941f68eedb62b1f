"""Sessions really tracked: done means the same identity, and stopping costs nothing."""

import json
from contextlib import suppress
from pathlib import Path

import pytest

from anchorpose.batch.sessions import find_sessions
from anchorpose.batch.summary import SESSIONS, done_identity
from anchorpose.batch.tracking import track_session
from anchorpose.cli import main
from anchorpose.cli.track_verbs import TrackOptions
from anchorpose.errors import InputError
from anchorpose.results.unfinished import JOURNAL, unfinished_results
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording


@pytest.mark.slow
def test_done_means_the_same_identity_never_that_a_file_exists(tmp_path: Path) -> None:
    for seed in (3, 4):
        simulate_recording(tmp_path / f"s{seed}", single(seed, seconds=0.5, fps=10.0))
    command = ["batch", str(tmp_path / "s*" / "recording"), "-o", str(tmp_path / "out"), "--workers", "2"]
    assert main(command) == 0
    runs = sorted((tmp_path / "out" / "sessions").glob("*/run.json"))
    first = {path: path.stat().st_mtime_ns for path in runs}
    assert len(first) == 2
    assert main(command) == 0
    assert {path: path.stat().st_mtime_ns for path in runs} == first  # nothing is done again
    document = json.loads(runs[0].read_text())
    runs[0].write_text(json.dumps(document | {"identity": "of other inputs"}))
    assert main(command) == 0
    assert json.loads(runs[0].read_text())["identity"] == document["identity"]
    assert runs[1].stat().st_mtime_ns == first[runs[1]]
    assert main([*command, "--summary"]) == 0
    assert {row.state for row in SESSIONS.read(tmp_path / "out" / SESSIONS.file)} == {"done"}
    (session,) = find_sessions([str(tmp_path / "s3" / "recording")], TrackOptions(stop=3))
    assert track_session(session, runs[0].parent)  # other settings are another session
    assert done_identity(runs[0].parent) != document["identity"]


def test_a_session_that_is_refused_keeps_its_unfinished_run_though_its_journal_cannot_be_read(tmp_path: Path) -> None:
    simulate_recording(tmp_path / "s3", single(3, seconds=0.5, fps=10.0))
    results = tmp_path / "out"
    with suppress(KeyboardInterrupt), unfinished_results(results, None) as work:
        (work / JOURNAL).mkdir()
        (work / JOURNAL / "learnt").write_bytes(b"hours of work")
        raise KeyboardInterrupt
    (session,) = find_sessions([str(tmp_path / "s3" / "recording")], TrackOptions(start=99))
    with pytest.raises(InputError, match="has no frames 99"):
        track_session(session, results)
    assert (work / JOURNAL / "learnt").read_bytes() == b"hours of work"
