"""What the viewer draws: points, body, surface, with and without a recording, in light and in dark."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from viewer_builder import viewer_of, write_small_recording, write_small_results
from viewer_page import bluish, opened, scene_picture, until

pytest_plugins = ("viewer_fixtures",)


def test_the_patient_is_on_the_screen_in_light_and_in_dark(viewer: Any) -> None:
    dark_ground = []
    for scheme in ("light", "dark"):
        viewer.emulate_media(color_scheme=scheme)
        picture = scene_picture(viewer)
        assert bluish(picture) > 3000
        viewer.keyboard.press("p")
        assert bluish(scene_picture(viewer)) < 300
        viewer.keyboard.press("p")
        dark_ground.append(picture[5, 5].mean())
    assert dark_ground[0] > 200 > 60 > dark_ground[1]


def test_the_body_the_surface_and_the_room_can_be_shown(viewer: Any) -> None:
    bare = scene_picture(viewer)
    for key in "bfr":
        viewer.keyboard.press(key)
        until(viewer, lambda: viewer.evaluate("!anchorpose.frames.missing"), 60)
        assert (np.abs(scene_picture(viewer) - bare).sum(axis=2) > 30).sum() > 500
        viewer.keyboard.press(key)
        until(viewer, lambda: viewer.evaluate("!anchorpose.frames.missing"), 60)
    assert (np.abs(scene_picture(viewer) - bare).sum(axis=2) > 30).sum() < 100


def test_a_pixel_lies_on_the_screen_where_an_independent_projection_puts_it(viewer: Any) -> None:
    """The page's own sum for picking against the server's arrays, to the last digit of a float."""
    found = np.array(viewer.evaluate(
        "() => { const c = anchorpose.frames.points.cameras[0], p = c.points.geometry.getAttribute('pixel').array;"
        " const points = anchorpose.frames.points;"
            " return [0, 100, 400].map((i) => [...p.subarray(4 * i, 4 * i + 3), ...points.place(c, p, i)]); }"
    ))  # fmt: skip
    server_side = viewer.evaluate("anchorpose.description.cameras[0]")
    camera_to_world = np.array(server_side["camera_to_world"])
    distortion = np.array([0.05, -0.02, 0.001, 0.0, 0.0])
    matrix = np.array(
        [[server_side["fx"], 0, server_side["cx"]], [0, server_side["fy"], server_side["cy"]], [0, 0, 1.0]]
    )
    rays = cv2.undistortPoints(found[:, None, :2], matrix, distortion)[:, 0]
    z = found[:, 2:3] * 0.001
    expected = np.hstack([rays * z, z]) @ camera_to_world[:3, :3].T + camera_to_world[:3, 3]
    assert np.abs(expected - found[:, 3:]).max() < 1e-5


def test_points_that_nobody_told_apart_are_shown_in_one_colour_and_said_so(page: Any, tmp_path: Path) -> None:
    recording = write_small_recording(tmp_path / "recording")
    with viewer_of(write_small_results(tmp_path / "results", recording, people=False), recording) as server:
        opened(page, server)
        assert "do not say whose" in page.locator("#notice").inner_text()
        assert bluish(scene_picture(page)) < 100
        assert page.evaluate("anchorpose.frames.points.cameras[0].count") > 1000


def test_a_picture_that_cannot_be_read_is_told(page: Any, tmp_path: Path) -> None:
    recording = write_small_recording(tmp_path / "recording")
    results = write_small_results(tmp_path / "results", recording)
    damaged = recording / "right" / "depth" / "000002.png"
    damaged.write_bytes(damaged.read_bytes()[:80])
    with viewer_of(results, recording) as server:
        opened(page, server)
        page.keyboard.press("ArrowRight")
        page.keyboard.press("ArrowRight")
        until(page, lambda: "Camera right: the picture is truncated." in page.locator("#status").inner_text())
