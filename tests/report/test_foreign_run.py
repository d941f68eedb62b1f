"""A run.json that was edited, damaged or made by another program: the report is made of it, or it is refused."""

import copy
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from report_builder import squats, write_session

from anchorpose.errors import InputError
from anchorpose.report.comparable import differences
from anchorpose.report.page import corrections, kept_frames, problems, provenance, write_report
from anchorpose.report.session import Session, input_hashes, read_session
from anchorpose.report.summary import summary
from anchorpose.report.timeline import kept_rows
from anchorpose.results.run_record import matched_share, read_run

PNG = cv2.imencode(".png", np.full((4, 6, 3), 90, np.uint8))[1].tobytes()
SIGNED = {"reason": "a curtain", "who": "AB", "when": "2026-03-01T09:30:00Z"}
PLACE = {"frame": 3, "time_s": 0.1, **SIGNED}
INTERVAL = {"first_frame": 2, "last_frame": 4, "start_s": 0.1, "end_s": 0.2}
BODY = {"learnt_from_s": 4.0, "height_m": 1.72, "height_sigma_m": 0.01, "clothes_m": {"trunk": 0.005}}
BODY |= {"bones": [{"bone": "Thigh", "length_m": 0.4, "sigma_m": 0.004, "refined_m": 0.001}]}
EVERYTHING: dict[str, Any] = {
    "lost": [{**INTERVAL, "why": "nobody is in view"}],
    "poor_depth": [{**INTERVAL, "camera": "front", "kind": "edges", "worst": 0.09, "why": "edges are wide"}],
    "residuals": [{"camera": "front", "what": "floor", "value": 0.004, "unit": "m"}],
    "timings": [{"stage": "surface", "seconds": 3.5}],
    "body": BODY | {"coefficients": [0.1]},
    "patient": {"frame": 2, "xz_m": [0.1, 0.2], "reason": "stood still", "rival_xz_m": None},
    "corrections": {
        "file": "c.json",
        "sha256": "a" * 64,
        "not_honoured": [],
        "unusable": [{**INTERVAL, **SIGNED}],
        "joints": [{"joint": "KneeLeft", "position_m": [0.1, 0.5, 0.0], "sigma_m": 0.02, **PLACE}],
        "patient": {"position_m": [0.1, 1.0, 0.0], **PLACE},
    },
    "pictures": [{"file": "pictures/a.png", "frame": 2, "time_s": 0.1, "camera": "front", "caption": "c", "why": "w"}],
    "notes": ["A note."],
}
OTHERS = (None, True, -1, 2**70, 1e308, "", "x", [], {}, [[1]], [None], {"a": [1]}, "\u202e/../..")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_session(tmp_path_factory.mktemp("foreign") / "r", squats(20), **EVERYTHING)
    (folder / "pictures").mkdir()
    (folder / "pictures/a.png").write_bytes(PNG)
    return folder


def altered(document: Any) -> Iterator[Any]:
    """The document with one value replaced or one key left out, for every place in it."""
    for path in [path for path in places(document) if path]:
        for other in (*OTHERS, KeyError):
            changed = copy.deepcopy(document)
            owner = changed
            for step in path[:-1]:
                owner = owner[step]
            if other is not KeyError:
                owner[path[-1]] = other
            else:
                del owner[path[-1]]
            yield changed


def places(value: Any) -> Iterator[tuple[str | int, ...]]:
    yield ()
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        for place in places(inner):
            yield (key, *place)


def use(session: Session) -> None:
    """Everything on the page that comes from run.json."""
    for part in (provenance, problems, corrections, kept_frames, kept_rows, summary):
        part(session)
    matched_share(session.run, len(session.joints.frame))
    differences((session, session), ("a", "b"))


@pytest.mark.thorough
def test_no_altered_run_json_is_more_than_refused(folder, tmp_path):
    session, refused, read = read_session(folder), 0, 0
    use(session)
    path = tmp_path / "run.json"
    for run in altered(read_run(folder / "run.json")):
        path.write_text(json.dumps(run))
        try:
            found = read_run(path)
        except InputError:  # and nothing else
            refused += 1
        else:
            use(replace(session, run=found, inputs=input_hashes(found["inputs_sha256"])))
            read += 1
    assert refused > 1000
    assert read > 100  # what only people read may be any text


@pytest.mark.parametrize("file", ["/etc/hostname", "../secret.png", "pictures/../../secret.png", "pictures/link.png"])
def test_no_file_from_elsewhere_gets_into_the_page(tmp_path, refusal, file):
    folder = write_session(tmp_path / "r", squats(4), pictures=[{**EVERYTHING["pictures"][0], "file": file}])
    (tmp_path / "secret.png").write_bytes(PNG)
    (folder / "pictures").mkdir()
    (folder / "pictures/link.png").symlink_to(tmp_path / "secret.png")
    assert "pictures[0].file" in refusal(["report", str(folder)])
    assert not (folder / "report.html").exists()


@pytest.mark.parametrize("content", [b"", b"a private text", PNG[:40]])
def test_a_picture_that_is_none_is_named_as_damaged_and_not_embedded(tmp_path, content):
    folder = write_session(tmp_path / "r", squats(4), pictures=EVERYTHING["pictures"])
    (folder / "pictures").mkdir()
    (folder / "pictures/a.png").write_bytes(content)
    page = write_report(folder).read_text(encoding="utf-8")
    assert "This picture is damaged." in page
    assert "data:image/webp" not in page
