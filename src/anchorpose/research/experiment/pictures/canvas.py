"""What all pictures share: figures whose bytes depend on nothing but their content, the upright view, shaded meshes."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import MissingPackage
from anchorpose.pages import canvas as colours
from anchorpose.pages.canvas import as_hex
from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import Recording
from anchorpose.research.experiment.correspondence import Skin, TruePlaces
from anchorpose.research.experiment.framework import Reference
from anchorpose.research.experiment.matching import Window, take_window
from anchorpose.surface.mesh import faces
from anchorpose.surface.surface import Surface
from anchorpose.tracker.run import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


DOTS_PER_INCH: Final = 110
COLOURS: Final = 256  # what a PNG with a palette can hold
BLUE, VERMILLION, GREEN = as_hex(colours.BLUE), as_hex(colours.VERMILLION), as_hex(colours.GREEN)
BARE: Final = np.array([0.86, 0.86, 0.86])
"""The colour of a mesh of which nothing but its shape is told."""

LAMP: Final = np.array([-0.35, 0.45, 0.82])  # to the right, up, towards the viewer: from the viewer's left shoulder
AMBIENT: Final = 0.35


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One file of the album. section: which kind of picture it is."""

    file: str
    caption: str
    section: str
    figure: Figure


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """From the camera's side, level, parallel rays: axes (3, 3) of the world, to the right, up, and to the viewer."""

    axes: np.ndarray

    def flat_m(self, points_m: np.ndarray, shift_m: float = 0.0) -> np.ndarray:
        """(..., 2) metres to the right, ``shift_m`` farther than they are, and up."""
        return np.asarray(points_m @ self.axes[:2].T + np.array([shift_m, 0.0]))

    def near_m(self, points_m: np.ndarray) -> np.ndarray:
        """(...) metres towards the viewer."""
        return np.asarray(points_m @ self.axes[2])


def upright_view(camera: Camera) -> View:
    """The camera's view turned level, up being the world's Y, however the camera was mounted."""
    T_world_camera, up = camera.require_pose(), np.array([0.0, 1.0, 0.0])
    towards = -T_world_camera[:3, 2] * [1.0, 0.0, 1.0]
    length = float(np.linalg.norm(towards))
    if length < 1e-6:
        raise ValueError(f"camera {camera.name} looks straight down: it has no side of the patient to show upright")
    towards = towards / length
    return View(np.stack([np.cross(up, towards), up, towards]))


@contextmanager
def default_style() -> Iterator[None]:
    """Within it no file of the user's decides what a figure looks like. Raises MissingPackage without matplotlib."""
    try:
        import matplotlib
    except ImportError as error:
        raise MissingPackage("drawing the experiment's pictures", "matplotlib", "experiments") from error
    with matplotlib.rc_context():
        matplotlib.rcParams.update({**_defaults(matplotlib), "font.size": 9.0, "axes.titlesize": 9.5})
        yield


def _defaults(matplotlib: Any) -> Any:
    """All that matplotlib comes with, but for the backend, which nothing here uses."""
    return {key: value for key, value in matplotlib.rcParamsDefault.items() if "backend" not in key}


def blank_figure(width_in: float, height_in: float) -> Figure:
    """A figure of no window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), dpi=DOTS_PER_INCH, layout="constrained")


def as_png(figure: Figure) -> bytes:
    """With at most ``COLOURS`` colours: a third of the size, so that a page can hold all pictures.

    The same figure gives the same bytes: no date, no version.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas, buffer = FigureCanvasAgg(figure), io.BytesIO()
    canvas.draw()
    drawn = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    # the palette that keeps small marks' colours, which a mean over boxes of colours does not
    palette = drawn.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
    palette.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def draw_mesh(axes: Axes, view: View, surface: Surface, colour: np.ndarray = BARE, shift_m: float = 0.0) -> None:
    """The shaded mesh, moved to the right by ``shift_m``. colour: (3,) of all nodes, or (n, 3), 0 to 1."""
    from matplotlib.collections import PolyCollection

    triangles = faces(surface)
    triangles = triangles[np.argsort(view.near_m(surface.points_m)[triangles].mean(axis=1), kind="stable")]
    place = view.flat_m(surface.points_m, shift_m)
    slant = surface.normals @ view.axes.T @ (LAMP / np.linalg.norm(LAMP))
    light = AMBIENT + (1.0 - AMBIENT) * np.clip(slant, 0.0, 1.0)
    shaded = np.broadcast_to(colour, (len(surface), 3)) * light[:, None]
    face = np.clip(shaded[triangles].mean(axis=1), 0.0, 1.0)
    axes.add_collection(PolyCollection(list(place[triangles]), facecolors=face, edgecolors=face, linewidths=0.4))


def frame_axes(axes: Axes, view: View, surfaces: list[tuple[Surface, float]]) -> None:
    """Equal scales, room for all of the surfaces where they are shifted to, nothing around them."""
    places = [view.flat_m(surface.points_m, shift_m) for surface, shift_m in surfaces if len(surface)]
    if places:
        together = np.concatenate(places)
        low, high = together.min(axis=0) - 0.05, together.max(axis=0) + 0.05
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.set(xticks=[], yticks=[], frame_on=False)  # not set_axis_off: the layout would leave no room for the title


def apart_m(view: View, one: Surface, other: Surface) -> float:
    """How far to the right the other surface goes to stand clear of the first."""
    if len(one) == 0 or len(other) == 0:
        return 1.0
    return float(view.flat_m(one.points_m)[:, 0].max() - view.flat_m(other.points_m)[:, 0].min()) + 0.15


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


def take_moment(frame: int, reference: Reference, run: Run, skin: Skin, name: str, title: str) -> Moment:
    """The frame and the next one; ValueError where the patient is not known there."""
    window = take_window(frame, reference, run)
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
