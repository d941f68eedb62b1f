"""What a recording states about the patient: all of it optional, none of it copied into results or exports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

MissingPart = Literal[
    "arm_left", "arm_right", "forearm_left", "forearm_right", "hand_left", "hand_right",
    "leg_left", "leg_right", "shank_left", "shank_right", "foot_left", "foot_right",
]  # fmt: skip
"""A part that a body may lack, with all that hangs on it: a missing arm is missing from the shoulder on."""

CoveredPart = Literal[
    "head", "trunk", "upper_arm_left", "upper_arm_right", "forearm_left", "forearm_right", "hand_left", "hand_right",
    "thigh_left", "thigh_right", "shank_left", "shank_right", "foot_left", "foot_right",
]  # fmt: skip
"""A segment that an orthosis, brace, helmet, harness or prosthesis may cover."""

GROWN_YEARS: Final = 16.0  # from then on bodies are those of adults
FIRST_RECORDED: Final = 2010  # depth cameras for everybody appeared in that year


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """The patient. None: unknown."""

    height_m: float | None = None
    age_years: float | None = None
    birth_year: int | None = None
    sex: Literal["female", "male"] | None = None
    missing: tuple[MissingPart, ...] = ()
    covered: tuple[CoveredPart, ...] = ()

    @property
    def unmeasured(self) -> Subject:
        """The same without what the pictures can contradict: height, age and sex."""
        return Subject(missing=self.missing, covered=self.covered)

    @property
    def grown(self) -> bool | None:
        """Whether the patient is an adult, None where that is unknown.

        Of a birth year alone only those who were grown when the first depth cameras appeared: the year of the recording
        is not known, and results do not depend on today's date.
        """
        if self.age_years is not None:
            return self.age_years >= GROWN_YEARS
        if self.birth_year is not None and self.birth_year + GROWN_YEARS <= FIRST_RECORDED:
            return True
        return None


UNKNOWN: Final = Subject()
