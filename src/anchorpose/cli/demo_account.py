"""Write the sentences that ``anchorpose demo`` prints at its end. They state the figures of an evaluation in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from anchorpose.report.words import named_part
from anchorpose.results.evaluate import ErrorSummary, Evaluation
from anchorpose.results.evaluation_file import longest_error_sentence


def account(evaluation: Evaluation) -> list[str]:
    """Return the findings of an evaluation, one sentence per item; a sentence whose figures are unknown is left out."""
    return [
        *_accuracy(evaluation),
        *_seen_and_inferred(evaluation),
        *_joints(evaluation.per_joint),
        *_knees(evaluation),
        *_uncertainty(evaluation.overall.coverage_95),
        longest_error_sentence(evaluation),
    ]


def _accuracy(evaluation: Evaluation) -> Iterator[str]:
    errors = evaluation.overall
    if errors.mean_mm is not None and errors.p95_mm is not None:
        yield f"Joints are {errors.mean_mm:.0f} mm off on average; 95 of 100 are at most {errors.p95_mm:.0f} mm off."
    if errors.lost_share:
        yield f"{100 * errors.lost_share:.0f} % of the joints are lost: these have no position."


def _seen_and_inferred(evaluation: Evaluation) -> Iterator[str]:
    """Yield a sentence on seen joints and a sentence on inferred joints, with their share and their mean error."""
    for words, errors in (("seen", evaluation.observed), ("hidden and inferred", evaluation.hidden)):
        if errors.mean_mm is not None:
            share = 100 * errors.joint_frames / evaluation.overall.joint_frames
            yield f"{share:.0f} % of the joints were {words}: {errors.mean_mm:.0f} mm off on average."


def _joints(per_joint: Iterable[tuple[str, ErrorSummary]]) -> Iterator[str]:
    known = sorted((errors.mean_mm, named_part(name)) for name, errors in per_joint if errors.mean_mm is not None)
    if known:
        (least, best), (most, worst) = known[0], known[-1]
        yield f"The best joint is the {best} ({least:.0f} mm), the worst the {worst} ({most:.0f} mm)."


def _knees(evaluation: Evaluation) -> Iterator[str]:
    angles = dict(evaluation.angles)
    left, right = (angles[f"knee_flexion_{side}"].mean_abs_deg for side in ("left", "right"))
    if left is not None and right is not None:
        yield f"Knee flexion is {left:.1f} degrees off on the left and {right:.1f} on the right."


def _uncertainty(coverage: float | None) -> Iterator[str]:
    if coverage is not None:
        yield f"The stated uncertainty covers the true position on {100 * coverage:.0f} of 100 axes; 95 is exact."
