"""Hold one camera's frame with a label for every pixel."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np


class PixelLabel(IntEnum):
    """The label of a pixel. Each label from ``OTHER_PERSON`` on stands for one person other than the patient."""

    NO_READING = 0
    BACKGROUND = 1
    EQUIPMENT = 2  # a separate label, since the patient may be behind the equipment
    CLUTTER = 3  # foreground that is not part of a person: flying pixels, small pieces
    PATIENT = 4
    OTHER_PERSON = 5


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One camera's depth frame and the label of each pixel."""

    depth_m: np.ndarray  # (height, width) float32 m, 0 = no reading
    labels: np.ndarray  # (height, width) uint8 of ``PixelLabel``

    @property
    def patient(self) -> np.ndarray:
        """Return (height, width) bool: pixels on the patient."""
        return self.labels == np.uint8(PixelLabel.PATIENT)

    @property
    def hidden_by_equipment(self) -> np.ndarray:
        """Return (height, width) bool: pixels that show the equipment; the patient may be behind it."""
        return self.labels == np.uint8(PixelLabel.EQUIPMENT)
