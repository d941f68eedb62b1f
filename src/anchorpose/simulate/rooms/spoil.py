"""Spoil a depth image by effects of real rooms: black cloth, bare metal, another camera's light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.simulate.render import PATIENT, TrueImage

BLOB_PX: Final = 2.5  # size of the patches in which readings fail
DARK_LOSS: Final = (0.15, 0.55)  # share of black cloth without a reading
SHINY_LOSS: Final = (0.3, 0.8)  # share of bare metal without a reading
BURST_CHANCE: Final = 0.15  # chance of a frame into which another camera shines
BURST_SHARE: Final = (0.08, 0.35)  # share of the pixels of such a frame
WRONG_SHARE: Final = 0.4  # share of the spoilt pixels that have a wrong reading instead of none
WRONG_M: Final = 0.25  # standard deviation of a wrong reading


@dataclass(frozen=True, slots=True, eq=False)
class Spoil:
    """The losses of one recording's readings.

    dark (b + 1,) bool: body parts of the patient in black cloth, by part number; dark_loss, shiny_loss: share of black
    cloth and of bare metal without a reading; interference: another camera shines into some frames.
    """

    dark: np.ndarray
    dark_loss: float
    shiny_loss: float
    interference: bool


def draw_spoil(
    rng: np.random.Generator, bone_names: tuple[str, ...], dark: bool, shiny: bool, interference: bool
) -> Spoil:
    """Draw black trousers, a black top or both."""
    wears = [("Leg", "HipJoint", "Hips"), ("Spine", "Back", "Shoulder", "Arm"), ("Leg", "Hips", "Spine", "Back", "Arm")]
    chosen = wears[int(rng.integers(3))]
    parts = np.array([False, *(dark and any(name in bone for name in chosen) for bone in bone_names)])
    losses = rng.uniform(*DARK_LOSS), rng.uniform(*SHINY_LOSS) if shiny else 0.0
    return Spoil(parts, losses[0] if dark else 0.0, losses[1], interference)


def spoilt_mm(
    rng: np.random.Generator, spoil: Spoil, image: TrueImage, shiny: np.ndarray, reading_mm: np.ndarray
) -> np.ndarray:
    """Return a reading (height, width) uint16 millimetres without the losses by black cloth and metal, and with
    bursts.

    shiny (height, width) bool: pixels of bare metal that nobody hides.
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
    """Return one frame with speckle: patches without a reading, or with one that is off by decimetres."""
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
