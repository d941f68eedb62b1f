"""What is measured, as data: each suite's scene classes, with their recordings and how they are scored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import scores
from recordings import DATA, MOVEMENTS, FrontAlone, OneFrame, Ready, Real, Recording, Simulated

from anchorpose.joints import JOINT_INDEX
from anchorpose.simulate import config as presets
from anchorpose.simulate.bodies import BUILDS, OtherBody
from anchorpose.simulate.config import Equipment, SimulationConfig
from anchorpose.simulate.rooms.plan import RoomConfig

Use = Literal["tuning", "held-out"]
Config = SimulationConfig
Scores = dict[str, float]


@dataclass(frozen=True, slots=True)
class Case:
    """One run: a recording, how the patient is named in it, and how its results are scored.

    row: the scene class; name: returns settings that differ from the defaults, or None to leave the recording out;
    score: returns the scores, or pairs of a part's name and its scores, which get rows of their own; refused: the
    scores of a recording that is refused.
    """

    row: str
    recording: Recording
    score: Callable[[Ready, Path], Any] = scores.against_truth
    name: Callable[[Ready], dict[str, Any] | None] = field(default=lambda ready: {})
    refused: Callable[[], Scores] = dict


@dataclass(frozen=True, slots=True)
class Suite:
    """cases: of a use, all or the few of ``--quick``. alone: run one after another, so that times can be compared."""

    about: str
    cases: Callable[[Use, bool], Iterator[Case]]
    alone: bool = False


# easy: the README's rows

EASY: Final[dict[str, Callable[[int, float], Config]]] = {
    "one camera, nobody else": presets.single,
    "the same with holes of 0.15 m": lambda seed, seconds: presets.holes(seed, 0.15, seconds),
    "clinic: three cameras, frame, two therapists": presets.clinic,
    "the same clinic, front camera alone": lambda seed, seconds: replace(presets.clinic(seed, seconds), cameras=1),
}
EASY_SEEDS: Final = {"tuning": 101, "held-out": 141}


def easy(use: Use, quick: bool) -> Iterator[Case]:
    """Yield four seeds of each row, six seconds."""
    for row, (title, make) in enumerate(EASY.items()):
        for seed in range(EASY_SEEDS[use], EASY_SEEDS[use] + (1 if quick else 4)):
            config = make(seed, 3.0 if quick else 6.0)
            yield Case(title, Simulated(f"easy-{row}-{seed}-{config.seconds:g}", config))


# hard: captured rehabilitation movements in equipment, held by therapists, with people who walk through


@dataclass(frozen=True, slots=True)
class Recipe:
    """A movement in equipment; passers_by walk through."""

    movement: str
    equipment: Equipment
    passers_by: int = 0


BARS: Final = Recipe("sit-to-stand", "parallel-bars", 1)
RECIPES: Final[dict[Use, tuple[Recipe, ...]]] = {
    "tuning": (
        BARS,
        Recipe("sit-to-stand", "wheelchair", 1),
        Recipe("deep-squat", "parallel-bars"),
        Recipe("shoulder-abduction", "walker", 1),
        Recipe("hurdle-step", "parallel-bars", 1),
        Recipe("shoulder-rotation", "standing-frame", 1),
        Recipe("inline-lunge", "none", 1),
        BARS,
        Recipe("leg-raise", "parallel-bars"),
        Recipe("deep-squat", "none", 2),
        Recipe("shoulder-extension", "wheelchair"),
        Recipe("sit-to-stand", "standing-frame", 1),
    ),
    "held-out": (
        BARS,
        Recipe("sit-to-stand", "wheelchair", 1),
        Recipe("deep-squat", "parallel-bars", 1),
        Recipe("shoulder-abduction", "standing-frame", 1),
        Recipe("hurdle-step", "none", 1),
        Recipe("side-lunge", "none", 1),
        Recipe("side-lunge", "parallel-bars"),
        Recipe("shoulder-scaption", "parallel-bars", 1),
        Recipe("shoulder-scaption", "walker"),
        Recipe("sit-to-stand", "sling", 1),
        Recipe("deep-squat", "sling", 1),
        Recipe("leg-raise", "sling"),
    ),
}
"""Held out: other subjects, two movements and one kind of equipment that no recording for tuning has."""

HARD_SEED: Final[dict[Use, int]] = {"tuning": 41_000, "held-out": 42_000}
SUBJECTS: Final[dict[Use, tuple[int, ...]]] = {"tuning": (1, 2, 3, 4, 5), "held-out": (6, 7)}
ROUNDS: Final = 2  # of each recipe, with another seed


def hard_scenes(use: Use, seconds: float = 10.0, fps: float = 15.0) -> dict[str, Config]:
    """Return the settings of each hard scene by its name."""
    found = {}
    for number, recipe in enumerate(RECIPES[use] * ROUNDS):
        seed = HARD_SEED[use] + number
        base = replace(presets.clinic(seed, seconds, fps), subjects=SUBJECTS[use])
        config = presets.rehabilitation(base, MOVEMENTS, recipe.movement, recipe.equipment, recipe.passers_by)
        found[f"{recipe.equipment}-{recipe.movement}-{seed}"] = config
    return found


def hard(use: Use, quick: bool) -> Iterator[Case]:
    """Yield 24 scenes by three cameras, then by the front camera alone."""
    scenes = list(hard_scenes(use, 3.0 if quick else 10.0).items())[: 2 if quick else None]
    whole = [Simulated(f"hard-{name}-{config.seconds:g}", config) for name, config in scenes]
    yield from (Case("hard scenes, three cameras", recording) for recording in whole)
    yield from (Case("hard scenes, front camera alone", FrontAlone(recording)) for recording in whole)


# bodies: builds, heights, clothes, braces, missing limbs

BODY_SEED: Final[dict[Use, int]] = {"tuning": 61_000, "held-out": 63_000}


def people() -> dict[str, Callable[[Config], Config]]:
    """Return each kind of person, as a change of a recording's settings."""

    def body(config: Config, **given: Any) -> Config:
        return replace(config, body=OtherBody(**given))

    def settings(config: Config, **given: Any) -> Config:
        return replace(config, body=OtherBody(build="varied"), **given)

    return {
        **{build: partial(body, build=build) for build in BUILDS},
        "small": partial(settings, height_m=1.47),
        "tall": partial(settings, height_m=1.93),
        "tight clothes": partial(settings, clothing_m=0.002),
        "loose clothes": partial(settings, clothing_m=0.015),
        "braces": partial(body, build="varied", braces=("left shank", "right thigh")),
        "corset": partial(body, build="varied", braces=("trunk",)),
        "no left shank": partial(body, build="varied", missing=("shank_left",)),
        "no right forearm": partial(body, build="varied", missing=("forearm_right",)),
    }


def bodies(use: Use, quick: bool) -> Iterator[Case]:
    """Yield each kind of person before one camera, then in a clinic of three."""
    kinds = people()
    for scene, make in (("one camera", presets.single), ("clinic", presets.clinic)):
        for person in list(kinds)[: 2 if quick else None] if not (quick and scene == "clinic") else ():
            for seed in range(BODY_SEED[use], BODY_SEED[use] + (1 if quick else 2)):
                config = kinds[person](make(seed, 3.0 if quick else 6.0))
                name = f"body-{person}-{scene}-{seed}-{config.seconds:g}".replace(" ", "_")
                yield Case(f"{scene}: {person}", Simulated(name, config))


# rooms: cluttered rooms seen by one camera at an unknown place

ROOM_SEED: Final[dict[Use, int]] = {"tuning": 51_000, "held-out": 52_000}


def rooms(use: Use, quick: bool) -> Iterator[Case]:
    """Yield 40 rooms, of sensors that filter their depth and of others; the patient is named as a user would."""
    for seed in range(ROOM_SEED[use], ROOM_SEED[use] + (4 if quick else 40)):
        config = presets.room(seed, 6.0, 15.0, MOVEMENTS if MOVEMENTS.is_file() else None)
        filtered = "filtered" if config.sensor.endswith("filtered") else "not filtered"
        recording = Simulated(f"room-{seed}", config)
        yield Case(f"rooms, depth {filtered}", recording, scores.in_a_room, scores.name_patient, scores.not_found)


# starts: the first pose from a single frame


def _highest_hands(joints_m: np.ndarray) -> int:
    hands = joints_m[:, [JOINT_INDEX["WristLeft"], JOINT_INDEX["WristRight"]], 1]
    return int(np.argmax(hands.min(axis=1)))


def _lowest_pelvis(joints_m: np.ndarray) -> int:
    return int(np.argmin(joints_m[:, JOINT_INDEX["SpineBase"], 1]))


def _middle(joints_m: np.ndarray) -> int:
    return len(joints_m) // 2


def _before(seed: int, seconds: float, motions: tuple[str, ...], **room: Any) -> Config:
    """A bare room whose camera stands where it is set; the patient may be turned away from it."""
    rng = np.random.default_rng(seed)
    plan = RoomConfig(**({"distance_m": rng.uniform(2.2, 3.2), "camera_height_m": 1.2, "tilt_rad": 0.08} | room))
    base = presets.single(seed, seconds)
    return replace(base, motions=motions, room=plan, pose_known=False, stool=plan.posture != "stands")


ALONG: Final = ("squat", "reach", "weight-shift")
STARTS: Final[dict[str, tuple[Callable[[int], Config], Callable[[np.ndarray], int]]]] = {
    "arms raised": (lambda seed: _before(seed, 4.0, ("arm-raise",)), _highest_hands),
    "squat": (lambda seed: _before(seed, 4.0, ("squat",)), _lowest_pelvis),
    "seated": (lambda seed: _before(seed, 2.0, ("reach", "head"), posture="sits", seat="chair"), _middle),
    "turned by a quarter": (lambda seed: _before(seed, 2.0, ALONG, azimuth_rad=(-1) ** seed * np.pi / 2), _middle),
    "turned away": (lambda seed: _before(seed, 2.0, ALONG, azimuth_rad=np.pi), _middle),
    "feet cut off": (
        lambda seed: _before(seed, 2.0, ALONG, distance_m=1.5, camera_height_m=1.4, tilt_rad=0.0),
        _middle,
    ),
}
START_SEED: Final[dict[Use, int]] = {"tuning": 71_000, "held-out": 73_000}


def starts(use: Use, quick: bool) -> Iterator[Case]:
    """Yield single frames: a person in a bare room, in postures and from sides that are hard to begin with."""
    for title in STARTS:
        for seed in range(START_SEED[use], START_SEED[use] + (1 if quick else 10)):
            yield Case(
                f"one frame: {title}", _start(title, seed), scores.in_a_room, scores.name_patient, scores.not_found
            )


def _start(title: str, seed: int) -> OneFrame:
    make, moment = STARTS[title]
    return OneFrame(Simulated(f"start-{title.replace(' ', '_')}-{seed}", make(seed)), moment)


# real: labels by eye, and an inertial sensor

PEOPLE: Final = ("people_in_line", "iit_rehab_room", "five_people", "realsense_board")


def real(use: Use, quick: bool) -> Iterator[Case]:
    """Yield labelled sequences, recordings with a sensor on the thigh, and labelled people; the same for both uses."""
    sequences = scores.labelled_sequences()
    for sequence in sequences[:: len(sequences) // 6] if quick else sequences:
        yield Case("MSR Action3D: labels", Real(f"msr_action3d/{sequence}"), scores.against_msr_labels)
    clips = sorted(path.parent.name for path in DATA.glob("utd_mhad/*/recording.json"))
    for clip in clips[::8] if quick else clips:
        title = clip.split("_", 3)[-1].replace("_", " ")
        yield Case(f"thigh sensor: {title}", Real(f"utd_mhad/{clip}"), scores.against_inertial_sensor)
    for folder in PEOPLE[2:] if quick else PEOPLE:
        for person in scores.people_in(folder):
            yield Case(
                f"people: {folder}",
                Real(folder),
                partial(scores.against_people_labels, person=person),
                partial(scores.name_labelled, person=person),
            )


# contacts: by body part


def contacts(use: Use, quick: bool) -> Iterator[Case]:
    """Yield the clinics of the easy and the hard scenes, by body part."""
    clinics = [case for case in easy(use, quick) if case.row.startswith("clinic")]
    by_three = [case for case in hard(use, quick) if case.row.endswith("three cameras")]
    for case in (*clinics, *by_three):
        yield replace(case, row="contacts", score=scores.contacts_by_part)


# speed: every scene class, one run after the other


def speed(use: Use, quick: bool) -> Iterator[Case]:
    """Yield one or two recordings of every scene class, the hardest too; start-up stands apart in the table."""
    seconds, scenes = 3.0 if quick else 6.0, hard_scenes(use, 3.0 if quick else 10.0)
    seed = EASY_SEEDS[use]
    bars = next((name, config) for name, config in scenes.items() if name.startswith("parallel-bars-sit"))
    crowd = replace(presets.clinic(seed, seconds), cameras=1, therapists=3, passers_by=3)
    for title, recording in (
        ("one camera", Simulated(f"easy-0-{seed}-{seconds:g}", presets.single(seed, seconds))),
        ("clinic, three cameras", Simulated(f"easy-2-{seed}-{seconds:g}", presets.clinic(seed, seconds))),
        ("bars with a passer-by, three cameras", Simulated(f"hard-{bars[0]}-{bars[1].seconds:g}", bars[1])),
        ("six other people, one camera", Simulated(f"crowd-{seed}-{seconds:g}", crowd)),
        ("room, filtered depth", Simulated("room-51001", presets.room(51_001, 6.0, 15.0))),
        ("one image", _start("squat", START_SEED[use])),
    ):
        one_camera = title.startswith(("room", "one image"))
        yield (
            Case(title, recording, scores.in_a_room, scores.name_patient, scores.not_found)
            if one_camera
            else Case(title, recording)
        )
    if not quick:
        yield Case("real: six people in line", Real("people_in_line"), lambda ready, results: {})


SUITES: Final[dict[str, Suite]] = {
    "easy": Suite("the README's rows", easy),
    "hard": Suite("rehabilitation movements in equipment, therapists, passers-by", hard),
    "bodies": Suite("builds, heights, clothes, braces, missing limbs", bodies),
    "rooms": Suite("cluttered rooms, one camera at an unknown place", rooms),
    "starts": Suite("the first pose from a single frame", starts),
    "real": Suite("labels by eye and an inertial sensor on real depth", real),
    "contacts": Suite("contacts with people, by body part", contacts),
    "speed": Suite("processor time of every scene class", speed, alone=True),
}


def cases_of(names: Sequence[str], use: Use, quick: bool) -> dict[str, list[Case]]:
    """Return the cases of each suite; raises SystemExit for an unknown one."""
    for name in names:
        if name not in SUITES:
            raise SystemExit(f"There is no suite {name}; there are {', '.join(SUITES)}.")
    return {name: list(SUITES[name].cases(use, quick)) for name in names}
