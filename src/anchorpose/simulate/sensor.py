"""Simulate the readings of a depth sensor: noise, errors at edges, flying pixels, lost readings, whole millimetres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numba as nb
import numpy as np

from anchorpose.lens import Intrinsics, LensModel


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorSpec:
    """A sensor's image size, lens, range and errors."""

    kind: Literal["time-of-flight", "stereo"]
    width: int
    height: int
    focal_px: float
    nearest_m: float
    farthest_m: float
    # Factor on the axial noise that was measured on white targets. The noise of a time-of-flight camera is proportional
    # to the inverse square root of the returned light. Clothes, skin and floors return a quarter of the light that a
    # white target returns, so the factor is 2.
    noise_gain: float = 2.0
    baseline_m: float = 0.0  # m, distance between the imagers of a stereo camera
    disparity_noise_px: float = 0.06  # pixels, standard deviation of the error of disparity
    disparity_steps: float = 32.0  # number of quantisation steps per pixel of disparity
    filtered: bool = False  # whether librealsense's filters are applied: decimation by two, then smoothing
    wiggle_m: float = 0.0012  # m, amplitude of a time-of-flight camera's smooth error, which is constant in a session
    dots: int = 0  # number of laser points from which the image is computed; 0 = every pixel has its own measurement
    lens: str = "pinhole"  # one of ``LENSES``


SENSORS = {
    "kinect-v2": SensorSpec(
        kind="time-of-flight", width=512, height=424, focal_px=365.0, nearest_m=0.5, farthest_m=4.5
    ),
    # mode NFOV (narrow field of view) unbinned; about half of the Kinect v2's noise (Toelgyessy et al. 2021,
    # doi:10.3390/s21020413)
    "azure-kinect": SensorSpec(
        kind="time-of-flight", width=640, height=576, focal_px=504.0, nearest_m=0.5, farthest_m=3.86, noise_gain=1.2
    ),
    # D455: 95 mm between the imagers, field of view 87 degrees wide (Luxonis, OAK vs RealSense), range from 0.4 m on
    # (librealsense, issue 9977)
    "realsense": SensorSpec(
        kind="stereo", width=848, height=480, focal_px=424.0, nearest_m=0.4, farthest_m=6.0, baseline_m=0.095
    ),
    # half of the sensor's resolution, as in the data set MSR Action3D: depth steps of 9 mm at 1.8 m and 26 mm at 3 m
    "kinect-v1": SensorSpec(
        kind="stereo",
        width=320,
        height=240,
        focal_px=285.0,
        nearest_m=0.5,
        farthest_m=4.5,
        baseline_m=0.075,
        disparity_noise_px=0.03,
        disparity_steps=16.0,
    ),
    # a D415 with librealsense's filters; the stated noise is the noise before the filters
    "realsense-filtered": SensorSpec(
        kind="stereo",
        width=424,
        height=240,
        focal_px=303.0,
        nearest_m=0.4,
        farthest_m=6.0,
        baseline_m=0.055,
        disparity_noise_px=0.15,
        filtered=True,
    ),
    # mode WFOV 2x2 binned, field of view 120 x 120 degrees (117 with this lens), range 0.25 to 2.88 m (Microsoft's
    # hardware specification). At 2.88 m, the WFOV mode has the random error that the mode NFOV unbinned has at 3.86 m,
    # so its noise is taken as 1.6 times that of "azure-kinect"
    "azure-kinect-wfov": SensorSpec(
        kind="time-of-flight",
        width=512,
        height=512,
        focal_px=252.0,
        nearest_m=0.25,
        farthest_m=2.88,
        noise_gain=1.9,
        lens="rational",
    ),
    # mode NFOV unbinned, field of view 75 x 65 degrees (73 x 65 with this lens), range 0.5 to 3.86 m; sensor, modes and
    # limits of error are those of the Azure Kinect (Orbbec's hardware specification of Femto Bolt)
    "femto-bolt": SensorSpec(
        kind="time-of-flight",
        width=640,
        height=576,
        focal_px=504.0,
        nearest_m=0.5,
        farthest_m=3.86,
        noise_gain=1.2,
        lens="rational",
    ),
    # 50 mm between the imagers (measured on two devices), field of view 87 +- 3 degrees wide (data sheet, see
    # docs/simulate.md); the maker assumes an error of 0.08 pixels of disparity for a calibrated unit (librealsense,
    # issue 3904). The real camera also reads beyond 4.5 m, with more error
    "d435": SensorSpec(
        kind="stereo",
        width=848,
        height=480,
        focal_px=424.0,
        nearest_m=0.3,
        farthest_m=4.5,
        baseline_m=0.05,
        disparity_noise_px=0.08,
    ),
    # field of view 58 x 45 degrees, range 0.8 to 3.5 m (Asus, as quoted in docs/simulate.md); 75 mm from the imager to
    # the projector, steps of an eighth of a pixel of disparity, and a standard deviation of half a step, which is 5.7
    # mm at 2 m (Khoshelham and Oude Elberink 2012, doi:10.3390/s120201437)
    "xtion": SensorSpec(
        kind="stereo",
        width=640,
        height=480,
        focal_px=577.0,
        nearest_m=0.8,
        farthest_m=3.5,
        baseline_m=0.075,
        disparity_noise_px=0.05,
        disparity_steps=8.0,
    ),
    # 576 measured points, which ARKit spreads over 256 x 192 pixels (apple/ARKitScenes, issue 14), range up to 5 m
    # (Apple). The error of these depth images is smooth: 1 mm from a plane at 1 to 1.5 m (Teo and Yang 2023,
    # doi:10.1016/j.dibe.2023.100169; the gain is chosen for this value), and within 1 cm of the truth (Luetzenburg et
    # al. 2021, doi:10.1038/s41598-021-01763-9; cited without having been read). The focal length is taken from
    # ARKitScenes
    "iphone-lidar": SensorSpec(
        kind="time-of-flight",
        width=256,
        height=192,
        focal_px=212.0,
        nearest_m=0.3,
        farthest_m=5.0,
        noise_gain=8.0,
        wiggle_m=0.005,
        dots=576,
    ),
}

LENSES: dict[str, tuple[LensModel, tuple[float, ...], float | None]] = {
    "pinhole": (LensModel.BROWN_CONRADY, (0.0, 0.0, 0.0, 0.0, 0.0), None),
    # coefficients of the same order as those of a Kinect v2's infrared camera
    "brown-conrady": (LensModel.BROWN_CONRADY, (0.09, -0.27, 0.001, -0.0005, 0.09), None),
    # coefficients of the same order as those of an Azure Kinect's depth camera, and the valid radius of that camera
    "rational": (LensModel.RATIONAL, (0.44, 0.013, -2.4e-5, -6.4e-5, -0.002, 0.77, 0.089, -0.005), 1.74),
    # a lens in whose image the border is a tenth nearer to the centre than in a pinhole camera's image
    "kannala-brandt": (LensModel.KANNALA_BRANDT, (-0.02, 0.003, -0.001, 0.0002), None),
}
"""Model, coefficients and valid radius of each imitated lens."""

# m; minimum difference of the depths around a pixel at an edge, beyond the difference that the surface's slope explains
EDGE_STEP_M = 0.03
# factor on a slope's depth change per pixel: 3 x 3 pixels span 2 such changes, and a margin doubles this
SLOPE_ALLOWANCE = 4.0
DROPOUT = 0.003  # probability that a pixel, at an edge or elsewhere, has no reading
EDGE_JITTER = 0.35  # probability that an edge pixel has the reading of one of its neighbours
FLYING = 0.22  # probability that an edge pixel has a depth between the near and the far surface
EDGE_LOSS = 0.08  # probability that an edge pixel has no reading
GRAZING_COSINE = 0.10  # cosine of the largest angle of incidence (84 degrees) that gives a reading
BLOB_PX = 2.2  # pixels, standard deviation of the Gaussian that imitates a stereo camera's matching window
SPECKLE_DEVIATIONS = 2.7  # size of the noise, in standard deviations, above which stereo matching fails
JOINED_M = 0.1  # m; ARKit smooths depth steps below this value, unless the colour image shows an edge


def intrinsics_of(spec: SensorSpec, lens: str | None) -> Intrinsics:
    """Return the intrinsics of a sensor. lens: one of ``LENSES``; None = the lens in ``spec``."""
    model, coefficients, radius = LENSES[spec.lens if lens is None else lens]
    return Intrinsics(
        fx=spec.focal_px,
        fy=spec.focal_px,
        cx=spec.width / 2.0,
        cy=spec.height / 2.0,
        distortion=coefficients,
        model=model,
        valid_radius=radius,
    )


def draw_wiggle(rng: np.random.Generator, spec: SensorSpec) -> np.ndarray:
    """Draw one device's error of depth (height, width) float32, metres, which varies smoothly over the image and is the
    same in all images.
    """
    import cv2

    coarse = rng.normal(0.0, spec.wiggle_m, (6, 7)).astype(np.float32)
    return cv2.resize(coarse, (spec.width, spec.height), interpolation=cv2.INTER_CUBIC)


def sense(
    rng: np.random.Generator, spec: SensorSpec, depth_m: np.ndarray, cosine: np.ndarray, wiggle_m: np.ndarray
) -> np.ndarray:
    """Return a noisy depth image in whole millimetres, (height, width) uint16, 0 = no reading.

    depth_m (height, width) float32: true depth along the optical axis, 0 = nothing there; cosine (height, width)
    float32: cosine of the angle between ray and surface normal.
    """
    if spec.kind == "stereo":
        sensed_m = _sense_stereo(rng, spec, depth_m)
    else:
        chance = rng.random((2, *depth_m.shape), dtype=np.float32)
        noise = rng.standard_normal(depth_m.shape, dtype=np.float32)
        sensed_m = np.zeros_like(depth_m)
        _sense_time_of_flight(depth_m, cosine, wiggle_m, chance, noise, spec.noise_gain, spec.focal_px, sensed_m)
    if spec.dots:
        sensed_m = _spread_dots(spec, sensed_m)
    kept = (sensed_m >= spec.nearest_m) & (sensed_m <= spec.farthest_m)
    return np.where(kept, np.rint(sensed_m * 1000.0), 0.0).astype(np.uint16)


@nb.njit(cache=True)
def _sense_time_of_flight(
    depth_m: np.ndarray,
    cosine: np.ndarray,
    wiggle_m: np.ndarray,
    chance: np.ndarray,
    noise: np.ndarray,
    gain: float,
    focal_px: float,
    sensed_m: np.ndarray,
) -> None:
    """Fill ``sensed_m`` with depth that has edge errors and axial noise; 0 = no reading.

    The noise depends on range and angle of incidence as in Fankhauser et al. 2015 (doi:10.1109/ICAR.2015.7251485).
    """
    height, width = depth_m.shape
    for row in range(height):
        for column in range(width):
            near, far = np.float32(1e9), np.float32(0.0)
            for r in range(max(row - 1, 0), min(row + 2, height)):
                for c in range(max(column - 1, 0), min(column + 2, width)):
                    z = depth_m[r, c]
                    if z > 0.0:
                        near = min(near, z)
                        far = max(far, z)
            z = depth_m[row, column]
            facing = cosine[row, column]
            slope = np.sqrt(max(1.0 - facing * facing, 0.0)) / max(facing, np.float32(0.02)) * z / focal_px
            if far - near > EDGE_STEP_M + SLOPE_ALLOWANCE * slope:
                u = chance[1, row, column]
                if u < EDGE_LOSS:
                    continue
                if u < EDGE_LOSS + FLYING:
                    z = near + (u - EDGE_LOSS) / FLYING * (far - near)
                elif u > 1.0 - EDGE_JITTER:
                    pick = int((1.0 - u) / EDGE_JITTER * 9.0)
                    r = min(max(row + pick // 3 - 1, 0), height - 1)
                    c = min(max(column + pick % 3 - 1, 0), width - 1)
                    z, facing = depth_m[r, c], cosine[r, c]
            if z <= 0.0 or facing < GRAZING_COSINE or chance[0, row, column] < DROPOUT:
                continue
            slant = np.arccos(min(facing, np.float32(1.0)))
            sigma_mm = 1.5 - 0.5 * z + 0.3 * z * z + 0.1 * z**1.5 * slant**2 / (np.pi / 2.0 - slant) ** 2
            sensed_m[row, column] = z + wiggle_m[row, column] + gain * 0.001 * min(sigma_mm, 30.0) * noise[row, column]


def _spread_dots(spec: SensorSpec, sensed_m: np.ndarray) -> np.ndarray:
    """Smooth each surface by a Gaussian whose standard deviation is half the spacing of the laser points."""
    import cv2

    half_spacing_px = 0.5 * float(np.sqrt(spec.width * spec.height / spec.dots))
    return np.asarray(cv2.bilateralFilter(sensed_m, -1, JOINED_M, half_spacing_px))


def _sense_stereo(rng: np.random.Generator, spec: SensorSpec, depth_m: np.ndarray) -> np.ndarray:
    """Add an error that grows with the square of range and is correlated within the matching window (after Ahn et al.
    2019).
    """
    import cv2

    near_first = cv2.erode(np.where(depth_m > 0, depth_m, np.float32(100.0)), np.ones((1, 3), np.uint8))
    fattened = np.where(rng.random(depth_m.shape, dtype=np.float32) < 0.5, near_first, depth_m)
    fattened = cv2.medianBlur(np.where(fattened < 99.0, fattened, 0.0).astype(np.float32), 3)
    blobs = cv2.GaussianBlur(rng.standard_normal(depth_m.shape, dtype=np.float32), (0, 0), BLOB_PX)
    blobs = blobs * np.float32(2.0 * np.sqrt(np.pi) * BLOB_PX)  # scales the blurred noise back to unit variance
    gain = np.float32(spec.focal_px * spec.baseline_m)
    disparity = np.divide(gain, fattened, out=np.zeros_like(fattened), where=fattened > 0)
    lost = (np.abs(blobs) > SPECKLE_DEVIATIONS) | _shadowed(disparity) | (disparity <= 0)
    steps = spec.disparity_steps
    noisy = np.rint((disparity + spec.disparity_noise_px * blobs) * steps) / steps
    return np.where(lost | (noisy <= 0), 0.0, gain / np.maximum(noisy, 1e-3)).astype(np.float32)


@nb.njit(cache=True)
def _shadowed(disparity: np.ndarray) -> np.ndarray:
    """Return (height, width) bool: pixels of the left imager that show surfaces that a nearer object hides from the
    right imager.
    """
    height, width = disparity.shape
    hidden = np.zeros((height, width), dtype=np.bool_)
    for row in range(height):
        leftmost = np.float32(1e9)
        for column in range(width - 1, -1, -1):
            d = disparity[row, column]
            if d <= 0.0:
                continue
            seen_at = column - d
            hidden[row, column] = seen_at >= leftmost
            leftmost = min(leftmost, seen_at)
    return hidden
