"""Error of the anchor descriptor on simulated recordings: python benchmarks/descriptor_error.py --seeds 4.

Two estimates of e_1, e_2 and e_max (``research.descriptor_errors``), beside the values that the gate assumes:
``still``: one moment read twice by the sensor, nodes matched by their pixels: noise alone.
``moving``: successive frames, nodes matched by the true skin: noise, clothes and movement.
The patient's pixels are the true ones: isolation is not measured here.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.geodesics.anchors import anchor_descriptor, find_anchors
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import ANCHOR_NAMES, JOINT_INDEX
from anchorpose.research.descriptor_errors import ErrorModel, NoErrorModel, estimate_errors
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.render import EQUIPMENT, NOTHING, PATIENT, Figure, TrueImage, draw_figures
from anchorpose.simulate.sensor import SENSORS, sense
from anchorpose.simulate.shoot import Studio, set_up
from anchorpose.surface.border import Border, border
from anchorpose.surface.mesh import build_surface
from anchorpose.surface.patient_surface import fuse
from anchorpose.surface.surface import Surface
from anchorpose.track_tree.hypotheses import GateConfig

UP, FACING = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
SAME_POINT_M = 0.010  # half a mesh cell and the noise that is left; a node farther from the skin point is another one


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """A surface with its descriptor (n, 5), and the true skin (v, 3) it shows."""

    surface: Surface
    descriptor: np.ndarray
    skin_m: np.ndarray


def observe(studio: Studio, frame: int, reading: int) -> Moment:
    """What the stages up to the descriptor make of one moment, as the sensor reads it the given time."""
    clinic = studio.clinic
    spec, cameras = SENSORS[clinic.config.sensor], clinic.cameras
    performance = studio.performances[0]
    figures = performance.figures(frame)
    views = []
    for index, camera in enumerate(cameras):
        picture = draw_figures(camera, studio.stills[index], figures)
        rng = np.random.default_rng([clinic.config.seed, index, frame, reading])
        depth = sense(rng, spec, picture.depth_m, picture.cosine, studio.readers[index].wiggle_m)
        views.append(labelled((depth * camera.depth_scale).astype(np.float32), picture))
    meshes = [
        build_surface(view.depth_m, view.patient, camera, bridge=view.hidden_by_equipment)
        for view, camera in zip(views, cameras, strict=True)
    ]
    surface = fuse(meshes, cameras)
    places = performance.joints_m()[frame][[JOINT_INDEX[name] for name in ANCHOR_NAMES]]
    cut = border(surface, views) == Border.CUT
    anchors = find_anchors(surface, UP, FACING, cut=cut, predicted_m=places)
    return Moment(surface, anchor_descriptor(surface, anchors), patient_of(figures).skin_m)


def labelled(depth_m: np.ndarray, picture: TrueImage) -> View:
    """The reading with the labels that perfect isolation would give."""
    names = {NOTHING: PixelLabel.BACKGROUND, EQUIPMENT: PixelLabel.EQUIPMENT, PATIENT: PixelLabel.PATIENT}
    labels = np.full(depth_m.shape, PixelLabel.OTHER_PERSON, np.uint8)
    for number, label in names.items():
        labels[picture.label == number] = label
    labels[depth_m == 0] = PixelLabel.NO_READING
    return View(depth_m, labels)


def patient_of(figures: tuple[Figure, ...]) -> Figure:
    return next(figure for figure in figures if figure.label == PATIENT)


def still_matches(studio: Studio, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Descriptors of the nodes that two readings of one moment have in common."""
    one, other = observe(studio, frame, 0), observe(studio, frame, 1)
    place = [np.column_stack([moment.surface.camera, moment.surface.pixel]).astype(np.int64) for moment in (one, other)]
    key = [rows @ [1 << 32, 1 << 16, 1] for rows in place]
    _, first, second = np.intersect1d(*key, assume_unique=True, return_indices=True)
    return one.descriptor[first], other.descriptor[second]


def moving_matches(studio: Studio, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Descriptors of nodes in two frames that are nearest to one vertex of the true skin."""
    moments = [observe(studio, number, 0) for number in (frame, frame + 1)]
    node = []
    for moment in moments:
        away, nearest = cKDTree(moment.surface.points_m).query(moment.skin_m, distance_upper_bound=SAME_POINT_M)
        node.append(np.where(np.isfinite(away), nearest, -1))
    both = (node[0] >= 0) & (node[1] >= 0)
    pairs = np.unique(np.stack([node[0][both], node[1][both]], axis=1), axis=0)
    return moments[0].descriptor[pairs[:, 0]], moments[1].descriptor[pairs[:, 1]]


def gather(seeds: int, moments: int, cameras: int, therapists: int, way: str) -> ErrorModel | NoErrorModel:
    """One error model of several clinics."""
    found = []
    for seed in range(1, seeds + 1):
        config = SimulationConfig(seed=seed, seconds=4.0, cameras=cameras, therapists=therapists)
        studio = set_up(draw_clinic(config))
        for frame in np.linspace(0, studio.clinic.config.frames - 2, moments).astype(int).tolist():
            found.append(still_matches(studio, frame) if way == "still" else moving_matches(studio, frame))
    before, after = (np.concatenate([pair[side] for pair in found]) for side in (0, 1))
    return estimate_errors(before, after, np.repeat(np.arange(len(found)), [len(pair[0]) for pair in found]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=4, help="clinics")
    parser.add_argument("--moments", type=int, default=10, help="pairs of frames a clinic")
    parser.add_argument("--cameras", type=int, default=1)
    parser.add_argument("--therapists", type=int, default=0, help="who hide anchors")
    asked = parser.parse_args()
    gate = GateConfig()
    print(f"| mm | {' | '.join(ANCHOR_NAMES)} | e_2 at 0 m | e_2 a metre | bound at 0 m | bound a metre |")
    print("|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|")
    for way in ("still", "moving"):
        model = gather(asked.seeds, asked.moments, asked.cameras, asked.therapists, way)
        if isinstance(model, NoErrorModel):
            print(f"| {way} | {model} |")
            continue
        values = [*model.anchor_m, model.surface_offset_m, model.surface_per_m]
        values += [model.anchor_bound_m, model.surface_bound_per_m]
        print(f"| {way}, {model.pairs} pairs | {' | '.join(f'{1000 * value:.1f}' for value in values)} |")
    unknown = " | ".join(["–"] * 7)
    print(f"| the gate | {unknown} | {1000 * gate.anchor_bound_m:.1f} | {1000 * gate.surface_bound_per_m:.1f} |")


if __name__ == "__main__":
    main()
