"""Track eight short recordings and compare every byte of the results with stored digests, or with another commit.

    python tools/goldens.py                    compare with tests/goldens/goldens.json, as the tests do
    python tools/goldens.py --update           store what this code gives on this machine
    python tools/goldens.py --against COMMIT   compare with what another commit makes of the same recordings

``--only NAME...`` takes some of the recordings. Seven are simulated, one is of MSR Action3D. Digests hold on one kind
of machine only, since compilers and libraries choose instructions by processor: where the stored fingerprint is not
this machine's, a summary of values must agree within tolerances. ``--against`` is exact on every machine; it compiles
the kernels of the other commit first, which takes minutes. Tables and exports state the version of the package: after
raising it, ``--update``.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from golden_digests import (
    RECORDING,
    WHOLE,
    Digests,
    Summary,
    beyond_tolerance,
    differences,
    digest_of_folder,
    digests_of,
    summary_of,
)
from golden_machine import fingerprint

import anchorpose
from anchorpose.cli import main as run_verb
from anchorpose.simulate.config import BEHIND_AND_BEFORE, SimulationConfig, clinic, holes, room, single
from anchorpose.simulate.write import simulate_recording
from anchorpose.threads import one_thread

ROOT: Final = Path(__file__).resolve().parents[1]
SOURCE: Final = Path(anchorpose.__file__).parents[1]
STORED: Final = ROOT / "tests" / "goldens" / "goldens.json"
DATA: Final = ROOT.parent / "shared" / "data"
MSR: Final = DATA / "msr_action3d" / "a06_s01_e02"
FORMATS: Final = "trc,mot,csv,bvh,bids"  # all that need no extra
RUN_LINES: Final = (
    "import json, sys; from anchorpose.cli import main; sys.exit(any(main(line) for line in json.loads(sys.argv[1])))"
)
FPS: Final = 10.0


def _small(config: SimulationConfig, **changes: Any) -> SimulationConfig:
    """``config`` seen by a camera with few pixels, which costs least."""
    return replace(config, sensor="kinect-v1", **changes)


IN_BARS: Final[dict[str, Any]] = {
    "cameras": 2,
    "equipment": "parallel-bars",
    "chest_pad": True,
    "stool": False,
    "motions": ("squat",),
    "therapists_stay": True,
    "therapist_tasks": BEHIND_AND_BEFORE,
    "passers_by": 1,
}
SIMULATED: Final = {
    "single": _small(single(7, 0.8, FPS)),
    "hole": _small(holes(8, 0.12, 0.6, FPS)),
    "clinic": _small(clinic(9, 0.3, FPS)),
    "front": _small(clinic(12, 0.3, FPS), cameras=1, pose_known=False),
    "bars": _small(clinic(11, 0.3, FPS), **IN_BARS),
    "room": room(51_001, 0.3, FPS),
    "filtered": replace(single(3, 0.6, FPS), sensor="realsense-filtered"),
}
OPTIONS: Final = {"single": ("--smooth",), "msr": ("--stop", "6")}
"""Of ``anchorpose track``."""
NAMES: Final = (*SIMULATED, "msr")


@dataclass(frozen=True, slots=True)
class Made:
    """What the code made of one recording."""

    digests: Digests
    summary: Summary


class Absent(Exception):
    """A recording that is not part of the project is not on this machine."""


def make(name: str, folder: Path) -> Made:
    """Simulate, track and export one recording under an empty folder. Raises Absent or RuntimeError."""
    recording = recording_of(name, folder)
    for line in command_lines(name, recording, folder / "results"):
        with contextlib.redirect_stdout(io.StringIO()):
            failed = run_verb(line)
        if failed:
            raise RuntimeError(f"{name}: 'anchorpose {' '.join(line)}' failed")
    return Made(all_digests(recording, folder / "results"), summary_of(folder / "results"))


def recording_of(name: str, folder: Path) -> Path:
    """The recording folder, simulated under ``folder`` where it can be; raises Absent."""
    if name in SIMULATED:
        with one_thread():
            simulate_recording(folder / "simulated", SIMULATED[name])
        return folder / "simulated" / "recording"
    if not (MSR / "recording.json").is_file():
        raise Absent(f"{MSR.relative_to(DATA.parent)} is absent: real depth is not part of the project")
    return MSR


def command_lines(name: str, recording: Path, results: Path) -> list[list[str]]:
    """Track, then export. The command line is used because it changes least from commit to commit."""
    track = ["track", str(recording), "-o", str(results), *OPTIONS.get(name, ())]
    formats = FORMATS.replace("mot,", "") if name == "filtered" else FORMATS  # a MOT cannot mark lost joints
    return [track, ["export", str(results), "--to", formats]]


def all_digests(recording: Path, results: Path) -> Digests:
    """Of the results, and of the recording with its truth."""
    source = recording if recording == MSR else recording.parent
    return {RECORDING: {WHOLE: digest_of_folder(source)}, **digests_of(results)}


def compare(name: str, made: Made, stored: dict[str, Any], here: dict[str, str]) -> list[str]:
    """One line per difference that counts: any on a machine like the stored one, otherwise those beyond tolerance."""
    golden = stored["recordings"][name]
    if here == stored["fingerprint"]:
        found = differences(golden["digests"], made.digests)
    else:
        found = beyond_tolerance(golden["summary"], made.summary)
    return [f"{name}: {line}" for line in found]


def other_machine(stored: dict[str, Any], here: dict[str, str]) -> str:
    """A sentence on how this machine differs from the stored one; empty where it does not."""
    before = stored["fingerprint"]
    differing = [name for name in {**before, **here} if before.get(name) != here.get(name)]
    if not differing:
        return ""
    return f"not the machine of the goldens (other {', '.join(differing)}): compared within tolerances, not exactly"


def read_stored() -> dict[str, Any]:
    """The stored goldens."""
    return dict(json.loads(STORED.read_text(encoding="utf-8")))


def update(names: Sequence[str], folder: Path) -> int:
    """Store the goldens of ``names``; the others stay, if they are of this kind of machine."""
    here = fingerprint()
    before = read_stored() if STORED.is_file() else {"fingerprint": here, "recordings": {}}
    if here != before["fingerprint"] and set(names) != set(NAMES):
        raise SystemExit(f"{STORED} is of another machine; store all recordings at once, without --only.")
    made = {name: asdict(make(name, folder / name)) for name in names}
    recordings = {name: golden for name, golden in {**before["recordings"], **made}.items() if name in NAMES}
    text = json.dumps({"fingerprint": here, "recordings": recordings}, indent=1)
    text = re.sub(r"[\[{][^][{}]*[\]}]", lambda inmost: " ".join(inmost[0].split()), text)  # each file on one line
    STORED.write_text(text + "\n", encoding="utf-8")
    return 0


def check(names: Sequence[str], folder: Path) -> int:
    """Compare with what is stored; 1 where something differs."""
    stored, here = read_stored(), fingerprint()
    print(other_machine(stored, here) or "the machine of the goldens: compared exactly")
    return report({name: compare(name, make(name, folder / name), stored, here) for name in names})


def against(commit: str, names: Sequence[str], folder: Path) -> int:
    """Compare with what another commit makes of the same recordings; 1 where something differs."""
    recordings = {name: recording_of(name, folder / name) for name in names}
    with checked_out(commit, folder / "tree") as tree:
        sides = {"old": tree / "src", "new": SOURCE}
        tracking = []
        for side, source in sides.items():
            lines = [
                line for name, path in recordings.items() for line in command_lines(name, path, folder / side / name)
            ]
            (folder / side).mkdir()
            tracking.append(start_lines(source, lines))
        failed = [side for side, code in zip(sides, [process.wait() for process in tracking], strict=True) if code]
        if failed:
            raise SystemExit(f"the {failed[0]} code could not track or export a recording; its message is above.")
    found = {}
    for name, path in recordings.items():
        old, new = (all_digests(path, folder / side / name) for side in sides)
        found[name] = [f"{name}: {line}" for line in differences(old, new)]
    return report(found)


@contextlib.contextmanager
def checked_out(commit: str, tree: Path) -> Iterator[Path]:
    """A git worktree of a commit, removed at the end."""
    git = ["git", "-C", str(ROOT), "worktree"]
    if subprocess.run([*git, "add", "--quiet", "--detach", str(tree), commit], check=False).returncode:
        raise SystemExit(f"'{commit}' could not be checked out; give a commit, a branch or a tag of this repository.")
    try:
        yield tree
    finally:
        subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def start_lines(source: Path, lines: list[list[str]]) -> subprocess.Popen[bytes]:
    """Run command lines in one process with the package in ``source``."""
    environment = {**os.environ, "PYTHONPATH": str(source)}
    command = [sys.executable, "-c", RUN_LINES, json.dumps(lines)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)


def report(found: dict[str, list[str]]) -> int:
    """Print what differs; 1 where anything does."""
    for name, lines in found.items():
        print("\n".join(lines) or f"{name}: the same")
    return int(any(found.values()))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    way = parser.add_mutually_exclusive_group()
    way.add_argument("--update", action="store_true", help="store the digests of this code")
    way.add_argument("--against", metavar="COMMIT", help="compare with another commit")
    parser.add_argument("--only", nargs="+", choices=NAMES, default=NAMES, metavar="NAME", help=", ".join(NAMES))
    given = parser.parse_args(arguments)
    try:
        with TemporaryDirectory() as scratch:
            if given.against:
                return against(given.against, given.only, Path(scratch))
            return (update if given.update else check)(given.only, Path(scratch))
    except Absent as absent:
        raise SystemExit(f"{absent}; take the others with --only {' '.join(SIMULATED)}.") from None


if __name__ == "__main__":
    raise SystemExit(main())
