"""``anchorpose experiment``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from anchorpose.batch.worker import KERNELS
from anchorpose.cli.console import say
from anchorpose.cli.limits import MOST_PROCESSES, whole
from anchorpose.errors import InputError

if TYPE_CHECKING:
    from anchorpose.research.experiment.config import ExperimentConfig


def experiment(
    out: Path,
    /,
    *,
    quick: bool = False,
    real: Path | None = None,
    config: Path | None = None,
    processes: Annotated[int | None, whole(1, MOST_PROCESSES)] = None,
) -> None:
    """Repeat the paper's comparison: every method in one tracking framework, with tables, figures and a page.

    Takes about six hours on two cores; the estimate at the start is measured on your machine. Stop it at any time:
    the same command continues from there. --quick shows in five minutes that everything works.

    Parameters
    ----------
    out
        The folder to write, or that of an earlier run.
    quick
        One short recording and two hole sizes, to check an installation; its figures mean nothing.
    real
        A folder of real recordings with a reference skeleton (skeleton.npz) each, to compare on as well.
    config
        A TOML or JSON file with your own selection: methods, hole sizes, recordings, seeds.
    processes
        How many recordings are processed at once; by default as many as there are cores.
    """
    settings = _settings(quick, config)
    for name in KERNELS:
        os.environ.setdefault(name, "1")  # the movements made here have the same bytes as on one core
    try:
        _run(out, settings, real, processes or os.cpu_count() or 1)
    except KeyboardInterrupt as stopped:
        stopped.add_note("The same command goes on from here.")
        raise
    say(f"Open {out / 'index.html'}; the tables are in {out / 'tables'}.")


def _settings(quick: bool, config: Path | None) -> ExperimentConfig:
    from anchorpose.cli.config_file import load_config
    from anchorpose.research.experiment import config as experiments

    if quick and config is not None:
        raise InputError(config, "cannot be combined with --quick", "leave one of the two out")
    if config is not None:
        return load_config(config, experiments.ExperimentConfig)
    return experiments.quick() if quick else experiments.ExperimentConfig()


def _run(out: Path, settings: ExperimentConfig, real: Path | None, processes: int) -> None:
    from anchorpose.cli.console import progress_bar
    from anchorpose.research.experiment.run import run_experiment
    from anchorpose.results.folder import naming_place

    with naming_place(out), progress_bar("Comparing") as progress:
        run_experiment(
            out,
            settings,
            real,
            processes,
            lambda done_s, all_s: progress(round(done_s), round(all_s)),
            say,
        )
