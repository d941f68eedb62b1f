"""Run a probe in a process of its own, with the version of the code that is measured, and keep its answer."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter
from recordings import Ready, digest_of
from suite import Probe, Scores
from tracking import ONE_THREAD
from versions import REPOSITORY, Version

from anchorpose.simulate.config import SimulationConfig

PROBES: Final = Path("benchmarks") / "probes"


def run_probe(probe: Probe, ready: Ready, version: Version, cache: Path, again: bool) -> list[tuple[str, Scores]]:
    """Return the parts that a probe measured, with their scores; again: measure although an answer is kept."""
    script = script_of(probe, version)
    arguments = [str(ready.recording), str(ready.truth), *probe.options]
    if ready.config is not None:
        arguments += ["--config", TypeAdapter(SimulationConfig).dump_json(ready.config).decode()]
    if version.settings:
        arguments += ["--settings", json.dumps(version.settings)]
    sources = (path.read_text(encoding="utf-8") for path in sorted(script.parent.glob("*.py")))
    key = digest_of(version.digest, ready.digest, *arguments, *sources)
    out = cache / "answers" / f"{probe.script}-{ready.name}-{key}.json"
    if again or not out.is_file():
        _run([sys.executable, str(script), *arguments], version, out)
    return [(part, scores) for part, scores in json.loads(out.read_text(encoding="utf-8"))]


def script_of(probe: Probe, version: Version) -> Path:
    """Return the version's own script, since internal modules change; if absent, the script of this working tree."""
    own, this = (root / PROBES / f"{probe.script}.py" for root in (version.root, REPOSITORY))
    return own if own.is_file() else this


def _run(command: list[str], version: Version, out: Path) -> None:
    """Run the command of a probe; ``out`` appears only when the probe has answered."""
    out.parent.mkdir(parents=True, exist_ok=True)
    work = out.with_suffix(f".{os.getpid()}.work")
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(version.source)}
    done = subprocess.run([*command, "--out", str(work)], env=environment, capture_output=True)
    if done.returncode:
        raise RuntimeError(f"{Path(command[1]).name} {command[2]}: {done.stderr.decode(errors='replace')[-2000:]}")
    work.rename(out)
