"""What the pictures are of: one recording as it is and with the hole, the two frames, and the truth of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import Recording
from anchorpose.research.experiment.correspondence import Skin, TruePlaces
from anchorpose.research.experiment.framework import paper_config
from anchorpose.research.experiment.matching import Window, take_window
from anchorpose.research.experiment.reference import Reference
from anchorpose.surface.surface import Surface
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Room
from anchorpose.tracking.motion_database import MotionDatabase
from anchorpose.tracking.motion_file import load_motions


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """A recording, and what every method is given of it."""

    room: Room
    reference: Reference
    motions: MotionDatabase | None
    config: TrackConfig


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """Two frames. name: in files; title: in captions; truth: where the first frame's nodes are in the second."""

    name: str
    title: str
    window: Window
    truth: TruePlaces

    @property
    def surfaces(self) -> tuple[Surface, Surface]:
        """What is seen of the patient in either frame."""
        return self.window.observations[0].surface, self.window.observations[1].surface


def set_stage(recording: Recording, reference: Reference, motions: Path) -> Stage:
    """Everything that is known before the first frame is followed."""
    config = paper_config(motions)
    database = load_motions(config.motion_file, recording.rate_hz, config.motion)
    return Stage(prepare_room(recording, config), reference, database, config)


def take_moment(stage: Stage, skin: Skin, frame: int, name: str, title: str) -> Moment:
    """The frame and the next one; ValueError where the patient is not known there."""
    window = take_window(frame, stage.room, stage.reference, stage.motions, stage.config)
    if window is None:
        raise ValueError(f"the patient is not known in frame {frame}, or not seen in the next: choose another one")
    before, after = (seen.surface.points_m.astype(np.float64) for seen in window.observations[:2])
    return Moment(name, title, window, skin.follow(before, frame, frame + 1, after))


def taken_pixels(whole: Recording, pierced: Recording, frame: int) -> np.ndarray:
    """(height, width) bool: what the first camera's picture lost to the hole."""
    pictures = [read_frame(recording, frame).depths_m[0] for recording in (whole, pierced)]
    if pictures[0] is None or pictures[1] is None:
        raise ValueError(f"the first camera has no picture of frame {frame}")
    taken: np.ndarray = (pictures[0] > 0) & (pictures[1] == 0)
    return taken
