"""Measure how often the learnt descriptor names skin otherwise than the tracked body, on recordings tracked rightly.

    python tools/measure_named_places.py RECORDING...

Prints, for each recording, the share of places over three deviations off, and for its frames the nats of the body as it
is tracked, turned round, and of its least probable limb: constants of ``body/pose_probability.py`` and ``limb_watch``.
"""

from __future__ import annotations

import argparse
import tempfile
from itertools import count
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anchorpose.body.likelihood import SKIN_SIGMA_M, render_skin
from anchorpose.body.limb_proposals import exchanged
from anchorpose.body.pose_probability import NAMED_FOOTPRINT_M, named_nats, places
from anchorpose.body.registration import Registration
from anchorpose.body.skin_points import pose_points
from anchorpose.descriptor.learnt import described, nearest_rays
from anchorpose.pipeline import TrackConfig, track_recording
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.patient import PatientTracker

EVERY = 10  # frames


class Frame(NamedTuple):
    """Nats of the tracked body, turned round, and of the least probable limb; far (n,) bool: places far off."""

    right: float
    turned: float
    limb: float
    far: np.ndarray


def measured(tracker: PatientTracker, found: Registration, seen: Observation) -> Frame:
    """What the descriptor says of a frame."""
    pose, evidence = found.belief.pose, seen.evidence
    right, *_, turned = (named_nats(tracker.body, one, evidence) for one in (pose, *exchanged(tracker.body, pose)))
    return Frame(right.sum(), turned.sum(), right.sum(axis=1).min(), far_off(tracker, found, seen))


def far_off(tracker: PatientTracker, found: Registration, seen: Observation) -> np.ndarray:
    """(n,) bool: places over three deviations from those of the skin."""
    points, far = tracker.body.points, [np.zeros(0, bool)]
    skin_m = pose_points(tracker.body, found.belief.pose).points_m
    for view, camera in zip(seen.evidence.views, seen.evidence.cameras, strict=True):
        skin = None if view is None else render_skin(points, skin_m, camera, NAMED_FOOTPRINT_M)
        if view is None or skin is None:
            continue
        every = (slice(None, None, skin.step), slice(None, None, skin.step))
        row, column, inside = (values[every] for values in nearest_rays(camera))
        shown = inside & (skin.point >= 0) & view.patient[every]
        shown &= np.abs(view.depth_m[every] - skin.depth_m) < 3.0 * SKIN_SIGMA_M
        said = described(view.depth_m, camera)
        place, error = said.place[row[shown], column[shown]], said.error[row[shown], column[shown]]
        away = np.linalg.norm(place - places(points)[skin.point[shown]], axis=1)
        far.append((away > 3.0 * np.sqrt(2.0 / np.pi) * error)[np.isfinite(error)])
    return np.concatenate(far)


def main() -> None:
    """Track and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", nargs="+", type=Path)
    frames, numbers, unseen = list[Frame](), count(1), PatientTracker._unseen

    def noted(tracker: PatientTracker, found: Registration, seen: Observation) -> np.ndarray:
        if next(numbers) % EVERY == 0 and found.found:
            frames.append(measured(tracker, found, seen))
        return unseen(tracker, found, seen)

    PatientTracker._unseen = noted  # called once for every frame that is estimated
    for recording in parser.parse_args().recording:
        frames.clear()
        with tempfile.TemporaryDirectory() as out:
            track_recording(recording, Path(out), TrackConfig(), lambda *_: None)
        right, turned, limb = (np.array([frame[k] for frame in frames]) for k in range(3))
        far = 100.0 * np.concatenate([frame.far for frame in frames]).mean()
        print(
            f"{recording.name}: {len(frames)} frames, {far:.1f} % far off; right {right.min():.0f} to {right.max():.0f}"
        )
        print(
            f"  turned round {turned.min():.0f} to {turned.max():.0f} nats; least of a limb {limb.min():.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
