"""Draw the plan of a room: place of the camera, furniture, people, and disturbances of the depth images."""

from __future__ import annotations

from typing import Annotated, Final, Literal, get_args

import numpy as np
from pydantic import Field

from anchorpose.settings import settings
from anchorpose.simulate.sensor import SENSORS

Framing = Literal["whole", "feet-cut-off", "head-cut-off"]  # if the head is cut off, the feet may be cut off, too
Posture = Literal["stands", "sits", "stands-up"]
Seat = Literal["stool", "chair", "wheelchair"]
Other = Literal["sits", "stands", "passes-before", "passes-behind"]
Moved = Literal["none", "stool", "wheelchair", "door"]
Opening = Literal["none", "window", "doorway"]
Clutter = Literal[
    "table",
    "chair",
    "stool",
    "shelf",
    "cupboard",
    "monitor",
    "boxes",
    "plant",
    "coat-rack",
    "bed",
    "curtain",
    "wheelchair",
]

NEAREST_M, FARTHEST_M = 1.2, 4.5  # m, limits of the distance from camera to patient along the floor
# m, maximum distance from the camera to the place of a patient who comes in after the recording has begun; a walk to a
# place farther away would take the whole recording
FARTHEST_LATE_M: Final = 3.3
RANGE_MARGIN_M: Final = 0.5  # m, space for movements between the patient and the end of the sensor's range
LOWEST_M, HIGHEST_M = 0.5, 2.5  # m, limits of the camera's height
STEEPEST_RAD: Final = float(np.radians(35.0))  # rad, maximum downward tilt of the camera
UPWARD_RAD: Final = float(np.radians(8.0))  # rad, maximum upward tilt, as of a camera on a low shelf
LARGEST_ROLL_RAD: Final = float(np.radians(4.0))  # rad, maximum rotation about the optical axis
AIM_RAD: Final = float(np.radians(9.0))  # rad, maximum angle, up or down, from the optical axis to the patient's middle
CLEARLY_RAD: Final = float(np.radians(3.0))  # rad; a head or foot at least this far outside the image is cut off
INSIDE_RAD: Final = float(np.radians(1.5))  # rad; a head or foot at least this far inside the image is in view
SEATED_SHARE: Final = 0.76  # height of the top of a seated person's head, as a share of the stature
MIDDLE_SHARE: Final = 0.55  # height of the patient's middle, always in view, as a share of the head's height
ROOM_SENSORS: Final = ("kinect-v2", "azure-kinect", "realsense", "kinect-v1", "realsense-filtered")
SENSOR_CHANCES: Final = (0.2, 0.15, 0.15, 0.2, 0.3)  # probability of each sensor in ``ROOM_SENSORS``
FRAMINGS: Final = get_args(Framing)
POSTURES: Final = get_args(Posture)
LOW: Final[tuple[Clutter, ...]] = ("table", "chair", "stool", "boxes", "wheelchair")  # furniture in front of the legs
ROOM_FOR_PASSER_M: Final = 2.2  # m, minimum distance from camera to patient for a person to walk between them


@settings
class RoomConfig:
    """The plan of one room. In the world frame, the patient is at the origin and faces +X."""

    # m, distance from camera to patient along the floor
    distance_m: Annotated[float, Field(ge=NEAREST_M, le=FARTHEST_M)]
    camera_height_m: Annotated[float, Field(ge=LOWEST_M, le=HIGHEST_M)]
    # downward tilt of the camera; negative = upwards
    tilt_rad: Annotated[float, Field(ge=-UPWARD_RAD, le=STEEPEST_RAD)]
    roll_rad: Annotated[float, Field(ge=-LARGEST_ROLL_RAD, le=LARGEST_ROLL_RAD)] = 0.0
    azimuth_rad: float = 0.0  # direction from the patient to the camera: 0 = in front, positive = left
    framing: Framing = "whole"
    posture: Posture = "stands"
    seat: Seat = "stool"
    late: bool = False  # the patient walks in after the recording has begun
    clutter: tuple[Clutter, ...] = ()
    before: tuple[Clutter, ...] = ()  # furniture between the camera and the patient's legs
    others: tuple[Other, ...] = ()  # other people; people who walk through come last
    # furniture that moves: the last person who walks through pushes a stool or wheelchair, or a door opens
    moved: Moved = "none"
    opening: Opening = "none"
    mirror: bool = False
    mannequin: bool = False
    poster: bool = False
    dark_clothes: bool = False  # whether the patient wears black cloth, which returns little light
    shiny: bool = False  # whether bare metal often has no reading
    interference: bool = False  # whether another camera's light disturbs some frames

    @property
    def passers_by(self) -> int:
        """Return the number of people who walk through."""
        return sum(other.startswith("passes") for other in self.others)

    @property
    def pushed(self) -> bool:
        """Return whether a person pushes furniture through the room."""
        return self.moved in ("stool", "wheelchair")


def draw_sensor(rng: np.random.Generator) -> str:
    """Draw the name of the sensor of a room's camera."""
    return str(rng.choice(ROOM_SENSORS, p=SENSOR_CHANCES))


def draw_room_config(rng: np.random.Generator, sensor: str, stature_m: float) -> RoomConfig:
    """Draw the plan of a room for a patient of a given stature, seen by a given sensor."""
    late = bool(rng.random() < 0.2)
    posture: Posture = "stands" if late else rng.choice(POSTURES, p=(0.5, 0.3, 0.2))
    framing: Framing = rng.choice(FRAMINGS, p=(0.45, 0.35, 0.2))
    head_m = SEATED_SHARE * stature_m if posture == "sits" else stature_m
    farthest_m = FARTHEST_LATE_M if late else FARTHEST_M
    distance_m, height_m, tilt_rad = _draw_place(rng, sensor, framing, head_m, farthest_m)
    others, moved = _draw_others(rng, distance_m)
    low = tuple(rng.choice(LOW, int(rng.integers(1, 3)), replace=False)) if distance_m > 1.6 else ()
    return RoomConfig(
        distance_m=distance_m,
        camera_height_m=height_m,
        tilt_rad=tilt_rad,
        roll_rad=rng.uniform(-LARGEST_ROLL_RAD, LARGEST_ROLL_RAD),
        azimuth_rad=rng.uniform(-np.pi, np.pi),
        framing=framing,
        posture=posture,
        seat=rng.choice(get_args(Seat)),
        late=late,
        clutter=tuple(rng.choice(get_args(Clutter), int(rng.integers(3, 9)))),
        before=low if rng.random() < 0.5 else (),
        others=others,
        moved=moved,
        opening=rng.choice(get_args(Opening), p=(0.4, 0.3, 0.3)),
        mirror=rng.random() < 0.3,
        mannequin=rng.random() < 0.2,
        poster=rng.random() < 0.4,
        dark_clothes=rng.random() < 0.3,
        shiny=rng.random() < 0.5,
        interference=rng.random() < 0.2,
    )


def in_image_rad(sensor: str, place: tuple[float, float, float], height_m: float) -> float:
    """Return the vertical position in the image of a point that is ``height_m`` above the patient's place. The position
    is its angle above the optical axis, divided by half of the vertical field of view. For a point outside the image,
    the position is beyond ±1.

    place: the camera's distance_m, height_m, tilt_rad.
    """
    distance_m, camera_m, tilt_rad = place
    return float((np.arctan2(height_m - camera_m, distance_m) + tilt_rad) / _half_view_rad(sensor))


def framing_of(sensor: str, place: tuple[float, float, float], head_m: float) -> Framing | None:
    """Return the framing: the parts of a person at the patient's place that the image border cuts off. Return None if
    too little of the person is seen, or if the border is too near to head or feet to decide.
    """
    half = _half_view_rad(sensor)
    cut, kept = 1.0 + CLEARLY_RAD / half, 1.0 - INSIDE_RAD / half
    head, middle, feet = (in_image_rad(sensor, place, share * head_m) for share in (1.0, MIDDLE_SHARE, 0.0))
    if abs(middle) > 0.8:
        return None
    if head < kept and feet > -kept:
        return "whole"
    if head < kept and feet < -cut:
        return "feet-cut-off"
    return "head-cut-off" if head > cut else None


def _half_view_rad(sensor: str) -> float:
    spec = SENSORS[sensor]
    return float(np.arctan2(spec.height / 2.0, spec.focal_px))


def _draw_place(
    rng: np.random.Generator, sensor: str, framing: Framing, head_m: float, farthest_m: float
) -> tuple[float, float, float]:
    """Draw the camera's distance_m, height_m and tilt_rad so that the image has the given framing."""
    while True:
        distance_m, height_m = rng.uniform(NEAREST_M, farthest_m), rng.uniform(LOWEST_M, HIGHEST_M)
        down = np.arctan2(height_m - MIDDLE_SHARE * head_m, distance_m) + rng.uniform(-AIM_RAD, AIM_RAD)
        place = (distance_m, height_m, float(np.clip(down, -UPWARD_RAD, STEEPEST_RAD)))
        near = np.hypot(distance_m, height_m - MIDDLE_SHARE * head_m) < SENSORS[sensor].farthest_m - RANGE_MARGIN_M
        if near and framing_of(sensor, place, head_m) == framing:
            return place


def _draw_others(rng: np.random.Generator, distance_m: float) -> tuple[tuple[Other, ...], Moved]:
    """Draw up to three other people, and the furniture that moves. Only a person who walks through pushes furniture."""
    kinds: tuple[Other, ...] = ("sits", "stands", "passes-behind", "passes-before")
    chances = np.array([0.25, 0.2, 0.2, 0.35 if distance_m >= ROOM_FOR_PASSER_M else 0.0])
    drawn: list[Other] = [
        rng.choice(kinds, p=chances / chances.sum()) for _ in range(int(rng.choice(4, p=(0.25, 0.35, 0.25, 0.15))))
    ]
    moved: Moved = rng.choice(get_args(Moved), p=(0.5, 0.15, 0.15, 0.2))
    others = sorted(drawn, key=lambda kind: kind.startswith("passes"))
    if moved in ("stool", "wheelchair"):
        others = [*others[-2:], "passes-behind"]
    return tuple(others), moved
