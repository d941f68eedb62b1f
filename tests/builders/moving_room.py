"""A built room in which people move, seen by cameras whose clocks disagree; depth frames on demand."""

from dataclasses import dataclass, field

import numpy as np
from room_builder import ROOM, body, camera_at, picture

from anchorpose.camera import Camera
from anchorpose.recording.recording import Clock

FRONT = camera_at((2.5, 1.3, 0.0), (0.0, 0.9, 0.0), width=192, height=160)
LEFT = camera_at((1.5, 1.2, -2.1), (0.0, 0.9, 0.0), width=192, height=160)


def shown_s(clock: Clock, reference_s: float) -> float:
    """The time that a clock shows at a reference time."""
    return reference_s + clock.ahead_s + clock.drift * (reference_s - clock.at_s)


def walking(time_s: float) -> tuple:
    """Two people of different height; one sways, one walks about; movements that never repeat."""
    sway = 0.12 * np.sin(2.1 * time_s) + 0.08 * np.sin(5.3 * time_s + 1.0)
    lean = 0.15 * np.sin(1.7 * time_s + 0.3)
    x, z = 0.5 * np.sin(0.9 * time_s) - 0.2, 0.7 + 0.4 * np.cos(1.3 * time_s + 0.5)
    return (*body(float(sway), float(lean) - 0.3, 1.75), *body(float(x), float(z), 1.55))


def standing(time_s: float) -> tuple:
    """Nobody moves."""
    return body(0.0, 0.0)


@dataclass(slots=True, eq=False)
class MovingRoom:
    """One clock per camera; every camera takes a depth frame each 1 / fps seconds of its own clock."""

    cameras: tuple[Camera, ...]
    clocks: tuple[Clock, ...]
    scene: object = walking
    seconds: float = 6.0
    fps: float = 15.0
    reads: int = 0
    made: dict = field(default_factory=dict)

    @property
    def times_s(self) -> tuple[np.ndarray, ...]:
        steps = np.arange(round(self.seconds * self.fps)) / self.fps
        return tuple(shown_s(clock, 0.0) + steps for clock in self.clocks)

    def read(self, camera: int, position: int) -> np.ndarray:
        self.reads += 1
        if (camera, position) not in self.made:
            time_s = float(self.clocks[camera].reference_s(self.times_s[camera][position]))
            seed = 1000 * camera + position
            self.made[camera, position] = picture(self.cameras[camera], *ROOM, *self.scene(time_s), seed=seed)
        return self.made[camera, position]
