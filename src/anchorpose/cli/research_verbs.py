"""Define the commands for research: the paper's comparison and the public benchmark."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App

from anchorpose.batch.worker import KERNELS
from anchorpose.cli.console import progress_bar, say, show_table
from anchorpose.errors import InputError
from anchorpose.options import MOST_FRAMES, MOST_PROCESSES, whole

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
    """Repeat the paper's comparison of methods in the paper's tracking framework; write tables, figures and a page.

    This takes about 21 hours of one processor core; an estimate for your machine is printed at the start. You may stop
    it at any time: the same command continues. --quick shows in five minutes that everything works.

    Parameters
    ----------
    out
        The folder to write, or that of an earlier run.
    quick
        Use one short recording and two hole sizes, to check an installation; the figures mean nothing.
    real
        A folder of real recordings, each with a reference skeleton (skeleton.npz), on which methods are compared, too.
    config
        A TOML or JSON file with your own selection of methods, hole sizes, recordings and seeds.
    processes
        How many recordings are processed at once; by default as many as there are cores.
    """
    settings = _settings(quick, config)
    for name in KERNELS:
        # Numerical libraries use a single thread, so that the simulated movements do not depend on the number of cores
        os.environ.setdefault(name, "1")
    try:
        _run(out, settings, real, processes or os.cpu_count() or 1)
    except KeyboardInterrupt as stopped:
        stopped.add_note("The same command goes on from here.")
        raise
    say(f"Open {out / 'index.html'}; the tables are in {out / 'tables'}.")


def _settings(quick: bool, config: Path | None) -> ExperimentConfig:
    from anchorpose.recording.document import load_config
    from anchorpose.research.experiment import config as experiments

    if quick and config is not None:
        raise InputError(config, "cannot be combined with --quick", "leave one of the two out")
    if config is not None:
        return load_config(config, experiments.ExperimentConfig)
    return experiments.quick() if quick else experiments.ExperimentConfig()


def _run(out: Path, settings: ExperimentConfig, real: Path | None, processes: int) -> None:
    from anchorpose.research.experiment.run import run_experiment
    from anchorpose.results.folder import naming_place

    with naming_place(out), progress_bar("Comparing") as progress:
        run_experiment(out, settings, real, processes, lambda done_s, all_s: progress(round(done_s), round(all_s)), say)


benchmark = App(name="benchmark", help="A public benchmark of association and tracking, for methods of any kind.")


@benchmark.command
def make(
    out: Path,
    /,
    *,
    part: Literal["development", "test", "all"] = "all",
    recordings: Annotated[int | None, whole(1, MOST_FRAMES)] = None,
    processes: Annotated[int | None, whole(1, MOST_PROCESSES)] = None,
) -> int:
    """Simulate the benchmark's recordings, and compare them with the reference by hashes of their content.

    The whole set takes some minutes and 0.9 GB. The same command continues after a stop. The exit code is 1 if a
    recording differs from the reference in any byte; docs/benchmark.md explains what this means for scores.

    Parameters
    ----------
    out
        The folder to write, or that of an earlier run.
    part
        development: recordings to develop a method. test: recordings for the figures of the leader board.
    recordings
        Make only the first recordings of each kind, this many.
    processes
        How many recordings are simulated at once; by default as many as there are cores.
    """
    from anchorpose.research.benchmark.make import make_benchmark
    from anchorpose.research.benchmark.plan import Part, groups_of

    groups = [group for each in Part if part in ("all", each) for group in groups_of(each, recordings)]
    with progress_bar("Simulating", at_once=False) as progress:
        made = make_benchmark(out, groups, processes, progress)
    for sentence in made.other_bytes:
        say(f"{sentence}.")
    count = sum(len(group.recordings) for group in made.groups)
    say(f"{out}: {count} recordings, of which {count - len(made.other_bytes)} have the bytes of the reference.")
    return int(bool(made.other_bytes))


@benchmark.command
def score(
    answers: Path,
    folder: Path | None = None,
    /,
    *,
    part: Literal["development", "test"] = "test",
    against: Path | None = None,
    real: Path | None = None,
    labels: Path | None = None,
    json: Path | None = None,
) -> None:
    """Score the answers of any method, print the figures with a row for the leader board, and write them as JSON.

    Parameters
    ----------
    answers
        A folder with answers.json, and joints or matches as CSV or Parquet; docs/benchmark.md describes them.
    folder
        The folder made by 'anchorpose benchmark make'. Not needed with --real.
    part
        The part whose recordings are scored.
    against
        Another folder of answers; differences between the two are printed with 95 % intervals over recordings.
    real
        A folder of real recordings, scored in place of simulated ones: real.csv of the answers is compared with labels
        made by eye.
    labels
        With --real: the folder of labels, benchmarks/labels of the repository.
    json
        The file to write; by default score.json (with --real: real.json) in the folder of answers.
    """
    import json as text

    from anchorpose.recording.writable import check_file, new_folder
    from anchorpose.results.folder import write_text_whole

    target = json or answers / ("score.json" if real is None else "real.json")
    check_file(target, '"anchorpose-benchmark-score"' if real is None else '"recordings"', folder, real, labels)
    if real is not None:
        document = _real(answers, real, labels)
    elif folder is None:
        raise InputError(answers, "can be scored only with the recordings", "name the benchmark's folder after it")
    else:
        document = _simulated(answers, folder, part, against)
    with new_folder(target.resolve().parent, target):
        write_text_whole(target, text.dumps(document, indent=1, allow_nan=False) + "\n")
    say(f"All figures are in {target}.")


def _simulated(answers: Path, folder: Path, part: str, against: Path | None) -> dict[str, Any]:
    from anchorpose.research.benchmark.answers import read_answers
    from anchorpose.research.benchmark.make import open_benchmark
    from anchorpose.research.benchmark.plan import Part
    from anchorpose.research.benchmark.score import as_document, compare, score_answers

    made = open_benchmark(folder)
    one = score_answers(made, read_answers(answers, made), Part(part))
    if not one.tasks:
        raise InputError(answers, f"has no answers for the part {part}", "give --part, or make those recordings")
    document = as_document(one)
    _print_figures(document["method"], {task: figures for task, figures in document["tasks"].items() if figures})
    if against is not None:
        other = score_answers(made, read_answers(against, made), Part(part))
        document["against"] = {"method": other.answers.method, "differences": compare(one, other)}
        _print_figures(f"minus {other.answers.method}, 95 %", document["against"]["differences"])
    if one.answers.elsewhere:
        say(f"{one.answers.elsewhere} rows are about recordings that are not in {folder}; they were not scored.")
    for sentence in one.other_bytes:
        say(f"{sentence}: its figures are not those of the reference.")
    say(document["row"])
    return document


def _real(answers: Path, real: Path, labels: Path | None) -> dict[str, Any]:
    from anchorpose.research.benchmark.real import score_real
    from anchorpose.results.run_record import as_json

    if labels is None:
        raise InputError(real, "needs the labels", "add --labels with benchmarks/labels of the repository")
    found: dict[str, Any] = as_json(score_real(answers, real, labels))
    _print_figures("", found)
    return {"recordings": found}


def _print_figures(title: str, rows: dict[str, dict[str, Any]]) -> None:
    """Print a table of numbers, with a column per recording or task and a row per quantity; shares are in per cent."""
    from rich.table import Column

    lines = list[list[str]]()
    for name in next(iter(rows.values()), {}):
        share = "share" in name or "within" in name or "coverage" in name
        values = [figures[name] for figures in rows.values()]
        scaled = [100.0 * value if share and value is not None else value for value in values]
        cells = ["–" if v is None else f"{v:.1f}" if isinstance(v, float) else str(v) for v in scaled]
        if any(value is not None for value in values):
            lines.append([f"{name}, %" if share else name, *cells])
    show_table((Column(no_wrap=True, min_width=24), *rows), lines, title=title)
