"""Convert an image without errors to the image that a recorder stores: add the sensor's errors, the losses of readings
that are typical of cluttered rooms, and the recorder's filters.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from anchorpose.simulate.librealsense import MEMORY, decimated_mm, smoothed_mm
from anchorpose.simulate.render import TrueImage
from anchorpose.simulate.rooms.spoil import Spoil, spoilt_mm
from anchorpose.simulate.sensor import SensorSpec, sense


@dataclass(frozen=True, slots=True, eq=False)
class Reader:
    """The converter of one camera's true images to stored images."""

    spec: SensorSpec
    wiggle_m: np.ndarray  # (height, width) m, systematic error of the sensor
    spoil: Spoil | None = None  # losses of readings in a cluttered room; None = none
    shiny: np.ndarray | None = None  # (height, width) bool, pixels of bare metal
    # depth images before smoothing, by frame number; they are kept only to save time: computing an image again would
    # give the same result
    recent: dict[int, np.ndarray] = field(default_factory=dict)

    def raw_mm(self, rng: np.random.Generator, image: TrueImage) -> np.ndarray:
        """Return the sensor's reading of a true image, (height, width) uint16 mm, before smoothing; 0 = no reading."""
        if self.spec.filtered:
            reading = decimated_mm(rng, self.spec, image.depth_m, image.cosine)
        else:
            reading = sense(rng, self.spec, image.depth_m, image.cosine, self.wiggle_m)
        if self.spoil is None or self.shiny is None:
            return reading
        return spoilt_mm(rng, self.spoil, image, self.shiny, reading)

    def keep(self, frame: int, reading_mm: np.ndarray) -> None:
        """Keep a depth image as it was before smoothing, since the recorder uses it to smooth the next frames."""
        self.recent[frame] = reading_mm
        for old in [number for number in self.recent if number <= frame - MEMORY]:
            del self.recent[old]

    def stored_mm(self, readings_mm: list[np.ndarray]) -> np.ndarray:
        """Return the image that the recorder stores for the last of some consecutive depth images."""
        return smoothed_mm(self.spec, readings_mm) if self.spec.filtered else readings_mm[-1]
