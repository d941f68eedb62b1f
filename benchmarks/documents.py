"""Measure what the pages ask for, and write it into them: ``run.py --docs``."""

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
    """Measure what the pages ask for, the cheapest first, and write it into them after each measurement; None: only
    write what is kept.

    What was measured with this commit is not measured again. Raises SystemExit, once all that can be written is, with
    the blocks that cannot.
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
    """Measure one after another; return a sentence for each that failed, after which the others go on."""
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
    """Return about how many processor minutes it takes, and its command, for an order."""
    suite = SUITES.get(wanted.name)
    return (0 if suite is None or wanted.quick else suite.minutes), wanted.command


def _text_of(page: str) -> str:
    return (REPOSITORY / page).read_text(encoding="utf-8")


def wanted_of(text: str) -> list[Wanted]:
    """Return what the blocks of a page ask for. Raises ValueError for words without a meaning."""
    return [wanted for block in blocks_in(text) if not block.once for wanted in wanted_by(table_of(block))]


def wanted_by(asked: Table | None) -> tuple[Wanted, ...]:
    """Return what a block asks for; None is the headlines."""
    return tuple(dict.fromkeys(one.wanted for one in HEADLINES)) if asked is None else (asked.wanted,)


def _printed(script: Wanted) -> str:
    command = [sys.executable, script.name, *script.options]
    return subprocess.run(command, cwd=REPOSITORY, check=True, stdout=subprocess.PIPE, text=True).stdout.strip()


def write_pages(pages: Sequence[str], cache: Path) -> list[str]:
    """Write what is kept into the pages; return a sentence for each block that stays as it is."""
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
    """Return what a block holds. Raises KeyError where something was not measured."""
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
    """Return a line per origin, with the commands that have it."""
    commands = dict[Origin, list[str]]()
    for wanted, one in measured.items():
        commands.setdefault(one.origin, []).append(f"`{wanted.command}`")
    return "\n".join(
        f"*Commit {origin.commit}, {origin.date}, {origin.machine}:* {', '.join(of)}" for origin, of in commands.items()
    )
