"""Colours of all pictures: Okabe and Ito's, told apart by colour-blind readers; blue, green, red as OpenCV has them."""

from __future__ import annotations

from typing import Final

from anchorpose.isolation.view import PixelLabel

Colour = tuple[int, int, int]

SKY: Final = (233, 180, 86)
ORANGE: Final = (0, 159, 230)
GREEN: Final = (115, 158, 0)
YELLOW: Final = (66, 228, 240)
BLUE: Final = (178, 114, 0)
VERMILLION: Final = (0, 94, 213)
PURPLE: Final = (167, 121, 204)
WHITE: Final = (255, 255, 255)
GREY: Final = (150, 150, 150)
BLACK: Final = (0, 0, 0)

PATIENT: Final = SKY
EQUIPMENT: Final = ORANGE
OTHERS: Final = (PURPLE, GREEN, YELLOW, WHITE)
"""Other people in the order of their labels; the fifth has the first's colour again, but a number of its own."""


def colour_of_person(label: int) -> Colour:
    """The colour of a person's pixel label."""
    if label == PixelLabel.PATIENT:
        return PATIENT
    return OTHERS[(label - PixelLabel.OTHER_PERSON) % len(OTHERS)]


def as_hex(colour: Colour) -> str:
    """The colour as web pages write it."""
    return "#{2:02x}{1:02x}{0:02x}".format(*colour)
