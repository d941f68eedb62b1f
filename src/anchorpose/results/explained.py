"""Write explained.parquet, which states how well each reported pose explains the depth images, and find the frames that
are explained worst.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import pyarrow as pa

from anchorpose.body.pose import PARTS
from anchorpose.results.frame_table import FrameTable, Numbers
from anchorpose.results.frame_time import worst_rows
from anchorpose.results.parquet import TRACK_AGAIN

if TYPE_CHECKING:  # for types only, since programs that only read results must not import compiled kernels
    from anchorpose.body.explanation import Explanation

PART_NAMES: Final = ("trunk", "arm_left", "leg_left", "arm_right", "leg_right")
"""Names of the body parts in ``Explanation.seen_past``, in the same order; the trunk includes the head."""

CM2_PER_M2: Final = 1e4
# cm2, minimum area of the patient's seen surface not near the reported body (uncovered area) that counts as bad: the
# area of a hand; clothes and other people's grips cause up to 40 cm2
UNCOVERED_CM2: Final = 80.0
# minimum share of a part's skin that a camera sees past, for the part to count as badly placed; correctly placed parts
# have less
SEEN_PAST: Final = 0.3
APART_S: Final = 0.5  # s, minimum time between two moments in run.json; closer moments show the same situation
MOST_MOMENTS: Final = 5  # maximum number of badly explained moments in run.json


@dataclass(frozen=True, slots=True, eq=False)
class ExplainedFrame:
    """The measures (of ``Explanation``) of how well the reported pose in one frame explains the depth images of this
    frame.

    uncovered_cm2: area of the patient's seen surface that is not near the skin of the reported body; NaN if the patient
    is lost or not seen at all. seen_past (5,): share of each part's camera-facing skin that a camera sees past, in the
    order of ``PART_NAMES``. A camera sees past a point of skin if it measures a surface behind this point. The share is
    NaN where the patient is lost or too little of the part is in view.
    """

    frame: int
    time_s: float
    uncovered_cm2: float
    seen_past: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class ExplainedTable:
    """The measures of all frames: frame (n,) int32, time_s (n,) float64, uncovered_cm2 (n,) and seen_past (n, 5)
    float32. ``ExplainedFrame`` states their meaning.
    """

    frame: np.ndarray
    time_s: np.ndarray
    uncovered_cm2: np.ndarray
    seen_past: np.ndarray


LARGEST_CM2: Final = 1e6
"""Maximum uncovered area in the table, in cm2: a hundred square metres, more than the walls that a camera sees."""

EXPLAINED: Final = FrameTable(
    file="explained.parquet",
    arrays=ExplainedTable,
    columns={
        "uncovered_cm2": Numbers(("uncovered_cm2",), 0.0, LARGEST_CM2, pa.float32()),
        "seen_past": Numbers(tuple(f"{name}_seen_past" for name in PART_NAMES), 0.0, 1.0, pa.float32()),
    },
    remedy=TRACK_AGAIN,
)
EXPLAINED_FILE, read_explained, write_explained = EXPLAINED.file, EXPLAINED.read, EXPLAINED.open


def explained_frame(frame: int, time_s: float, explanation: Explanation | None) -> ExplainedFrame:
    """Return the row of explained.parquet for a frame; explanation: None if the patient is lost."""
    if explanation is None:
        return ExplainedFrame(frame, time_s, np.nan, np.full(PARTS, np.nan))
    anything_seen = len(explanation.covered) + len(explanation.node) > 0
    uncovered_cm2 = CM2_PER_M2 * explanation.uncovered_m2 if anything_seen else np.nan
    return ExplainedFrame(frame, time_s, uncovered_cm2, explanation.seen_past)


def unexplained(table: ExplainedTable) -> np.ndarray:
    """Return the badness (n,) of each frame's explanation. It is the larger of two ratios: the uncovered area divided
    by ``UNCOVERED_CM2``, and the largest share of a part that is seen past divided by ``SEEN_PAST``. If the badness is
    1 or more, a limb is probably not at the place that the result reports. The badness is NaN if neither ratio is
    known.
    """
    past = np.fmax.reduce(table.seen_past / SEEN_PAST, axis=1)
    return np.asarray(np.fmax(table.uncovered_cm2 / UNCOVERED_CM2, past), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Moment:
    """A frame that its pose explains poorly, and the reason in words."""

    frame: int
    time_s: float
    reason: str


@dataclass(frozen=True, slots=True)
class ExplainedSummary:
    """The summary in run.json: the share of frames in which at least ``uncovered_limit_cm2`` of the patient's seen
    surface is uncovered (not near the reported body), and the worst moments.

    known_frames: number of frames in which the uncovered area is known; uncovered_share: share of these frames whose
    uncovered area reaches the limit, None if the area is known in no frame.
    """

    uncovered_limit_cm2: float
    known_frames: int
    uncovered_share: float | None
    worst: tuple[Moment, ...]


def summarise(table: ExplainedTable) -> ExplainedSummary:
    """Compute the share of frames with at least ``UNCOVERED_CM2`` of uncovered surface (seen surface that is not near
    the reported body), and the worst moments.
    """
    known = table.uncovered_cm2[np.isfinite(table.uncovered_cm2)]
    share = float((known >= UNCOVERED_CM2).mean()) if len(known) else None
    return ExplainedSummary(UNCOVERED_CM2, len(known), share, worst_moments(table))


def worst_moments(table: ExplainedTable) -> tuple[Moment, ...]:
    """Return the frames that their poses explain worst (a badness of 1 or more, ``unexplained``), the worst first: at
    most ``MOST_MOMENTS`` frames, at least ``APART_S`` apart.
    """
    badness = unexplained(table)
    rows = worst_rows(np.where(badness >= 1.0, badness, np.nan), table.time_s, APART_S, MOST_MOMENTS)
    return tuple(Moment(int(table.frame[row]), float(table.time_s[row]), _reason(table, row)) for row in rows)


def _reason(table: ExplainedTable, row: int) -> str:
    uncovered_cm2, reasons = table.uncovered_cm2[row], list[str]()
    if uncovered_cm2 >= UNCOVERED_CM2:
        reasons.append(f"{uncovered_cm2:.0f} cm² of the patient's surface is covered by no limb")
    for name, share in zip(PART_NAMES, table.seen_past[row].tolist(), strict=True):
        if share >= SEEN_PAST:
            limb = " ".join(reversed(name.split("_")))  # for example, "left arm" for ``arm_left``
            reasons.append(f"the {limb} lies in front of what a camera sees: {100.0 * share:.0f} %")
    return "; ".join(reasons)
