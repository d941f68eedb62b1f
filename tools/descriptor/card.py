"""The model card: what the package's weights say of people of every kind, on images that no training saw.

The images are drawn by the generator of the training, with seeds that training never uses, and are described as users
describe theirs, by onnxruntime. All figures are of single images. ``python tools/train_descriptor.py --card``.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "src")]

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402
from people import People  # noqa: E402
from scenes import FARTHEST_M, FOCAL_PX, HEIGHT, LOOKS, MOST_PEOPLE, WIDTH, Batch, Drawn, Scenes, packed  # noqa: E402

from anchorpose.camera import Camera  # noqa: E402
from anchorpose.descriptor.learnt import STEP, Described, describe  # noqa: E402
from anchorpose.descriptor.people import LEAST_CERTAINTY, find_people  # noqa: E402
from anchorpose.lens import Intrinsics  # noqa: E402
from anchorpose.simulate.render import PATIENT, Figure, TrueImage, draw_figures  # noqa: E402

FIRST_SEED: Final = 4_000_000_000
"""Training draws from its own seed plus the images that were seen, below a hundred million, and checks from 990,000.
The generator of a CPU takes 32 bits, so this is not one of those again."""

IMAGES: Final = 500
SCENES: Final = 10  # drawn at once; each gives ``LOOKS`` images
STATURE_CM: Final = 170.0
SIDE: Final = 0.02  # of stature off the middle: there left and right differ
SURE: Final = 0.9  # probability of a pixel
WIDEST_PX: Final = 800  # four focal lengths to each side of the axis, at every second pixel

RIM_RAYS: Final = 3  # beside a person: there a ray may be half of the person
SAME_M: Final = 0.002  # in depth, of what is drawn twice
THINGS: Final = (
    "walls and floor",
    "what people sit on, lie on or stand in",
    "loose furniture, screens, poles",
    "chairs and tables of nobody",
    "balls and joined round things",
    f"anything within {RIM_RAYS} rays of a person",
)
"""What pixels show that show nobody; the last wherever it applies."""

Rows = dict[str, np.ndarray]


class Measured(NamedTuple):
    """Tables as columns by name: of images, of people in them (image: row), and of people's pixels (person: row)."""

    images: Rows
    people: Rows
    pixels: Rows


class Truth(NamedTuple):
    """One image: depth_m (h, w) as sensed; patch, place, person as in ``Batch``; nobody: the patch of no person;
    pelvis_m (MOST_PEOPLE, 3) in the camera's frame; thing (h/2, w/2): which of ``THINGS``."""

    depth_m: np.ndarray
    patch: np.ndarray
    place: np.ndarray
    person: np.ndarray
    nobody: int
    pelvis_m: np.ndarray
    thing: np.ndarray


def measure(images: int, first_seed: int = FIRST_SEED) -> Measured:
    """Draw and describe at least so many images."""
    torch.set_num_threads(1)  # one order of sums
    scenes = Scenes(torch.device("cpu"), first_seed)
    found = list[Measured]()
    while sum(len(one.images["things"]) for one in found) < images:
        drawn = scenes.scene(SCENES)
        known, things = known_of(scenes, drawn), things_of(scenes, drawn)
        for _ in range(LOOKS):
            batch = scenes.look(drawn)
            truths = [_truth(scenes, drawn, batch, things, row) for row in range(SCENES)]
            found += [_judge(truth, _rows_of(known, batch, row)) for row, truth in enumerate(truths)]
    return _joined(found)


def known_of(scenes: Scenes, drawn: Drawn) -> Rows:
    """What the generator knows of each person (n, MOST_PEOPLE): there or not, body, posture, place and what is seen."""
    shape, posed = (len(drawn.true_m), MOST_PEOPLE), drawn.posed
    pelvis_m = scenes.pelvises(drawn).numpy()
    stature_m, mass_index = _build(scenes.people, posed.shape, posed.size)
    towards = -drawn.where[..., [0, 2]].numpy()
    facing = posed.facing.numpy().reshape(shape)
    ahead = (np.stack([np.cos(facing), -np.sin(facing)], axis=-1) * towards).sum(axis=-1)
    there = np.zeros(shape[0] * shape[1], dtype=bool)
    there[drawn.kept.numpy()] = True
    rows = {
        "there": there,
        "posture": posed.posture.numpy(),
        "child": posed.child.numpy(),
        "cloth_m": posed.cloth_m.numpy(),
        "stature_m": stature_m,
        "mass_index": mass_index,
        "distance_m": np.linalg.norm(pelvis_m, axis=-1),
        "away_deg": np.rad2deg(np.arccos(np.clip(ahead / np.linalg.norm(towards, axis=-1), -1.0, 1.0))),
        "seen": _seen_share(scenes, drawn),
    }
    return {name: values.reshape(shape) for name, values in rows.items()}


def _build(people: People, shape: torch.Tensor, size: torch.Tensor) -> tuple[np.ndarray, np.ndarray]:
    """Stature (n,) m, and mass over its square (n,) kg / m2 at the density of water, of bodies without clothes."""
    skin = people.vertices + torch.einsum("nk,kvi->nvi", shape, people.basis[: shape.shape[1]])
    skin = skin * size[:, None, None]
    a, b, c = (skin[:, people.faces[:, corner]] for corner in range(3))
    volume = (torch.linalg.cross(a, b) * c).sum(dim=(1, 2)).abs() / 6.0
    stature = skin[..., 1].amax(dim=1) - skin[..., 1].amin(dim=1)
    return stature.numpy(), (1000.0 * volume / stature.clamp_min(0.1) ** 2).numpy()


def _seen_share(scenes: Scenes, drawn: Drawn) -> np.ndarray:
    """(n * MOST_PEOPLE,) of the pixels that a person would cover alone in an image without borders, the share that
    shows the person."""
    share = np.zeros(len(drawn.true_m) * MOST_PEOPLE)
    faces = scenes.people.faces.numpy()
    part, nothing = np.ones(len(faces), np.uint8), np.zeros((WIDEST_PX, WIDEST_PX))
    empty = TrueImage(*(nothing.astype(kind) for kind in (np.float32, np.float32, np.uint8, np.uint8)))
    for skin, row in zip(drawn.skin_m, drawn.kept.tolist(), strict=True):
        image, person = divmod(row, MOST_PEOPLE)
        own = (skin + drawn.where[image, person] - drawn.view.place[image]) @ drawn.view.turn[image]
        whole = draw_figures(_wide_camera(), empty, (Figure(own.numpy(), faces, part, PATIENT),))
        seen = int((drawn.person[image, ::STEP, ::STEP] == person).sum())
        share[row] = seen / max(1, int((whole.label == PATIENT).sum()))
    return share


def things_of(scenes: Scenes, drawn: Drawn) -> np.ndarray:
    """(n, h/2, w/2) which of ``THINGS`` every second pixel shows; of no meaning where it shows a person."""
    half = (slice(None), slice(None, None, STEP), slice(None, None, STEP))
    true_m, thing = drawn.true_m[half], torch.zeros(drawn.true_m[half].shape, dtype=torch.long)
    for number, boxes in enumerate(map(packed, drawn.boxes), start=1):
        depth_m = torch.full_like(true_m, FARTHEST_M)
        for box in range(boxes.centre.shape[1]):
            own = (part[:, box] for part in boxes)
            depth_m = scenes.box_depth(depth_m, scenes.rays[half[1:]], drawn.view.turn, drawn.view.place, *own)
        thing[(depth_m < FARTHEST_M) & ((depth_m - true_m).abs() < SAME_M)] = number
    thing[drawn.angular_m[half] > true_m + SAME_M] = 4
    around = np.ones((2 * RIM_RAYS + 1,) * 2, np.uint8)
    people = (drawn.person[half] >= 0).numpy().astype(np.uint8)
    rim = np.stack([cv2.dilate(image, around) > 0 for image in people])
    return np.where(rim, 5, thing.numpy())


def _truth(scenes: Scenes, drawn: Drawn, batch: Batch, things: np.ndarray, row: int) -> Truth:
    one = (batch.depth_m, batch.patch, batch.place, batch.person)
    nobody = len(scenes.surface.centres)
    return Truth(*(layer[row].numpy() for layer in one), nobody, scenes.pelvises(drawn)[row].numpy(), things[row])


def _rows_of(known: Rows, batch: Batch, row: int) -> Rows:
    """What is known of the people of one image (MOST_PEOPLE,), and of the image."""
    own = {name: values[row] for name, values in known.items()}
    image = {"number": int(own["there"].sum()), "sensor": int(batch.sensor[row]), "cut_out": bool(batch.cut_out[row])}
    return own | {name: np.full(MOST_PEOPLE, value) for name, value in image.items()}


def _judge(truth: Truth, known: Rows) -> Measured:
    """Describe one image and compare; people of whom no pixel is judged are left out."""
    said = describe(truth.depth_m, _camera())
    assert said.person.shape == truth.person.shape
    others, found = truth.patch == truth.nobody, said.person >= 0.5
    mine = (truth.patch >= 0) & ~others
    owners = _found_people(said, truth)
    number = np.flatnonzero(np.bincount(truth.person[mine], minlength=MOST_PEOPLE))
    people = {name: values[number] for name, values in known.items()}
    area = np.bincount(truth.person[mine], _areas(truth)[mine], minlength=MOST_PEOPLE)[number]
    people |= {"area_m2": area, "person_found": np.isin(number, owners), "image": np.zeros(len(number), int)}
    called = {"others": others, "wrong": others & found, "sure": others & (said.person >= SURE)}
    images = {name: np.bincount(truth.thing[mask], minlength=len(THINGS)) for name, mask in called.items()}
    images["things"] = np.array(owners.count(-1))
    images |= {name: known[name][0] for name in ("number", "sensor", "cut_out")}
    rows = np.searchsorted(number, truth.person[mine])
    return Measured({name: np.array([value]) for name, value in images.items()}, people, _pixels(said, truth, rows))


def _pixels(said: Described, truth: Truth, rows: np.ndarray) -> Rows:
    """The judged pixels of people; NaN where a pixel was not found."""
    mine = (truth.patch >= 0) & (truth.patch != truth.nobody)
    place, true = said.place[mine], truth.place[mine]
    sided = np.minimum(np.abs(place[:, 2]), np.abs(true[:, 2])) > SIDE
    vote_m = np.linalg.norm(said.pelvis_m[mine] - truth.pelvis_m[truth.person[mine]], axis=1)
    return {
        "person": rows,
        "found": said.person[mine] >= 0.5,
        "error_cm": STATURE_CM * np.linalg.norm(place - true, axis=1),
        "expected_cm": STATURE_CM * said.error[mine],
        "crossed": np.where(sided, place[:, 2] * true[:, 2] < 0, np.nan),
        "vote_cm": 100.0 * vote_m,
    }


def _found_people(said: Described, truth: Truth) -> list[int]:
    """Whom each found person shows with most of the rays; -1: nobody."""
    people = find_people([said], [truth.depth_m], [np.eye(4)])
    rays = [one.rays[0] for one in people if one.certainty >= LEAST_CERTAINTY and one.rays[0] is not None]
    return [int(np.bincount(truth.person[own] + 1).argmax()) - 1 for own in rays]


def _areas(truth: Truth) -> np.ndarray:
    return np.asarray((truth.depth_m[::STEP, ::STEP] * STEP / FOCAL_PX) ** 2)


def _camera() -> Camera:
    """The camera of every image."""
    lens = Intrinsics(fx=FOCAL_PX, fy=FOCAL_PX, cx=(WIDTH - 1) / 2.0, cy=(HEIGHT - 1) / 2.0)
    return Camera(name="drawn", width=WIDTH, height=HEIGHT, depth_scale=0.001, intrinsics=lens)


def _wide_camera() -> Camera:
    """A camera with the rays that the network answers for, and the same far beyond the borders of its image."""
    beyond = (WIDEST_PX - np.array([WIDTH, HEIGHT]) // STEP) // 2
    focal, (cx, cy) = FOCAL_PX / STEP, (beyond + (np.array([WIDTH, HEIGHT]) - 1) / 2.0 / STEP).tolist()
    lens = Intrinsics(fx=focal, fy=focal, cx=cx, cy=cy)
    size = {"width": WIDEST_PX, "height": WIDEST_PX}
    return Camera(name="wide", depth_scale=0.001, intrinsics=lens, T_world_camera=np.eye(4), **size)


def _joined(found: Sequence[Measured]) -> Measured:
    """All images in one."""
    people_before = np.cumsum([0, *(len(one.people["image"]) for one in found)])
    for number, one in enumerate(found):
        one.people["image"] += number
        one.pixels["person"] += people_before[number]
    return Measured(
        *(
            {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
            for tables in zip(*found, strict=True)
        )
    )
