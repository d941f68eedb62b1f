"""Which parts of a recording the body is learnt from."""

from types import SimpleNamespace

import numpy as np
import pytest

from anchorpose.tracker import passes
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.passes import plan_route


def begins(
    monkeypatch: pytest.MonkeyPatch, seen: list[int], config: TrackConfig | None = None
) -> list[tuple[int, int]]:
    """Position of the first and the second frame of each stretch, where the patient is seen in some frames, best first;
    one frame per second for ten minutes."""
    recording = SimpleNamespace(streams=[SimpleNamespace(files=range(600), time_s=np.arange(600.0))])
    initial = tuple(SimpleNamespace(frame=frame, choice=frame, start=None) for frame in seen)
    room = SimpleNamespace(recording=recording, initial_frames=initial, initial_frame=initial[0] if seen else None)
    monkeypatch.setattr(passes.Route, "frame", lambda _, position: position)
    route = plan_route(room, config or TrackConfig(), lambda: None)
    found = []
    for stretch in route.stretches():
        frames = iter(stretch.frames())
        found.append((next(frames), next(frames)))
        assert stretch.choice == (found[-1][0] if seen else None)
    return found


def test_a_long_recording_is_learnt_from_in_three_parts_a_minute_apart(monkeypatch):
    assert begins(monkeypatch, [300, 310, 361, 380, 20, 599]) == [(300, 299), (361, 360), (20, 21)]


def test_a_short_recording_is_learnt_from_in_one_part(monkeypatch):
    assert begins(monkeypatch, [300, 310, 250]) == [(300, 299)]


def test_only_what_is_tracked_is_learnt_from(monkeypatch):
    assert begins(monkeypatch, [300, 20, 599], TrackConfig(start=200, stop=500)) == [(300, 301)]


def test_where_nobody_was_seen_the_whole_recording_is_looked_through(monkeypatch):
    assert begins(monkeypatch, []) == [(0, 1)]
