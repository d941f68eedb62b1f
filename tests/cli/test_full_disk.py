"""A disk that takes no more bytes: every verb that writes names the place, and leaves nothing half-written."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from places_builder import make_places
from sources_builder import noise, tum

from anchorpose.cli import main

resource = pytest.importorskip("resource", reason="limits of a process exist on POSIX only")


@contextmanager
def full_disk() -> Iterator[None]:
    """The system refuses to write more than 64 bytes into a file as it does on a full disk: by a number, without the
    file's name."""
    before, compiles = resource.getrlimit(resource.RLIMIT_FSIZE), sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # Python 3.11 leaves half of a compiled module there, which nobody can import
    resource.setrlimit(resource.RLIMIT_FSIZE, (64, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = compiles


VERBS = {
    "simulate": ["{out}", "--seconds", "0.1", "--preset", "single"],
    "convert": ["{tum}", "{out}", "--intrinsics", "30,30,15.5,11.5"],
    "calibrate": ["{recording}", "-o", "{out}"],
    "track": ["{recording}", "-o", "{out}"],
    "batch": ["{recording}", "-o", "{out}"],
    "report": ["{results}"],
    "export": ["{results}", "--to", "csv", "-o", "{out}"],
    "measure": ["{results}"],
    "evaluate": ["{results}", "--truth", "{truth}", "--json", "{out}"],
    "motions": ["build", "{out}.npz", "{results}"],
    "experiment": ["{out}", "--quick"],
}
WRITES_INTO_RESULTS = {"report", "measure"}


@pytest.fixture(scope="module")
def places(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("given")
    tum(folder / "tum", noise())
    return make_places(folder, "session-17") | {"tum": folder / "tum"}


@pytest.mark.parametrize("verb", VERBS)
def test_a_full_disk_is_reported_with_the_place(verb, places, tmp_path, capsys):
    out = tmp_path / "ward-north"
    given = [one.format(**places | {"out": out}) for one in VERBS[verb]]
    before = sorted(path.name for path in places["results"].iterdir())
    with full_disk():
        code = main([verb, *given])
    said = " ".join(capsys.readouterr().err.split())
    assert code == 2, said
    assert (places["results"] if verb in WRITES_INTO_RESULTS else out).name in said, said
    assert "File too large" in said, said  # what this limit is called; on a full disk: no space left
    assert sorted(path.name for path in places["results"].iterdir()) == before
