"""What a reviewer marks and moves in the viewer is in the file."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from viewer_builder import PERIOD_S, viewer_of
from viewer_page import file_of, opened, sign, until

from anchorpose.viewer.server import ViewerServer

pytest_plugins = ("viewer_fixtures",)


def test_an_interval_is_marked_by_keyboard_and_is_in_the_file(viewer: Any, server: ViewerServer) -> None:
    for key in ("ArrowRight", "ArrowRight", "i", "Shift+ArrowRight", "o", "m"):
        viewer.keyboard.press(key)
    assert viewer.evaluate("document.activeElement.id") == "sign-reason"
    sign(viewer, "the curtain")
    (found,) = file_of(server).unusable
    assert (found.first_frame, found.last_frame, found.reason, found.who) == (2, 12, "the curtain", "AB")
    assert found.end_s == pytest.approx(12 * PERIOD_S, abs=1e-5)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", found.when)
    assert "the curtain (AB)" in viewer.locator("#corrections").inner_text()


def test_a_joint_is_moved_by_keys_saved_and_undone(viewer: Any, server: ViewerServer) -> None:
    viewer.keyboard.press("2")  # from the right: the screen's right is forward for the patient
    knee = viewer.evaluate("anchorpose.description.joints.indexOf('KneeLeft')")
    for _ in range(knee + 1):
        viewer.keyboard.press("]")
    before = viewer.evaluate(f"Array.from(anchorpose.rows.at(0).joints.subarray({3 * knee}, {3 * knee + 3}))")
    for key in ("e", "ArrowRight", "ArrowRight", "Shift+ArrowRight", "ArrowUp", "Enter"):
        viewer.keyboard.press(key)
    sign(viewer, "the knee is further forward")
    (found,) = file_of(server).joints
    moved = (np.array(found.position_m) - before) * 1000
    assert (found.frame, found.joint, found.sigma_m) == (0, "KneeLeft", 0.02)
    assert moved[:2] == pytest.approx([11.0, 5.0], abs=0.2)
    assert "corrected" in viewer.locator("#joint-card").inner_text()
    viewer.keyboard.press("Control+z")
    until(viewer, lambda: not file_of(server).joints)
    assert file_of(server).withdrawn[0].entry == found
    until(viewer, lambda: "None so far" in viewer.locator("#corrections").inner_text())  # the file is first


@pytest.mark.thorough
def test_undoing_a_second_correction_brings_the_first_one_back(viewer: Any, server: ViewerServer) -> None:
    for reason in ("first", "second"):
        for key in (*(["]"] if reason == "first" else []), "e", "ArrowRight", "Enter"):
            viewer.keyboard.press(key)
        sign(viewer, reason)
        viewer.wait_for_timeout(1100)  # what a person needs for two corrections; the file counts in seconds
    (found,) = file_of(server).joints
    assert found.reason == "second"
    viewer.keyboard.press("Control+z")
    until(viewer, lambda: file_of(server).joints[0].reason == "first")
    until(viewer, lambda: "earlier correction holds again" in viewer.locator("#status").inner_text())
    viewer.keyboard.press("Control+z")
    until(viewer, lambda: not file_of(server).joints)


def test_a_page_shows_what_another_reviewer_corrected_before_it_replaces_it(viewer: Any, server: ViewerServer) -> None:
    joint = viewer.evaluate("anchorpose.description.joints[0]")
    server.api.corrections.add(
        {"frame": 0, "joint": joint, "position_m": [0.1, 0.9, 0.0], "sigma_m": 0.02, "reason": "theirs", "who": "CD"}
    )
    for key in ("]", "e", "ArrowRight", "Enter"):
        viewer.keyboard.press(key)
    viewer.fill("#sign-reason", "mine")
    viewer.fill("#sign-who", "AB")
    viewer.press("#sign-reason", "Enter")
    until(viewer, lambda: "CD corrected this joint meanwhile" in viewer.locator("#status").inner_text())
    viewer.click("#tab-correct")
    assert "theirs (CD)" in viewer.locator("#corrections").inner_text()
    assert not file_of(server).withdrawn
    viewer.click("#joint-save")
    sign(viewer, "mine")
    (found,) = file_of(server).joints
    assert (found.reason, file_of(server).withdrawn[0].entry.reason) == ("mine", "theirs")


def test_a_joint_is_put_on_the_point_that_is_clicked(viewer: Any, server: ViewerServer) -> None:
    for key in ("]", "e", "s"):
        viewer.keyboard.press(key)
    place = viewer.evaluate(POINT_OF, [4, 53])
    click_at(viewer, place)
    viewer.click("#joint-save")
    sign(viewer, "here")
    (found,) = file_of(server).joints
    assert np.linalg.norm(np.array(found.position_m) - place["world"]) < 0.08


POINT_OF = (  # where a point with a label is drawn, and where it is
    "([label, wanted]) => { const c = anchorpose.frames.points.cameras[0],"
    " p = c.points.geometry.getAttribute('pixel').array;"
    " for (let i = 0; i < c.count; i++) if ((p[4 * i + 3] & 255) === label && p[4 * i + 1] === wanted) {"
    " const w = anchorpose.frames.points.place(c, p, i), s = anchorpose.view.project(w);"
    " return { screen: s, world: w }; } }"
)


def click_at(page: Any, place: dict[str, Any]) -> None:
    page.locator("#scene").click(position={"x": place["screen"][0], "y": place["screen"][1]})


def test_the_patient_is_named_by_a_click_and_the_page_says_what_to_run(viewer: Any, server: ViewerServer) -> None:
    for key in ("5", "ArrowRight", "ArrowRight", "n"):  # 5: as the first depth camera sees it
        viewer.keyboard.press(key)
    until(viewer, lambda: viewer.evaluate("!anchorpose.frames.missing"))
    assert viewer.locator("#corrections-next").is_hidden()
    told = viewer.locator("#name-tracked").inner_text()
    assert told.startswith("Tracked: the person at x 0.10, z 0.05 m in frame 2, who was seen in place")
    assert told.endswith("The person at x 0.40, z -0.90 m may be the patient as well.")
    other = viewer.evaluate(POINT_OF, [5, 88])
    click_at(viewer, other)
    until(viewer, lambda: viewer.evaluate("document.querySelector('#sign').open"))
    assert "in frame 2" in viewer.locator("#sign-title").inner_text()
    sign(viewer, "the therapist was tracked")
    found = file_of(server).patient
    assert (found.frame, found.reason) == (2, "the therapist was tracked")
    assert np.linalg.norm(np.array(found.position_m) - other["world"]) < 0.15
    assert "in frame 2. Track again" in viewer.locator("#name-state").inner_text()
    command = viewer.locator("#corrections-command").inner_text().strip()
    assert command.endswith('-o NEW-RESULTS --corrections "results.corrections.json"')
    assert "the patient is here: the therapist was tracked (AB)" in viewer.locator("#corrections").inner_text()
    viewer.keyboard.press("Control+z")
    until(viewer, lambda: file_of(server).patient is None)
    until(viewer, lambda: "another person than the patient" in viewer.locator("#name-state").inner_text())


def test_a_click_on_nobody_names_nobody(viewer: Any, server: ViewerServer) -> None:
    for key in ("5", "r", "n"):
        viewer.keyboard.press(key)
    until(viewer, lambda: viewer.evaluate("!anchorpose.frames.missing"))
    click_at(viewer, viewer.evaluate(POINT_OF, [0, 30]))
    until(viewer, lambda: "never moves, track with --patient" in viewer.locator("#status").inner_text())
    assert not viewer.evaluate("document.querySelector('#sign').open")
    viewer.keyboard.press("Escape")
    assert viewer.locator("#name-start").get_attribute("aria-pressed") == "false"
    assert not server.api.corrections.path.exists()


@pytest.mark.thorough
def test_earlier_corrections_are_listed_and_taken_back(viewer: Any, server: ViewerServer) -> None:
    for key in ("i", "o", "m"):
        viewer.keyboard.press(key)
    sign(viewer, "first")
    viewer.reload()
    viewer.wait_for_selector("html[data-ready]")
    viewer.click("#tab-correct")
    item = viewer.locator("#corrections li")
    assert "first (AB)" in item.inner_text()
    item.locator("button").nth(0).focus()
    viewer.keyboard.press("Delete")
    until(viewer, lambda: not file_of(server).unusable)
    assert len(file_of(server).withdrawn) == 1


def test_when_the_program_is_stopped_the_page_says_so(page: Any, small: tuple[Path, Path]) -> None:
    with viewer_of(small[0]) as server:
        opened(page, server)
        page.evaluate("() => { window.fetch = () => Promise.reject(new TypeError('gone')); }")
        for key in ("i", "o", "m"):
            page.keyboard.press(key)
        page.fill("#sign-reason", "x")
        page.fill("#sign-who", "AB")
        page.press("#sign-reason", "Enter")
        until(page, lambda: "Was it stopped?" in page.locator("#status").inner_text())
