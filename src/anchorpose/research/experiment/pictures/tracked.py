"""Draw the paper's figures "mhtjoints" and "update": predicted, tracked and true joints over the frame's mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from anchorpose.joints import LIMBS
from anchorpose.research.experiment.framework import start_at
from anchorpose.research.experiment.given import GivenFrames
from anchorpose.research.experiment.method import Method
from anchorpose.research.experiment.pictures.canvas import (
    BLUE,
    GREEN,
    VERMILLION,
    Picture,
    View,
    blank_figure,
    draw_mesh,
    frame_axes,
)
from anchorpose.surface.surface import Surface
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.room import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SECTION: Final = "tracked"
MOMENTS: Final = 4
# number of frames from a drawn frame to the next drawn frame; at ten frames per second, the body moves visibly in these
# 0.3 s
APART: Final = 3
KINDS: Final = (("tracked", GREEN, "^", 5.0), ("predicted", VERMILLION, "x", 5.0), ("truth", BLUE, "o", 7.0))
"""Kinds of joints, with colour, marker and size of their marks. Marks of the truth are hollow, and drawn on top."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackedFrame:
    """A frame to be drawn: its surface, and its true, predicted and tracked joints."""

    frame: int
    surface: Surface
    joints_m: dict[str, np.ndarray]  # (21, 3), world, by kind: truth, predicted, tracked

    def error_m(self, kind: str) -> float:
        """Return the mean distance in metres of the joints of a kind (predicted or tracked) from the true joints."""
        return float(np.linalg.norm(self.joints_m[kind] - self.joints_m["truth"], axis=1).mean())


def follow(
    start: int, given: GivenFrames, run: Run, method: Method, setting: object, truth_m: np.ndarray
) -> list[TrackedFrame]:
    """Return a method's joints in up to ``MOMENTS`` frames: frame start + 1, and every ``APART``-th frame after it.

    truth_m (t, 21, 3): true joints, world.
    """
    if method.associate is None:
        raise ValueError(f"{method.key} does not run in the framework")
    config = method.configure(run.config, setting)
    wanted = range(start + 1, min(start + 2 + (MOMENTS - 1) * APART, len(truth_m)), APART)
    if not wanted:
        raise ValueError(f"no frame comes after frame {start}")
    stop = min(wanted[-1] + config.follow.look_ahead, len(truth_m))
    tracker = start_at(start, given, replace(run, config=config, associate=method.associate(setting)))
    found: list[TrackedFrame] = []
    frame = start
    for frame_set in [*(given.frame(position) for position in range(start + 1, stop)), None]:
        predicted = _joints(tracker)
        estimates = tracker.finish() if frame_set is None else filter(None, [tracker.step(frame_set)])
        for _ in estimates:
            frame += 1
            if frame in wanted:
                joints = {"truth": truth_m[frame], "predicted": predicted, "tracked": tracker.history[-1]}
                found.append(TrackedFrame(frame, tracker.window[0].surface, joints))
            predicted = _joints(tracker)
    return found


def _joints(tracker: PatientTracker) -> np.ndarray:
    """Return the joints (21, 3) that are predicted for the next frame."""
    pose = tracker.predict(1)[0]
    return tracker.body.joints(pose)


def tracked_picture(view: View, method: Method, frames: list[TrackedFrame], rate_hz: float, start: int) -> Picture:
    """Draw frames side by side, each with its joints. start: the frame in which the pose was given."""
    figure = blank_figure(2.9 * len(frames), 5.2)
    for number, each in enumerate(frames):
        axes = figure.add_subplot(1, len(frames), number + 1)
        draw_tracked(axes, view, each)
        axes.set_title(f"{(each.frame - start) / rate_hz:.1f} s: {1e3 * each.error_m('tracked'):.0f} mm")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(KINDS))
    caption = (
        f"Joints by {method.title}, {len(frames)} moments after the frame in which the pose is given: the truth (blue,"
        " round), what the motion dynamics predict from the frame before (vermilion, crosses), and what is tracked"
        " (green, triangles), over the frame's mesh with its holes. Titles: time since the given pose, and the mean"
        " distance of the tracked joints from the truth; that of the predicted ones is "
        + ", ".join(f"{1e3 * each.error_m('predicted'):.0f}" for each in frames)
        + " mm."
    )
    return Picture("tracked.png", caption, SECTION, figure)


def draw_tracked(axes: Axes, view: View, frame: TrackedFrame) -> None:
    """Draw the mesh of one frame, and its true, predicted and tracked joints."""
    from matplotlib.collections import LineCollection

    draw_mesh(axes, view, frame.surface)
    for kind, colour, marker, size in KINDS:
        place = view.flat_m(frame.joints_m[kind])
        limbs = [place[list(limb)] for limb in LIMBS]
        axes.add_collection(LineCollection(limbs, colors=colour, linewidths=0.8, alpha=0.7))
        fill = "none" if kind == "truth" else colour
        axes.plot(
            *place.T, marker, color=colour, markersize=size, markerfacecolor=fill, markeredgewidth=1.3, label=kind
        )
    frame_axes(axes, view, [(frame.surface, 0.0)])
