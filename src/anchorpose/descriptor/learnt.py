"""Describe depth images by the learnt descriptor: which pixels show people, and which place on the body each shows.

The paper's descriptor (Definition 3) consists of the geodesic distances from a surface point to the anchors. Measured
on an image, these distances are wrong wherever parts of the body are hidden (Section IV-C calls this error e_3). Here a
network that was trained on simulated images finds the place of each pixel on the skin of a complete body, where the
distances are known. See ``docs/descriptor.md``.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path
from threading import Lock
from typing import Any, Final, NamedTuple
from weakref import ReferenceType, ref

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.lens import Intrinsics, lens_array, project, rays_of_pixels
from anchorpose.recording.regular_file import read_whole

FOCAL_PX: Final = 200.0  # pixels, focal length of the images that the network was trained on
INPUTS: Final = 5  # number of layers of the network's input image (``inputs_of``)
STEP: Final = 2  # pixels, spacing of the network's outputs on its input image, along rows and columns
# pixels; width and height of the network's image are multiples of this, since the network halves the image five times
MULTIPLE: Final = 32
SMALLEST_PX: Final = 32  # pixels, minimum width and height of the network's image
# maximum tangent of the angle (50 degrees) between a ray and the optical axis, since training images show no wider view
WIDEST: Final = 1.2
FARTHEST_M: Final = 9.0  # m; a farther value counts as no reading
NEAREST_M: Final = 0.3  # m; a nearer value counts as no reading
# two windows for computing relief, which is the depth minus the mean depth in a window: the window's side in pixels,
# and the limit in m to which the relief is clipped
WINDOWS: Final = ((9, 0.15), (33, 0.5))
OFFSET: Final = 0.1  # statures; unit of length in which the network states places within a patch of skin
LARGEST_BYTES: Final = 64_000_000  # bytes, maximum size of a file of weights; the package's file has 4 MB
LONGEST_LINE: Final = 4096  # bytes, maximum length of the first line of a file of weights
REMEMBERED: Final = 8  # number of described images kept in memory, enough for two moments of four cameras
FORMAT: Final = "anchorpose-learnt-descriptor"
REMEDY: Final = "export it by tools/train_descriptor.py, or use the weights of the package"


class Described(NamedTuple):
    """The descriptor's outputs for the pixels on a grid of (h, w) rays, which are a hundredth of a focal length apart.

    The fields ``place``, ``error`` and ``pelvis_m`` are NaN if the probability that the pixel shows a person is below a
    half.
    """

    row: np.ndarray  # (h, w) int64, row of each ray's pixel in the image, 0 without a reading
    column: np.ndarray  # (h, w) int64, column of the same pixel
    read: np.ndarray  # (h, w) bool, whether the pixel has a reading
    person: np.ndarray  # (h, w) float32, probability that the pixel shows a person, 0 without a reading
    # (h, w, 3) float32, place on the mean adult, standing, scaled to stature 1: X forward, Y up from the floor, Z right
    place: np.ndarray
    # (h, w) float32, expected distance of ``place`` from the true place, in statures (1 = the mean adult's height)
    error: np.ndarray
    pelvis_m: np.ndarray  # (h, w, 3) float32, place of the pelvis of the pixel's person, in the camera's frame


@dataclass(frozen=True, eq=False)
class Weights:
    """A trained network, and the linear map from the network's features of a pixel to the pixel's place within a patch
    of skin (``tools/train_descriptor.py``).
    """

    session: Any  # the network
    slope: np.ndarray  # (p, 3, f) slope of the map from the f features of a pixel to its offset from the patch's centre
    base: np.ndarray  # (p, 3) constant term of the same map
    centres: np.ndarray  # (p, 3) centres of the patches
    about: dict[str, Any]  # number of training images, and hashes of the scripts and the network


@cache
def stored_weights() -> Weights:
    """Return the weights that ship with the package."""
    with resources.as_file(resources.files("anchorpose.descriptor").joinpath("data/learnt.weights")) as path:
        return read_weights(path)


def read_weights(path: Path) -> Weights:
    """Read weights that ``tools/train_descriptor.py`` exported: a line of JSON, then the network in ONNX.

    Raises InputError for a damaged file and for any other kind of file.
    """
    import onnxruntime

    head, network = _parts(path)
    options = onnxruntime.SessionOptions()
    # a single thread adds numbers in a fixed order, so every run gives exactly the same results
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"])
    nothing = np.zeros((1, INPUTS, MULTIPLE, MULTIPLE), np.float32)
    slope, base, centres = session.run(["slope", "base", "centres"], {"depth": nothing})
    return Weights(session, slope, base, centres, head)


def _parts(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return the file's description and the network; check by a hash that the network is unchanged since its export."""
    line, _, network = read_whole(path, LARGEST_BYTES, REMEDY).partition(b"\n")
    try:
        head = json.loads(line) if len(line) < LONGEST_LINE else None
    except ValueError:
        head = None
    if not isinstance(head, dict) or head.get("format") != FORMAT:
        raise InputError(path, "holds no weights of the learnt descriptor", REMEDY)
    if head.get("network_sha256") != hashlib.sha256(network).hexdigest():
        raise InputError(path, "is damaged: its network is not the exported one", REMEDY)
    return head, network


def describe(depth_m: np.ndarray, camera: Camera, weights: Weights | None = None) -> Described:
    """Describe one depth image (height, width), metres, 0 without a reading. By default, the package's ``weights`` are
    used.

    A value that is not a number, or is not between ``NEAREST_M`` and ``FARTHEST_M``, counts as no reading. Raises
    ValueError if the image has another size than the camera's images, or a field of view of less than 9 degrees.
    """
    if depth_m.shape != (camera.height, camera.width):
        raise ValueError(f"the image has {depth_m.shape} pixels, the camera ({camera.height}, {camera.width})")
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


_remembered: Final[dict[int, tuple[ReferenceType[np.ndarray], Camera, Described]]] = {}
_lock: Final = Lock()


def described(depth_m: np.ndarray, camera: Camera) -> Described:
    """Return the descriptor's outputs for an image, as ``describe`` computes them. The results for the last images are
    kept in memory, since several stages need them.

    An image must not be changed after it was described, since this function recognises an image by its identity and not
    by its content. Raises InputError with the camera's name if ``describe`` raises an error.
    """
    with _lock:
        known = _remembered.get(id(depth_m))
    if known is not None and known[0]() is depth_m and known[1].intrinsics == camera.intrinsics:
        return known[2]
    try:
        found = describe(depth_m, camera)
    except ValueError as error:
        remedy = "correct the intrinsics, or record with a camera that shows a whole person"
        raise InputError(f"camera {camera.name}", str(error), remedy) from error
    with _lock:
        while len(_remembered) >= REMEMBERED:
            _remembered.pop(next(iter(_remembered)))
        # the weak reference shows whether the id still belongs to this image, since the id of a freed image may be used
        # again
        _remembered[id(depth_m)] = (ref(depth_m), camera, found)
    return found


def nearest_rays(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return three arrays (height, width): row and column, in the grid of ``Described``, of the ray nearest to each
    pixel; and whether the grid has a ray near the pixel.
    """
    return _nearest_rays(camera.intrinsics, camera.width, camera.height)


@lru_cache(maxsize=16)
def _nearest_rays(intrinsics: Intrinsics, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rays = rays_of_pixels(intrinsics, width, height)
    low, across, down = _extent(rays)
    place = np.nan_to_num((rays - low) * FOCAL_PX / STEP, nan=-1.0)
    column, row = np.rint(np.clip(place, -1.0, 1e6)).astype(np.int64).T.swapaxes(1, 2)
    inside = (column >= 0) & (row >= 0) & (column < across // STEP) & (row < down // STEP)
    return np.where(inside, row, 0), np.where(inside, column, 0), inside


def _extent(rays: np.ndarray) -> tuple[np.ndarray, int, int]:
    """Return x and y (2,), at depth 1, of the ray in the first column and row of the network's image, and the image's
    width and height in rays.
    """
    flat = rays.reshape(-1, 2)
    low = np.maximum(np.nanmin(flat, axis=0), -WIDEST)
    size = np.floor((np.minimum(np.nanmax(flat, axis=0), WIDEST) - low) * FOCAL_PX).astype(int) + 1
    if size.min() < SMALLEST_PX:
        shown = np.rad2deg(size.min() / FOCAL_PX)
        raise ValueError(f"an image must show at least 9 degrees for the descriptor, this one shows {shown:.1f}")
    across, down = (-(-size // MULTIPLE) * MULTIPLE).tolist()
    return low, across, down


def inputs_of(depth_m: np.ndarray) -> np.ndarray:
    """Return the network's input (5, h, w) float32 for depth (h, w): depth, whether the pixel has a reading, relief
    (depth minus the local mean) in two windows (``WINDOWS``), and 1 / depth.

    The function ``inputs_of`` in ``tools/train_descriptor.py`` must give the same values.
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
    """Return row and column (h, w) of the pixel nearest to each ray of a pinhole camera with the focal length
    ``FOCAL_PX``, and whether the image has such a pixel.

    The nearest pixel is used instead of a mean of neighbouring pixels, since no surface lies at the mean depth of the
    two sides of an edge.
    """
    low, across, down = _extent(rays_of_pixels(intrinsics, width, height))
    x, y = low[0] + np.arange(across) / FOCAL_PX, low[1] + np.arange(down) / FOCAL_PX
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    pixel = project(np.column_stack([grid, np.ones(len(grid))]), lens_array(intrinsics))
    whole = np.rint(np.where(np.isfinite(pixel), np.clip(pixel, -1e6, 1e6), -1.0)).astype(np.int64)
    inside = np.all((whole >= 0) & (whole < [width, height]), axis=1)
    column, row = np.where(inside[:, None], whole, 0).T.reshape(2, down, across)
    return row, column, inside.reshape(down, across)


def _probability(classes: np.ndarray) -> np.ndarray:
    """Return the probability (h, w) that a pixel shows a person. classes (p + 1, h, w): the network's scores for the p
    patches of skin, then for "no person".
    """
    raised = classes - classes.max(axis=0)
    np.exp(raised, out=raised)  # in place, since it takes time to allocate a new array
    return np.asarray(1.0 - raised[-1] / raised.sum(axis=0))


def _answers(said: np.ndarray, weights: Weights) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return place (n, 3), expected error (n,) and pelvis vote (n, 3) of n pixels, from the network's outputs (n,
    outputs). The vote is the vector, in metres, from the pixel's surface point to the pelvis.

    The outputs are a score per patch, a score for "no person", the log of the error, the vote, and features. A pixel's
    offset from the centre of its patch is a linear function of the features.
    """
    patches = len(weights.centres)
    patch, rest = said[:, :patches].argmax(axis=1), said[:, patches + 1 :]
    offset = np.einsum("nij,nj->ni", weights.slope[patch], rest[:, 4:]) + weights.base[patch]
    return weights.centres[patch] + OFFSET * offset, np.exp(rest[:, 0]), rest[:, 1:4]


def _spread(values: np.ndarray, found: np.ndarray) -> np.ndarray:
    whole = np.full((*found.shape, *values.shape[1:]), np.nan, dtype=np.float32)
    whole[found] = values
    return whole
