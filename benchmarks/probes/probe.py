"""Define the command line of every probe:

    PROBE RECORDING TRUTH [--config JSON] [--settings JSON] [--OPTION VALUE]... --out JSON

A probe measures by calling internal modules of the program. It therefore runs with the version of the program that is
measured, and imports only this version and other modules of this folder. A probe writes, for each group of
scores (each kind of wrong pose, for example), the group's name and its scores by name.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from anchorpose.simulate.config import SimulationConfig
from anchorpose.threads import one_thread

Row = tuple[str, dict[str, float]]


@dataclass(frozen=True, slots=True)
class Scene:
    """The recording to measure. config: the settings of a simulated scene; options: the probe's own options by name;
    settings: those of TrackConfig that differ from the defaults."""

    recording: Path
    truth: Path
    config: SimulationConfig | None
    options: dict[str, Any]
    settings: dict[str, Any]

    @property
    def simulated(self) -> SimulationConfig:
        """Return the settings of the simulated scene, which this probe needs."""
        assert self.config is not None, "this probe measures simulated scenes"
        return self.config


def answer(measure: Callable[[Scene], Iterable[Row]], **options: float | str) -> None:
    """Measure the scene of the command line and write the rows. options: this probe's options with their defaults."""
    parser = argparse.ArgumentParser()
    parser.add_argument("recording", type=Path)
    parser.add_argument("truth", type=Path)
    parser.add_argument("--config", type=TypeAdapter(SimulationConfig).validate_json)
    parser.add_argument("--settings", type=json.loads, default={})
    parser.add_argument("--out", type=Path, required=True)
    for name, default in options.items():
        parser.add_argument(f"--{name}", type=type(default), default=default)
    chosen = parser.parse_args()
    own = {name: getattr(chosen, name) for name in options}
    scene = Scene(chosen.recording, chosen.truth, chosen.config, own, chosen.settings)
    with one_thread():
        rows = list(measure(scene))
    chosen.out.write_text(json.dumps(rows), encoding="utf-8")
