"""From a recording folder to calibration.json and pictures of what was found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from anchorpose.calibration.calibration import Calibration, PoseRecord
from anchorpose.calibration.first_frames import noise_per_m, what_stays
from anchorpose.calibration.marker_pose import place_by_markers
from anchorpose.calibration.markers import read_marker_layout
from anchorpose.pages.canvas import as_png
from anchorpose.pages.stage_drawing import draw_model
from anchorpose.recording.reader import open_recording
from anchorpose.results.calibration_file import write_calibration
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.preparation import settle


def calibrate_recording(
    recording: Path, folder: Path, config: TrackConfig, ignore_given: bool = False, markers: Path | None = None
) -> Calibration:
    """Find every camera's pose and write calibration.json and one picture per camera into an existing folder.

    ignore_given: find given poses as well. markers: a markers.json; cameras with an image of the markers are placed by
    them, the others in the same world. Raises InputError where the recording cannot be used or a pose is not accepted.
    """
    with one_thread():
        opened = open_recording(recording)
        if ignore_given:
            opened = replace(opened, cameras=tuple(replace(c, T_world_camera=None) for c in opened.cameras))
        by_marker: dict[str, PoseRecord] = {}
        if markers is not None:
            opened, by_marker = place_by_markers(opened, read_marker_layout(markers))
        settled = settle(opened, config)
        found, samples = settled.calibration, settled.samples
        records = tuple(by_marker.get(pose.camera, pose) for pose in found.poses)
        calibration = replace(found, poses=records, notes=(*opened.notes, *found.notes))
        write_calibration(folder, opened.folder.resolve().name, calibration)
        for index, camera in enumerate(calibration.cameras):
            seen = [depth for sample in samples if (depth := sample.depths_m[index]) is not None]
            background = opened.backgrounds_m[index]
            if background is not None or seen:
                still = background if background is not None else what_stays(np.stack(seen), noise_per_m(seen))
                (folder / f"{camera.name}.png").write_bytes(
                    as_png(draw_model(camera, still, opened.equipment, axes=True))
                )
    return calibration
