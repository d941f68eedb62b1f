"""Label separate pieces of surface as the patient's hidden limbs, such as a foot seen below a kneeling therapist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.isolation.scene import SMALLEST_PIECE_M2, Pieces
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.threads import each

# 1/m3, number of pieces of surface per volume near a patient that have no person's label and do not show the patient;
# in simulated clinics, it is 1 to 3
CLUTTER_PER_M3: Final = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class HiddenSkin:
    """The predicted skin of limbs whose place is too uncertain for this skin to decide, pixel by pixel, which person a
    pixel shows.
    """

    points_m: np.ndarray  # (n, 3), predicted points on the skin, metres in the world frame
    sigma_m: np.ndarray  # (n,) standard deviation of the skin about the point
    part: np.ndarray  # (n,) int, the segment to which the point belongs: half of a limb or of the trunk

    def density(self, places_m: np.ndarray) -> np.ndarray:
        """Return (m,) 1/m3: for each place (m, 3), the probability density that the centre of a visible piece of a limb
        lies there. A piece is equally likely to show any point of a segment (half of a limb or of the trunk, ``part``).
        At each place, the segment with the highest density counts.
        """
        away2 = ((places_m[:, None] - self.points_m) ** 2).sum(axis=2)
        normal = np.exp(-0.5 * away2 / self.sigma_m**2) / (np.sqrt(2.0 * np.pi) * self.sigma_m) ** 3
        belongs = self.part[:, None] == np.unique(self.part)
        return np.asarray((normal @ (belongs / belongs.sum(axis=0))).max(axis=1, initial=0.0))


def label_hidden_limbs(
    pieces: Sequence[Pieces | None], views: Sequence[View | None], hidden: HiddenSkin
) -> tuple[View | None, ...]:
    """Give separate pieces without a person's label the patient's label where a hidden limb is more probable than an
    unknown object; return the changed views.

    Because of the patient's label, the body model is then fitted to such a piece, too. If no pose of the limb fits the
    piece, the fitted body will not cover the piece.
    """

    def labelled(pixels: Pieces | None, view: View | None) -> View | None:
        return view if pixels is None or view is None else _label(pixels, view, hidden)

    return tuple(each(labelled, pieces, views) if len(hidden.part) else views)


def _label(pixels: Pieces, view: View, hidden: HiddenSkin) -> View:
    free = np.flatnonzero(view.labels[pixels.row, pixels.column] == PixelLabel.CLUTTER)
    piece, count = pixels.piece[free], pixels.piece_count + 1
    large = np.flatnonzero(np.bincount(piece, pixels.area_m2[free], count) >= SMALLEST_PIECE_M2)
    sums = [np.bincount(piece, pixels.points_m[free, axis], count) for axis in range(3)]
    centre_m = np.stack(sums, axis=1)[large] / np.bincount(piece, minlength=count)[large, None]
    limb = large[hidden.density(centre_m) > CLUTTER_PER_M3]
    if not len(limb):
        return view
    shown = free[np.isin(piece, limb)]
    labels = view.labels.copy()
    labels[pixels.row[shown], pixels.column[shown]] = PixelLabel.PATIENT
    return View(view.depth_m, labels)
