"""Measure this program: python benchmarks/run.py SUITE... [--quick] [--against COMMIT]
Measure all figures of README and docs: python benchmarks/run.py --docs [PAGE...] [--from-cache]

Suites (``suites.py`` declares them): SUITES

Recordings are simulated once and kept in --cache, with the results of each version of the code: a run that was stopped
goes on, and a recording is tracked again only if it or the code has changed. The table has one row per scene class:
means over its recordings, with the worst recording's value in brackets. Coverage is the share of axes on which the
truth lies within 1.96 sigma (0.95 is calibrated), for joints called observed and for joints called hidden. A confident
error is over 100 mm and over four sigma. Times are processor seconds without compiling: compare them only within one
run, best of suite ``speed``, which runs alone.

--against: also track the recordings with the code of a commit, and print the differences with 95 % intervals over the
recordings. --without SOURCE: compare with the same code with one source of proposals switched off, instead of a commit.
--rows TEXT: measure only the rows whose name contains the text, for example --rows people. --quick: measure only the
selection that a developer runs before every merge that touches tracking; it takes under 20 minutes on two idle cores.
--use held-out: only for the final evaluation. --docs: measure what the measured blocks of the pages ask for
(``blocks.py``); all changes of the program must be committed, and a suite that was measured with this commit is not
measured again.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final, get_args

from blocks import Wanted
from documents import PAGES, fill
from filelock import FileLock
from measurements import Rows
from probing import run_probe
from recordings import Ready, digest_of
from suite import Case, Use
from suites import SUITES, cases_of
from table import differences, table
from tracking import COST_FILE, Cost, read_cost, track
from versions import Version, at_commit, without, working_tree

from anchorpose.body.config import Source

CACHE: Final = Path.home() / ".cache" / "anchorpose-benchmarks"
QUICK_SUITES: Final = ("easy", "hard", "bodies", "rooms", "starts", "real", "contacts", "kidnapped")


@dataclass(frozen=True, slots=True)
class Plan:
    """Settings that all jobs of a run share. again: track even if results are kept, to measure the time; rows: a text
    in the names of the rows to measure, empty for all rows.
    """

    use: Use
    quick: bool
    cache: Path
    versions: tuple[Version, ...]
    again: bool = False
    rows: str = ""


def measure(suite: str, index: int, plan: Plan) -> list[list[tuple[str, dict[str, float]]]]:
    """Run one case with each version; return per version the rows and their scores, none if the data is absent."""
    case = cases_of([suite], plan.use, plan.quick)[suite][index]
    ready = case.recording.ready(plan.cache)
    named = None if ready is None else case.name(ready)
    if ready is None or named is None:
        return [[] for _ in plan.versions]
    return [_measure(case, ready, named, version, plan) for version in plan.versions]


def _measure(
    case: Case, ready: Ready, named: dict[str, Any], version: Version, plan: Plan
) -> list[tuple[str, dict[str, float]]]:
    if case.probe is not None:
        found = run_probe(case.probe, ready, version, plan.cache, plan.again)
        return [(f"{case.row}: {part}" if part else case.row, scores) for part, scores in found]
    named = named | version.settings
    results = results_folder(ready, named, version, plan.cache)
    cost = tracked(results, ready, named, version, plan.again)
    costs = {"frame_ms": cost.frame_ms, "start_s": cost.start_s, "peak_mb": cost.peak_mb}
    if cost.refused:
        return [(case.row, case.refused() | {"refused": 1.0})]
    found = case.score(ready, results)
    if isinstance(found, dict):
        return [(case.row, found | costs)]
    return [(f"{case.row}: {part}", scores) for part, scores in found]


def results_folder(ready: Ready, named: dict[str, Any], version: Version, cache: Path) -> Path:
    """Return the folder for the results of a recording that a version tracks with the settings ``named``."""
    key = digest_of(version.digest, ready.digest, json.dumps(named))
    return cache / "results" / f"{ready.name}-{key}"


def tracked(results: Path, ready: Ready, named: dict[str, Any], version: Version, again: bool = False) -> Cost:
    """Return the cost of the kept results; without results, or without a cost (a run was stopped), track now."""
    results.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(results.parent / f".{results.name}.lock"):  # another case may need the same results
        if again or not (results / COST_FILE).is_file():
            shutil.rmtree(results, ignore_errors=True)
            return track(version.source, ready.recording, results, named)
        return read_cost(results)


def run_suite(suite: str, plan: Plan, processes: int) -> list[Rows]:
    """Run a suite; return per version the rows in the order in which the suite declares them, with the same recordings
    in the same order for all versions.
    """
    cases = cases_of([suite], plan.use, plan.quick)[suite]
    chosen = [index for index, case in enumerate(cases) if plan.rows in case.row]
    if not chosen:
        raise RuntimeError(f"{suite} has no row with {plan.rows} in its name")
    if SUITES[suite].alone:
        _compile(plan)
    found: dict[int, list[list[tuple[str, dict[str, float]]]]] = {}
    faults, began = list[str](), time.monotonic()
    with ProcessPoolExecutor(1 if SUITES[suite].alone else processes, mp_context=get_context("spawn")) as pool:
        jobs = {pool.submit(measure, suite, index, plan): index for index in chosen}
        for number, job in enumerate(as_completed(jobs), 1):
            name = cases[jobs[job]].recording.name
            if (error := job.exception()) is None:
                found[jobs[job]] = job.result()
            else:
                faults.append(f"{name}: {error}")
            _say(f"{suite}: {number} of {len(chosen)} after {time.monotonic() - began:.0f} s; {name}")
    if faults:  # raised only now, so that the results of the other cases are kept
        raise RuntimeError(f"{suite} could not be measured: {'; '.join(faults)}")
    return rows_of([found[index] for index in chosen], len(plan.versions))


def _compile(plan: Plan) -> None:
    """Compile the kernels of every version before anything is timed."""
    ready = cases_of(["easy"], plan.use, True)["easy"][2].recording.ready(plan.cache)
    assert ready is not None
    for version in plan.versions:
        tracked(plan.cache / "results" / f"warm-{version.digest}", ready, {}, version)


def rows_of(found: Sequence[Sequence[Sequence[tuple[str, dict[str, float]]]]], versions: int) -> list[Rows]:
    """Return per version the rows of all cases. A case in which only another version has a row, such as a body part
    that only this version reports as touched, has no scores in this row. A case may have a row several times: the left
    and the right joint.
    """
    rows: list[Rows] = [{} for _ in range(versions)]
    for case in found:
        for row in dict.fromkeys(row for scored in case for row, _ in scored):
            of_row = [[scores for name, scores in scored if name == row] for scored in case]
            count = max(map(len, of_row))
            for of, scores in zip(rows, of_row, strict=True):
                of.setdefault(row, []).extend([*scores, *[dict[str, float]()] * (count - len(scores))])
    return rows


def _fill_pages(pages: Sequence[str], cache: Path, processes: int | None) -> None:
    """Fill the measured blocks of the pages. processes: to measure with first; None to write only kept figures."""

    def measure_suite(wanted: Wanted) -> Rows:
        alone = SUITES[wanted.name].alone
        plan = Plan(wanted.use, wanted.quick, cache, (working_tree(),), again=alone)
        return run_suite(wanted.name, plan, processes or 1)[0]

    fill(pages, cache, measure_suite if processes else None)


def _say(sentence: str) -> None:
    print(sentence, file=sys.stderr, flush=True)


def main() -> None:
    """Print a table per suite."""
    about = "\n".join(f"  {name:10s} {suite.about}" for name, suite in SUITES.items())
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").replace("SUITES", f"\n{about}", 1),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("suites", nargs="*", metavar="SUITE", help=f"with --quick: {', '.join(QUICK_SUITES)}")
    other = parser.add_mutually_exclusive_group()
    other.add_argument("--against", metavar="COMMIT")
    other.add_argument(
        "--without", choices=[str(source) for source in Source], help="a source of proposals, to compare"
    )
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--rows", metavar="TEXT", default="", help="only the rows whose name contains TEXT")
    parser.add_argument("--use", choices=get_args(Use), default="tuning")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--cache", type=Path, default=CACHE)
    parser.add_argument("--json", type=Path, help="write all scores of all recordings")
    parser.add_argument("--docs", nargs="*", metavar="PAGE", help="fill the measured blocks of these pages, or of all")
    parser.add_argument("--from-cache", action="store_true", help="with --docs: only write what was measured before")
    chosen = parser.parse_args()
    if chosen.docs is not None:
        _fill_pages(chosen.docs or PAGES, chosen.cache, None if chosen.from_cache else chosen.processes)
        return
    names = chosen.suites or (QUICK_SUITES if chosen.quick else parser.error("name a suite, or give --quick"))
    cases_of(names, chosen.use, chosen.quick)
    versions = [working_tree()]
    if chosen.against:
        versions.append(at_commit(chosen.against, chosen.cache))
    if chosen.without:
        versions.append(without(chosen.without))
    document, faults = dict[str, Any](), list[str]()
    print(f"{chosen.use} recordings{', quick' * chosen.quick}; load {os.getloadavg()[0]:.1f} at the start")
    for name in names:
        plan = Plan(chosen.use, chosen.quick, chosen.cache, tuple(versions), SUITES[name].alone, chosen.rows)
        try:
            by_version = run_suite(name, plan, chosen.processes)
        except RuntimeError as error:
            faults.append(str(error))
            continue
        print(f"\n## {name}: {SUITES[name].about}\n\n{table(by_version[0])}", flush=True)
        if len(versions) > 1:
            print(f"\n{differences(*by_version, versions[1].title)}", flush=True)
        document[name] = {version.title: rows for version, rows in zip(versions, by_version, strict=True)}
    if chosen.json:
        chosen.json.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    if faults:
        raise SystemExit("\n".join(faults))


if __name__ == "__main__":
    main()
