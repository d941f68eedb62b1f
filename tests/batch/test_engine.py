"""Jobs on workers: a failure stays alone, a killed worker repeats one job, and what is stopped ends."""

import importlib
import os
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from threading import Thread

import batch_stub
import pytest
from distributed import Client, LocalCluster

from anchorpose.batch import cluster, tracking
from anchorpose.batch.cluster import Job, Place, connected, run_jobs
from anchorpose.batch.sessions import find_sessions
from anchorpose.cli.track_verbs import TrackOptions
from anchorpose.errors import AnchorposeError, MissingPackage
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording

BUILDERS = str(Path(batch_stub.__file__).parent)


@pytest.fixture(autouse=True)
def _children_find_the_stubs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (BUILDERS, os.environ.get("PYTHONPATH")))))


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(sys.modules, cluster.__name__)
    with pytest.raises(MissingPackage, match=r"pip install 'anchorpose\[batch\]'"):
        importlib.import_module(cluster.__name__)


def lines(path: Path) -> list[str]:
    return path.read_text().split() if path.exists() else []


def wait_until(true, timeout_s: float = 30.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@contextmanager
def known_client(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Client]]:
    """The client that the engine uses, for the test to look at."""
    seen: list[Client] = []

    @contextmanager
    def noted(place: Place, jobs: int) -> Iterator[Client]:
        with connected(place, jobs) as client:
            seen.append(client)
            yield client

    monkeypatch.setattr(cluster, "connected", noted)
    yield seen


@pytest.mark.thorough
def test_what_fails_fails_alone_with_its_sentence(tmp_path: Path) -> None:
    jobs = [
        Job("good", partial(batch_stub.note, tmp_path, "good"), tmp_path / "logs" / "good.log"),
        Job("bad", partial(batch_stub.refuse, tmp_path, "bad"), tmp_path / "logs" / "bad.log"),
        Job("short", partial(batch_stub.be_killed, tmp_path, "short")),
        Job("alone", partial(batch_stub.threads, tmp_path / "threads")),
    ]
    outcomes = {outcome.name: outcome for outcome in run_jobs(jobs, Place(workers=2))}
    assert set(outcomes) == {"good", "bad", "short", "alone"}
    assert (outcomes["good"].why, len(lines(tmp_path / "good"))) == (None, 1)
    assert outcomes["bad"].why == f"{tmp_path / 'bad'}: is not a recording; give another."
    assert outcomes["bad"].why in (tmp_path / "logs" / "bad.log").read_text()
    assert "memory" in str(outcomes["short"].why)
    assert lines(tmp_path / "short")[1:] == []  # a killed child is no killed worker: not repeated
    assert lines(tmp_path / "threads") == ["1", "1"]


def kill_a_worker(client: Client, name: str) -> None:
    """The one that holds this job, before it is done."""
    for address, keys in client.processing().items():
        if any(key.startswith(f"{name}-") for key in keys):
            os.kill(client.run(os.getpid, workers=[address])[address], signal.SIGKILL)
            return
    raise AssertionError(f"no worker holds {name}")


@pytest.mark.thorough
def test_a_worker_killed_twice_repeats_its_own_session_only(tmp_path: Path, monkeypatch) -> None:
    go = tmp_path / "go"
    names = ["a", "b", "c", "d"]
    jobs = [Job(name, partial(batch_stub.wait_for, tmp_path, name, go)) for name in names]

    def disturb(clients: list[Client]) -> None:
        wait_until(lambda: clients and lines(tmp_path / "a") and lines(tmp_path / "b"))
        kill_a_worker(clients[0], "a")
        wait_until(lambda: len(lines(tmp_path / "a")) == 2)
        kill_a_worker(clients[0], "b")
        wait_until(lambda: len(lines(tmp_path / "b")) == 2)
        go.touch()

    with known_client(monkeypatch) as clients:
        thread = Thread(target=disturb, args=(clients,), daemon=True)
        thread.start()
        outcomes = []
        for outcome in run_jobs(jobs, Place(workers=2)):
            outcomes.append(outcome)
        thread.join()
    assert sorted(outcome.name for outcome in outcomes if outcome.why is None) == names
    assert {name: len(lines(tmp_path / name)) for name in names} == {"a": 2, "b": 2, "c": 1, "d": 1}
    assert (tmp_path / "a.stopped").exists()  # the child of a killed worker ends, as by a signal


@pytest.mark.slow
def test_four_real_sessions_on_two_workers_are_all_done_though_a_worker_is_killed_twice(
    tmp_path: Path, monkeypatch
) -> None:
    simulate_recording(tmp_path / "made", single(5, 2.0, 8.0), lambda done, total: None)
    names = ["a", "b", "c", "d"]
    for name in names:
        shutil.copytree(tmp_path / "made" / "recording", tmp_path / "in" / name)
    out, patience_s = tmp_path / "out", 600.0

    def learnt(name: str) -> bool:
        """Whether the session is half-way: the body is learnt, no frame is tracked."""
        return (out / "sessions" / f".{name}.unfinished" / "journal" / "learnt").exists()

    def disturb(clients: list[Client]) -> None:
        for name in ("a", "b"):
            wait_until(lambda name=name: clients and learnt(name), patience_s)
            kill_a_worker(clients[0], name)
            wait_until(lambda name=name: len(lines(tmp_path / name)) == 2, patience_s)

    monkeypatch.setattr(tracking, "track_session", partial(batch_stub.track_counted, tmp_path))
    with known_client(monkeypatch) as clients:
        thread = Thread(target=disturb, args=(clients,), daemon=True)
        thread.start()
        sessions = find_sessions([str(tmp_path / "in" / name) for name in names], TrackOptions())
        rows = tracking.run_batch(sessions, out, Place(workers=2), lambda done, total: None)
        thread.join()
    assert [(row.session, row.state) for row in rows] == [(name, "done") for name in names]
    assert [len(lines(tmp_path / name)) for name in names] == [2, 2, 1, 1]
    for table in ("joints.parquet", "angles.parquet", "people.parquet"):  # the same recording, disturbed and not
        assert len({(out / "sessions" / name / table).read_bytes() for name in names}) == 1


@pytest.mark.thorough
def test_workers_hold_no_results(tmp_path: Path, monkeypatch) -> None:
    jobs = [Job(str(number), partial(batch_stub.note, tmp_path, "done")) for number in range(3)]
    with known_client(monkeypatch) as clients:
        for number, _ in enumerate(run_jobs(jobs, Place(workers=1)), 1):
            ended = len(lines(tmp_path / "done"))
            wait_until(lambda most=ended - number: sum(map(len, clients[0].has_what().values())) <= most, 5.0)


@pytest.mark.thorough
def test_what_stops_the_caller_stops_the_children_first(tmp_path: Path) -> None:
    never = tmp_path / "never"
    jobs = [
        Job("quick", partial(batch_stub.note, tmp_path, "quick")),
        Job("long", partial(batch_stub.wait_for, tmp_path, "long", never)),
        Job("later", partial(batch_stub.wait_for, tmp_path, "later", never)),
    ]

    def stopped_after_one() -> None:
        for _ in run_jobs(jobs, Place(workers=2)):
            wait_until(lambda: lines(tmp_path / "long"))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped_after_one()
    assert (tmp_path / "long.stopped").exists()
    assert not (tmp_path / "later").exists()


def test_a_scheduler_that_runs_is_used_and_left_running(tmp_path: Path) -> None:
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0", processes=True) as cluster:
        place = Place(scheduler=cluster.scheduler_address)
        for _ in range(2):
            assert [outcome.why for outcome in run_jobs([Job("a", print)], place)] == [None]


def test_a_scheduler_that_does_not_answer_or_is_no_address_is_one_sentence(monkeypatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 1.0)
    with pytest.raises(AnchorposeError, match=r"No scheduler answers at tcp://127\.0\.0\.1:9"):
        list(run_jobs([Job("a", print)], Place(scheduler="tcp://127.0.0.1:9")))
    with pytest.raises(AnchorposeError, match="--scheduler"):
        Place(scheduler="fast")
