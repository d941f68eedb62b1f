"""Measure how well the cameras' clocks are found, with known poses and without.

The recording is ten minutes of a clinic, of which only the images that the estimate reads are rendered. An error is
that of the time which an image gets on the first camera's clock: the offset is the error in the middle of the
recording, the drift is the difference between the errors at its ends.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from probe import Row, Scene, answer

from anchorpose.calibration.clocks import ClockConfig, Clocks, estimate_clocks
from anchorpose.calibration.first_frames import level_of_pose
from anchorpose.camera import Camera
from anchorpose.recording.depth_image import FRAMES_KEPT
from anchorpose.results.uncertainty import NORMAL_95
from anchorpose.simulate.clinic import Clinic, draw_clinic, random_stream
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.render import TrueImage, draw_figures
from anchorpose.simulate.sensor import SENSORS, draw_wiggle, sense
from anchorpose.simulate.shoot import empty_rooms, equipment_triangles
from anchorpose.simulate.write import Record, draw_record


@dataclass(frozen=True, slots=True, eq=False)
class LazyClinic:
    """A clinic's images by camera and position, rendered when they are read. reads: camera and position of each image
    that ``RecordedFrames`` would read from the disk, since it keeps the latest ``FRAMES_KEPT`` images in memory.
    """

    clinic: Clinic
    cameras: tuple[Camera, ...]
    stills: tuple[TrueImage, ...]
    wiggles_m: tuple[np.ndarray, ...]
    records: tuple[Record, ...]
    rendered: dict[tuple[int, int], np.ndarray] = field(default_factory=dict)
    reads: list[tuple[int, int]] = field(default_factory=list)

    @property
    def times_s(self) -> tuple[np.ndarray, ...]:
        """Return the time stamps of each camera's images."""
        return tuple(record.stamp_s[record.kept] for record in self.records)

    def read(self, camera: int, position: int) -> np.ndarray:
        """Return the depth image (height, width) at a position in a camera's stream, float32 metres."""
        if (camera, position) not in self.reads[-FRAMES_KEPT:]:
            self.reads.append((camera, position))
        record = self.records[camera]
        number = int(record.shown[np.flatnonzero(record.kept)[position]])
        if (camera, number) not in self.rendered:
            self.rendered[camera, number] = self._render(camera, number)
        return self.rendered[camera, number].astype(np.float32) * np.float32(0.001)

    def _render(self, camera: int, number: int) -> np.ndarray:
        config = self.clinic.config
        figures = self.clinic.act(self.clinic.true_times_s(camera)[number : number + 1]).figures(0)
        image = draw_figures(self.clinic.cameras[camera], self.stills[camera], figures)
        rng = random_stream(config, "sensor", camera, number)
        return sense(rng, SENSORS[config.sensor], image.depth_m, image.cosine, self.wiggles_m[camera])


def lazy_clinic(config: SimulationConfig) -> LazyClinic:
    """Set up the rooms and time stamps, without rendering people yet."""
    clinic, spec = draw_clinic(config), SENSORS[config.sensor]
    numbers = range(config.cameras)
    return LazyClinic(
        clinic,
        clinic.cameras,
        tuple(empty_rooms(clinic, equipment_triangles(clinic, moved=False))),
        tuple(draw_wiggle(random_stream(config, "sensor", index), spec) for index in numbers),
        tuple(draw_record(clinic, index) for index in numbers),
    )


def measure(scene: Scene) -> Iterator[Row]:
    """Estimate the clocks with and without camera poses."""
    config, known = scene.simulated, lazy_clinic(scene.simulated)
    levels = [level_of_pose(camera.require_pose()) for camera in known.cameras]
    cameras = tuple(replace(camera, T_world_camera=None) for camera in known.cameras)
    blind = replace(known, cameras=cameras, reads=[])
    for part, seen in (("poses known", known), ("poses unknown", blind)):
        clocks = estimate_clocks(seen, levels, ClockConfig())
        for camera in range(1, config.cameras):
            yield part, _scores(config, clocks, camera, len(seen.reads))


def _scores(config: SimulationConfig, clocks: Clocks, camera: int, frames_read: int) -> dict[str, float]:
    """Return the errors of one clock; no errors of a clock that was kept without an estimate. frames_read: number of
    depth images that the estimate of all clocks has read, repeated reads included.
    """
    found = clocks.cameras[camera]
    if found.doubt is not None:
        return {"kept": 1.0}
    stamps_s = np.array([0.0, 0.5, 1.0]) * config.seconds
    true_s = stamps_s + config.clock_late_s[camera] + config.clock_drift[camera] * stamps_s
    start_ms, middle_ms, end_ms = 1e3 * (found.clock.reference_s(stamps_s) - true_s)
    return {
        "offset_ms": abs(middle_ms),
        "drift_ms": abs(end_ms - start_ms),
        "in_band": float(abs(middle_ms) < NORMAL_95 * 1e3 * (found.sigma_s or np.nan)),
        "kept": 0.0,
        "frames_read": float(frames_read),
    }


if __name__ == "__main__":
    answer(measure)
