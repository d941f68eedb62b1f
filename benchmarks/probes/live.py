"""Measure how much less accurate live tracking is than ``track``.

The recording is tracked by ``track``, and played at its own pace to live tracking with a look-ahead of 0 and of 1
frame. Errors are those after the first seconds, from which live tracking learns the body; frames that live tracking
drops are not counted.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event

from probe import Row, Scene, answer

from anchorpose.live.cameras import Playback
from anchorpose.live.first_seconds import LiveOptions, User
from anchorpose.live.session import track_live
from anchorpose.pipeline import track_recording
from anchorpose.recording.reader import open_recording
from anchorpose.results.evaluate import evaluate
from anchorpose.tracker.config import TrackConfig

LEARNT_S = 6.0


def measure(scene: Scene) -> Iterator[Row]:
    """Track with ``track`` and twice live; yield a row for each."""
    with TemporaryDirectory() as work:
        for part, wait_frames in (("track", None), ("live", 0), ("live, one frame later", 1)):
            results, scores = Path(work) / part, dict[str, float]()
            results.mkdir()
            if wait_frames is None:
                track_recording(scene.recording, results, TrackConfig(), lambda done, total: None)
            else:
                options = LiveOptions(config=TrackConfig(), wait_frames=wait_frames, start_s=LEARNT_S)
                user = User(lambda sentence: print(sentence, file=sys.stderr), Event())
                latency = track_live([Playback(open_recording(scene.recording))], results, options, [], user)
                scores["dropped"] = latency.dropped / max(1, latency.count + latency.dropped)
                scores |= {"delay_ms": 1e3 * latency.quantile_s(0.5), "delay_p99_ms": 1e3 * latency.quantile_s(0.99)}
            mean_mm = evaluate(results, scene.truth, LEARNT_S).overall.mean_mm
            yield part, scores | {"error_mm": float("nan") if mean_mm is None else mean_mm}


if __name__ == "__main__":
    answer(measure)
