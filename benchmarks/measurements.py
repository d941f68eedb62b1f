"""Keep measurements with their origins until they are made again."""

from __future__ import annotations

import json
import os
import platform
import re
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from blocks import Wanted
from pydantic import TypeAdapter
from recordings import digest_of

Rows = dict[str, list[dict[str, float]]]
"""Per row of a suite, the scores of its recordings."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Where figures come from. commit: the last commit that changed the program or its benchmarks; date: day, UTC."""

    commit: str
    date: str
    machine: str


@dataclass(frozen=True, slots=True)
class Measurement:
    """What was measured: the rows of a suite, or the Markdown that a script printed."""

    origin: Origin
    rows: Rows | None = None
    text: str = ""


STORED: Final = TypeAdapter(Measurement)


def origin_of_now(commit: str) -> Origin:
    """Return the origin of what is measured now, on this machine."""
    processors = Path("/proc/cpuinfo")
    names = re.findall(r"^model name\s*: (.+)$", processors.read_text(), re.MULTILINE) if processors.is_file() else []
    name = names[0] if names else platform.processor()
    return Origin(commit, f"{datetime.now(UTC):%Y-%m-%d}", f"{name}, {os.cpu_count()} cores")


def keep(wanted: Wanted, measurement: Measurement, cache: Path) -> None:
    """Store a measurement in place of the last measurement by the same command."""
    file = _file_of(wanted, cache)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(asdict(measurement), indent=1), encoding="utf-8")


def kept_of(wanted: Wanted, cache: Path) -> Measurement | None:
    """Return the last kept measurement; None without one."""
    file = _file_of(wanted, cache)
    return STORED.validate_json(file.read_bytes()) if file.is_file() else None


def is_kept(wanted: Wanted, commit: str, cache: Path) -> bool:
    """Return whether the last kept measurement was made with this commit."""
    kept = kept_of(wanted, cache)
    return kept is not None and kept.origin.commit == commit


def _file_of(wanted: Wanted, cache: Path) -> Path:
    return cache / "measured" / f"{Path(wanted.name).stem}-{digest_of(wanted.command)}.json"
