"""Recording folders spoilt in every way that was thought of: each is read, or refused in one sentence.

    .venv/bin/python benchmarks/fuzz_recordings.py [--cases 10000] [--first NUMBER] [--state FILE]

A case is a small recording with damaged bytes, extreme or foreign values, pipes, devices and links in place of files,
times of other units, images and meshes that lie about their size, thousands of cameras. It is opened, and everything
that a run reads first is read. Counted are recordings, refusals in one sentence, and faults, each with the number of
its case, which --first repeats: another error, a crash of native code, more than 30 s of the processor or 2 GB. With
--state, a run that was stopped goes on where it ended, and counts add up.
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

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "builders"))
from recording_builder import write_recording
from spoil_recording import spoil

from anchorpose.calibration.noise import noise_per_m
from anchorpose.errors import InputError
from anchorpose.recording.pairing import find_gaps
from anchorpose.recording.reader import input_files, open_recording, read_frames

LONGEST_S, MOST_BYTES = 30, 2 << 30
BY_THE_CLOCK = 20  # times as long, since other programs may have the processor; for what waits without working
SAVED_EVERY = 500  # cases


@dataclass
class State:
    """How far a run has come. next: the number of the first case that was not tried."""

    next: int = 0
    read: int = 0
    refused: int = 0
    faults: list[str] = field(default_factory=list)
    longest_s: float = 0.0
    largest_mb: float = 0.0

    def count(self, found: str) -> None:
        """A case that ended as it must: "read" or "refused"."""
        self.read += found == "read"
        self.refused += found == "refused"

    def fault(self, ways: str, error: Exception) -> None:
        """The case that is tried now did what it must not do."""
        self.faults.append(f"case {self.next} ({ways}): {type(error).__name__}: {error}"[:500])
        print(self.faults[-1], flush=True)

    def end_case(self, seconds: float) -> None:
        """The next case is tried."""
        self.longest_s = max(self.longest_s, round(seconds, 3))
        self.largest_mb = max(self.largest_mb, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
        self.next += 1

    def save(self, path: Path) -> None:
        """Whole or not at all."""
        partial = path.with_suffix(".partial")
        partial.write_text(json.dumps(asdict(self), indent=1) + "\n")
        partial.replace(path)


def load_state(path: Path) -> State:
    """The state of a run that was stopped, or of one that begins."""
    return State(**json.loads(path.read_text())) if path.exists() else State()


def limit_time(seconds: int) -> None:
    """The process ends after so much processor time, or where it waits much longer; 0: it may go on."""
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.alarm(BY_THE_CLOCK * seconds)


def name_place_of_death() -> None:
    """A process that ends by ``limit_time`` or a crash says where it is, also within native code."""
    faulthandler.enable()
    for number in (signal.SIGALRM, signal.SIGPROF):
        faulthandler.register(number, chain=True)


def outcome(folder: Path) -> str:
    """ "read" or "refused"; whatever else happens is an error, or a refusal of another form (ValueError)."""
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
        if "\n" in str(error) or str(folder) not in str(error) or len(str(error)) > len(str(error.path)) + 1000:
            raise ValueError(f"not one sentence that names the file: {error}") from error
        return "refused"
    return "read"


def run_cases(state: State, stop: int, folder: Path, path: Path) -> None:
    """Cases up to ``stop`` in this process; path: where the state is kept."""
    good, bad = folder / "good", folder / "bad"
    if not good.exists():
        write_recording(good, frames=3, cameras=("front", "left"))
    limit = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + MOST_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    while state.next < stop:
        number = state.next
        (folder / "number").write_text(f"{number} not spoilt yet")
        shutil.rmtree(bad, ignore_errors=True)
        shutil.copytree(good, bad)
        ways = spoil(bad, number)
        (folder / "number").write_text(f"{number} {ways}")
        start = time.process_time()
        limit_time(LONGEST_S)
        try:
            state.count(outcome(bad))
        except Exception as error:
            state.fault(ways, error)
        limit_time(0)
        state.end_case(time.process_time() - start)
        if state.next % SAVED_EVERY == 0:
            state.save(path)
    state.save(path)


def run_apart(program: list[str], path: Path, stop: int) -> State:
    """All cases in processes of their own: one that crashes or hangs ends at its case, which is a fault.

    program: this file or ``fuzz_readers.py``, with how many cases it is to try.
    """
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "number").write_text("")
        while (state := load_state(path)).next < stop:
            code = subprocess.run(
                [sys.executable, *program, "--state", str(path), "--here", folder], check=False
            ).returncode
            number, _, ways = (Path(folder) / "number").read_text().partition(" ")
            if code and not number:
                sys.exit(f"it failed before the first case: exit code {code}")
            if code:
                state = load_state(path)
                state.faults.append(f"case {number} ({ways}): the process ended with {code}")
                state.next = int(number) + 1  # what it did since the state was last saved is not counted
                state.save(path)
    return load_state(path)


def describe(state: State) -> str:
    """Counts, faults and what the worst case cost."""
    tried = state.read + state.refused + len(state.faults)
    counts = f"{tried} cases: {state.read} read, {state.refused} refused, {len(state.faults)} faults"
    return "\n".join([*state.faults, f"{counts}; longest {state.longest_s:.2f} s, {state.largest_mb:.0f} MB"])


def main() -> None:
    """Prints the counts; exit code 1 where there are faults."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=10000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--state", type=Path)
    parser.add_argument("--here", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.here is not None:
        name_place_of_death()
        run_cases(load_state(given.state), given.cases, given.here, given.state)
        return
    with tempfile.TemporaryDirectory() as folder:
        path, stop = given.state or Path(folder) / "state.json", given.first + given.cases
        if not path.exists():
            State(next=given.first).save(path)
        state = run_apart([__file__, "--cases", str(stop)], path, stop)
    print(describe(state))
    sys.exit(bool(state.faults))


if __name__ == "__main__":
    main()
