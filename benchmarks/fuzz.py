"""Test what becomes of damaged input of every kind.

    .venv/bin/python benchmarks/fuzz.py [recordings | READER]... [--cases 10000] [--first NUMBER] [--state FOLDER]

recordings: a small recording folder with damaged bytes, extreme or foreign values, pipes, devices and links in place of
files, times of other units, images and meshes with false sizes, thousands of cameras. The folder is opened, and all
that a run reads first is read. READER: a file of a format that ``convert`` reads, with flipped bits, cut, zeroed, with
a piece doubled or taken out, or with lengths exchanged. The file is converted.

The program counts inputs that are read, refusals in one sentence, and faults. A fault is another error, a crash of
native code, too much time or memory, a folder left half-written, an image that cannot be read, or an image that was not
recorded, from a file that was only cut. Each fault is printed with the number of its case; --first repeats this case.
With --state, a run that was stopped goes on where it ended, and its counts add up.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final, Protocol

from fuzz_files import Files, readers, require

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "builders"))
from recording_builder import write_recording
from spoil_recording import spoil

from anchorpose.calibration.first_frames import noise_per_m
from anchorpose.errors import InputError
from anchorpose.recording.reader import input_files, open_recording, read_frames
from anchorpose.recording.recording import find_gaps

BY_THE_CLOCK = 20  # limit by the clock, times that of processor time: other programs may run
SAVED_EVERY: Final = 500  # cases
RECORDINGS: Final = "recordings"


@dataclass
class State:
    """How far a run has come. next: the number of the first case that was not tried."""

    next: int = 0
    read: int = 0
    refused: int = 0
    faults: list[str] = field(default_factory=list)
    longest_s: float = 0.0
    largest_mb: float = 0.0

    def save(self, path: Path) -> None:
        """Write the state to a file, completely or not at all."""
        partial_file = path.with_suffix(".partial")
        partial_file.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")
        partial_file.replace(path)

    def describe(self) -> str:
        """Return as text the faults, the counts, and the longest time and largest memory."""
        tried = self.read + self.refused + len(self.faults)
        counts = f"{tried} cases: {self.read} read, {self.refused} refused, {len(self.faults)} faults"
        return "\n".join([*self.faults, f"{counts}; longest {self.longest_s:.2f} s, {self.largest_mb:.0f} MB"])


def load_state(path: Path) -> State:
    """Return the state of a run that was stopped, or of a new one."""
    return State(**json.loads(path.read_text(encoding="utf-8"))) if path.exists() else State()


class Fuzzer(Protocol):
    """One kind of input. longest_s, most_bytes: limits of processor time and of memory for one case."""

    longest_s: int
    most_bytes: int

    def damage(self, number: int) -> str:
        """Write the input of a case and return how it was damaged."""

    def outcome(self) -> str:
        """Return ``read`` or ``refused``; any error is a fault."""


@dataclass
class Recordings:
    """Recording folders, spoilt by ``spoil_recording``."""

    folder: Path
    longest_s: int = 30
    most_bytes: int = 2 << 30

    def __post_init__(self) -> None:
        self.good, self.bad = self.folder / "good", self.folder / "bad"
        if not self.good.exists():
            write_recording(self.good, frames=3, cameras=("front", "left"))

    def damage(self, number: int) -> str:
        shutil.rmtree(self.bad, ignore_errors=True)
        shutil.copytree(self.good, self.bad)
        return spoil(self.bad, number)

    def outcome(self) -> str:
        return recording_outcome(self.bad)


def recording_outcome(folder: Path) -> str:
    """Open a recording and read all that a run reads first."""
    try:
        recording = open_recording(folder)
        find_gaps(recording)
        for frame_set in read_frames(recording):
            for depth_m in frame_set.depths_m:
                if depth_m is not None:
                    noise_per_m([depth_m])
        for path in input_files(recording):
            path.stat()
    except InputError as error:
        sentence = str(error)
        one = "\n" not in sentence and str(folder) in sentence and len(sentence) <= len(str(error.path)) + 1000
        require(one, f"not one sentence that names the file: {error}")
        return "refused"
    return "read"


def limit_time(seconds: int) -> None:
    """End the process after ``seconds`` of processor time, or after much longer by the clock; 0 ends the limits."""
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.alarm(BY_THE_CLOCK * seconds)


def name_place_of_death() -> None:
    """Make a process that ``limit_time`` or a crash ends print where it was, also within native code."""
    faulthandler.enable()
    for number in (signal.SIGALRM, signal.SIGPROF):
        faulthandler.register(number, chain=True)


def run_cases(fuzzer: Fuzzer, stop: int, folder: Path, path: Path) -> None:
    """Try cases up to ``stop`` in this process; path: where the state is kept."""
    state = load_state(path)
    limit = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + fuzzer.most_bytes
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    while state.next < stop:
        (folder / "number").write_text(f"{state.next} not damaged yet")
        ways = fuzzer.damage(state.next)
        (folder / "number").write_text(f"{state.next} {ways}")
        began = time.process_time()
        limit_time(fuzzer.longest_s)
        try:
            found = fuzzer.outcome()
            state.read += found == "read"
            state.refused += found == "refused"
        except Exception as error:
            state.faults.append(f"case {state.next} ({ways}): {type(error).__name__}: {error}"[:500])
            print(state.faults[-1], flush=True)
        limit_time(0)
        state.longest_s = max(state.longest_s, round(time.process_time() - began, 3))
        state.largest_mb = max(state.largest_mb, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
        state.next += 1
        if state.next % SAVED_EVERY == 0:
            state.save(path)
    state.save(path)


def run_apart(kind: str, path: Path, stop: int) -> State:
    """Try all cases in separate processes: if one crashes or hangs, its case is a fault, and the next one goes on."""
    with tempfile.TemporaryDirectory() as folder:
        number_file = Path(folder) / "number"
        number_file.write_text("")
        command = [sys.executable, __file__, kind, "--cases", str(stop), "--state", str(path), "--here", folder]
        while (state := load_state(path)).next < stop:
            code = subprocess.run(command, check=False).returncode
            number, _, ways = number_file.read_text().partition(" ")
            if code and not number:
                sys.exit(f"it failed before the first case: exit code {code}")
            if code:
                state = load_state(path)
                state.faults.append(f"case {number} ({ways}): the process ended with {code}")
                state.next = int(number) + 1  # cases since the state was last saved are not counted
                state.save(path)
    return load_state(path)


def main() -> None:
    """Print the counts of each kind; exit code 1 where there are faults."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "kinds", nargs="*", metavar="KIND", help=f"by default all: {RECORDINGS}, {', '.join(readers())}"
    )
    parser.add_argument("--cases", type=int, default=10000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--state", type=Path)
    parser.add_argument("--here", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    known = (RECORDINGS, *readers())
    if unknown := set(given.kinds) - set(known):
        parser.error(f"there is no {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    if given.here is not None:
        name_place_of_death()
        (kind,) = given.kinds
        fuzzer = Recordings(given.here) if kind == RECORDINGS else Files(given.here, kind)
        run_cases(fuzzer, given.cases, given.here, given.state)
        return
    faults = 0
    with tempfile.TemporaryDirectory() as folder:
        states = given.state or Path(folder)
        states.mkdir(exist_ok=True)
        for kind in given.kinds or known:
            path = states / f"{kind}.json"
            if not path.exists():
                State(next=given.first).save(path)
            state = run_apart(kind, path, given.first + given.cases)
            print(f"{kind}: {state.describe()}", flush=True)
            faults += len(state.faults)
    sys.exit(faults > 0)


if __name__ == "__main__":
    main()
