"""One piece of work in a process of its own; ``python -m anchorpose.batch.child`` does what it reads.

The work, a pickled call, comes on the standard input from the worker, which has it from the scheduler: whoever may hand
dask a job may run anything on its workers, with or without this. Nothing is unpickled from a disk, and results are the
files that the work writes. The input stays open as long as the process that asked for the work lives. When that one is
killed, the input ends, and so does the work: it is stopped as by a signal, so that what it stored is kept and can be
gone on with elsewhere.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import time
from typing import Final

from anchorpose.cli import exit_code_of

STOP_S: Final = 10.0  # to remove half-written files, and for a kernel to return
ABANDONED: Final = 143  # as of SIGTERM


def main() -> int:
    """Does the work and returns the exit code."""
    call = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_stop_when_abandoned, daemon=True).start()

    def work() -> None:
        call()  # what it returns is no exit code

    return exit_code_of(work)


def _stop_when_abandoned() -> None:
    while os.read(sys.stdin.fileno(), 1):  # not by the stream: its lock would be held when the process ends
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(STOP_S)
    os._exit(ABANDONED)


if __name__ == "__main__":
    sys.exit(main())
