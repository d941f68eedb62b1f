"""The learnt descriptor: which pixels of a depth image show people, and which place on the body each of them shows.

The paper's descriptor (Definition 3) is the geodesic distances of a surface point to the anchors. Measured on an image,
they are wrong wherever something is hidden: the error e_3 of Section VI. Here a network that was trained on simulated
images names the place on the complete body's skin, where the distances are known. See ``docs/descriptor.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import InputError, MissingPackage
from anchorpose.lens import Intrinsics, lens_array, project, rays_of_pixels
from anchorpose.recording.regular_file import read_whole

FOCAL_PX: Final = 200.0  # of the images that the network was trained on
STEP: Final = 2  # the network answers for each second pixel
MULTIPLE: Final = 32  # the network halves its image five times
SMALLEST_PX: Final = 32
WIDEST: Final = 1.2  # of a ray, 50 degrees from the axis: training images show no wider field of view
FARTHEST_M: Final = 9.0
NEAREST_M: Final = 0.3
WINDOWS: Final = ((9, 0.15), (33, 0.5))  # pixels around which relief is taken, and the largest relief in metres
OFFSET: Final = 0.1  # of stature: the unit in which the network gives places within a patch
LARGEST_BYTES: Final = 64_000_000  # of a file of weights; the package's has 4
FORMAT: Final = "anchorpose learnt descriptor 1"


class Described(NamedTuple):
    """What the descriptor says of the pixels on a grid of (h, w) rays, a hundredth of a focal length apart.

    row, column (h, w) int64 of the image and read (h, w): whether there is a reading; row and column are 0 where not.
    person (h, w) float32: probability that the pixel shows a person, 0 without a reading.
    place (h, w, 3) float32: on the standing mean adult of stature 1, X forward, Y up from the floor, Z to the right.
    error (h, w) float32: the expected distance of ``place`` from the true place, in statures.
    pelvis_m (h, w, 3) float32: the place of this person's pelvis in the camera's frame.
    place, error and pelvis_m are NaN where the probability is below a half.
    """

    row: np.ndarray
    column: np.ndarray
    read: np.ndarray
    person: np.ndarray
    place: np.ndarray
    error: np.ndarray
    pelvis_m: np.ndarray


@dataclass(frozen=True, eq=False)
class Weights:
    """A trained network: its session, and how it says where within a patch a pixel is (``tools/train_descriptor.py``).

    slope (p, 3, f), base (p, 3): from the f features of a pixel to its offset from centres (p, 3).
    """

    session: Any
    slope: np.ndarray
    base: np.ndarray
    centres: np.ndarray


@cache
def stored_weights() -> Weights:
    """The weights that ship with the package."""
    with resources.as_file(resources.files("anchorpose.descriptor").joinpath("data/learnt.onnx")) as path:
        return read_weights(path)


def read_weights(path: Path) -> Weights:
    """Read weights that ``tools/train_descriptor.py`` exported.

    Raises InputError for a file that is none, and MissingPackage without onnxruntime.
    """
    try:
        import onnxruntime
    except ModuleNotFoundError as error:
        raise MissingPackage("the learnt descriptor", "onnxruntime", "descriptor") from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # one order of sums: the same bytes on each run
    options.log_severity_level = 4  # what is wrong is said by the exception
    content = read_whole(path, LARGEST_BYTES, "install anchorpose again, or give another file")
    try:
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        known = session.get_modelmeta().custom_metadata_map.get("format") == FORMAT
    except Exception as error:  # onnxruntime's own, which derive from no common class
        raise InputError(path, "no network can be read from it", "export it by tools/train_descriptor.py") from error
    if not known:
        raise InputError(path, "it holds another network", "export it by tools/train_descriptor.py")
    slope, base, centres = session.run(["slope", "base", "centres"], {"depth": np.zeros((1, 5, 32, 32), np.float32)})
    return Weights(session, slope, base, centres)


def describe(depth_m: np.ndarray, camera: Camera, weights: Weights | None = None) -> Described:
    """Describe one depth image (height, width), metres, 0 without a reading; ``weights``: those of the package.

    Raises ValueError for an image that shows less than 9 degrees: nothing can be told from so little.
    """
    weights = stored_weights() if weights is None else weights
    row, column, inside = _sampling(camera.intrinsics, camera.width, camera.height)
    seen_m = np.where(inside, depth_m[row, column], 0.0).astype(np.float32)
    seen_m[~((seen_m > NEAREST_M) & (seen_m < FARTHEST_M))] = 0.0
    ((said,),) = weights.session.run(["said"], {"depth": inputs_of(seen_m)[None]})
    every = (slice(None, None, STEP), slice(None, None, STEP))
    read, row, column = seen_m[every] > 0.0, row[every], column[every]
    person = np.where(read, _probability(said[: len(weights.centres) + 1]), np.float32(0.0))
    found = person >= 0.5
    depth = depth_m[row[found], column[found], None]
    surface = np.concatenate([camera.pixel_rays()[row[found], column[found]] * depth, depth], axis=1)
    place, error, vote = _answers(said[:, found].T, weights)
    return Described(
        np.where(read, row, 0),
        np.where(read, column, 0),
        read,
        person,
        _spread(place, found),
        _spread(error, found),
        _spread(surface + vote, found),
    )


def inputs_of(depth_m: np.ndarray) -> np.ndarray:
    """Return (5, h, w) float32 of depth (h, w): range, whether there is a reading, relief against two means, nearness.

    The same as ``inputs_of`` of the training.
    """
    import cv2

    seen = (depth_m > 0.0).astype(np.float32)
    layers: list[np.ndarray] = [depth_m / 4.0, seen]
    for size, most_m in WINDOWS:
        share = cv2.blur(seen, (size, size), borderType=cv2.BORDER_CONSTANT)
        mean = cv2.blur(depth_m, (size, size), borderType=cv2.BORDER_CONSTANT) / np.maximum(share, 1e-6)
        layers.append(np.clip((depth_m - mean) / most_m, -1.0, 1.0) * seen)
    layers.append(seen / np.maximum(depth_m, NEAREST_M))
    return np.stack(layers).astype(np.float32)


@lru_cache(maxsize=16)
def _sampling(intrinsics: Intrinsics, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row, column (h, w) of the pixel nearest to each ray of a pinhole of ``FOCAL_PX``, and whether there is any.

    Nearest, not mean: a mean over an edge is a depth where nothing is.
    """
    rays = rays_of_pixels(intrinsics, width, height).reshape(-1, 2)
    low = np.maximum(np.nanmin(rays, axis=0), -WIDEST)
    size = np.floor((np.minimum(np.nanmax(rays, axis=0), WIDEST) - low) * FOCAL_PX).astype(int) + 1
    if size.min() < SMALLEST_PX:
        shown = np.rad2deg(size.min() / FOCAL_PX)
        raise ValueError(f"an image must show at least 9 degrees for the descriptor, this one shows {shown:.1f}")
    across, down = (-(-size // MULTIPLE) * MULTIPLE).tolist()
    x, y = low[0] + np.arange(across) / FOCAL_PX, low[1] + np.arange(down) / FOCAL_PX
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    pixel = project(np.column_stack([grid, np.ones(len(grid))]), lens_array(intrinsics))
    whole = np.rint(np.where(np.isfinite(pixel), np.clip(pixel, -1e6, 1e6), -1.0)).astype(np.int64)
    inside = np.all((whole >= 0) & (whole < [width, height]), axis=1)
    column, row = np.where(inside[:, None], whole, 0).T.reshape(2, down, across)
    return row, column, inside.reshape(down, across)


def _probability(classes: np.ndarray) -> np.ndarray:
    """Probability (h, w) that a pixel shows any patch, of the numbers (p + 1, h, w) of which the last is for nobody."""
    raised = np.exp(classes - classes.max(axis=0))
    return np.asarray(1.0 - raised[-1] / raised.sum(axis=0))


def _answers(said: np.ndarray, weights: Weights) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place (n, 3), expected error (n,) and vote for the pelvis (n, 3) m, of what is said (n, outputs) of n pixels.

    The numbers are one for each patch and for nobody, the log of the error, the vote, and the features of which the
    offset within the patch is a linear function.
    """
    patches = len(weights.centres)
    patch, rest = said[:, :patches].argmax(axis=1), said[:, patches + 1 :]
    offset = np.einsum("nij,nj->ni", weights.slope[patch], rest[:, 4:]) + weights.base[patch]
    return weights.centres[patch] + OFFSET * offset, np.exp(rest[:, 0]), rest[:, 1:4]


def _spread(values: np.ndarray, found: np.ndarray) -> np.ndarray:
    whole = np.full((*found.shape, *values.shape[1:]), np.nan, dtype=np.float32)
    whole[found] = values
    return whole
