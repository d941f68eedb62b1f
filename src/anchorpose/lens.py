"""Convert rays to pixels and pixels to rays by OpenCV's lens models (docs.opencv.org, calib3d and fisheye).

A ray (line of sight) is given by x/z and y/z in the camera's coordinate frame. A lens model is valid up to the radius,
sqrt(x² + y²) / z of a ray, at which its polynomial stops being monotonic or the maker's guarantee ends. Pixels beyond
the valid radius have no ray (NaN), and rays beyond it have no pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Final

import numpy as np
from numba import njit


class LensModel(StrEnum):
    """The OpenCV lens model to which distortion coefficients belong."""

    BROWN_CONRADY = "brown-conrady"  # k1 k2 p1 p2 k3
    RATIONAL = "rational"  # k1 k2 p1 p2 k3 k4 k5 k6, optionally s1 s2 s3 s4, optionally the sensor's tilt
    KANNALA_BRANDT = "kannala-brandt"  # k1 k2 k3 k4 of OpenCV's fisheye; doi:10.1109/TPAMI.2006.153


COEFFICIENTS: Final = {LensModel.BROWN_CONRADY: (5,), LensModel.RATIONAL: (8, 12, 14), LensModel.KANNALA_BRANDT: (4,)}
"""The allowed numbers of coefficients of each model."""

NAMES: Final = {
    LensModel.BROWN_CONRADY: "k1, k2, p1, p2, k3",
    LensModel.RATIONAL: "k1, k2, p1, p2, k3, k4, k5, k6",
    LensModel.KANNALA_BRANDT: "k1, k2, k3, k4",
}
"""The names of each model's coefficients in OpenCV's order, for messages."""

WIDEST: Final = 8.0  # maximum sqrt(x² + y²) / z of a ray: 83 degrees off the axis, wider than any depth camera's image
_PLAIN, _RADIAL, _TILTED, _FISHEYE = 0.0, 1.0, 2.0, 3.0  # kinds of lens, as numbers in a lens array (``lens_array``)
_KIND, _RADIUS, _K, _TILT = 4, 5, 6, 18  # indices in a lens array: kind, valid radius, coefficients, tilt matrix
_SIZE: Final = 27  # number of entries of a lens array (``lens_array``)
_STEPS: Final = 20  # maximum number of steps of Newton's method; inside the valid radius, five are enough
# pixels, maximum distance of a ray's projection from the pixel at which Newton's method has found the pixel's ray
_EXACT_PX: Final = 1e-6
# Column and row of a ray without a pixel, far outside every image. NaN is not used for these coordinates, since
# compiled code converts them to integers.
NOWHERE: Final = -1e6
_SLOPE: Final = 1e-6  # step in x/z or y/z of a ray, with which the derivative of the projection is computed numerically


@dataclass(frozen=True, slots=True, kw_only=True)
class Intrinsics:
    """A pinhole camera with OpenCV's distortion; pixel centres have whole-numbered coordinates.

    valid_radius: sqrt(x² + y²) / z of a ray up to which the maker guarantees the coefficients (Azure Kinect's "metric
    radius" is 1.74); None if unknown. model: also accepted as text, such as "rational"; ValueError for other texts.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    model: LensModel = LensModel.BROWN_CONRADY
    valid_radius: float | None = None

    def __post_init__(self) -> None:
        """Turn the name of a lens model into the model; the text alone would be taken for another model."""
        object.__setattr__(self, "model", LensModel(self.model))

    @property
    def matrix(self) -> np.ndarray:
        """Return the camera matrix (3, 3) float64."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


@lru_cache(maxsize=32)
def lens_array(lens: Intrinsics) -> np.ndarray:
    """Return the parameters of a lens as an array (27,) float64, read only, for compiled code: fx, fy, cx, cy, then
    further values for ``pixel_of_ray``.
    """
    array = np.zeros(_SIZE)
    array[:4] = lens.fx, lens.fy, lens.cx, lens.cy
    coefficients = np.zeros(14)
    coefficients[: len(lens.distortion)] = lens.distortion
    array[_K : _K + 12] = coefficients[:12]
    array[_TILT:] = _tilt(*coefficients[12:]).ravel()
    array[_KIND] = _kind(lens.model, coefficients)
    given = WIDEST if lens.valid_radius is None else lens.valid_radius
    array[_RADIUS] = min(given, _turning_point(array))
    array.setflags(write=False)
    return array


def _kind(model: LensModel, coefficients: np.ndarray) -> float:
    if model is LensModel.KANNALA_BRANDT:
        return _FISHEYE
    if coefficients[12:].any():
        return _TILTED
    return _RADIAL if coefficients.any() else _PLAIN


def _tilt(about_x: float, about_y: float) -> np.ndarray:
    """Return the projection (3, 3) of the image onto a sensor that is tilted by two angles, radians (OpenCV's tau)."""
    cos_x, sin_x, cos_y, sin_y = np.cos(about_x), np.sin(about_x), np.cos(about_y), np.sin(about_y)
    turn_x = np.array([[1.0, 0.0, 0.0], [0.0, cos_x, sin_x], [0.0, -sin_x, cos_x]])
    turn_y = np.array([[cos_y, 0.0, -sin_y], [0.0, 1.0, 0.0], [sin_y, 0.0, cos_y]])
    turn = turn_y @ turn_x
    onto = np.array([[turn[2, 2], 0.0, -turn[0, 2]], [0.0, turn[2, 2], -turn[1, 2]], [0.0, 0.0, 1.0]])
    return np.asarray(onto @ turn)


def _turning_point(array: np.ndarray) -> float:
    """Return the radius of a ray, sqrt(x² + y²) / z, beyond which the model is invalid: there, rays with a larger
    radius have pixels nearer to the image's centre. Return ``WIDEST`` if no such radius exists.
    """
    if array[_KIND] == _PLAIN:
        return WIDEST
    radius = np.linspace(0.0, WIDEST, 8001)
    seen = np.array([_radial(r, array) for r in radius.tolist()])
    back = np.flatnonzero(np.diff(seen) <= 0.0)
    return float(radius[back[0]]) if len(back) else WIDEST


@njit(cache=True, nogil=True)
def _radial(radius: float, lens: np.ndarray) -> float:
    """Return the distance of a ray's pixel from the optical axis, in focal lengths, computed from the radial
    coefficients alone; -1 where the model is undefined. radius: sqrt(x² + y²) / z of the ray.
    """
    k = lens[_K:]
    if lens[_KIND] == _FISHEYE:
        angle = np.arctan(radius)
        squared = angle * angle
        return angle * (1.0 + squared * (k[0] + squared * (k[1] + squared * (k[2] + squared * k[3]))))
    squared = radius * radius
    above = 1.0 + squared * (k[0] + squared * (k[1] + squared * k[4]))
    below = 1.0 + squared * (k[5] + squared * (k[6] + squared * k[7]))
    return radius * above / below if below > 0.0 else -1.0


@njit(cache=True, nogil=True)
def pixel_of_ray(x: float, y: float, lens: np.ndarray) -> tuple[float, float]:
    """Project a ray to column and row; a ray beyond the lens's valid radius gets coordinates far outside every image.
    lens: the array of ``lens_array``.
    """
    if lens[_KIND] == _PLAIN:
        return lens[0] * x + lens[2], lens[1] * y + lens[3]
    squared = x * x + y * y
    if squared > lens[_RADIUS] * lens[_RADIUS]:
        return NOWHERE, NOWHERE
    radius = np.sqrt(squared)
    scale = _radial(radius, lens) / radius if radius > 1e-9 else 1.0
    u, v = x * scale, y * scale
    if lens[_KIND] != _FISHEYE:
        p1, p2, s = lens[_K + 2], lens[_K + 3], lens[_K + 8 : _K + 12]
        u += 2.0 * p1 * x * y + p2 * (squared + 2.0 * x * x) + squared * (s[0] + squared * s[1])
        v += p1 * (squared + 2.0 * y * y) + 2.0 * p2 * x * y + squared * (s[2] + squared * s[3])
    if lens[_KIND] == _TILTED:
        t = lens[_TILT:]
        away = t[6] * u + t[7] * v + t[8]
        u, v = (t[0] * u + t[1] * v + t[2]) / away, (t[3] * u + t[4] * v + t[5]) / away
    return lens[0] * u + lens[2], lens[1] * v + lens[3]


@njit(cache=True, nogil=True)
def project(points: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Project points (n, 3) in the camera frame to (n, 2) column and row; NaN behind the camera and beyond the lens's
    valid radius.
    """
    pixels = np.full((len(points), 2), np.nan)
    for p in range(len(points)):
        if points[p, 2] > 1e-6:
            column, row = pixel_of_ray(points[p, 0] / points[p, 2], points[p, 1] / points[p, 2], lens)
            if column > NOWHERE:
                pixels[p, 0], pixels[p, 1] = column, row
    return pixels


def rays_of_pixels(lens: Intrinsics, width: int, height: int) -> np.ndarray:
    """Return the ray (height, width, 2) float64 of each pixel, exact to a millionth of a pixel; NaN where a pixel has
    no ray.

    OpenCV's own fixed-point iteration is less exact: for a real rational lens, its rays have errors of 4 mm at a
    distance of 2.5 m, and of 68 mm in image corners.
    """
    array = lens_array(lens)
    if array[_KIND] == _PLAIN:
        row, column = np.mgrid[:height, :width]
        return np.stack([(column - lens.cx) / lens.fx, (row - lens.cy) / lens.fy], axis=-1)
    radius = np.linspace(0.0, array[_RADIUS], 4001)
    seen = np.array([_radial(r, array) for r in radius.tolist()])
    return _rays(array, radius, seen, width, height)


@njit(cache=True, nogil=True)
def _rays(lens: np.ndarray, radius: np.ndarray, seen: np.ndarray, width: int, height: int) -> np.ndarray:
    """Return the ray of each pixel (height, width, 2), found by Newton's method, which starts at the ray that the
    radial coefficients alone give; NaN without a ray. radius (k,): radii of rays, from zero up; seen (k,): the value of
    ``_radial`` for each of these radii.
    """
    rays = np.full((height, width, 2), np.nan)
    for row in range(height):
        for column in range(width):
            u, v = (column - lens[2]) / lens[0], (row - lens[3]) / lens[1]
            away = np.sqrt(u * u + v * v)
            scale = np.interp(away, seen, radius) / away if away > 1e-12 else 1.0
            x, y, found = _solve(u * scale, v * scale, float(column), float(row), lens)
            if found:
                rays[row, column, 0], rays[row, column, 1] = x, y
    return rays


@njit(cache=True, nogil=True)
def _solve(x: float, y: float, column: float, row: float, lens: np.ndarray) -> tuple[float, float, bool]:
    """Solve for the ray of the pixel (column, row), starting at the ray (x, y); return the ray and whether it was
    found.
    """
    for _ in range(_STEPS):
        c, r = pixel_of_ray(x, y, lens)
        miss_c, miss_r = column - c, row - r
        if c == NOWHERE:  # beyond the valid radius: try a ray closer to the axis
            x, y = 0.99 * x, 0.99 * y
            continue
        if abs(miss_c) < _EXACT_PX and abs(miss_r) < _EXACT_PX:
            return x, y, True
        cx, rx = pixel_of_ray(x - _SLOPE, y, lens)
        cy, ry = pixel_of_ray(x, y - _SLOPE, lens)
        a, b, d, e = (c - cx) / _SLOPE, (c - cy) / _SLOPE, (r - rx) / _SLOPE, (r - ry) / _SLOPE
        whole = a * e - b * d
        if not np.isfinite(whole) or whole <= 0.0:
            return x, y, False
        x, y = x + (e * miss_c - b * miss_r) / whole, y + (a * miss_r - d * miss_c) / whole
    return x, y, False
