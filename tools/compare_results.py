"""Track the same recordings with two versions of the code and tell whether their tables agree byte for byte.

    python tools/compare_results.py OLD_SRC NEW_SRC RECORDING... [--smooth RECORDING...] [--keep FOLDER]

OLD_SRC and NEW_SRC are ``src`` folders, for example of two git worktrees. Each recording is tracked by both. Results of
OLD_SRC that --keep holds from an earlier call are reused; delete them when OLD_SRC changes.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pyarrow.parquet as pq

TABLES = ("joints", "angles", "poses", "anchors", "contacts", "people", "posture", "episodes", "measures",
          "explained")  # fmt: skip


def track(source: Path, recording: Path, results: Path, smooth: bool) -> None:
    """Track a recording with the package in ``source``."""
    run = "import sys; from anchorpose.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", run, "track", str(recording), "-o", str(results), "--overwrite"]
    environment = {**os.environ, "PYTHONPATH": str(source.resolve())}
    done = subprocess.run(command + ["--smooth"] * smooth, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{source} could not track {recording}:\n{done.stderr}{done.stdout}")


def differences(old: Path, new: Path) -> list[str]:
    """One line per table that differs: which columns, or that a table is missing."""
    found = []
    for name in TABLES:
        file = f"{name}.parquet"
        before, after = old / file, new / file
        if not (before.is_file() and after.is_file()):
            found.append(f"{file}: missing from {old if not before.is_file() else new}")
        elif digest(before) != digest(after):
            found.append(f"{file}: {what_differs(before, after)}")
    return found


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def what_differs(before: Path, after: Path) -> str:
    """The columns whose values differ; otherwise the schema or the file's metadata does."""
    one, other = pq.read_table(before), pq.read_table(after)
    if one.num_rows != other.num_rows:
        return f"{one.num_rows} rows, then {other.num_rows}"
    names = [n for n in one.column_names if n not in other.column_names or not one[n].equals(other[n])]
    names += [n for n in other.column_names if n not in one.column_names]
    return f"columns {', '.join(names)}" if names else "the same values, other metadata or row groups"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("recordings", type=Path, nargs="*")
    parser.add_argument("--smooth", type=Path, nargs="*", default=[])
    parser.add_argument("--keep", type=Path, help="folder that keeps the results of OLD_SRC")
    given = parser.parse_args()
    differing = 0
    with tempfile.TemporaryDirectory() as scratch:
        kept = given.keep or Path(scratch) / "old"
        kept.mkdir(parents=True, exist_ok=True)
        jobs = [(path, False) for path in given.recordings] + [(path, True) for path in given.smooth]
        for number, (recording, smooth) in enumerate(jobs):
            name = hashlib.sha256(f"{recording.resolve()} {smooth}".encode()).hexdigest()[:12]
            old, new = kept / name, Path(scratch) / f"new-{number}"
            if not old.is_dir():
                track(given.old, recording, old, smooth)
            track(given.new, recording, new, smooth)
            found = differences(old, new)
            print(f"{recording}{' --smooth' * smooth}: {'; '.join(found) or 'all tables the same'}", flush=True)
            differing += bool(found)
    return 1 if differing else 0


if __name__ == "__main__":
    raise SystemExit(main())
