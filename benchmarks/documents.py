"""Measure the figures that README and docs ask for, and write them into these pages: ``run.py --docs``."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from blocks import Block, Table, Wanted, blocks_in, table_of, with_contents
from headlines import HEADLINES, headline_table
from measurements import Measurement, Origin, Rows, is_kept, keep, kept_of, origin_of_now
from suites import SUITES
from table import table
from versions import REPOSITORY, commit_of_code

PAGES: Final = (
    "README.md",
    *sorted(path.relative_to(REPOSITORY).as_posix() for path in (REPOSITORY / "docs").glob("**/*.md")),
)


def fill(pages: Sequence[str], cache: Path, measure: Callable[[Wanted], Rows] | None) -> None:
    """Measure what the blocks of the pages ask for, the cheapest first, and fill the blocks after each measurement.

    measure: None to write only kept measurements. A measurement of this commit is not repeated. Raises SystemExit at
    the end, with the measurements that failed and the blocks that could not be written.
    """
    if unknown := set(pages) - set(PAGES):
        raise SystemExit(f"--docs: no page {', '.join(sorted(unknown))}; name README.md or one below docs.")
    wanted = sorted({one for page in pages for one in wanted_of(_text_of(page))}, key=_minutes)
    faults = [] if measure is None else _measure_all(wanted, pages, cache, measure)
    if faults := [*faults, *write_pages(pages, cache)]:
        raise SystemExit("\n".join(faults))


def _measure_all(
    wanted: Sequence[Wanted], pages: Sequence[str], cache: Path, measure: Callable[[Wanted], Rows]
) -> list[str]:
    """Measure one table after another, also after a failure; return a sentence for each measurement that failed."""
    commit, faults = commit_of_code(), list[str]()
    left = [one for one in wanted if not is_kept(one, commit, cache)]
    for number, one in enumerate(left):
        minutes = sum(_minutes(later)[0] for later in left[number:])
        print(
            f"{len(left) - number} left, some {minutes} processor minutes: {one.command}", file=sys.stderr, flush=True
        )
        try:
            found = {"text": _printed(one)} if one.is_script else {"rows": measure(one)}
        except (RuntimeError, subprocess.CalledProcessError) as error:
            faults.append(f"{one.command}: {error}")
            continue
        keep(one, Measurement(origin_of_now(commit), **found), cache)
        write_pages(pages, cache)
    return faults


def _minutes(wanted: Wanted) -> tuple[int, str]:
    """Return a sort key: the approximate processor minutes of a measurement, and its command."""
    suite = SUITES.get(wanted.name)
    return (0 if suite is None or wanted.quick else suite.minutes), wanted.command


def _text_of(page: str) -> str:
    return (REPOSITORY / page).read_text(encoding="utf-8")


def wanted_of(text: str) -> list[Wanted]:
    """Return the measurements that the blocks of a page need. Raises ValueError for words that are not understood."""
    return [wanted for block in blocks_in(text) if not block.once for wanted in wanted_by(table_of(block))]


def wanted_by(asked: Table | None) -> tuple[Wanted, ...]:
    """Return the measurements that a block needs. asked: its table, None for the headline figures."""
    return tuple(dict.fromkeys(one.wanted for one in HEADLINES)) if asked is None else (asked.wanted,)


def _printed(script: Wanted) -> str:
    command = [sys.executable, script.name, *script.options]
    return subprocess.run(command, cwd=REPOSITORY, check=True, stdout=subprocess.PIPE, text=True).stdout.strip()


def write_pages(pages: Sequence[str], cache: Path) -> list[str]:
    """Write the kept measurements into the pages; return a sentence for each block that cannot be written."""
    faults = list[str]()

    def content_of(block: Block) -> str | None:
        try:
            return content(table_of(block), cache)
        except (KeyError, ValueError) as error:
            faults.append(f"measured: {block.words}: {error.args[0]}")
            return None

    for page in pages:
        before = _text_of(page)
        after = with_contents(before, content_of)
        if after != before:
            (REPOSITORY / page).write_text(after, encoding="utf-8")
    return faults


def content(asked: Table | None, cache: Path) -> str:
    """Return the content of a block: figures and their origins. Raises KeyError if a measurement for it is absent."""
    measured = dict[Wanted, Measurement]()
    for wanted in wanted_by(asked):
        kept = kept_of(wanted, cache)
        if kept is None:
            raise KeyError(f"not measured yet: {wanted.command}")
        measured[wanted] = kept
    return f"{_shown(asked, measured)}\n\n{_origins(measured)}"


def _shown(asked: Table | None, measured: Mapping[Wanted, Measurement]) -> str:
    if asked is None:
        return headline_table({wanted: one.rows or {} for wanted, one in measured.items()})
    found = measured[asked.wanted]
    if found.rows is None:
        return found.text
    return table({row: of for row, of in found.rows.items() if row.startswith(asked.rows or "")}, asked.columns)


def _origins(measured: Mapping[Wanted, Measurement]) -> str:
    """Return a line per origin, with the commands whose measurements have this origin."""
    commands = dict[Origin, list[str]]()
    for wanted, one in measured.items():
        commands.setdefault(one.origin, []).append(f"`{wanted.command}`")
    return "\n".join(
        f"*Commit {origin.commit}, {origin.date}, {origin.machine}:* {', '.join(of)}" for origin, of in commands.items()
    )
