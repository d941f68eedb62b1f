"""Measure which things the learnt descriptor takes for people, and whether a body explains these things.

Each thing stands alone in an empty room, turned at random, and is seen by one camera from three distances. An image of
the empty room is given, so that the whole thing is foreground. A mannequin has the shape of a person: one image cannot
distinguish it from a person who stands still, so it shows what a person would score.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

import numpy as np
from probe import Row, Scene, answer

from anchorpose.camera import Camera
from anchorpose.descriptor.learnt import described
from anchorpose.descriptor.people import LEAST_CERTAINTY, find_people
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.scene import set_scene
from anchorpose.recording.recording import FrameSet
from anchorpose.rotations import UP, turns_about
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.render import render_still
from anchorpose.simulate.rooms.free_meshes import grid_triangles, hanging_coat
from anchorpose.simulate.rooms.people import draw_mannequin
from anchorpose.simulate.rooms.pieces import box, chair, coat_rack, pole, triangles_of, wheelchair
from anchorpose.simulate.sensor import SENSORS, intrinsics_of, sense
from anchorpose.tracker.patient_choice import HUMAN, MOST_PAST
from anchorpose.tracker.sighting import sight_people

DISTANCES_M: Final = (1.5, 2.5, 3.5)
CAMERA_M, TILT_RAD = 1.3, 0.17  # above the floor, and downwards
BEHIND_M: Final = 1.0  # from a thing to the wall behind it
THERE_M: Final = 0.6  # maximum horizontal distance from a thing to the pelvis of a person that is found in it
FLAT_M: Final = 0.005  # from a poster to the wall

Draw = Callable[[np.random.Generator, SimulationConfig], np.ndarray]


class Taken(NamedTuple):
    """How the program takes a thing. certainty: of the person found at its place, 0 without a person; explained, past:
    of that person's rough body (``RoughBody``), NaN without a rough body."""

    certainty: float
    explained: float
    past: float

    @property
    def found(self) -> bool:
        """Whether a person is found with enough certainty."""
        return self.certainty >= LEAST_CERTAINTY

    @property
    def human(self) -> bool:
        """Whether a person is found whom a rough body explains."""
        return self.found and self.explained >= HUMAN and self.past <= MOST_PAST


def cut_out(rng: np.random.Generator, config: SimulationConfig) -> np.ndarray:
    """Return the triangles (n, 3, 3) of a person of cardboard."""
    return draw_mannequin(rng, config) * [0.01, 1.0, 1.0]


def poster(rng: np.random.Generator, config: SimulationConfig) -> np.ndarray:
    """Return the triangles of a poster on the wall; depth does not show the print."""
    return triangles_of([box((BEHIND_M - FLAT_M, 1.1, 0.0), (FLAT_M, rng.uniform(1.4, 1.9), rng.uniform(0.6, 0.9)))])


def dog(rng: np.random.Generator, config: SimulationConfig) -> np.ndarray:
    """Return the triangles of a large standing dog: a trunk, a neck, a head and four legs."""
    size, legs = rng.uniform(0.8, 1.1), [pole((x, 0.22, z), 0.03, 0.44) for x in (-0.3, 0.3) for z in (-0.08, 0.08)]
    trunk, neck = box((0.0, 0.52, 0.0), (0.75, 0.24, 0.24)), box((0.38, 0.66, 0.0), (0.14, 0.24, 0.14))
    return size * triangles_of([trunk, neck, box((0.5, 0.8, 0.0), (0.28, 0.15, 0.15)), *legs])


def ball(rng: np.random.Generator, config: SimulationConfig) -> np.ndarray:
    """Return the triangles of an exercise ball of 55 to 75 cm."""
    u, v = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 33), np.linspace(0.0, np.pi, 17))
    sphere = np.stack([np.cos(u) * np.sin(v), np.cos(v) + 1.0, np.sin(u) * np.sin(v)], axis=2)
    return grid_triangles(rng.uniform(0.275, 0.375) * sphere)


def wheelchair_with_coat(rng: np.random.Generator, config: SimulationConfig) -> np.ndarray:
    """Return the triangles of a wheelchair with a coat over its back and seat."""
    coat = hanging_coat(rng, 1.0, 0.0) - [0.3, 0.0, 0.0]
    return np.concatenate([wheelchair(rng).triangles, np.maximum(coat, [-np.inf, 0.02, -np.inf])])


THINGS: Final[dict[str, Draw]] = {
    "mannequin": draw_mannequin,
    "person of cardboard": cut_out,
    "poster on the wall": poster,
    "coats on a stand": lambda rng, config: coat_rack(rng).triangles,
    "wheelchair with a coat": wheelchair_with_coat,
    "empty wheelchair": lambda rng, config: wheelchair(rng).triangles,
    "empty chair": lambda rng, config: chair(rng).triangles,
    "dog": dog,
    "exercise ball": ball,
}
FRONT: Final = ("person of cardboard", "poster on the wall")  # turned to the camera, not at random


def take(name: str, config: SimulationConfig, distance_m: float) -> Taken:
    """Render a thing, drawn from the settings' seed, from a distance; return how the program takes it."""
    rng = np.random.default_rng([config.seed, list(THINGS).index(name)])
    yaw = 0.0 if name in FRONT else rng.uniform(-np.pi, np.pi)
    thing = THINGS[name](rng, config) @ turns_about(UP, np.array([yaw]))[0].T
    camera, room = _camera(config, distance_m), _room(distance_m)
    empty_m, depth_m = (_seen(rng, config, camera, room, things) for things in (thing[:0], thing))
    pose = camera.require_pose()
    found = find_people([described(depth_m, camera)], [depth_m], [pose])
    certainty = max((one.certainty for one in found if _there(one.pelvis_m[[0, 2]])), default=0.0)
    scene = set_scene(camera, learn_background(empty_m, [depth_m], camera, 0.0), None)
    people = sight_people(FrameSet(frame=0, time_s=0.0, depths_m=(depth_m,)), [scene]).people
    bodies = [one.body for one in people if one.body is not None and _there(one.person.ground_xz_m)]
    best = max(((body.explained, body.past) for body in bodies), default=(np.nan, np.nan))
    return Taken(certainty, *best)


def _there(place_xz_m: np.ndarray) -> bool:
    return bool(np.linalg.norm(place_xz_m) < THERE_M)


def _camera(config: SimulationConfig, distance_m: float) -> Camera:
    """Return a camera that looks along X at the origin."""
    spec, pose = SENSORS[config.sensor], np.eye(4)
    away = np.array([np.cos(TILT_RAD), -np.sin(TILT_RAD), 0.0])
    right = np.array([0.0, 0.0, 1.0])
    pose[:3, :3] = np.stack([right, np.cross(away, right), away], axis=1)
    pose[:3, 3] = [-distance_m, CAMERA_M, 0.0]
    size, lens = {"width": spec.width, "height": spec.height}, intrinsics_of(spec, None)
    return Camera(name="front", depth_scale=0.001, intrinsics=lens, T_world_camera=pose, **size)


def _room(distance_m: float) -> np.ndarray:
    floor = box((0.0, -0.05, 0.0), (2.0 * distance_m + 4.0, 0.1, 8.0))
    return triangles_of([floor, box((BEHIND_M + 0.05, 1.5, 0.0), (0.1, 3.0, 8.0))])


def _seen(
    rng: np.random.Generator, config: SimulationConfig, camera: Camera, room: np.ndarray, thing: np.ndarray
) -> np.ndarray:
    """Return the depth image in metres, as the sensor reads it."""
    true, spec = render_still(camera, room, thing), SENSORS[config.sensor]
    steady = np.zeros_like(true.depth_m)
    return np.asarray(sense(rng, spec, true.depth_m, true.cosine, steady) * np.float32(0.001))


def measure(scene: Scene) -> Iterator[Row]:
    """Yield a row for each thing and distance."""
    for name in THINGS:
        for distance_m in DISTANCES_M:
            taken = take(name, scene.simulated, distance_m)
            yield (
                f"{name} at {distance_m:g} m",
                {
                    "found_percent": 100.0 * taken.found,
                    "body_explains_percent": 100.0 * taken.human,
                    "no_body_percent": 100.0 * (taken.found and np.isnan(taken.explained)),
                    "certainty": taken.certainty,
                    "explained": taken.explained,
                    "past": taken.past,
                },
            )


if __name__ == "__main__":
    answer(measure)
