"""How much less accurate live tracking is: python benchmarks/live_accuracy.py --seeds 2 --first-seed 141 --seconds 20.

Each recording of ``accuracy.py`` is simulated, tracked by ``track``, and played at its own pace to live tracking, with
a look-ahead of 0 and of 1 frame (``--wait-frames``). Errors are those after the first seconds, from which live tracking
learns the body; frames that it drops are not counted, their number is told. Needs a machine that does nothing else.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event
from typing import Final

from accuracy import SCENES, TITLES, TRUTH_FILE

from anchorpose.live.first_seconds import LiveOptions, User
from anchorpose.live.latency import LatencySummary
from anchorpose.live.playback import Playback
from anchorpose.live.session import track_live
from anchorpose.pipeline import TrackConfig, track_recording
from anchorpose.recording.reader import open_recording
from anchorpose.results.evaluate import evaluate
from anchorpose.simulate.write import simulate_recording

SCENES_LIVE: Final = ("single", "clinic", "clinic-front")
LEARNT_S: Final = 6.0


def offline_mm(recording: Path, truth: Path, results: Path) -> float:
    """Mean error of ``track`` after the first seconds, millimetres."""
    results.mkdir()
    track_recording(recording, results, TrackConfig(), lambda done, total: None)
    return evaluate(results, truth, LEARNT_S).overall.mean_mm or float("nan")


def live_mm(recording: Path, truth: Path, results: Path, wait_frames: int) -> tuple[float, LatencySummary]:
    """The same of live tracking, and its latency."""
    results.mkdir()
    options = LiveOptions(config=TrackConfig(), wait_frames=wait_frames, start_s=LEARNT_S)
    source = Playback(open_recording(recording))
    user = User(lambda sentence: print(sentence, file=sys.stderr), Event())
    latency = track_live([source], results, options, [], user)
    return evaluate(results, truth, LEARNT_S).overall.mean_mm or float("nan"), latency


def main() -> None:
    """Prints a row for each recording."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=SCENES_LIVE)
    options = parser.parse_args()
    print("| recording | seed | track mm | live mm | one frame later mm | dropped | median ms | 99 % ms |")
    print("|---|--:|--:|--:|--:|--:|--:|--:|", flush=True)
    for scene in options.scenes:
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            with TemporaryDirectory() as work:
                folder = Path(work)
                simulate_recording(folder / "simulated", SCENES[scene](seed, options.seconds))
                recording, truth = folder / "simulated/recording", folder / "simulated" / TRUTH_FILE
                still = offline_mm(recording, truth, folder / "offline")
                at_once, latency = live_mm(recording, truth, folder / "live", 0)
                later, _ = live_mm(recording, truth, folder / "later", 1)
            print(
                f"| {TITLES[scene]} | {seed} | {still:.1f} | {at_once:.1f} | {later:.1f} | {latency.dropped} of "
                f"{latency.count + latency.dropped} | {1e3 * latency.median_s:.0f} | {1e3 * latency.p99_s:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
