"""Measure the errors of a simulated laboratory's clock and coordinate frame, if both have to be found.

The laboratory, another motion capture system, is made by ``laboratory_builder``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from probe import Row, Scene, answer

from anchorpose.agreement.matching import match_results
from anchorpose.agreement.reference import read_reference

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "builders"))
from laboratory_builder import make_laboratory, missed


def measure(scene: Scene) -> Iterator[Row]:
    """Match the results with the laboratory's file."""
    with TemporaryDirectory() as work:
        lab = make_laboratory(Path(work), scene.simulated.seed, scene.simulated.seconds)
        match = match_results(lab.results, read_reference(lab.reference))
        off = missed(lab, match)
    clock = {"clock_ms": off.time_ms, "stated_clock_ms": off.stated_time_ms}
    yield "", clock | {"frame_mm": off.translation_mm, "frame_deg": off.rotation_deg}


if __name__ == "__main__":
    answer(measure)
