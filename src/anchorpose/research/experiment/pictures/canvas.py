"""Provide the parts that all pictures use: pairs of frames with the truth, reproducible figures, a level view, shaded
meshes.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import MissingPackage
from anchorpose.pages.canvas import Ink, as_hex
from anchorpose.recording.recording import FrameSet
from anchorpose.research.experiment.config import Form
from anchorpose.research.experiment.correspondence import Skin, TruePlaces
from anchorpose.research.experiment.matching import Window, take_window
from anchorpose.research.experiment.work import Trial
from anchorpose.surface.mesh import faces
from anchorpose.surface.surface import Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


DOTS_PER_INCH: Final = 110
COLOURS: Final = 256  # number of colours in a picture: the maximum for a PNG with a palette
BLUE, VERMILLION, GREEN = as_hex(Ink.BLUE), as_hex(Ink.VERMILLION), as_hex(Ink.GREEN)
BARE: Final = np.array([0.86, 0.86, 0.86])
"""Colour (red, green, blue) of a mesh without coloured data, of which only the shape is shown."""

# direction to the light (right, up, towards the viewer); the light comes from above the viewer's left shoulder
LAMP: Final = np.array([-0.35, 0.45, 0.82])
AMBIENT: Final = 0.35  # share of the brightness that is independent of the light's direction


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One picture with its file name and caption."""

    file: str
    caption: str
    section: str  # section of the page that contains the picture
    figure: Figure


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A level view with parallel rays, from the side of the patient on which the camera stands."""

    axes: np.ndarray  # (3, 3), world; the rows are the directions to the right, up and towards the viewer

    def flat_m(self, points_m: np.ndarray, shift_m: float = 0.0) -> np.ndarray:
        """Return (..., 2) the points' places in the picture: metres to the right (plus ``shift_m``) and up."""
        return np.asarray(points_m @ self.axes[:2].T + np.array([shift_m, 0.0]))

    def near_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return the nearness (...) of points to the viewer: metres from the world's origin towards the viewer."""
        return np.asarray(points_m @ self.axes[2])


def upright_view(camera: Camera) -> View:
    """Return the camera's view, turned so that the world's Y points up in the picture, however the camera is
    mounted.
    """
    T_world_camera, up = camera.require_pose(), np.array([0.0, 1.0, 0.0])
    towards = -T_world_camera[:3, 2] * [1.0, 0.0, 1.0]
    length = float(np.linalg.norm(towards))
    if length < 1e-6:
        raise ValueError(f"camera {camera.name} looks straight down: it has no level view")
    towards = towards / length
    return View(np.stack([np.cross(up, towards), up, towards]))


@contextmanager
def default_style() -> Iterator[None]:
    """Make figures that are drawn within the ``with`` block independent of the user's matplotlib settings.

    Raises MissingPackage without matplotlib.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise MissingPackage("drawing the experiment's pictures", "matplotlib", "experiments") from error
    with matplotlib.rc_context():
        matplotlib.rcParams.update({**_defaults(matplotlib), "font.size": 9.0, "axes.titlesize": 9.5})
        yield


def _defaults(matplotlib: Any) -> Any:
    """Return matplotlib's own defaults, except for the backend, which is not used here."""
    return {key: value for key, value in matplotlib.rcParamsDefault.items() if "backend" not in key}


def blank_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty matplotlib figure that opens no window; its size is in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), dpi=DOTS_PER_INCH, layout="constrained")


def as_png(figure: Figure) -> bytes:
    """Return the figure as a PNG with at most ``COLOURS`` colours, so that a page can contain all pictures.

    The same figure gives the same bytes, since the file has no date and no version.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas, buffer = FigureCanvasAgg(figure), io.BytesIO()
    canvas.draw()
    drawn = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    # MAXCOVERAGE keeps the colours of small marks, which other methods of quantisation may replace
    palette = drawn.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
    palette.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def draw_mesh(axes: Axes, view: View, surface: Surface, colour: np.ndarray = BARE, shift_m: float = 0.0) -> None:
    """Draw the shaded mesh, moved to the right by ``shift_m``. colour: (3,) for all nodes, or (n, 3), 0 to 1."""
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
    """Set equal scales, and limits that contain all surfaces, each moved to the right by its shift (float, metres)."""
    places = [view.flat_m(surface.points_m, shift_m) for surface, shift_m in surfaces if len(surface)]
    if places:
        together = np.concatenate(places)
        low, high = together.min(axis=0) - 0.05, together.max(axis=0) + 0.05
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    # ``set_axis_off`` is not used, since the layout would then leave no space for the title
    axes.set(xticks=[], yticks=[], frame_on=False)


def apart_m(view: View, one: Surface, other: Surface) -> float:
    """Return the shift to the right in metres that puts the other surface beside the first in a picture."""
    if len(one) == 0 or len(other) == 0:
        return 1.0
    return float(view.flat_m(one.points_m)[:, 0].max() - view.flat_m(other.points_m)[:, 0].min()) + 0.15


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """Two successive frames to be drawn side by side, with the true correspondence of their nodes."""

    name: str  # the moment's name in file names
    title: str  # title in captions
    window: Window
    truth: TruePlaces  # places of the first frame's nodes in the second

    @property
    def surfaces(self) -> tuple[Surface, Surface]:
        """Return the seen surface of the patient in both frames."""
        return self.window.observations[0].surface, self.window.observations[1].surface


def take_moment(frame: int, trial: Trial, skin: Skin, name: str, title: str) -> Moment:
    """Return a frame and the next frame of a trial.

    Raises ValueError if the patient was not found in the first frame or is not seen in the next.
    """
    window = take_window(frame, trial.given, trial.runs[Form.REFINED])
    if window is None:
        raise ValueError(f"the patient was not found in frame {frame} or is not seen in the next: choose another one")
    before, after = (seen.surface.points_m.astype(np.float64) for seen in window.observations[:2])
    return Moment(name, title, window, skin.follow(before, frame, frame + 1, after))


def taken_pixels(whole: FrameSet, holed: FrameSet) -> np.ndarray:
    """Return (height, width) bool: pixels of the first camera's depth image that the hole removed."""
    pictures = [each.depths_m[0] for each in (whole, holed)]
    if pictures[0] is None or pictures[1] is None:
        raise ValueError(f"the first camera has no picture of frame {whole.frame}")
    taken: np.ndarray = (pictures[0] > 0) & (pictures[1] == 0)
    return taken
