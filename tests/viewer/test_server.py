"""The viewer's server: who is let in, what can be asked, what becomes of corrections."""

import http.client
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import webbrowser
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

import pytest
from recording_builder import edit_json
from viewer_builder import unpack, viewer_of

from anchorpose.cli import main
from anchorpose.results.corrections import CorrectionsRecord, corrections_beside, read_corrections
from anchorpose.results.run_record import as_json
from anchorpose.viewer import review
from anchorpose.viewer.access import Guard, is_loopback
from anchorpose.viewer.guarded_server import opened_page
from anchorpose.viewer.server import ViewerServer

INTERVAL = {"first_frame": 2, "last_frame": 8, "reason": "a curtain", "who": "AB"}
KNEE = {"frame": 4, "joint": "KneeLeft", "position_m": [0.1, 0.5, -0.1], "sigma_m": 0.02, "reason": "x", "who": "AB"}
PATIENT = {"frame": 4, "position_m": [0.1, 1.0, 0.0], "reason": "the other one", "who": "AB"}

pytest_plugins = ("viewer_fixtures",)


def ask(
    server: ViewerServer, path: str, method: str = "GET", body: Any = None, **headers: str
) -> tuple[int, bytes, dict[str, str]]:
    """path: behind the token, or as it is where it begins with a slash."""
    port, token = server.guard.port, server.guard.token
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    sent = {"Host": f"127.0.0.1:{port}", **{name.replace("_", "-"): value for name, value in headers.items()}}
    target = path if path.startswith("/") else f"/{token}/{path}"
    connection.request(method, target, body if body is None or isinstance(body, str) else json.dumps(body), sent)
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, content, dict(answer.getheaders())


def tell(server: ViewerServer, name: str, body: Any) -> tuple[int, Any]:
    origin = f"http://127.0.0.1:{server.guard.port}"
    status, content, _ = ask(server, name, "POST", body, Origin=origin, Content_Type="application/json")
    return status, json.loads(content)


def test_nobody_gets_in_without_the_token(server: ViewerServer) -> None:
    token = server.guard.token
    assert len(token) >= 32
    for path in (
        "/",
        "/description",
        f"/{token[:-1]}/",
        f"/{token}x/description",
        "/favicon.ico",
        f"/x/{token}/motion",
    ):
        status, content, _ = ask(server, path)
        assert status == 403
        assert b"anchorpose view" in content
    assert ask(server, "description")[0] == 200
    assert ask(server, f"/{token}/description?x=1")[0] == 200


def test_a_page_that_points_its_own_name_here_gets_nothing_and_one_beyond_a_tunnel_can_save(
    server: ViewerServer,
) -> None:
    port = server.guard.port
    for host in ("evil.example", "127.0.0.1.evil.example", "localhost.evil.example", "localhost@evil.example"):
        assert ask(server, "description", Host=f"{host}:{port}")[0] == 403
    for host in ("[::1", "", "192.168.1.5"):
        assert ask(server, "description", Host=host)[0] == 403
    for host in (f"localhost:{port}", f"[::1]:{port}", f"127.0.0.1:{port + 1}", "LOCALHOST"):  # a tunnel has its own
        assert ask(server, "description", Host=host)[0] == 200

    def save(origin: str) -> int:
        sent = {"Host": "localhost:9000", "Origin": origin, "Content_Type": "application/json"}
        return ask(server, "corrections/add", "POST", INTERVAL, **sent)[0]

    assert save(f"http://localhost:{server.guard.port}") == 403
    assert save("http://localhost:9000") == 200


def test_only_the_page_itself_can_change_something(server: ViewerServer) -> None:
    own = f"http://127.0.0.1:{server.guard.port}"
    for headers in (
        {"Content_Type": "application/json"},
        {"Content_Type": "application/json", "Origin": "http://evil.example"},
        {"Content_Type": "application/json", "Origin": "null"},
        {"Content_Type": "text/plain", "Origin": own},
    ):
        assert ask(server, "corrections/add", "POST", INTERVAL, **headers)[0] == 403
    assert not server.api.corrections.path.exists()
    assert tell(server, "corrections/add", INTERVAL)[0] == 200


@pytest.mark.parametrize(
    "name",
    ["../server.py", "view/../../server.py", "%2e%2e/server.py", "/etc/passwd", "three/", "view", "hypotheses/start"],
)
def test_no_address_reaches_the_disk(server: ViewerServer, name: str) -> None:
    assert ask(server, f"/{server.guard.token}/{name}")[0] == 404


def test_the_page_may_load_nothing_from_elsewhere_and_nothing_is_kept(server: ViewerServer) -> None:
    for name in ("", "view/main.js", "description"):
        status, _, headers = ask(server, name)
        assert status == 200
        policy = dict(part.strip().split(" ", 1) for part in headers["Content-Security-Policy"].split(";"))
        assert (policy["default-src"], policy["connect-src"]) == ("'none'", "'self'")
        assert policy["script-src"].startswith("'self' 'sha256-")
        assert "unsafe" not in headers["Content-Security-Policy"]
        assert (headers["Cache-Control"], headers["Referrer-Policy"]) == ("no-store", "no-referrer")


def test_requests_that_make_no_sense_get_a_sentence(server: ViewerServer) -> None:
    for path in ("points?first=0&count=900", "points?first=x&count=1", "surface?first=-1&count=1"):
        status, content, _ = ask(server, path)
        assert status == 400
        assert json.loads(content)["error"]
    assert ask(server, "points?first=0")[0] == 404
    assert tell(server, "corrections/add", ["no object"])[0] == 400
    for body in ("[" * 50_000, '{"a":' * 10_000, '{"position": 1' + "0" * 400 + "}"):
        status, answer = tell(server, "hypotheses/start", body)
        assert status == 400
        assert re.search("levels deep|64 bits", answer["error"])
    assert tell(server, "hypotheses/start", {"position": 10**6})[0] == 400
    own = f"http://127.0.0.1:{server.guard.port}"
    big = {"reason": "x" * 70_000}
    assert ask(server, "corrections/add", "POST", big, Origin=own, Content_Type="application/json")[0] == 413


def test_a_correction_is_in_the_file_with_its_time_and_who_and_when(server: ViewerServer) -> None:
    assert tell(server, "corrections/add", INTERVAL)[0] == 200
    status, held = tell(server, "corrections/add", KNEE)
    assert status == 200
    found = read_corrections(server.api.corrections.path)
    assert (found.unusable[0].start_s, found.unusable[0].end_s) == pytest.approx((2 / 15, 8 / 15), abs=1e-6)
    assert found.joints[0].position_m == (0.1, 0.5, -0.1)
    assert found.joints[0].time_s == pytest.approx(4 / 15, abs=1e-6)
    assert found.joints[0].when.endswith("Z")
    assert found.recording.name == "ward 3"
    taken = {"entry": held["unusable"][0], "who": "CD"}
    status, held = tell(server, "corrections/take-back", taken)
    assert (status, held["unusable"]) == (200, [])
    assert read_corrections(server.api.corrections.path).withdrawn[0].who == "CD"
    assert tell(server, "corrections/take-back", taken)[0] == 400


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        *(("add", KNEE | wrong) for wrong in ({"frame": 900}, {"joint": "Tail"}, {"sigma_m": -1}, {"frame": [4]})),
        *(("add", KNEE | wrong) for wrong in ({"position_m": [1, 2]}, {"who": ""}, {"more": 1})),
        *(("take-back", {"who": who}) for who in ("", " ", 7, None)),
        *(("take-back", {"entry": entry}) for entry in ([1], None)),
        ("take-back", {"why": "x"}),
    ],
)
def test_a_correction_that_is_wrong_changes_nothing(server: ViewerServer, name: str, wrong: dict[str, Any]) -> None:
    _, held = tell(server, "corrections/add", INTERVAL)
    before = server.api.corrections.path.read_bytes()
    body = wrong if name == "add" else {"entry": held["unusable"][0], "who": "CD", **wrong}
    status, answer = tell(server, f"corrections/{name}", body)
    assert (status, bool(answer["error"])) == (400, True)
    assert server.api.corrections.path.read_bytes() == before
    assert tell(server, f"corrections/{name}", {})[0] == 400


def test_a_pixel_of_a_person_is_a_place_in_the_world(server: ViewerServer) -> None:
    status, content, _ = ask(server, "place?position=4&camera=front&column=48&row=60")
    assert status == 200  # the middle of the trunk: 2.3 m before a camera at x 2.4 m that looks along -x
    assert json.loads(content)["position_m"] == pytest.approx([0.1, 1.0 + 4 / 110 * 2.3, 0.0], abs=0.03)
    status, content, _ = ask(server, "place?position=4&camera=right&column=11&row=100")  # who walks by, 1.9 m away
    assert status == 200
    assert json.loads(content)["position_m"] == pytest.approx([-37 / 110 * 1.9, 1.0 - 36 / 110 * 1.9, 0.5], abs=0.05)


@pytest.mark.parametrize(
    ("column", "row", "told"),
    [
        (90, 20, r"room or the equipment.*track with --patient -1\.10,-1\.\d+@4"),
        (32, 82, "room or the equipment"),
        (48, 1, "no reading here; click on the trunk"),
    ],
)
def test_a_pixel_of_nobody_is_refused_with_a_sentence(server: ViewerServer, column: int, row: int, told: str) -> None:
    status, content, _ = ask(server, f"place?position=4&camera=front&column={column}&row={row}")
    answer = json.loads(content)
    assert (status, answer["position_m"]) == (200, None)
    assert re.search(told, answer["why"])


@pytest.mark.parametrize(
    ("query", "told"),
    [
        ("position=4&camera=front&column=96&row=20", "no pixel at column 96"),
        ("position=4&camera=top&column=4&row=20", "no camera 'top'"),
        ("position=99&camera=front&column=4&row=20", "no frame 99"),
        ("position=4&camera=front&column=a&row=20", "."),
    ],
)
def test_a_pixel_that_there_is_not_is_refused(server: ViewerServer, query: str, told: str) -> None:
    status, content, _ = ask(server, f"place?{query}")
    assert status == 400
    assert re.search(told, json.loads(content)["error"])


def test_who_the_patient_is_can_be_changed_and_taken_back(server: ViewerServer) -> None:
    first, second = ({**PATIENT, "frame": frame, "position_m": [0.1, 1.0, z]} for frame, z in ((4, 0.0), (7, 0.5)))
    assert tell(server, "corrections/add", first)[1]["patient"]["time_s"] == pytest.approx(4 / 15, abs=1e-6)
    held = json.loads(ask(server, "corrections")[1])
    _, held = tell(server, "corrections/add", {**second, "replaces": held["patient"]})
    found = read_corrections(server.api.corrections.path)
    assert (found.patient.frame, found.patient.xz_m) == (7, (0.1, 0.5))
    assert [each.entry.frame for each in found.withdrawn] == [4]
    _, held = tell(server, "corrections/take-back", {"entry": held["patient"], "who": "CD"})
    assert held["patient"]["frame"] == 4
    _, held = tell(server, "corrections/take-back", {"entry": held["patient"], "who": "CD"})
    assert held["patient"] is None
    assert [each.entry.frame for each in read_corrections(server.api.corrections.path).withdrawn] == [7, 4]


@pytest.mark.parametrize(
    ("entry", "kind", "refusal"),
    [(KNEE, "joints", "AB corrected this joint"), (PATIENT, "patient", "AB named the patient")],
)
def test_a_correction_that_a_second_reviewer_has_not_seen_is_not_replaced(
    server: ViewerServer, entry: dict[str, Any], kind: str, refusal: str
) -> None:
    _, first = tell(server, "corrections/add", entry)
    other = {**entry, "position_m": [0.3, 0.5, 0.0], "who": "CD"}
    _, answer = tell(server, "corrections/add", {**other, "replaces": None})
    assert answer == {**first, "refused": f"{refusal} meanwhile; look at it and save again."}
    seen = first[kind] if kind == "patient" else first[kind][0]
    _, second = tell(server, "corrections/add", {**other, "replaces": seen})
    assert "refused" not in second
    assert len(read_corrections(server.api.corrections.path).withdrawn) == 1
    now = second[kind] if kind == "patient" else second[kind][0]
    tell(server, "corrections/take-back", {"entry": now, "who": "CD"})
    tell(server, "corrections/take-back", {"entry": seen, "who": "AB"})
    _, answer = tell(server, "corrections/add", {**other, "replaces": seen})
    assert "was withdrawn meanwhile" in answer["refused"]


def test_two_who_correct_at_once_lose_nothing(server: ViewerServer) -> None:
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda frame: tell(server, "corrections/add", {**KNEE, "frame": frame}), range(24)))
    assert {status for status, _ in answers} == {200}
    assert sorted(entry.frame for entry in read_corrections(server.api.corrections.path).joints) == list(range(24))


SECOND_VIEWER = """
import sys
from pathlib import Path
from anchorpose.viewer.server import open_viewer
with open_viewer(Path(sys.argv[1]), None, None, "", "127.0.0.1", 0) as server:
    print("ready", flush=True)
    sys.stdin.readline()
    for frame in range(1, 40, 2):
        server.api.corrections.add({"frame": frame, "joint": "KneeLeft", "position_m": [0.1, 0.5, 0.0],
                                    "sigma_m": 0.02, "reason": "x", "who": "CD"})
"""


def test_two_viewers_of_the_same_results_lose_nothing(server: ViewerServer, small: tuple[Path, Path]) -> None:
    command = [sys.executable, "-c", SECOND_VIEWER, str(small[0])]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "ready\n"
        other.stdin.write("go\n")
        other.stdin.flush()
        for frame in range(0, 40, 2):
            server.api.corrections.add({**KNEE, "frame": frame})
        assert other.wait(30) == 0
    assert sorted(entry.frame for entry in read_corrections(server.api.corrections.path).joints) == list(range(40))


def test_a_lock_that_is_never_released_is_reported(server: ViewerServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(review, "PATIENCE_S", 0.05)
    with review.locked(server.api.corrections.path):
        status, answer = tell(server, "corrections/add", INTERVAL)
    assert status == 400
    assert "another program" in answer["error"]
    assert tell(server, "corrections/add", INTERVAL)[0] == 200


def test_earlier_corrections_are_there_again_and_damaged_ones_stop_the_viewer(small: tuple[Path, Path]) -> None:
    path = corrections_beside(small[0])
    path.unlink(missing_ok=True)
    with viewer_of(*small) as first:
        tell(first, "corrections/add", INTERVAL)
    with viewer_of(*small) as second:
        tell(second, "corrections/add", KNEE)
        assert len(json.loads(ask(second, "corrections")[1])["unusable"]) == 1
    path.write_text(path.read_text()[:-20])
    assert main(["view", str(small[0]), "--no-browser"]) == 2
    path.unlink()


def test_a_second_round_of_review_keeps_what_the_first_one_found(tmp_path: Path, small: tuple[Path, Path]) -> None:
    path = corrections_beside(small[0])
    with viewer_of(*small) as first:
        tell(first, "corrections/add", INTERVAL)
        tell(first, "corrections/add", KNEE)
    said = read_corrections(path)
    path.unlink()
    reviewed = tmp_path / "reviewed"
    shutil.copytree(small[0], reviewed)
    record = CorrectionsRecord(path.name, "a" * 64, said.unusable, said.joints, said.patient)
    edit_json(reviewed / "run.json", lambda run: run.update(corrections=as_json(record)))
    with viewer_of(reviewed) as second:
        shown = json.loads(ask(second, "corrections")[1])
        assert (len(shown["unusable"]), len(shown["joints"])) == (1, 1)
        assert not corrections_beside(reviewed).exists()  # looking writes nothing
        assert tell(second, "corrections/add", {**KNEE, "frame": 9})[0] == 200
        found = read_corrections(corrections_beside(reviewed))
        assert (found.unusable, [entry.frame for entry in found.joints]) == (said.unusable, [4, 9])
        assert found.joints[0] == said.joints[0]
        for entry in (*shown["unusable"], *shown["joints"]):
            assert tell(second, "corrections/take-back", {"entry": entry, "who": "CD"})[0] == 200
    with viewer_of(reviewed) as third:  # what was taken back does not come again
        assert [entry["frame"] for entry in json.loads(ask(third, "corrections")[1])["joints"]] == [9]


def test_the_page_gets_the_names_of_files_and_not_where_they_lie(server: ViewerServer) -> None:
    path = server.api.corrections.path
    path.write_text("{")
    answers = [ask(server, "corrections")[1].decode(), tell(server, "corrections/add", INTERVAL)[1]["error"]]
    path.unlink()
    path.mkdir()  # which the operating system itself complains of
    answers += [ask(server, "corrections")[1].decode(), tell(server, "corrections/add", INTERVAL)[1]["error"]]
    path.rmdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(server.api, "get", lambda name, query: path.with_name("no such file").read_bytes())
        answers.append(ask(server, "corrections")[1].decode())
    assert [answer for answer in answers if str(path.parent) in answer] == []
    assert all(path.name in answer for answer in answers[:4])
    assert "no such file: No such file or directory" in answers[4]


def test_without_a_recording_there_are_no_points_but_all_else(small: tuple[Path, Path]) -> None:
    with viewer_of(small[0]) as server:
        assert ask(server, "points?first=0&count=1")[0] == 400
        about = json.loads(ask(server, "description")[1])
        assert about["has"] == {"body": True, "anchors": True, "recording": False, "people": False}
        _, arrays = unpack(ask(server, "body")[1])
        assert len(arrays["vertices"]) > 10_000


def test_other_addresses_than_loopback_are_distinguished() -> None:
    assert [is_loopback(host) for host in ("127.0.0.1", "localhost", "::1", "127.9.9.9")] == [True] * 4
    assert [is_loopback(host) for host in ("0.0.0.0", "192.168.1.5", "ward-pc", "")] == [False] * 4
    open_to_all = Guard("secret", 80, loopback=False)
    assert open_to_all.host_is_ours({"Host": "ward-pc:80"})
    assert open_to_all.path_within("/secrets/motion") is None
    assert open_to_all.path_within("/secret/motion?x") == "motion"
    assert open_to_all.path_within("/sécret/") is None


def test_the_browser_is_not_started_with_the_secret(
    small: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened = list[tuple[str, Path, str, int]]()

    def browse(address: str) -> bool:
        file = Path(url2pathname(urlsplit(address).path))
        opened.append((address, file, file.read_text(), file.stat().st_mode | file.parent.stat().st_mode))
        return True

    def serve(server: ViewerServer) -> None:
        assert opened[0][1].exists()  # the browser may take its time
        raise KeyboardInterrupt

    monkeypatch.setattr(webbrowser, "open", browse)
    monkeypatch.setattr(ViewerServer, "serve_forever", serve)
    assert main(["view", str(small[0])]) == 0
    printed = capsys.readouterr().out.splitlines()[0].split()[-1]
    ((address, file, text, mode),) = opened
    assert address.startswith("file:///")
    assert urlsplit(printed).path.strip("/") not in address
    assert f"url={printed}" in text
    assert mode & 0o077 == 0
    assert not file.exists()
    assert not file.parent.exists()


def test_a_browser_that_follows_the_file_gets_to_the_page(page: Any, server: ViewerServer) -> None:
    shown = list[str]()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(webbrowser, "open", shown.append)
        with opened_page(server.address):
            page.goto(shown[0])
            page.wait_for_selector("html[data-ready]", timeout=20_000)
    assert page.url == server.address


def test_the_verb_prints_where_it_is_and_stops_on_request(small: tuple[Path, Path]) -> None:
    script = "import sys\nfrom anchorpose.cli import main\nif __name__ == '__main__': sys.exit(main(sys.argv[1:]))"
    process = subprocess.Popen(
        [sys.executable, "-c", script, "view", *map(str, small), "--no-browser"],
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a background shell's children ignore it
    )
    clock = threading.Timer(120, process.kill)  # a busy machine takes half a minute to start
    clock.start()
    try:
        address = process.stdout.readline().split()[-1]
        assert address.startswith("http://127.0.0.1:")
        assert "results.corrections.json" in process.stdout.readline()
        os.kill(process.pid, signal.SIGINT)
        assert "every correction was saved" in process.communicate()[0]
        assert process.returncode == 0
    finally:
        clock.cancel()
        process.kill()


def test_a_place_that_is_taken_or_is_another_machines_is_refused(
    server: ViewerServer, small: tuple[Path, Path], tmp_path: Path, refusal
) -> None:
    for results, place, words in (
        (small[0], ("--port", str(server.guard.port)), "Cannot listen on"),
        (small[0], ("--host", "203.0.113.7"), "Cannot listen on"),
        (small[0], ("--host", ""), "--host is empty"),
        (tmp_path / "none", (), "there is no such folder"),
    ):
        assert words in refusal(["view", str(results), "--no-browser", *place])
