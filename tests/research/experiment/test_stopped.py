"""The experiment as people meet it: stopped in the middle, gone on with, and the page at the end."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

CONFIG = """
recordings = 2
seconds = 1.5
holes_m = [0.0, 0.15]
scenes = ["paper"]
ablation = false
tuned = false
windows = 1
training_recordings = 2
training_samples = 40
methods = ["anchors", "nearest", "own"]
"""


def started(folder: Path) -> subprocess.Popen[str]:
    command = "import sys; from anchorpose.cli import main\nif __name__ == '__main__': sys.exit(main(sys.argv[1:]))"
    return subprocess.Popen(
        [sys.executable, "-c", command, "experiment", str(folder / "out"), "--config", str(folder / "config.toml")],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "TMPDIR": str(folder / "tmp")},
    )


def answers(folder: Path) -> set[Path]:
    return {path for path in (folder / "out" / "cache").rglob("*.npz") if path.parent.name in ("matched", "tracked")}


@pytest.mark.slow
def test_a_stopped_experiment_leaves_nothing_behind_and_goes_on_where_it_was(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    (tmp_path / "config.toml").write_text(CONFIG)
    (tmp_path / "tmp").mkdir()
    first, deadline = started(tmp_path), time.monotonic() + 300
    while len(answers(tmp_path)) < 2 and time.monotonic() < deadline:
        time.sleep(0.5)
    first.send_signal(signal.SIGTERM)
    assert first.wait(60) == 143
    kept = {path: path.stat().st_mtime_ns for path in answers(tmp_path)}
    assert len(kept) >= 2
    assert not list((tmp_path / "tmp").glob("anchorpose-*"))
    assert not list((tmp_path / "out").rglob("*partial*"))
    second = started(tmp_path)
    said, _ = second.communicate(timeout=600)
    assert second.returncode == 0, said
    assert len(answers(tmp_path)) == 2 * 2 * (3 + 2)
    assert all(path.stat().st_mtime_ns == written for path, written in kept.items())
    assert (tmp_path / "out" / "index.html").stat().st_size > 100_000
