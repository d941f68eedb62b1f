"""The lens of an Azure Kinect against the published formula, in every mode."""

import json
from pathlib import Path

import numpy as np
import pytest
from azure_builder import PARAMETERS, calibration, elements

from anchorpose.lens import LensModel, rays_of_pixels
from anchorpose.sources.azure_kinect import MODES, DepthMode, lens_of

REAL = Path(__file__).resolve().parents[3] / "shared" / "data" / "recorder_files" / "azure_kinect_nfov.mkv"
needs_the_real_file = pytest.mark.skipif(not REAL.is_file(), reason="../shared/data/recorder_files is not there")
BY_NAME = {mode.name: mode for mode in MODES}


def sensor_position(rays: np.ndarray, numbers: tuple[float, ...]) -> np.ndarray:
    """Where rays (..., 2) meet the sensor, 0 to 1 from corner to corner: the formula of intrinsic_transformation.c."""
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = numbers
    x, y = rays[..., 0], rays[..., 1]
    r2 = x**2 + y**2
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    u = x * radial + (r2 + 2 * x**2) * p2 + 2 * x * y * p1
    v = y * radial + (r2 + 2 * y**2) * p1 + 2 * x * y * p2
    return np.stack([u * fx + cx, v * fy + cy], axis=-1)


def worst_miss_px(mode: DepthMode, document: bytes, numbers: tuple[float, ...]) -> float:
    """How far a pixel's centre is from where its ray falls on the sensor, in pixels of the image."""
    rays = rays_of_pixels(lens_of(document, mode), mode.width, mode.height)
    # left and top sensor pixel of a mode and its binning, counted on the sensor: the SDK crops after binning
    left, top = (0, 0) if mode.name.startswith("WFOV") else (192, 180)
    binning = 2 if mode.name.endswith("2X2BINNED") else 1
    seen = (sensor_position(rays, numbers) * 1024 - (left, top)) / binning
    row, column = np.mgrid[: mode.height, : mode.width]
    centre = np.stack([column, row], axis=-1) + 0.5  # counted from the corner of the image's first pixel
    assert np.isfinite(rays[mode.height // 2, mode.width // 2]).all()
    return float(np.nanmax(np.abs(seen - centre)))


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("real", [False, pytest.param(True, marks=needs_the_real_file)])
def test_each_pixels_ray_falls_on_its_centre_by_the_published_formula(mode: DepthMode, real: bool) -> None:
    document, parameters = calibration(), PARAMETERS
    if real:
        document = next(content for name, content in elements(REAL.read_bytes()) if name == "465c")
        cameras = json.loads(document)["CalibrationInformation"]["Cameras"]
        (depth,) = (camera for camera in cameras if camera["Purpose"] == "CALIBRATION_CameraPurposeDepth")
        parameters = depth["Intrinsics"]["ModelParameters"]
    assert worst_miss_px(mode, document, tuple(parameters)) < 0.01


def test_p2_stands_before_p1_in_the_file_and_a_closing_zero_is_no_damage() -> None:
    lens = lens_of(calibration(), BY_NAME["NFOV_UNBINNED"])
    assert lens.model is LensModel.RATIONAL
    assert lens.distortion == (0.6, -0.03, 3e-05, -6e-05, -0.003, 0.93, 0.1, -0.015)
    assert lens_of(calibration() + b"\0", MODES[0]) == lens_of(calibration(), MODES[0])


@pytest.mark.parametrize("radius", [0, -1.0, None, "wide", float("nan")])
def test_a_radius_that_the_maker_did_not_find_is_not_known(radius: object) -> None:
    lens = lens_of(calibration(MetricRadius=radius), MODES[0])
    assert lens.valid_radius is None


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        (b"", "damaged"),
        (b"{", "damaged"),
        (b"\xff\xfe", "damaged"),
        (b"[" * 100_000, "damaged"),
        (b'{"CalibrationInformation": 3}', "damaged"),
        (
            b'{"CalibrationInformation": {"Cameras": [{"Location": "CALIBRATION_CameraLocationPV0"}]}}',
            "no depth camera",
        ),
        (calibration(SensorWidth=512), "1024 x 1024"),
        (calibration(PARAMETERS[:13]), "fourteen"),
        (calibration((*PARAMETERS[:13], "a")), "no numbers"),
        (calibration((*PARAMETERS[:13], [1])), "no numbers"),
        (calibration((*PARAMETERS[:13], float("nan"))), "fourteen"),
        (calibration((0.5, 0.5, 4.9, *PARAMETERS[3:])), "focal length"),
        (calibration((-0.5, *PARAMETERS[1:])), "image centre"),
        (calibration((*PARAMETERS[:10], 0.1, *PARAMETERS[11:])), "centre of distortion"),
        (calibration(Intrinsics={"ModelType": "other", "ModelParameters": PARAMETERS}), "lens model"),
        (calibration(Intrinsics=None), "no numbers"),
    ],
)
def test_a_calibration_that_cannot_be_used_is_refused(document: bytes, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        lens_of(document, MODES[0])
