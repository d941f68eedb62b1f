"""Read the measured blocks of README and docs, and write new contents into the blocks of a page.

    <!-- measured: easy --use held-out --columns mean_mm lost -->    the rows of a suite, and a few of its columns
    <!-- measured: benchmarks/events.py -->                           the Markdown that a script prints
    <!-- measured: headlines -->                                      the README's table, out of several suites
    <!-- measured once: anchorpose experiment OUT -->                 takes hours: written by hand
    ...
    <!-- end -->

``python benchmarks/run.py --docs`` measures and rewrites all kinds of blocks but the last. A block ends with the origin
of its figures: commit, date and machine.
"""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NoReturn, get_args

from suite import Use
from suites import SUITES

HEADLINES: Final = "headlines"
NOT_YET: Final = "*Not measured yet with this version.*"
BLOCK: Final = re.compile(
    r"<!-- measured(?P<once> once)?: (?P<words>[^\n]+?) -->\n(?P<content>.*?)<!-- end -->", re.DOTALL
)


@dataclass(frozen=True, slots=True)
class Wanted:
    """A measurement that a block needs. name: of a suite, or of a script, which ends in .py; options: of a script."""

    name: str
    use: Use = "tuning"
    quick: bool = False
    options: tuple[str, ...] = ()

    @property
    def is_script(self) -> bool:
        """Whether a script prints the content."""
        return self.name.endswith(".py")

    @property
    def command(self) -> str:
        """Return the command with which a reader measures it."""
        if self.is_script:
            return shlex.join(["python", self.name, *self.options])
        use = () if self.use == "tuning" else ("--use", self.use)
        return shlex.join(["python", "benchmarks/run.py", self.name, *use, *["--quick"] * self.quick])


@dataclass(frozen=True, slots=True)
class Block:
    """A block of a page. once: written by hand only; words: of its comment; content: its present content."""

    once: bool
    words: str
    content: str


@dataclass(frozen=True, slots=True)
class Table:
    """The table that a block asks for. columns: column names; rows: beginnings of row names. Empty means all."""

    wanted: Wanted
    columns: tuple[str, ...] = ()
    rows: tuple[str, ...] = ()


class _Words(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ValueError(message)


def _parser() -> argparse.ArgumentParser:
    parser = _Words(add_help=False)
    parser.add_argument("suite", choices=SUITES)
    parser.add_argument("--use", choices=get_args(Use), default="tuning")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--columns", nargs="+", default=[])
    parser.add_argument("--rows", nargs="+", default=[])
    return parser


def blocks_in(text: str) -> list[Block]:
    """Return the blocks of a page, from top to bottom."""
    return [Block(bool(found["once"]), found["words"], found["content"]) for found in BLOCK.finditer(text)]


def table_of(block: Block) -> Table | None:
    """Return the table that a block of a page asks for; None if it asks for the headline figures. Raises ValueError for
    words that are not understood.
    """
    name, *options = shlex.split(block.words)
    if name == HEADLINES and not options:
        return None
    if name.endswith(".py"):
        return Table(Wanted(name, options=tuple(options)))
    chosen = _parser().parse_args([name, *options])
    return Table(Wanted(chosen.suite, chosen.use, chosen.quick), tuple(chosen.columns), tuple(chosen.rows))


def with_contents(text: str, content_of: Callable[[Block], str | None]) -> str:
    """Return a page with new contents of its blocks; where ``content_of`` returns None, the old content stays."""

    def replaced(found: re.Match[str]) -> str:
        block = Block(bool(found["once"]), found["words"], found["content"])
        content = None if block.once else content_of(block)
        return found[0] if content is None else f"<!-- measured: {block.words} -->\n\n{content}\n\n<!-- end -->"

    return BLOCK.sub(replaced, text)
