"""What the viewer draws: points, body, surface, with and without a recording, in light and in dark."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from viewer_builder import BODY_SHIFT_M, BODY_TURN, viewer_of, write_small_session
from viewer_page import bluish, is_bluish, opened, scene_picture, until

from anchorpose.body.segments import load_body_asset
from anchorpose.camera import transform_points
from anchorpose.viewer.server import ViewerServer

pytestmark = pytest.mark.thorough

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


def patients_skin(server: ViewerServer) -> np.ndarray:
    """(n, 3) the patient's pixels of the first frame in the world, by ``Camera.back_project``."""
    depth_frames = server.api.review.depth_frames
    found = []
    for number, camera in enumerate(depth_frames.cameras):
        depth_m, labels = depth_frames.depth(0, number)[0], depth_frames.labels(0, number)

        found.append(
            transform_points(camera.require_pose(), camera.back_project(depth_m)[(labels == 4) & (depth_m > 0)])
        )
    return np.concatenate(found)


def test_points_are_drawn_where_an_independent_way_puts_them(viewer: Any, server: ViewerServer) -> None:
    for key in "xaqt":
        viewer.keyboard.press(key)  # nothing but the patient's points
    for preset in "125":
        viewer.keyboard.press(preset)
        blue = is_bluish(scene_picture(viewer))
        world = patients_skin(server)
        seen = np.array(viewer.evaluate("points => points.map((p) => anchorpose.view.project(p))", world.tolist()))
        column, row = np.rint(seen[:, :2]).astype(int).T
        assert blue[row, column].mean() > 0.97
        around = np.zeros(blue.shape, np.uint8)
        around[row, column] = 1
        near = cv2.dilate(around, np.ones((19, 19), np.uint8)) > 0
        assert (blue & ~near).sum() == 0


def test_the_point_that_a_click_finds_is_the_one_that_is_drawn(viewer: Any, server: ViewerServer) -> None:
    place = "(i) => anchorpose.frames.points.place(anchorpose.frames.points.cameras[0], pixels(), i)"
    pixels = "const pixels = () => anchorpose.frames.points.cameras[0].points.geometry.getAttribute('pixel').array;"
    found = np.array(viewer.evaluate(f"() => {{ {pixels} return [...Array(200).keys()].map({place}); }}"))
    labels = np.array(
        viewer.evaluate(f"() => {{ {pixels} return [...Array(200).keys()].map((i) => pixels()[4 * i + 3] & 255); }}")
    )
    skin = patients_skin(server)
    away_m = np.linalg.norm(found[labels == 4][:, None] - skin[None], axis=2).min(axis=1)
    assert len(away_m) > 10
    assert away_m.max() < 1e-5


def test_the_body_is_drawn_where_its_pose_puts_it(viewer: Any) -> None:
    for key in "xaqtp":
        viewer.keyboard.press(key)
    rest = load_body_asset().vertices
    skin = BODY_TURN.apply(rest) + BODY_SHIFT_M
    for preset in "12":
        viewer.keyboard.press(preset)
        bare = scene_picture(viewer)
        viewer.keyboard.press("b")
        body = np.abs(scene_picture(viewer) - bare).sum(axis=2) > 12
        viewer.keyboard.press("b")
        seen = np.array(viewer.evaluate("points => points.map((p) => anchorpose.view.project(p))", skin[::3].tolist()))
        column, row = np.rint(seen[:, :2]).astype(int).T
        assert body[row, column].mean() > 0.9
        around = np.zeros(body.shape, np.uint8)
        around[row, column] = 1
        near = cv2.dilate(around, np.ones((25, 25), np.uint8)) > 0
        assert (body & ~near).sum() == 0


def test_points_without_person_labels_are_shown_in_one_colour_and_reported(page: Any, tmp_path: Path) -> None:
    with viewer_of(*write_small_session(tmp_path, people=False)) as server:
        opened(page, server)
        assert "have no person labels" in page.locator("#notice").inner_text()
        assert bluish(scene_picture(page)) < 100
        assert page.evaluate("anchorpose.frames.points.cameras[0].count") > 1000


def test_a_picture_that_cannot_be_read_is_reported(page: Any, tmp_path: Path) -> None:
    results, recording = write_small_session(tmp_path)
    damaged = recording / "right" / "depth" / "000002.png"
    damaged.write_bytes(damaged.read_bytes()[:80])
    with viewer_of(results, recording) as server:
        opened(page, server)
        page.keyboard.press("ArrowRight")
        page.keyboard.press("ArrowRight")
        until(page, lambda: "Camera right: the picture is truncated." in page.locator("#status").inner_text())
