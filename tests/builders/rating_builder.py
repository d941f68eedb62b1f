"""The small session of the viewer's tests with trials, and a running page for a rater of them."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from viewer_builder import PERIOD_S, write_small_session

from anchorpose.recording.events import Trial, TrialColumn, Trials
from anchorpose.results.trial_table import TRIALS_FILE, write_trials
from anchorpose.viewer.rating import RatingServer, open_rating

CONDITIONS = ("quiet-off", "loud-on", "quiet-off", "loud-on", "quiet-off")
AMPLITUDE = 31.25
LENGTHS = (7, 9, 8, 6, 10)
"""Frames of each trial, all different: a trial can be known by its length."""


def small_trials() -> Trials:
    """Five trials of the small session, one after the other."""
    ends = [sum(LENGTHS[:k]) for k in range(len(LENGTHS))]
    rows = [
        Trial(k + 1, name, first * PERIOD_S, length * PERIOD_S, first * PERIOD_S, (AMPLITUDE, "near L1"))
        for k, (name, first, length) in enumerate(zip(CONDITIONS, ends, LENGTHS, strict=True))
    ]
    return Trials((TrialColumn("amplitude", "mA"), TrialColumn("electrodes", None)), tuple(rows))


def write_rated_session(folder: Path) -> tuple[Path, Path]:
    """Results with trials, and their recording."""
    results, recording = write_small_session(folder)
    write_trials(results / TRIALS_FILE, small_trials())
    return results, recording


@contextmanager
def rating_of(results: Path, recording: Path | None = None, rater: str = "AB") -> Iterator[RatingServer]:
    """A running page for a rater on a free port of this machine."""
    server = open_rating(results, recording, rater, "127.0.0.1", 0)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
