"""Disturb a depth image by effects of real rooms: black cloth, bare metal, another camera's light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.simulate.render import PATIENT, TrueImage

BLOB_PX: Final = 2.5  # pixels, standard deviation of the Gaussian that shapes the patches in which readings fail
DARK_LOSS: Final = (0.15, 0.55)  # range of the share of pixels of black cloth that have no reading
SHINY_LOSS: Final = (0.3, 0.8)  # range of the share of pixels of bare metal that have no reading
BURST_CHANCE: Final = 0.15  # probability that another camera's light disturbs a frame
BURST_SHARE: Final = (0.08, 0.35)  # range of the share of disturbed pixels in a disturbed frame
WRONG_SHARE: Final = 0.4  # share of the disturbed pixels with a wrong reading; the rest have no reading
WRONG_M: Final = 0.25  # m, standard deviation of the error of a wrong reading


@dataclass(frozen=True, slots=True, eq=False)
class Spoil:
    """The disturbances of the depth images of one recording."""

    dark: np.ndarray  # (b + 1,) bool, by part number (1 + index of a bone): parts of the patient in black cloth
    dark_loss: float  # share of black cloth without a reading
    shiny_loss: float  # share of bare metal without a reading
    interference: bool  # whether another camera's light disturbs some frames


def draw_spoil(
    rng: np.random.Generator, bone_names: tuple[str, ...], dark: bool, shiny: bool, interference: bool
) -> Spoil:
    """Draw the losses of readings in the depth images of one recording. With ``dark``, the patient has black trousers,
    a black top or both.
    """
    wears = [("Leg", "HipJoint", "Hips"), ("Spine", "Back", "Shoulder", "Arm"), ("Leg", "Hips", "Spine", "Back", "Arm")]
    chosen = wears[int(rng.integers(3))]
    parts = np.array([False, *(dark and any(name in bone for name in chosen) for bone in bone_names)])
    losses = rng.uniform(*DARK_LOSS), rng.uniform(*SHINY_LOSS) if shiny else 0.0
    return Spoil(parts, losses[0] if dark else 0.0, losses[1], interference)


def spoilt_mm(
    rng: np.random.Generator, spoil: Spoil, image: TrueImage, shiny: np.ndarray, reading_mm: np.ndarray
) -> np.ndarray:
    """Return a depth image (height, width) uint16 millimetres with losses on black cloth and bare metal, and with
    another camera's disturbance.

    shiny (height, width) bool: pixels that show bare metal in the room without people.
    """
    dark = (image.label == PATIENT) & spoil.dark[image.part]
    bare = shiny & (image.part == 0)
    lost = (dark & _patches(rng, reading_mm.shape, spoil.dark_loss)) | (
        bare & _patches(rng, reading_mm.shape, spoil.shiny_loss)
    )
    found = np.where(lost, 0, reading_mm).astype(np.uint16)
    if spoil.interference and rng.random() < BURST_CHANCE:
        found = _burst(rng, found)
    return found


def _burst(rng: np.random.Generator, reading_mm: np.ndarray) -> np.ndarray:
    """Return a depth image with disturbed patches, in which readings are missing or wrong by decimetres."""
    spoilt = _patches(rng, reading_mm.shape, rng.uniform(*BURST_SHARE))
    wrong = rng.random(reading_mm.shape) < WRONG_SHARE
    off_mm = 1000.0 * WRONG_M * rng.standard_normal(reading_mm.shape)
    mistaken = np.where(reading_mm > 0, (reading_mm + off_mm).clip(300.0, 60_000.0), 0.0)
    return np.where(spoilt, np.where(wrong, mistaken, 0.0), reading_mm).astype(np.uint16)


def _patches(rng: np.random.Generator, shape: tuple[int, ...], share: float) -> np.ndarray:
    """Return (height, width) bool: patches of a few pixels that cover a share of the image."""
    import cv2

    noise = cv2.GaussianBlur(rng.standard_normal(shape, dtype=np.float32), (0, 0), BLOB_PX)
    return np.asarray(noise < np.quantile(noise, share) if share > 0.0 else np.zeros(shape, dtype=bool))
