"""Define the settings of an experiment: recordings, holes in their depth images, scenes and methods."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Final

from pydantic import Field

from anchorpose.settings import Count, Positive, settings
from anchorpose.simulate.config import LARGEST_HOLE_M, SMALLEST_HOLE_M

PAPER_HOLES_M: Final = (0.0, 0.03, 0.06, 0.09, 0.12, 0.15)
"""Radii in metres of the holes that are cut into depth images: 0 (no hole), and the paper's five sizes."""


class Scene(StrEnum):
    """A kind of recording. The paper only has recordings of the kind ``PAPER``; this project has added the others."""

    PAPER = "paper"  # one person, one front camera, and no occlusion except the holes
    LOOSE = "loose"  # as PAPER, but with looser clothes, whose folds are 14 mm above the skin instead of 9 mm
    FRAME = "frame"  # one front camera, and the bars of a standing frame in front of the patient
    CLINIC_FRONT = "clinic-front"  # as FRAME, with two therapists who hold the patient and move
    CLINIC = "clinic"  # as CLINIC_FRONT, with three cameras
    REAL = "real"  # the user's recordings, in which another tracker's skeleton is the reference


class Form(StrEnum):
    """A form (variant) of the paper's tracking framework. The forms differ in how the pose is computed from the matches
    of nodes.

    A match of a node of the surface is a node of the next frame's surface. The paper rejects no match. A form with
    rejection leaves a node unmatched if this costs less in the track tree than a match: a match costs its distance from
    the node's predicted place, and a frame without a match costs ``TreeConfig.missed_cost_m``. Such a form also gives
    outliers less weight (Cauchy's function) when the motion of a body part is fitted. If too little of the patient's
    surface lies near the body in the fitted pose, or if the depth images are more probable without the body, the form
    replaces this pose by the predicted pose. As a result, bad matches have little effect.
    """

    REFINED = "surface"  # body parts are fitted to their matches, then to the surface (ICP); bad matches are rejected
    REFINED_ALL = "surface-all"  # as REFINED, but bad matches are not rejected, as in the paper
    MATCHES = "matches"  # body parts are fitted only to their matches; bad matches are rejected
    MATCHES_ALL = "matches-all"  # as MATCHES, but bad matches are not rejected

    @property
    def refined(self) -> bool:
        """Return whether body parts are registered to the surface after they were fitted to their matches."""
        return self in (Form.REFINED, Form.REFINED_ALL)

    @property
    def rejects(self) -> bool:
        """Return whether bad matches are rejected."""
        return self in (Form.REFINED, Form.MATCHES)


class Update(StrEnum):
    """The way in which the matches of nodes update the pose."""

    PARTS = "parts"  # each body part is moved separately, as in the paper
    KALMAN = "kalman"  # an iterated extended Kalman filter updates the whole pose (paper, Section III)
    PARTICLES = "particles"  # a particle filter updates the whole pose (paper, Section III)


@settings
class ExperimentConfig:
    """The settings of an experiment. The defaults are the paper's settings: 20 recordings, six sizes of hole, the same
    frames for all methods.

    The frame rate of ten per second is inferred from the paper: its 200 samples (frames) contain slow and fast
    movements of all limbs. 200 consecutive frames of a video would be too short for this, so the samples must be about
    a tenth of a second apart.
    """

    # first seed of the test recordings; each seed gives another body, other clothes and other movements
    first_seed: int = 501
    recordings: Count = 20  # number of recordings; with 150 frames each, they have 3,000 frames, as in the paper
    seconds: Positive = 15.0  # s, duration of each recording of the paper's scene
    fps: Annotated[Positive, Field(le=30)] = 10.0
    holes_m: tuple[float, ...] = PAPER_HOLES_M  # m, radii of the holes that are cut into depth images; 0 = no hole
    hole_share: Annotated[Positive, Field(le=1)] = 0.5  # share of the frames that get a hole, drawn at random
    # Number of frames in a segment of a recording, one second by default. In the first frame of each segment, the pose
    # is given to the methods.
    segment_frames: Annotated[Count, Field(ge=2)] = 10
    # Number of segments per recording on which every method runs, drawn at random. In the first of a segment's ten
    # frames, the pose is given and not tracked, so 20 recordings have 20 x 6 x 9 = 1,080 tracked frames.
    segments: Count = 6
    gaps_s: tuple[Positive, ...] = (0.1, 0.3, 1.0, 1.5)  # seconds between the two frames whose nodes are matched
    # number of pairs of frames whose matches are compared with the truth, for each recording, size of the hole in the
    # depth images, and gap (time between the two frames)
    windows: Count = 2
    # Forms (variants) of the paper's tracking framework that run. All of them run without holes and with the largest
    # hole; with holes of other sizes, only the forms run that fit body parts to the surface (``Form.refined``).
    forms: Annotated[tuple[Form, ...], Field(min_length=1)] = tuple(Form)
    scenes: tuple[Scene, ...] = (Scene.PAPER, Scene.LOOSE, Scene.FRAME, Scene.CLINIC_FRONT, Scene.CLINIC)
    scene_recordings: Count = 3  # number of recordings of each scene other than the paper's
    scene_seconds: Positive = 6.0  # s, duration of each recording of a scene other than the paper's
    methods: tuple[str, ...] = ()  # keys of methods, or paths of Python files with METHODS; empty = all methods
    # whether variants of anchorpose's tracker, each without one of its components, also run; they run in the scenes in
    # which the bars of a standing frame are in front of the patient
    ablation: bool = True
    # first seed of the training recordings, on which settings are chosen, and whose movements serve to predict poses
    training_seed: int = 401
    training_recordings: Count = 4
    # number of frames of the reference movements, which are used to predict poses
    training_samples: Annotated[Count, Field(ge=40)] = 200
    # number of pairs of frames per training recording on which settings are tried, each pair without and with holes
    training_windows: Count = 2
    # whether each method's setting is chosen on the training recordings; False: every method uses its first setting
    tuned: bool = True
    # whether pictures of matches, hypotheses and tracked joints are drawn; False: only tables and figures
    pictures: bool = True
    resamples: Annotated[Count, Field(ge=100)] = 2000  # number of random draws of recordings for a bootstrap interval

    def __post_init__(self) -> None:
        if not (
            self.seconds * self.fps >= self.segment_frames and self.scene_seconds * self.fps >= self.segment_frames
        ):
            raise ValueError(f"a recording must contain a segment of {self.segment_frames} frames; make it longer")
        for radius_m in self.holes_m:
            if radius_m != 0 and not SMALLEST_HOLE_M <= radius_m <= LARGEST_HOLE_M:
                raise ValueError(f"holes_m are 0 or {SMALLEST_HOLE_M} to {LARGEST_HOLE_M}, got {radius_m}")
        if 0.0 not in self.holes_m:
            raise ValueError("holes_m must contain 0, for comparison")
        if any(abs(self.fps * gap_s - self.stride(gap_s)) > 1e-6 or self.stride(gap_s) < 1 for gap_s in self.gaps_s):
            raise ValueError(f"gaps_s must be whole numbers of frames at {self.fps:g} per second, got {self.gaps_s}")
        seeds = range(self.first_seed, self.first_seed + max(self.recordings, self.scene_recordings))
        if set(seeds) & set(range(self.training_seed, self.training_seed + self.training_recordings)):
            raise ValueError("the recordings to test and to train on have seeds in common; move first_seed")

    def stride(self, gap_s: float) -> int:
        """Return the gap between two frames whose matches are compared, as a number of frames."""
        return round(gap_s * self.fps)

    def segments_of(self, scene: Scene) -> int:
        """Return the number of segments (pieces of ``segment_frames`` frames) on which methods run in each simulated
        recording of a scene.
        """
        seconds = self.seconds if scene is Scene.PAPER else self.scene_seconds
        return min(self.segments, round(seconds * self.fps) // self.segment_frames)

    def seeds(self, scene: Scene) -> range:
        """Return the seeds of the test recordings of a scene."""
        count = self.recordings if scene is Scene.PAPER else self.scene_recordings
        return range(self.first_seed, self.first_seed + count)


def quick() -> ExperimentConfig:
    """Return a configuration that runs every step once on very little data, only to show that the program works.

    The run takes five minutes.
    """
    return ExperimentConfig(
        recordings=1,
        seconds=1.5,
        holes_m=(0.0, 0.15),
        segment_frames=4,
        segments=1,
        gaps_s=(0.1,),
        windows=1,
        forms=(Form.REFINED, Form.MATCHES_ALL),
        scenes=(Scene.PAPER,),
        ablation=False,
        training_recordings=1,
        training_samples=40,
        tuned=False,
        resamples=200,
    )
