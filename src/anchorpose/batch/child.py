"""One piece of work in a process of its own; ``python -m anchorpose.batch.child ANSWER`` does what it reads.

The work, a pickled call, comes on the standard input, which stays open as long as the process that asked for it lives.
When that one is killed, the input ends, and so does the work: it is stopped as by a signal, so that what it stored is
kept and can be gone on with elsewhere.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any, Final

from anchorpose.cli import exit_code_of

STOP_S: Final = 10.0  # to remove half-written files, and for a kernel to return
ABANDONED: Final = 143  # as of SIGTERM


def main(answer: Path) -> int:
    """Does the work and writes its pickled return value to ``answer``; returns the exit code."""
    call = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_stop_when_abandoned, daemon=True).start()
    return exit_code_of(lambda: _write_whole(answer, call()))


def _write_whole(answer: Path, value: Any) -> None:
    partial = answer.with_name(f"{answer.name}.partial")
    partial.write_bytes(pickle.dumps(value))
    partial.replace(answer)


def _stop_when_abandoned() -> None:
    while os.read(sys.stdin.fileno(), 1):  # not by the stream: its lock would be held when the process ends
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(STOP_S)
    os._exit(ABANDONED)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
