"""``anchorpose experiment``."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from anchorpose.errors import InputError

EXIT_INTERRUPTED = 130
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def experiment(
    out: Path, /, *, quick: bool = False, real: Path | None = None, config: Path | None = None,
    processes: int | None = None,
) -> None:  # fmt: skip
    """Repeat the paper's comparison: every method in one tracking framework, with tables, figures and a page.

    Takes hours on two cores; it says how long at the start. Stop it at any time: the same command goes on from there.
    Give it --quick to see in two minutes that everything works.

    Parameters
    ----------
    out
        The folder to write, or that of an earlier run.
    quick
        One short recording and two sizes of hole, to check an installation; its figures mean nothing.
    real
        A folder of recording folders with a reference skeleton (skeleton.npz) each, to compare on as well.
    config
        A TOML or JSON file with your own subset: methods, sizes of hole, recordings, seeds.
    processes
        Recordings worked on at once; as many as there are cores unless given.
    """
    from anchorpose.cli.config_file import load_config
    from anchorpose.research.experiment.config import ExperimentConfig
    from anchorpose.research.experiment.config import quick as quick_config

    if quick and config is not None:
        raise InputError(config, "cannot be combined with --quick", "leave one of the two out")
    if processes is not None and processes < 1:
        raise InputError(out, f"cannot be worked on by {processes} processes", "give --processes 1 or more")
    chosen = ExperimentConfig() if config is None else load_config(config, ExperimentConfig)
    for name in THREADS:
        os.environ.setdefault(name, "1")  # one core a process; a new process reads it before it loads a library
    from anchorpose.cli.console import progress_bar
    from anchorpose.research.experiment.run import run_experiment

    try:
        with progress_bar("Comparing") as progress:
            run_experiment(
                out,
                quick_config() if quick else chosen,
                real,
                processes or os.cpu_count() or 1,
                lambda done_s, all_s: progress(round(done_s), round(all_s)),
                lambda sentence: print(sentence, flush=True),
            )
    except KeyboardInterrupt:
        print("Stopped; the same command goes on from here.", file=sys.stderr)
        raise SystemExit(EXIT_INTERRUPTED) from None
    print(f"Open {out / 'index.html'}; the tables are in {out / 'tables'}.")
