"""LD-SIFT: its depth maps and SIFT against plain versions and OpenCV's, and under what must not change it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from features_builder import height_field, lump, moved, rolled_sheet, rough, somewhere
from features_plain import plain_ld_sift, plain_sift

from anchorpose.research.features.depth_map import cell_shares, describe_image, image_side
from anchorpose.research.features.ld_sift import Beyond, LdSiftConfig, ld_sift

SMALL = LdSiftConfig(radius_m=0.10, samples=4)


def sift_of(picture: np.ndarray, samples: int) -> np.ndarray:
    descriptor = np.full(128, np.nan, np.float32)
    describe_image(np.asarray(picture, np.float64), cell_shares(samples), descriptor)
    return descriptor


def some_picture(samples: int, seed: int) -> np.ndarray:
    side = image_side(samples)
    rng = np.random.default_rng(seed)
    return cv2.GaussianBlur(rng.normal(size=(side, side)), (0, 0), 0.4 * samples)


@pytest.mark.parametrize("samples", [2, 3, 6])
def test_sift_is_its_definition_written_out_with_and_without_unknown_pixels(samples: int) -> None:
    picture = some_picture(samples, 1)
    np.testing.assert_allclose(sift_of(picture, samples), plain_sift(picture, samples), atol=1e-6)
    picture[np.random.default_rng(2).random(picture.shape) < 0.2] = np.nan
    np.testing.assert_allclose(sift_of(picture, samples), plain_sift(picture, samples), atol=1e-6)


def test_opencv_finds_the_same_descriptor_up_to_its_bytes() -> None:
    """Its cells are 3 sigma wide, its first octave is blurred first, y points up, and values are bytes both ways."""
    samples, distances = 11, []
    for seed in range(6):
        picture = some_picture(samples, seed)
        picture = np.round(255 * (picture - picture.min()) / np.ptp(picture))
        border = 60
        wide = cv2.copyMakeBorder(picture.astype(np.uint8), *(4 * [border]), cv2.BORDER_REPLICATE)
        blurred = cv2.GaussianBlur(wide.astype(np.float32), (0, 0), np.sqrt(1.6**2 - 0.5**2))
        own = sift_of(blurred[border:-border, border:-border], samples).reshape(4, 4, 8)
        centre = border + (len(picture) - 1) / 2
        keypoint = cv2.KeyPoint(centre, centre, 2 * samples / 3, 0.0, 1.0, 0)
        theirs = cv2.SIFT_create().compute(wide, [keypoint])[1][0].reshape(4, 4, 8)
        theirs = theirs[:, :, -np.arange(8) % 8] / np.linalg.norm(theirs)
        distances.append(np.linalg.norm(own - theirs))
    assert max(distances) < 0.05


@pytest.mark.parametrize("setting", [{}, {"beyond": Beyond.FLOOR, "samples": 3}])
def test_each_row_is_what_all_triangles_and_pixels_written_out_give(setting: dict) -> None:
    surface = rough(height_field(lump, side=31), 3, 0.0015)
    rotation, shift = somewhere(4)
    surface = moved(surface, rotation, shift)
    config = replace(SMALL, **setting)
    chosen = np.array([480, 2, 400])
    found = ld_sift(surface, config)[chosen]
    assert found.dtype == np.float32
    expected = np.stack([plain_ld_sift(surface, config, node) for node in chosen])
    np.testing.assert_allclose(found, expected, atol=2e-5)


def test_what_is_turned_away_counts_for_no_angle_and_is_hidden_by_what_is_above() -> None:
    surface, config = rough(rolled_sheet(), 11), LdSiftConfig(radius_m=0.08, samples=3)
    chosen = np.array([312, 305, 90])
    expected = np.stack([plain_ld_sift(surface, config, node) for node in chosen])
    np.testing.assert_allclose(ld_sift(surface, config)[chosen], expected, atol=2e-5)


def test_the_surface_in_front_hides_what_is_behind_and_only_what_is_joined_is_seen() -> None:
    sheet = rough(height_field(lump, side=21), 8)
    shifted = replace(sheet, points_m=sheet.points_m + np.array([0.05, 0, 0], np.float32))
    both = replace(
        sheet,
        points_m=np.concatenate([sheet.points_m, shifted.points_m]),
        normals=np.concatenate([sheet.normals] * 2),
        ring=np.concatenate([sheet.ring, np.where(sheet.ring >= 0, sheet.ring + len(sheet), -1)]),
        link_start=np.zeros(2 * len(sheet) + 1, np.int32),
        camera=np.zeros(2 * len(sheet), np.uint8),
        pixel=np.concatenate([sheet.pixel] * 2),
        skin=np.full(2 * len(sheet), -1, np.int32),
    )
    np.testing.assert_array_equal(ld_sift(both, SMALL)[: len(sheet)], ld_sift(sheet, SMALL))
