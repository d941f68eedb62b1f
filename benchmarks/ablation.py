"""Ablation of the tracker: python benchmarks/ablation.py --seeds 2 --seconds 4.

The recordings of accuracy.py, each tracked with the defaults, without one component at a time, and as in the paper
(every part by itself, from frame to frame). The variants are those of
``anchorpose.research.experiment.methods.references``; ``anchorpose experiment`` runs them on its own scenes.

With --method parts every variant registers part by part, as in the paper. Matches matter more then: by default they
only initialise the registration of the whole learnt body.

The table has means over the seeds. Off: the longest time that a joint is more than 150 mm off, in the worst recording.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from accuracy import DEFAULT_SCENES, SCENES, track_simulated

from anchorpose.motion.prediction import MotionConfig, MotionRule
from anchorpose.research.experiment.methods.references import ABLATION
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import Method, TrackConfig

VARIANTS: Final[Mapping[str, TrackConfig]] = {
    "**everything**": TrackConfig(),
    **dict(ABLATION.values()),
    "the paper's own way": TrackConfig(
        method=Method.PARTS, motion=MotionConfig(rule=MotionRule.BEST_SUBLIST, displacement_weight=0.0)
    ),
}


@dataclass(frozen=True, slots=True)
class Row:
    """One recording by one variant; None where every joint was lost."""

    mean_mm: float | None
    p95_mm: float | None
    lost_share: float
    off_s: float


def score(simulated: Path, results: Path, config: TrackConfig) -> Row:
    _, evaluation = track_simulated(simulated, results, config)
    overall = evaluation.overall
    lost = 0.0 if overall.lost_share is None else overall.lost_share
    return Row(overall.mean_mm, overall.p95_mm, lost, evaluation.longest_off.seconds)


def table(rows: Mapping[tuple[str, str], Sequence[Row]], scenes: Sequence[str]) -> str:
    """Markdown, one row a variant, three columns a scene."""
    heads = [f"{scene}: {what}" for scene in scenes for what in ("mean mm", "95 % mm", "off s")]
    lines = [f"| | {' | '.join(heads)} |", "|---|" + "--:|" * len(heads)]
    for variant in dict.fromkeys(variant for variant, _ in rows):
        cells = []
        for scene in scenes:
            found = rows[variant, scene]
            lost = max(row.lost_share for row in found)
            mean = _mean([row.mean_mm for row in found]) + (f" ({100 * lost:.0f} % lost)" if lost >= 0.01 else "")
            cells += [mean, _mean([row.p95_mm for row in found]), f"{max(row.off_s for row in found):.1f}"]
        lines.append(f"| {variant} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _mean(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{sum(known) / len(known):.1f}" if known else "–"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2, help="recordings of each scene")
    parser.add_argument("--first-seed", type=int, default=101)
    parser.add_argument("--seconds", type=float, default=4.0, help="length of each recording, at 15 pictures a second")
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(DEFAULT_SCENES))
    parser.add_argument("--method", type=Method, choices=list(Method), default=Method.ARTICULATED)
    chosen = parser.parse_args()
    variants = {name: config if config.method is Method.PARTS else replace(config, method=chosen.method)
                for name, config in VARIANTS.items()}  # fmt: skip
    rows: dict[tuple[str, str], list[Row]] = {(variant, scene): [] for variant in variants for scene in chosen.scenes}
    for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
        for scene in chosen.scenes:
            with TemporaryDirectory() as folder:
                simulated = Path(folder) / "simulated"
                simulate_recording(simulated, SCENES[scene](seed, chosen.seconds))
                for number, (variant, config) in enumerate(variants.items()):
                    row = score(simulated, Path(folder) / str(number), config)
                    rows[variant, scene].append(row)
                    print(f"{scene} seed {seed}, {variant}: {row}", file=sys.stderr)
    print(table(rows, chosen.scenes))


if __name__ == "__main__":
    main()
