"""The page for blinded raters: what it may know, the order of the trials, and what becomes of the scores."""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rating_builder import AMPLITUDE, CONDITIONS, LENGTHS, rating_of, small_trials, write_rated_session
from viewer_builder import PERIOD_S, unpack
from viewer_page import nameless, opened, until

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.recording.events import Trials
from anchorpose.results.ratings import ratings_beside, read_ratings
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.results.trial_table import TRIALS_FILE, write_trials
from anchorpose.viewer.rating import RatingServer, open_rating

ASKED = ("description", "overview", "motion?first=0&count=40", "rays", "body", "points?first=0&count=32&room=1")


@pytest.fixture(scope="module")
def rated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return write_rated_session(tmp_path_factory.mktemp("rated"))


@pytest.fixture
def session(rated: tuple[Path, Path]) -> tuple[Path, Path]:
    for path in rated[0].parent.glob("results.rating_*"):
        path.unlink()
    return rated


def ask(address: str, name: str, body: Any = None) -> tuple[int, bytes]:
    host, token = re.fullmatch(r"http://([^/]+)/([^/]+)/", address).groups()  # type: ignore[union-attr]
    connection = http.client.HTTPConnection(host, timeout=20)
    headers = {} if body is None else {"Origin": f"http://{host}", "Content-Type": "application/json"}
    text = None if body is None else json.dumps(body)
    connection.request("GET" if body is None else "POST", f"/{token}/{name}", text, headers)
    answer = connection.getresponse()
    found = answer.status, answer.read()
    connection.close()
    return found


def score(server: RatingServer, shown: Any, value: Any) -> tuple[int, Any]:
    status, content = ask(server.address, "score", {"shown": shown, "score": value})
    return status, json.loads(content)


def test_no_answer_tells_a_condition_a_setting_a_measure_or_where_in_the_session_a_trial_is(session):
    with rating_of(*session) as server:
        order = [row.trial for row in server.api.scores.current().rows]
        answers = {name: ask(server.address, name) for name in ASKED}
        assert {status for status, _ in answers.values()} == {200}
        telling = (*CONDITIONS, str(AMPLITUDE), "near L1", "amplitude", "ward 3", "results", "knee_flexion")
        for name, (_, content) in answers.items():
            assert [word for word in telling if word.encode() in content] == [], name
        description = json.loads(answers["description"][1])
        drawing = {"frames", "joints", "limbs", "states", "anchors", "has", "cameras", "equipment"}
        assert set(description) == drawing | {"rater", "spans", "best", "scores"}
        _, overview = unpack(answers["overview"][1])
        assert overview["frame"].tolist() == list(range(sum(LENGTHS)))
        for trial, (first, last) in zip(order, description["spans"], strict=True):
            assert last - first + 1 == LENGTHS[trial - 1]
            within_s = overview["time_s"][first : last + 1] - overview["time_s"][first]
            assert within_s == pytest.approx(PERIOD_S * np.arange(last - first + 1), abs=1e-6)
        assert np.diff(overview["time_s"]).min() > 0
        assert unpack(answers["motion?first=0&count=40"][1])[1]["angles"].size == 0


@pytest.mark.parametrize(
    "name",
    ["curves?first=0&count=9", "corrections", "place?position=0", "hypotheses", "trials.parquet", "hypotheses/found"],
)
def test_what_the_viewer_answers_beside_the_scene_is_not_answered(session, name):
    with rating_of(*session) as server:
        assert ask(server.address, name)[0] == 404


def test_each_trial_is_drawn_as_it_was_tracked_and_recorded(session):
    joints = read_joints(session[0] / JOINTS_FILE)
    with rating_of(*session) as server:
        _, motion = unpack(ask(server.address, "motion?first=0&count=40")[1])
        frames, kept = server.api.review.depth_frames, server.api.spans
        for row, (first, last) in zip(server.api.scores.current().rows, kept, strict=True):
            begins = sum(LENGTHS[: row.trial - 1])
            rows = slice(begins, begins + LENGTHS[row.trial - 1])
            assert np.array_equal(
                motion["joints"][first : last + 1], joints.position_m[rows].astype(np.float32), equal_nan=True
            )
            assert frames is not None
            assert frames.frame[first : last + 1].tolist() == list(range(rows.start, rows.stop))
            assert frames.pairs[first : last + 1, 0].tolist() == list(range(rows.start, rows.stop))


def test_a_score_is_in_the_file_at_once_and_a_later_one_replaces_it(session):
    with rating_of(*session) as server:
        path = session[0].parent / "results.rating_AB.tsv"
        drawn = read_ratings(path)
        assert sorted(row.trial for row in drawn.rows) == [1, 2, 3, 4, 5]
        assert {row.score for row in drawn.rows} == {None}
        assert score(server, 2, 10) == (200, {"scores": [None, 10, None, None, None]})
        assert score(server, 2, 0) == (200, {"scores": [None, 0, None, None, None]})
        lines = [line.split("\t") for line in path.read_text(encoding="utf-8").splitlines()]
        assert lines[0] == ["shown", "trial", "score", "time", "rater", "seed", "session"]
        shown, trial, given, when, rater, seed, _ = lines[2]
        assert (shown, trial, given, rater, seed) == ("2", str(drawn.rows[1].trial), "0", "AB", str(drawn.seed))
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", when)
        assert lines[1][2:4] == ["n/a", "n/a"]
        for wrong in ((0, 5), (6, 5), (1, 11), (1, -1), (1, 2.5), (1, "5"), (1, None), (1, True), ("1", 5)):
            assert score(server, *wrong)[0] == 400
        assert ask(server.address, "score", {"shown": 1})[0] == 404
        assert read_ratings(path).scores[drawn.rows[0].trial] is None


def test_the_order_is_that_of_the_seed_and_raters_have_files_of_their_own(session):
    orders = {}
    for rater in ("ab", "CD"):
        with rating_of(*session, rater=rater) as server, rating_of(*session, rater=rater) as second:
            held = server.api.scores.current()
            assert second.api.scores.current() == held  # two windows of one rater
            orders[rater] = [row.trial for row in held.rows]
            assert orders[rater] == (1 + np.random.default_rng(held.seed).permutation(5)).tolist()
    assert {path.name for path in session[0].parent.glob("*.tsv")} == {"results.rating_AB.tsv", "results.rating_CD.tsv"}


@pytest.mark.thorough
def test_orders_are_drawn_evenly(session):
    """Each trial comes first in a fifth of all orders: 5 sigma of 400 draws."""
    first = []
    for _ in range(400):
        ratings_beside(session[0], "AB").unlink(missing_ok=True)
        server = open_rating(session[0], None, "AB", "127.0.0.1", 0)
        first.append(server.api.scores.current().rows[0].trial)
        server.server_close()
    counts = np.bincount(first, minlength=6)[1:]
    assert np.abs(counts - 80).max() < 5 * np.sqrt(400 * 0.2 * 0.8)


def test_nothing_is_lost_when_the_program_is_killed(session):
    arguments = ["view", "--rate", "--rater", "AB", "--no-browser", str(session[0])]
    command = [sys.executable, "-c", f"from anchorpose.cli import main; main({arguments!r})"]

    def started() -> tuple[subprocess.Popen[str], str]:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "COLUMNS": "500"})
        assert process.stdout is not None
        address = next(found[0] for line in process.stdout if (found := re.findall(r"http://\S+", line)))
        return process, address

    process, address = started()
    status, _ = ask(address, "score", {"shown": 3, "score": 4})
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    assert status == 200
    before = read_ratings(ratings_beside(session[0], "AB"))
    process, address = started()
    assert json.loads(ask(address, "description")[1])["scores"] == [None, None, 4, None, None]
    process.send_signal(signal.SIGINT)
    assert "the same command goes on" in process.communicate()[0]
    assert read_ratings(ratings_beside(session[0], "AB")) == before


@pytest.mark.parametrize("rater", ["", "A B", "A1", "ABCDEFGHI", "A/B", "-"])
def test_initials_that_are_not_one_to_eight_letters_are_refused(session, refusal, rater):
    sentence = refusal(["view", str(session[0]), "--rate", f"--rater={rater}"])
    assert "not 1 to 8 letters" in sentence
    assert "--rater AB" in sentence
    assert list(session[0].parent.glob("*.tsv")) == []


def test_what_cannot_be_rated_is_refused_in_one_sentence(session, tmp_path, refusal):
    results, _ = write_rated_session(tmp_path)
    rate = ["view", str(results), "--rate", "--rater", "AB"]
    assert "add --rate" in refusal(["view", str(results), "--rater", "AB"])
    for spoilt, said in (
        (lambda text: text.replace(text.split("\t")[-1].strip(), "0" * 64), "scores of another session"),
        (lambda text: text.replace("\tAB\t", "\tCD\t"), "rater 'CD'"),
        (lambda text: text.replace("n/a\tn/a", "11\t2026-01-01T00:00:00Z", 1), "line 2 is not a place"),
        (lambda text: "\n".join(text.splitlines()[:3]), "other trials could be shown"),
        (lambda text: "x", "does not have the columns"),
    ):
        path = ratings_beside(results, "AB")
        path.unlink(missing_ok=True)
        open_rating(results, None, "AB", "127.0.0.1", 0).server_close()
        path.write_text(spoilt(path.read_text(encoding="utf-8")), encoding="utf-8")
        sentence = refusal(rate)
        assert said in sentence
        assert sentence.strip().count("\n") == 0
    path.unlink()
    trials = small_trials()
    late = Trials(trials.columns, (trials.rows[0].__class__(1, "off", 90.0, 1.0, 90.0, (None, None)),))
    write_trials(results / TRIALS_FILE, late)
    assert "no trial of which two frames were tracked" in refusal(rate)
    (results / TRIALS_FILE).unlink()
    assert "--events" in refusal(rate)
    assert "no such folder" in refusal(["view", str(tmp_path / "none"), "--rate", "--rater", "AB"])


def test_a_trial_of_which_nothing_was_tracked_is_left_out(tmp_path):
    results, recording = write_rated_session(tmp_path)
    trials = small_trials()
    late = trials.rows[0].__class__(6, "loud-on", 90.0, 1.0, 90.0, (None, None))
    write_trials(results / TRIALS_FILE, Trials(trials.columns, (*trials.rows, late)))
    with rating_of(results, recording) as server:
        assert sorted(server.api.scores.current().scores) == [1, 2, 3, 4, 5]


def test_a_place_that_cannot_be_written_is_refused(session, monkeypatch):
    monkeypatch.setattr("anchorpose.viewer.rating.ratings_beside", lambda results, rater: results / f"{rater}.tsv")
    with pytest.raises(InputError, match="lies inside"):
        open_rating(*session, "AB", "127.0.0.1", 0)


@pytest.mark.thorough
def test_a_trial_plays_to_its_end_and_keys_score_it(page, session):
    with rating_of(*session) as server:
        opened(page, server)
        (first, last), (second, _) = server.api.spans[:2]
        until(page, lambda: page.evaluate("anchorpose.playback.position") == last)
        assert not page.evaluate("anchorpose.playback.playing")
        page.keyboard.press("7")
        until(page, lambda: page.locator("#status").inner_text() == "Saved: 7.")
        page.keyboard.press("t")
        until(page, lambda: page.locator("#status").inner_text() == "Saved: 10.")
        page.keyboard.press("Enter")
        until(page, lambda: page.evaluate("anchorpose.session.at") == 1)
        assert page.evaluate("anchorpose.playback.first") == second
        page.keyboard.press("ArrowLeft")
        assert page.locator("#scores button[aria-pressed=true]").inner_text().startswith("10")
        page.keyboard.press("Home")
        assert page.evaluate("anchorpose.playback.position") >= first
        page.keyboard.press("End")  # no key of this page: the next trial must not come into view
        assert page.evaluate("anchorpose.playback.position") <= last
        assert [row.score for row in server.api.scores.current().rows] == [10, None, None, None, None]


@pytest.mark.thorough
def test_the_page_goes_on_at_the_first_trial_without_a_score_and_says_when_all_have_one(page, session):
    with rating_of(*session) as server:
        for shown in (1, 2, 4):
            score(server, shown, 3)
        opened(page, server)
        assert "Trial 3 of 5, 2 without a score" in page.locator("#progress").inner_text()
        page.locator("#scores button").nth(5).click()
        until(page, lambda: "1 without" in page.locator("#progress").inner_text())
        page.keyboard.press("Enter")  # after a click on a score, too
        page.keyboard.press("n")
        assert page.evaluate("anchorpose.session.at") == 4
        page.locator("#scores button").nth(0).click()
        until(page, lambda: "all have a score" in page.locator("#progress").inner_text())
        assert page.locator("#next").is_disabled()


@pytest.mark.thorough
def test_the_page_shows_and_asks_for_nothing_that_tells_a_trial(page, session):
    asked = list[str]()
    page.on("request", lambda request: asked.append(request.url + (request.post_data or "")))
    with rating_of(*session) as server:
        opened(page, server)
        page.keyboard.press("4")
        page.keyboard.press("Enter")
        until(page, lambda: page.evaluate("!anchorpose.frames.missing"))
        shown = page.content()
    for text in (shown, *asked):
        assert not any(word in text for word in (*CONDITIONS, str(AMPLITUDE), "near L1", "ward 3"))
    assert not any(re.search(r"trial|condition", url) for url in asked)


@pytest.mark.thorough
@pytest.mark.parametrize("width", [390, 1280])
def test_every_button_is_named_and_within_reach(page, session, width):
    page.set_viewport_size({"width": width, "height": 760})
    with rating_of(*session) as server:
        opened(page, server)
        assert nameless(page) == []
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        boxes = [box.bounding_box() for box in page.locator("#scores button, #moves button").all()]
        assert all(
            box["x"] >= 0 and box["x"] + box["width"] <= width and box["y"] + box["height"] <= 760 for box in boxes
        )
        assert min(box["height"] for box in boxes) >= 40


def test_a_page_without_a_recording_shows_the_skeleton(session):
    with rating_of(session[0]) as server:
        assert not json.loads(ask(server.address, "description")[1])["has"]["recording"]
        assert ask(server.address, "points?first=0&count=1")[0] == 400


def test_the_verb_names_the_file(session, monkeypatch, capsys):
    monkeypatch.setattr("anchorpose.viewer.server.ReviewServer.serve_forever", lambda self: None)
    assert main(["view", str(session[0]), "--rate", "--rater", "ab", "--no-browser"]) == 0
    assert "results.rating_AB.tsv" in capsys.readouterr().out.replace("\n", "")
