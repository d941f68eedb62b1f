"""How good the proposed equipment is on simulated clinics: python benchmarks/equipment_fit.py --seeds 6.

Each seed is another standing frame and other camera places. The proposal is made from the empty rooms' depth images and
compared with the frame that was simulated, in every camera's image: which share of the frame's pixels lies within
15 mm of the proposal, which share of the proposal's pixels is farther than that from the frame, and how far centres
and sizes of the parts are off.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from anchorpose.calibration.proposal import NoEquipment, propose_equipment
from anchorpose.calibration.proposal_readings import Region
from anchorpose.camera import Camera
from anchorpose.isolation.background import equipment_depth
from anchorpose.recording.equipment import Box, Cylinder, EquipmentModel
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import Recording
from anchorpose.simulate import config as presets
from anchorpose.simulate.write import simulate_recording

NEAR_M = 0.015


@dataclass(frozen=True, slots=True)
class Score:
    """One clinic: shares of pixels, and per true part the errors in mm of cross-section, length and middle line."""

    explained: float
    wrong: float
    parts: int
    true_parts: int
    section_mm: tuple[float, ...]
    length_mm: tuple[float, ...]
    off_line_mm: tuple[float, ...]


def score_recording(recording: Recording, cameras: Sequence[int]) -> Score | NoEquipment:
    """Propose from the chosen cameras, judge in all of them."""
    truth = recording.equipment
    rooms = [recording.backgrounds_m[index] for index in cameras]
    proposal = propose_equipment(
        [recording.cameras[index] for index in cameras], [room for room in rooms if room is not None], 0.0,
        Region(),
    )  # fmt: skip
    if isinstance(proposal, NoEquipment) or truth is None:
        return NoEquipment.NOTHING_STANDS
    judged = [recording.cameras[index] for index in cameras]
    explained = np.concatenate([_surface(camera, truth) for camera in judged])
    proposed = np.concatenate([_surface(camera, proposal.model) for camera in judged])
    errors = [_errors(part, proposal.model) for part in truth.parts if isinstance(part, Box | Cylinder)]
    found = np.array([error for error in errors if error is not None])
    return Score(
        explained=float((np.abs(proposal.model.distance_m(explained)) < NEAR_M).mean()),
        wrong=float((np.abs(truth.distance_m(proposed)) >= NEAR_M).mean()),
        parts=len(proposal.parts),
        true_parts=len(truth.parts),
        section_mm=tuple(found[:, 0]),
        length_mm=tuple(found[:, 1]),
        off_line_mm=tuple(found[:, 2]),
    )


def _surface(camera: Camera, model: EquipmentModel) -> np.ndarray:
    """(n, 3) world: where the camera's rays meet the model first."""
    rays = camera.pixel_rays()
    depth = equipment_depth(camera, model)
    T = camera.require_pose()
    points = np.concatenate([rays * depth[..., None], depth[..., None]], axis=2)[depth > 0]
    return np.asarray(points @ T[:3, :3].T + T[:3, 3], dtype=np.float64)


def _errors(true: Box | Cylinder, model: EquipmentModel) -> tuple[float, float, float] | None:
    """(cross-section, length, distance of the middle lines) in mm of the proposed part nearest to a true one."""
    middle, axis, section, length = _as_bar(true)
    best = None
    for part in model.parts:
        if not isinstance(part, Box | Cylinder):
            continue
        center, along, breadth, extent = _as_bar(part)
        if abs(along @ axis) < 0.95:
            continue
        offset = center - middle
        off = float(np.linalg.norm(offset - (offset @ axis) * axis))
        if off < 0.08 and (best is None or off < best[2]):
            best = float(np.abs(breadth - section).max()), abs(extent - length), off
    return None if best is None else (1000 * best[0], 1000 * best[1], 1000 * best[2])


def _as_bar(part: Box | Cylinder) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    if isinstance(part, Cylinder):
        return part.center_m, part.axis, np.full(2, 2.0 * part.radius_m), part.length_m
    long = int(np.argmax(part.size_m))
    return part.center_m, part.rotation[:, long], np.sort(np.delete(part.size_m, long)), float(part.size_m[long])


def row(title: str, scores: Sequence[Score]) -> str:
    """A row of the table: mean over the clinics, the worst in brackets; medians and 90 per cent of the parts."""
    spread = [np.concatenate([getattr(s, name) for s in scores]) for name in ("section_mm", "length_mm", "off_line_mm")]
    cells = [
        f"{100 * np.mean([s.explained for s in scores]):.1f} ({100 * min(s.explained for s in scores):.1f})",
        f"{100 * np.mean([s.wrong for s in scores]):.1f} ({100 * max(s.wrong for s in scores):.1f})",
        f"{sum(len(s.section_mm) for s in scores)} of {sum(s.true_parts for s in scores)}",
        *(f"{np.median(values):.1f} / {np.percentile(values, 90):.1f}" for values in spread),
    ]
    return f"| {title} | {len(scores)} | {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--sensor", choices=("kinect-v2", "azure-kinect", "realsense"), default="kinect-v2")
    parser.add_argument("--recordings", type=Path, nargs="*", default=(), help="score these folders instead")
    arguments = parser.parse_args()
    recordings = [open_recording(folder) for folder in arguments.recordings]
    with TemporaryDirectory() as folder:
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds) if not recordings else ():
            settings = replace(presets.clinic(seed, 0.1), sensor=arguments.sensor)
            simulate_recording(Path(folder) / str(seed), settings)
            recordings.append(open_recording(Path(folder) / str(seed) / "recording"))
        print(
            "| cameras | clinics | explained % | wrong % | parts found | cross-section mm | length mm | off line mm |"
        )
        print("|---|--:|--:|--:|--:|--:|--:|--:|")
        for title, cameras in (("three", (0, 1, 2)), ("front only", (0,))):
            scores = [score_recording(recording, cameras) for recording in recordings]
            known = [score for score in scores if isinstance(score, Score)]
            print(row(title, known) if known else f"| {title} | 0 of {len(scores)} |", flush=True)


if __name__ == "__main__":
    main()
