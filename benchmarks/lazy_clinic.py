"""A long simulated recording of which only the pictures that are asked for are ever made."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from anchorpose.camera import Camera
from anchorpose.simulate.clinic import Clinic, draw_clinic, random_stream
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.render import Figure, TrueImage, draw_figures
from anchorpose.simulate.sensor import SENSORS, draw_wiggle, sense
from anchorpose.simulate.shoot import empty_rooms, equipment_triangles, set_up
from anchorpose.simulate.write import Record, draw_record

FIGURES_KEPT = 8  # cameras look at nearly the same moments


@dataclass(slots=True, eq=False)
class LazyClinic:
    """The pictures of a clinic by camera and number, made when asked for and kept."""

    clinic: Clinic
    stills: tuple[TrueImage, ...]
    wiggles_m: tuple[np.ndarray, ...]
    records: tuple[Record, ...]
    backgrounds_m: tuple[np.ndarray, ...]
    made: dict[tuple[int, int], np.ndarray] = field(default_factory=dict)

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """With their true poses."""
        return self.clinic.cameras

    @property
    def times_s(self) -> tuple[np.ndarray, ...]:
        """What the stamps say."""
        return tuple(record.stamp_s[record.kept] for record in self.records)

    def read(self, camera: int, position: int) -> np.ndarray:
        """(height, width) float32 metres of the picture at a position in a camera's stream."""
        record = self.records[camera]
        number = int(record.shown[np.flatnonzero(record.kept)[position]])
        key = (camera, number)
        if key not in self.made:
            self.made[key] = self._shoot(camera, number)
        return self.made[key].astype(np.float32) * np.float32(0.001)

    def _shoot(self, camera: int, number: int) -> np.ndarray:
        config = self.clinic.config
        # the drawn time is this number's own, whatever stamp or file it ends up with
        picture = draw_figures(self.clinic.cameras[camera], self.stills[camera], self._figures(camera, number))
        rng = random_stream(config, "sensor", camera, number)
        return sense(rng, SENSORS[config.sensor], picture.depth_m, picture.cosine, self.wiggles_m[camera])

    def _figures(self, camera: int, number: int) -> tuple[Figure, ...]:
        return self.clinic.act(self.clinic.true_times_s(camera)[number : number + 1]).figures(0)


def lazy_clinic(config: SimulationConfig) -> LazyClinic:
    """Set up the rooms and stamps of ``config``, but render nobody yet."""
    clinic = draw_clinic(config)
    brief = set_up(draw_clinic(replace(config, seconds=0.1, starts_late_s=(), ends_early_s=())))
    studio = replace(brief, clinic=clinic, stills=empty_rooms(clinic, equipment_triangles(clinic, moved=False)))
    spec = SENSORS[config.sensor]
    wiggles = tuple(draw_wiggle(random_stream(config, "sensor", index), spec) for index in range(config.cameras))
    return LazyClinic(
        clinic,
        studio.stills,
        wiggles,
        tuple(draw_record(clinic, index) for index in range(config.cameras)),
        tuple(studio.background_mm(index) * np.float32(0.001) for index in range(config.cameras)),
    )
