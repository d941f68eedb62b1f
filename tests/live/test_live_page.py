"""The live page in Chromium: what patient and therapist see of frames, of lost joints and of silence."""

import time
from collections.abc import Callable
from dataclasses import replace
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
from live_builder import live_frame_of, page_running, standing_frame
from viewer_page import nameless, until

from anchorpose.joints import JointState
from anchorpose.live.output import LiveFrame, PersonInView
from anchorpose.live.page_server import PageOutput


class Playing:
    """Sends a frame again and again, as a session does; another one where ``show`` is called."""

    def __init__(self, output: PageOutput) -> None:
        self.output, self._make, self._stop = output, None, Event()
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def show(self, make: Callable[[int, float], LiveFrame] | None) -> None:
        self._make = make

    def close(self) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        number = 0
        while not self._stop.wait(0.05):
            make = self._make
            if make is not None:
                self.output.send(make(number, 0.05 * number))
                number += 1


@pytest.fixture
def playing():
    with page_running() as output:
        running = Playing(output)
        yield running
        running.close()


@pytest.fixture
def live(page: Any, playing: Playing) -> Any:
    page.goto(playing.output.address)
    page.wait_for_selector("html[data-ready]", timeout=20_000)
    return page


def reading(page: Any, dial: int = 0) -> str:
    return page.locator(".dial .reading").nth(dial).text_content()


def test_a_dial_shows_the_angle_and_its_target_and_everything_has_a_name(live, playing):
    assert nameless(live) == []
    playing.show(lambda number, time_s: standing_frame(number, time_s, knee_deg=42.0, dropped=3))
    until(live, lambda: reading(live) == "42°")
    assert reading(live, 1) == "0°"
    left, right = live.locator(".dial").all()
    assert "± " in left.locator(".spread").text_content()
    assert "reached" not in left.get_attribute("class")
    assert "reached" in right.get_attribute("class")
    assert right.locator(".verdict").text_content() == "✓ target"
    assert live.locator("#message").is_hidden()
    assert "3 images dropped" in live.locator("#pace").inner_text()
    assert live.evaluate("parseInt(document.querySelector('#pace').textContent)") >= 50
    assert live.evaluate("anchorpose.figure.view.drawn") > 0


def test_what_is_inferred_looks_inferred(live, playing):
    hidden = {"KneeLeft": JointState.HIDDEN_BY_EQUIPMENT}
    playing.show(lambda number, time_s: standing_frame(number, time_s, states=hidden, touched={"knee_left": False}))
    until(live, lambda: reading(live) == "~0°")
    dial = live.locator(".dial").first
    assert "inferred" in dial.get_attribute("class")
    assert dial.locator(".reading").evaluate("e => getComputedStyle(e).fill") == "none"
    assert dial.locator(".hand").evaluate("e => getComputedStyle(e).strokeDasharray") != "none"
    assert "inferred" in dial.locator(".spread").text_content()
    assert live.locator("#load-left").inner_text() == "~50"
    assert (live.locator("#touched").inner_text(), reading(live, 1)) == ("~left knee", "0°")


def test_what_is_lost_is_a_dash_and_never_the_last_value(live, playing):
    playing.show(lambda number, time_s: standing_frame(number, time_s, touched={"hand_left": True}))
    until(live, lambda: reading(live) == "0°")
    assert live.locator("#touched").inner_text() == "left hand"
    playing.show(lambda number, time_s: standing_frame(number, time_s, lost=("AnkleLeft",), touched={}))
    until(live, lambda: reading(live) == "–")
    assert (reading(live, 1), live.locator("#load-left").inner_text()) == ("0°", "–")
    assert live.locator("#touched").inner_text() == "nobody"
    assert live.locator(".dial .hand").first.get_attribute("visibility") == "hidden"
    nothing = np.full((21, 3), np.nan)
    playing.show(lambda number, time_s: live_frame_of(number, time_s, nothing, why_lost="nobody is seen"))
    until(live, lambda: "The patient is lost: nobody is seen." in live.locator("#message").inner_text())
    assert {reading(live, 0), reading(live, 1), live.locator("#touched").inner_text()} == {"–"}
    assert "now: –" in live.locator("#upright-now").inner_text()


def test_silence_is_reported_and_no_value_stays(live, playing):
    playing.output.say("Looking at the room.")
    until(live, lambda: live.locator("#message").inner_text() == "Looking at the room.")
    playing.show(standing_frame)
    until(live, lambda: reading(live) == "0°")
    playing.show(None)
    until(live, lambda: live.locator("#message").inner_text() == "No image for 2 s")
    assert reading(live) == "–"
    assert not live.evaluate("anchorpose.figure.skeleton.group.visible")
    playing.show(standing_frame)
    until(live, lambda: reading(live) == "0°" and live.locator("#message").is_hidden())
    playing.close()
    playing.output.close()
    until(live, lambda: live.locator("#message").inner_text() == "The session has ended.")
    assert reading(live) == "–"


BESIDE = (PersonInView(1, (0.0, 0.9), 1.7), PersonInView(3, (0.3, -0.9), 1.6))


def with_others(number: int, time_s: float) -> LiveFrame:
    return replace(standing_frame(number, time_s), people=BESIDE)


def test_a_click_or_a_key_makes_another_person_the_patient(live, playing):
    playing.show(with_others)
    first = live.get_by_role("button", name="Make person 1 the patient")
    until(live, lambda: first.is_visible() and live.locator("#people .patient-label").is_visible())
    stage = live.locator("#stage").bounding_box()
    boxes = [one.bounding_box() for one in live.locator("#people > *").all()]
    assert len(boxes) == 3
    for box in boxes:
        assert stage["x"] <= box["x"] <= stage["x"] + stage["width"] - box["width"] + 1
    assert first.evaluate("e => parseFloat(getComputedStyle(e).fontSize)") >= 20
    first.click()
    until(live, lambda: playing.output.asked() == 1)
    playing.show(None)
    time.sleep(0.2)  # a frame may be under way
    playing.output.say("Looking at the new patient for 6 s.")
    until(live, lambda: live.locator("#message").inner_text().startswith("Looking at the new patient for 6 s."))
    assert (reading(live), live.locator("#people button").count()) == ("–", 0)
    playing.show(with_others)
    until(live, lambda: live.locator("#people button").count() == 2)
    live.get_by_role("button", name="Make person 3 the patient").focus()
    live.keyboard.press("Enter")
    until(live, lambda: playing.output.asked() == 3)


def test_a_person_who_has_gone_is_a_sentence_on_the_page(live, playing):
    playing.show(with_others)
    until(live, lambda: live.locator("#people button").count() == 2)
    gone = {"error": "Person 3 is not in view now; the patient is as before."}
    live.evaluate("gone => { fetch = async () => new Response(JSON.stringify(gone), { status: 400 }); }", gone)
    live.locator("#people button").last.click()
    until(live, lambda: "Person 3 is not in view now" in live.locator("#message").inner_text())
    assert playing.output.asked() is None


def test_keys_mark_where_a_condition_begins_and_ends_and_its_rating(page):
    kept: list[str] = []
    with page_running(has_markers=True) as output:
        output.keep_markers(lambda text, at_s: kept.append(text))
        page.goto(output.address)
        page.wait_for_selector("html[data-ready]", timeout=20_000)
        assert nameless(page) == []
        page.keyboard.press("b")  # nothing has a name yet: the field takes the next keys
        page.keyboard.type("bend 40 Hz")
        assert kept == []
        page.locator("#condition").blur()
        for key in ("b", "7", "e"):
            page.keyboard.press(key)
        until(page, lambda: len(kept) == 3)
        assert kept == ["begin bend 40 Hz", "rating 7", "end"]
        until(page, lambda: page.locator("#marked").inner_text().startswith("Kept: "))


def test_without_a_recording_there_are_no_keys_for_markers(live, playing):
    assert not live.locator("#markers").is_visible()
