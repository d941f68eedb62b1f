"""Stands in for the tracker in tests of the command line: reads every frame as the tracker does, answers "lost"."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from anchorpose.joints import JOINT_COUNT, JointState
from anchorpose.recording.events import events_files, read_trials, recorded_span
from anchorpose.recording.reader import input_files, open_recording, read_frames
from anchorpose.report.page import write_report
from anchorpose.results.measuring import MeasureConfig, write_measured
from anchorpose.results.processing import ProcessingConfig
from anchorpose.results.records import write_contacts
from anchorpose.results.run_record import DroppedFrame, RunRecord, hash_files, write_run_record
from anchorpose.results.tables import JointFrame, write_joints
from anchorpose.tracker.config import TrackConfig


def track_recording(
    recording: Path,
    results: Path,
    config: TrackConfig,
    progress: Callable[[int, int], None],
    calibration: Path | None = None,
    corrections: Path | None = None,
    threads: int = 1,
    events: Path | None = None,
) -> None:
    opened = open_recording(recording)
    own = events_files(opened.folder)
    path, span = events or (own[0] if own else None), recorded_span(opened.streams[0].time_s)
    trials = None if path is None else read_trials(path, span)
    blank, state = np.full((JOINT_COUNT, 3), np.nan), (JointState.LOST,) * JOINT_COUNT
    dropped, count = [], 0
    with write_joints(results / "joints.parquet") as joints:
        for frame in read_frames(opened, config.start or 0, config.stop):
            lost = {"position_m": blank, "state": state, "sigma_m": blank[:, 0].copy()}
            joints.append(JointFrame(frame=frame.frame, time_s=frame.time_s, **lost))
            dropped += [DroppedFrame(frame.frame, frame.time_s, problem) for problem in frame.problems]
            count += 1
            progress(count, len(opened.streams[0].files))
    record = RunRecord(
        recording=recording.name,
        config=config,
        inputs_sha256=dict(hash_files(input_files(opened), opened.folder)),
        cameras=(),
        frame_count=count,
        dropped=tuple(dropped),
    )
    write_run_record(results / "run.json", record)
    with write_contacts(results / "contacts.parquet"):
        pass  # nobody touches a patient who is nowhere
    write_measured(results, ProcessingConfig(), MeasureConfig(), trials)
    write_report(results)
