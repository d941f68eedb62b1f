"""Everybody in view besides the patient: what the page shows of them, and by what a click names one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.isolation.bystander_memory import BystanderMemory
from anchorpose.isolation.view import PixelLabel

TOP: Final = 0.98  # of the heights of a person's skin: a flying pixel is not the head


@dataclass(frozen=True, slots=True)
class PersonInView:
    """number: from 1, the same while the person is followed; place_xz_m: on the floor, world; top_m: height (Y)."""

    number: int
    place_xz_m: tuple[float, float]
    top_m: float


def people_in(memory: BystanderMemory) -> tuple[PersonInView, ...]:
    """Who was seen in the newest frame of the memory, the patient left out."""
    return tuple(
        PersonInView(label - PixelLabel.PATIENT, (float(x), float(z)), float(np.quantile(points_m[:, 1], TOP)))
        for label, points_m in memory.seen_last.items()
        if label >= PixelLabel.OTHER_PERSON
        for x, z in [np.median(points_m[:, [0, 2]], axis=0)]
    )
