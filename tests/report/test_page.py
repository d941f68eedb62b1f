"""What the report says: numbers are those of the tables, gaps stay gaps, nothing comes from outside."""

import re
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from page_reader import PageReader
from report_builder import MEASURES, squats, write_session
from results_builder import make_frame, standing_joints
from session_builder import support

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_NAMES, JointState
from anchorpose.pages.overlay import save_pictures
from anchorpose.report.chart import make_bins
from anchorpose.report.curves import step_path
from anchorpose.report.measure_section import GROUPS, grouped_measures, words_of
from anchorpose.report.page import write_report
from anchorpose.results.measuring import MeasureConfig, write_measured
from anchorpose.results.processing import ProcessingConfig
from anchorpose.results.records import Measure
from anchorpose.results.run_record import PictureRecord

FRAMES = 120


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_session(tmp_path_factory.mktemp("report") / "r", squats(FRAMES))
    write_report(folder)
    return folder


@pytest.fixture(scope="module")
def page(folder: Path) -> PageReader:
    return PageReader(folder / "report.html")


def lost_throughout(count: int) -> list:
    return [make_frame(frame, frame / 30, standing_joints(), tuple(JOINT_NAMES)) for frame in range(count)]


def text_of(page: PageReader, tag: str) -> str:
    return " ".join(element.text for element in page.find(tag))


def figures_of(page: PageReader, name: str) -> list[float]:
    """The exact values of the numbers in the first row with this name."""
    row = next(row for row in page.find("tr") if row.children[0].text == name)
    return [float(figure.attributes["value"]) for figure in page.find("data") if row in figure.ancestors]


def numbers_behind(page: PageReader, identity: str) -> list[dict[str, str]]:
    """The rows of the CSV that a figure links to."""
    figure = page.find("figure", id=identity)[0]
    link = next(link for link in page.find("a", **{"class": "csv"}) if figure in link.ancestors)
    head, *lines = unquote(link.attributes["href"].split(",", 1)[1]).splitlines()
    return [dict(zip(head.split(","), line.split(","), strict=True)) for line in lines]


def test_the_numbers_of_an_angle_and_of_a_joint_are_those_of_its_rows(folder, page):
    rows = [row for row in pq.read_table(folder / "angles.parquet").to_pylist() if row["angle"] == "knee_flexion_left"]
    degrees, sigma = (np.array([row[key] for row in rows]) for key in ("degrees", "sigma_deg"))
    states = [row["state"] for row in rows]
    inferred = [state not in ("observed", "lost") for state in states]
    expected = [degrees.min(), np.median(degrees), degrees.max(), np.median(sigma), np.mean(inferred), 0.0]
    assert 0 < np.mean(inferred) < 1
    assert figures_of(page, "left knee flexion") == pytest.approx(expected, rel=1e-12)
    head = [row for row in pq.read_table(folder / "joints.parquet").to_pylist() if row["joint"] == "Head"]
    shares = [np.mean([row["state"] == state for row in head]) for state in JointState]
    typical = np.median([row["sigma_m"] for row in head if row["sigma_m"] is not None])
    assert shares[-1] > 0  # lost at its end
    assert figures_of(page, "head") == pytest.approx([*shares, typical], rel=1e-12)


def test_all_measures_stand_there_with_value_error_and_share_or_with_the_reason_why_not(page):
    shown = {float(figure.attributes["value"]) for figure in page.find("data")}
    for measure in MEASURES:
        if measure.value is not None:
            assert {measure.value, float(measure.frames)} <= shown, measure
    table = next(table for table in page.find("table") if table.attributes.get("class") == "measures")
    rows = {row.children[0].text: row.text for row in page.find("tr") if row.ancestors[-2:-1] == (table,)}
    assert "3.25 s ± 0.24 s25 %120" in rows["time upright"]
    assert "12.3° ± 2.9°50 %90" in rows["knee flexion while upright, mean, left"]
    assert "no value: the right knee is lost <always>" in rows["knee flexion while upright, mean, right"]
    assert "under 1 %" in rows["share of upright time with hands on"]
    assert "time with hands on, left knee" in rows
    folded = next(details.text for details in page.find("details") if "Help in detail" in details.text)
    assert "time with hands on, left knee, by person 1" in folded
    assert not [name for name in rows if "person" in name]


def test_the_numbers_behind_a_curve_are_those_of_the_table_and_empty_where_the_joint_is_lost(folder, page):
    cells = numbers_behind(page, "joint-Head")
    truth = [row for row in pq.read_table(folder / "joints.parquet").to_pylist() if row["joint"] == "Head"]
    assert len(cells) == FRAMES
    for cell, row in zip(cells, truth, strict=True):
        assert int(cell["first_frame"]) == row["frame"]
        if row["y_m"] is None:
            assert (cell["Head_y_lowest_m"], cell["Head_z_state"]) == ("", "lost")
        else:
            assert float(cell["Head_y_lowest_m"]) == pytest.approx(row["y_m"], abs=0.0006)


def test_a_curve_ends_where_its_joint_is_lost(folder, page):
    figure = page.find("figure", id="joint-Head")[0]
    lines = [p.attributes["d"] for p in page.find("path") if figure in p.ancestors and "line" in p.attributes["class"]]
    reach = [sum(int(x) for x in re.findall(r"(?<=[l ])(\d+) -?\d+", path)) for path in lines if path]
    assert max(reach) < 1000 * 0.9  # the head is lost in the last tenth


def test_the_page_holds_all_it_needs_and_is_the_same_each_time(folder, page):
    before = (folder / "report.html").read_bytes()
    assert write_report(folder).read_bytes() == before
    addresses = [e.attributes[name] for e in page.elements for name in ("src", "href") if name in e.attributes]
    assert [address for address in addresses if not address.startswith(("#", "data:"))] == []
    assert "url(" not in before.decode()
    targets = {f"#{element.attributes.get('id')}" for element in page.elements}
    assert {address for address in addresses if address.startswith("#")} <= targets


def test_names_notes_and_reasons_cannot_become_markup(folder, page):
    assert page.find("ward") == page.find("always") == []
    assert "<ward> & garden" in text_of(page, "h1")
    assert "The floor was found <by itself>." in text_of(page, "li")


def test_a_screen_reader_finds_headings_names_and_table_heads(page):
    levels = [int(element.tag[1]) for element in page.elements if re.fullmatch("h[1-6]", element.tag)]
    assert (levels[0], levels.count(1)) == (1, 1)
    assert all(later - earlier <= 1 for earlier, later in pairwise(levels))
    identities = [element.attributes["id"] for element in page.elements if "id" in element.attributes]
    assert len(identities) == len(set(identities))
    assert all(cell.attributes.get("scope") for cell in page.find("th"))
    assert all(table.children[0].tag == "caption" for table in page.find("table"))
    assert all(s.attributes.get("aria-hidden") == "true" or s.attributes.get("role") for s in page.find("svg"))
    assert all(e.attributes.get("aria-label") for e in page.elements if e.attributes.get("role") in ("img", "region"))
    assert all(i.attributes.get("aria-label") or i.attributes.get("alt") for i in page.find("input") + page.find("img"))


def test_kept_pictures_are_shown_with_why_they_were_chosen(tmp_path):
    frames = squats(30)
    folder = write_session(tmp_path / "r", frames)
    png = cv2.imencode(".png", np.full((40, 60, 3), 90, np.uint8))[1].tobytes()
    reasons = {2: "", 15: "sitting down"}
    pictures = [
        (PictureRecord(f"pictures/{k:06d}_front.png", k, k / 30, "front", "hand < hip", why), png)
        for k, why in reasons.items()
    ]
    records = [asdict(record) for record in save_pictures(folder, pictures)]
    page = PageReader(write_report(write_session(folder, frames, pictures=records)))
    assert [image.attributes["alt"] for image in page.find("img")] == ["Camera front. hand < hip"] * 2
    assert all(image.attributes["src"].startswith("data:image/webp;base64,") for image in page.find("img"))
    heads = [h.text for h in page.find("h3") if h.text[0].isdigit()]
    assert heads == ["1. Frame 2, 0.07 s", "2. Frame 15, 0.50 s: sitting down"]
    assert "17 of 21 joints seen, 4 inferred, 0 lost." in text_of(page, "p")


@pytest.mark.parametrize("facing_deg", [0.0, 90.0, 175.0, 180.0, -178.0])
def test_the_range_of_a_turned_pelvis_is_the_same_whichever_way_the_patient_faces(tmp_path, facing_deg):
    turned = np.radians(facing_deg + 8.0 * np.sin(np.pi * np.arange(40) / 10.0))
    joints = [
        np.stack([c * x + s * z, y, c * z - s * x], axis=1)
        for c, s, (x, y, z) in zip(np.cos(turned), np.sin(turned), [standing_joints().T] * 40, strict=True)
    ]
    frames = [make_frame(k, k / 30, joints[k]) for k in range(40)]
    folder = write_session(tmp_path / "r", frames)
    page = PageReader(write_report(folder))
    low, middle, high = figures_of(page, "pelvis rotation")[:3]
    assert high - low == pytest.approx(16.0, abs=0.2)
    assert -180 <= middle <= 180
    assert low < middle < high
    shown = np.array([low, middle, high]) - facing_deg
    assert np.abs((shown + 180) % 360 - 180) == pytest.approx([8.0, 0.0, 8.0], abs=1.0)
    curve = [float(cell["pelvis_rotation_lowest_deg"]) for cell in numbers_behind(page, "angle-pelvis_rotation")]
    assert max(abs(later - earlier) for earlier, later in pairwise(curve)) < 5.0


def test_a_reviewer_s_corrections_are_shown_signed(tmp_path):
    signed = {"reason": "a <visitor>", "who": "kl", "when": "2026-01-02T03:04:05Z"}
    unusable = {"first_frame": 3, "last_frame": 5, "start_s": 0.1, "end_s": 0.1667} | signed
    joint = {"frame": 7, "time_s": 0.2333, "joint": "KneeLeft", "position_m": [0, 0.5, 0], "sigma_m": 0.02} | signed
    record = {"file": "corrections.json", "sha256": "ab" * 32, "unusable": [unusable], "joints": [joint]}
    page = PageReader(write_report(write_session(tmp_path / "r", squats(12), corrections=record)))
    told = [item.text for item in page.find("li")]
    assert "Unusable: frames 3 to 5 (0.10 to 0.17 s): a <visitor> (kl, 2026-01-02T03:04:05Z)" in told
    assert "Placed by hand: left knee in frame 7 (0.23 s): a <visitor> (kl, 2026-01-02T03:04:05Z)" in told
    assert "marked unusable by a reviewer" in [span.text for span in page.find("span")]


NOT_MEASURED = (Measure(measure="recorded_time", value=None, unit="s", frames=0, why="no time is known"),)


def test_a_patient_who_was_never_found_has_a_page_without_a_number_made_up_and_so_has_one_frame(tmp_path):
    page = PageReader(write_report(write_session(tmp_path / "one", squats(1), measures=NOT_MEASURED, contacts=())))
    assert "0.0 s, 1 frame," in text_of(page, "section")
    folder = write_session(tmp_path / "r", lost_throughout(40), contacts=(), measures=NOT_MEASURED)
    page = PageReader(write_report(folder))
    assert "The patient was never found." in text_of(page, "section")
    assert "Hip flexion: no value in any frame." in text_of(page, "p")
    assert figures_of(page, "left knee flexion") == [0.0, 1.0]  # shares inferred and lost
    assert "nobody, as far as was seen" in text_of(page, "span")


def summary_of(folder: Path, frames: list, **tables: Any) -> str:
    page = PageReader(write_report(write_session(folder, frames, **tables)))
    return next(element.text for element in page.find("section") if element.attributes.get("class") == "summary")


def test_what_is_not_known_is_no_no(tmp_path):
    """Twelve frames of a patient who stands, eighteen in which nobody is found."""
    frames = squats(30)[:12] + lost_throughout(30)[12:]
    told = summary_of(tmp_path / "r", frames, contacts=())
    assert "Nobody was seen to touch the patient. The patient was found in 40 % of the frames" in told
    assert "whether anybody touched the patient in the others is not known" in told
    assert "stood up at least 1 time" in told
    assert "Most joint positions are lost" in told
    assert "inferred, not seen" not in told
    rows, cells = timeline_of(PageReader(tmp_path / "r" / "report.html"))
    (shape,) = rows["not known: patient lost"]
    assert shape == ("lost", drawn(0.5, 12, 29, count=30))
    assert [cell["touched"] for cell in cells] == [""] * 12 + ["not known: patient lost"] * 18
    met = summary_of(tmp_path / "s", frames)
    assert "counted again, and so is everybody after the patient was lost" in met
    assert "found in 40 % of the frames" in met


def test_the_summary_has_the_share_upright_of_the_measures_and_says_for_how_long_it_is_not_known(tmp_path):
    standing = [make_frame(frame, frame / 30, standing_joints()) for frame in range(12)]
    frames = standing + lost_throughout(30)[12:]
    folder = write_session(tmp_path / "r", frames, contacts=())
    found = {m.measure: m for m in write_measured(folder, ProcessingConfig(), MeasureConfig()).measures}
    assert found["upright_share"].value == 1.0
    page = PageReader(write_report(folder))
    assert "upright in 100 % of the time in which posture is known (unknown for 0.600 s" in (text_of(page, "section"))
    known = replace(MEASURES[2], value=None, sigma=None, why="no <frame> tells")
    told = summary_of(tmp_path / "s", squats(30), measures=(known,))
    assert "For how long the patient was upright is not known: no <frame> tells." in told


MEASURED = ("angles.parquet", "posture.parquet", "episodes.parquet", "measures.parquet")


@pytest.mark.parametrize(
    ("file", "remedy"),
    [(r"joints\.parquet", ""), (r"run\.json", ""), *((name, ": is missing.*anchorpose measure") for name in MEASURED)],
)
def test_a_folder_that_lacks_a_table_is_refused_and_measuring_proposed(tmp_path, file, remedy):
    folder = write_session(tmp_path / "r", squats(4))
    (folder / file.replace("\\", "")).unlink()
    with pytest.raises(InputError, match=file + remedy):
        write_report(folder)
    assert not (folder / "report.html").exists()


def test_without_a_table_of_contacts_touch_is_unknown_and_all_else_is_reported(tmp_path):
    folder = write_session(tmp_path / "r", squats(30))
    (folder / "contacts.parquet").unlink()
    write_measured(folder, ProcessingConfig(), MeasureConfig())
    page = PageReader(write_report(folder))
    told = text_of(page, "section")
    assert "Whether anybody touched the patient is not known: the folder has no contacts.parquet." in told
    assert "Nobody was seen" not in told
    assert "not known: no contacts.parquet" in text_of(page, "span")
    assert "no value: the results folder has no contacts.parquet" in text_of(page, "td")


def timeline_of(page: PageReader) -> tuple[dict[str, list[tuple[str, str]]], list[dict[str, str]]]:
    """(class, path) of the shapes of each row by its label; and the numbers behind the timeline."""
    figure = page.find("figure", id="timeline")[0]
    rows = {}
    for row in (e for e in page.find("div") if figure in e.ancestors and "row" in e.attributes["class"].split()):
        paths = [p for p in page.find("path") if row in p.ancestors and p.attributes["class"] != "grid"]
        rows[row.children[0].text] = [(p.attributes["class"], p.attributes["d"]) for p in paths]
    return rows, numbers_behind(page, "timeline")


def test_a_contact_is_dark_up_to_the_share_of_it_that_was_seen(page):
    rows, cells = timeline_of(page)
    for label, share, first, last in (("left knee: person 1", 0.9, 40, 60), ("pelvis: person 2", 0.2, 30, 119)):
        (light, whole), (dark, seen) = rows[label]
        assert (light, dark) == ("touch light", "touch")
        assert (whole, seen) == tuple(drawn(level, first, last) for level in (1.0, share))
    assert cells[50]["touched"] == "pelvis by person 2 (20 % seen); left knee by person 1 (90 % seen)"


def test_contacts_with_equipment_have_rows_of_their_own_and_are_nobodys_hands(tmp_path):
    contacts = (support("hand_left", "rail-left", 5, 20, 0.5), support("knee_left", "knee-pad", 0, 29))
    page = PageReader(write_report(write_session(tmp_path / "r", squats(30), contacts=contacts)))
    rows, cells = timeline_of(page)
    assert {"left hand: rail-left", "left knee: knee-pad"} <= set(rows)
    assert cells[10]["touched"] == "left hand by rail-left (50 % seen); left knee by knee-pad (100 % seen)"
    told = text_of(page, "section")
    assert "Nobody was seen to touch the patient. 2 parts of the body were in contact with the equipment." in told


def test_upright_is_dark_where_it_was_seen_and_light_where_inferred(page):
    rows, cells = timeline_of(page)
    shapes = dict(rows["upright"])
    assert shapes["posture light"] == drawn(1.0, 40, 79)  # the left leg is hidden
    assert shapes["posture"] == drawn(1.0, *(30, 39), *(80, 119))
    told = [cell["posture"] for cell in cells]
    assert told == ["not upright"] * 30 + ["upright"] * 10 + ["upright (inferred)"] * 40 + ["upright"] * 40


def drawn(level: float, *ends: int, count: int = FRAMES) -> str:
    """Columns of this height from frame to frame, both ends included."""
    height = np.zeros(count)
    for first, last in zip(ends[::2], ends[1::2], strict=True):
        height[first : last + 1] = level
    return step_path(height, make_bins(np.arange(count), np.arange(count) / 30.0))


def test_tables_of_different_frames_are_refused(tmp_path):
    folder, other = write_session(tmp_path / "r", squats(6)), write_session(tmp_path / "s", squats(5))
    (folder / "posture.parquet").write_bytes((other / "posture.parquet").read_bytes())
    with pytest.raises(InputError, match=r"other frames than joints\.parquet"):
        write_report(folder)


def test_the_page_says_how_good_a_cameras_depth_was(page):
    """0.0016 x 2.5 squared is 10 mm; 49 pixels are 7 by 7."""
    text = text_of(page, "body")
    assert "± 10 mm (one sigma), measured on the still room; 1.3 times as much on slanted surfaces" in text
    assert "neighbours have their error in common over 7 pixels; 1.2 % of the readings on surfaces" in text
    assert "steps of 5 mm, edges 2 pixels wide" in text
    assert "steep" not in text


def test_every_measure_that_is_computed_has_words_of_its_own(tmp_path):
    folder = write_session(tmp_path / "r", squats(12))
    measures = write_measured(folder, ProcessingConfig(), MeasureConfig()).measures
    assert len(measures) > 40
    assert [m.measure for m in measures if words_of(m.measure).meaning == words_of("unheard of").meaning] == []
    assert grouped_measures(measures).keys() == GROUPS.keys() - {"Rating"}  # people give that one
