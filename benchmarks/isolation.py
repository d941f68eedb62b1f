"""How many person labels are right, on simulated clinics: python benchmarks/isolation.py --seeds 4 --seconds 6.

Only readings that lie on a surface are counted: within 3 cm of the true depth at their pixel, which leaves out flying
pixels and pixels that look one aside; and, except with --with-outline, not on the outermost pixels of anything, which
the sensor mixes with what is beside them. --no-background removes the frames of the empty room, --no-tracker separates
people without the predicted patient. Time is processor time of isolation alone, all cameras together, without the
prediction.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import cv2
import numpy as np

from anchorpose.isolation.bystander_memory import empty_memory, update_memory
from anchorpose.isolation.people import find_people
from anchorpose.isolation.scene import find_all_pieces
from anchorpose.isolation.separation import separate, separate_initial
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.motion.database_file import load_motions
from anchorpose.pipeline import TrackConfig
from anchorpose.recording.reader import open_recording, read_frame, read_frames
from anchorpose.recording.recording import Recording
from anchorpose.simulate import config as presets
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.render import EQUIPMENT, PATIENT
from anchorpose.simulate.shoot import Shot, Studio, set_up
from anchorpose.simulate.write import simulate_recording
from anchorpose.threads import one_thread
from anchorpose.tracker.following import follow_patient
from anchorpose.tracker.passes import learn_on, plan_route
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Room, Run

ON_IT_M: Final = 0.03
COLUMNS: Final = ("equipment removed %", "patient lost to it %", "kept %", "others taken %", "kept, held %",
                  "others taken, held %", "swapped", "ms per frame")  # fmt: skip


@dataclass(slots=True)
class Count:
    """Readings of one frame."""

    equipment: int = 0
    equipment_left: int = 0
    patient: int = 0
    lost_to_equipment: int = 0
    kept: int = 0
    called_patient: int = 0
    taken: int = 0


def count(views: Sequence[View | None], shot: Shot, outline: bool) -> Count:
    """Labels against the truth, all cameras together; outline: also the outermost pixels."""
    total = Count()
    for view, image in zip(views, shot.images, strict=True):
        if view is None:
            continue
        on_it = (view.depth_m > 0) & (np.abs(view.depth_m - image.depth_m) < ON_IT_M)
        if not outline:
            on_it &= cv2.dilate(image.label, np.ones((3, 3))) == cv2.erode(image.label, np.ones((3, 3)))
        equipment, patient = (on_it & (image.label == label) for label in (EQUIPMENT, PATIENT))
        others = on_it & (image.label > PATIENT)
        total.equipment += int(equipment.sum())
        total.equipment_left += int((equipment & (view.labels >= PixelLabel.PATIENT)).sum())
        total.patient += int(patient.sum())
        total.lost_to_equipment += int((patient & (view.labels == PixelLabel.EQUIPMENT)).sum())
        total.kept += int((patient & view.patient).sum())
        total.called_patient += int((on_it & view.patient).sum())
        total.taken += int((others & view.patient).sum())
    return total


def tracked_views(recording: Recording, room: Room, config: TrackConfig) -> Iterator[tuple[int, Sequence[View | None]]]:
    """The labels that tracking used, frame by frame."""
    run = Run(room, config, load_motions(config.motion_file, 15.0, config.motion))
    route = plan_route(room, config, lambda: None)
    learnt = learn_on(route, run)
    shape = None if learnt is None else learnt.shape
    for positions in (route.backward[1:], route.forward):
        for estimate in follow_patient(run, route.frames(positions), shape):
            if estimate.observation is not None:
                yield estimate.frame_set.frame, estimate.observation.evidence.views


def untracked_views(
    recording: Recording, room: Room, config: TrackConfig
) -> Iterator[tuple[int, Sequence[View | None]]]:
    """The labels without any prediction, from the initial frame to both ends."""
    if room.initial_frame is None:
        return
    count, first = len(recording.streams[0].files), room.initial_frame.frame
    for positions in (range(first, -1, -1), range(first, count)):
        memory, before_s = empty_memory(), None
        for position in positions:
            frame = read_frame(recording, position)
            pieces = find_all_pieces(frame, room.scenes)
            elapsed_s = 0.0 if before_s is None else abs(frame.time_s - before_s)
            if before_s is None:
                people = find_people(pieces, config.isolation)
                views = separate_initial(pieces, people, room.initial_frame.choice)
            else:
                views = separate(pieces, memory, None, elapsed_s, config.isolation)
            memory = update_memory(memory, pieces, views, room.cameras, elapsed_s)
            before_s = frame.time_s
            yield frame.frame, views


def milliseconds(recording: Recording, room: Room, config: TrackConfig) -> float:
    """Median processor time of isolation over ten frames that are in memory, all cameras."""
    if room.initial_frame is None:
        return float("nan")
    frames = list(read_frames(recording, 0, 11))
    memory, spent = empty_memory(), []
    for number, frame in enumerate(frames):
        start = time.process_time()
        pieces = find_all_pieces(frame, room.scenes)
        if number == 0:
            views = separate_initial(pieces, find_people(pieces, config.isolation), room.initial_frame.choice)
        else:
            views = separate(pieces, memory, None, 1.0 / 15.0, config.isolation)
        memory = update_memory(memory, pieces, views, room.cameras, 1.0 / 15.0)
        spent.append(time.process_time() - start)
    return 1000.0 * float(np.median(spent[1:]))


def score(
    seed: int, seconds: float, background: bool, tracker: bool, outline: bool
) -> tuple[list[Count], np.ndarray, float]:
    """Counts of every frame, in which frames the patient is touched, milliseconds per frame."""
    config, scene = TrackConfig(), presets.clinic(seed, seconds)
    with TemporaryDirectory() as folder:
        simulate_recording(Path(folder) / "s", scene)
        recording = open_recording(Path(folder) / "s" / "recording")
        if not background:
            recording = replace(recording, backgrounds_m=tuple(None for _ in recording.cameras))
        touched = np.load(Path(folder) / "s" / "truth" / "truth.npz")["touched"].any(axis=1)
        room = prepare_room(recording, config)
        studio: Studio = set_up(draw_clinic(scene))
        views = (tracked_views if tracker else untracked_views)(recording, room, config)
        counts = {frame: count(labels, studio.shoot(frame), outline) for frame, labels in views}
        spent = milliseconds(recording, room, config)
    frames = sorted(counts)
    return [counts[frame] for frame in frames], touched[frames], spent


def row(name: str, counts: Sequence[Count], touched: np.ndarray, spent: float) -> str:
    """One line of the table."""

    def share(part: str, whole: str, of: np.ndarray) -> float:
        chosen = [entry for entry, used in zip(counts, of, strict=True) if used]
        total = sum(getattr(c, whole) for c in chosen)
        return 100.0 * sum(getattr(c, part) for c in chosen) / total if total else float("nan")

    every = np.ones(len(touched), dtype=bool)
    swapped = sum(c.taken > c.called_patient / 2 for c in counts)
    figures = [
        f"{100.0 - share('equipment_left', 'equipment', every):.2f}",
        f"{share('lost_to_equipment', 'patient', every):.2f}",
        *(f"{share(*pair, of):.2f}" for of in (~touched, touched)
          for pair in (("kept", "patient"), ("taken", "called_patient"))),
        str(swapped), f"{spent:.1f}",
    ]  # fmt: skip
    return f"| {name} | " + " | ".join(figures).replace("nan", "–") + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first-seed", type=int, default=501)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--no-background", action="store_true")
    parser.add_argument("--no-tracker", action="store_true")
    parser.add_argument("--with-outline", action="store_true")
    options = parser.parse_args()
    print("| seed | " + " | ".join(COLUMNS) + " |\n|---|" + "--:|" * len(COLUMNS))
    all_counts, all_touched, times = list[Count](), list[np.ndarray](), list[float]()
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        with one_thread():
            counts, touched, spent = score(
                seed, options.seconds, not options.no_background, not options.no_tracker, options.with_outline
            )
        print(row(str(seed), counts, touched, spent), flush=True)
        all_counts += counts
        all_touched.append(touched)
        times.append(spent)
    print(row("all", all_counts, np.concatenate(all_touched), float(np.median(times))))


if __name__ == "__main__":
    main()
