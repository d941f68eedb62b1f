"""The hard scenes: python benchmarks/hard_scenes.py --movements skeletons.npz --use tuning --out scenes.

Patients who do captured rehabilitation movements in equipment, held by therapists, while people pass between them and a
camera; the recordings begin in the middle of a movement. 24 recordings are for tuning; 24 are held out: other subjects,
two movements and one kind of equipment that no recording for tuning has. Without --out their names are listed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

from anchorpose.simulate.config import Equipment, SimulationConfig, clinic, rehabilitation

Use = Literal["tuning", "held-out"]

TUNING_SUBJECTS: Final = (1, 2, 3, 4, 5)
HELD_OUT_SUBJECTS: Final = (6, 7)
HELD_OUT_MOVEMENTS: Final = ("side-lunge", "shoulder-scaption")
HELD_OUT_EQUIPMENT: Final = "sling"
FIRST_SEED: Final = {"tuning": 41_000, "held-out": 42_000}
ROUNDS: Final = 2  # of each recipe with another seed; the bars come in every one


@dataclass(frozen=True, slots=True)
class Recipe:
    """A movement in equipment; passers_by walk through."""

    movement: str
    equipment: Equipment
    passers_by: int = 0


BARS: Final = Recipe("sit-to-stand", "parallel-bars", 1)
TUNING: Final = (
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
)
HELD_OUT: Final = (
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
)


def hard_scenes(
    use: Use, movement_file: Path, seconds: float = 10.0, fps: float = 15.0
) -> dict[tuple[str, int], SimulationConfig]:
    """The settings of each scene by its name and seed."""
    recipes, subjects = (TUNING, TUNING_SUBJECTS) if use == "tuning" else (HELD_OUT, HELD_OUT_SUBJECTS)
    found = {}
    for number, recipe in enumerate(recipes * ROUNDS):
        seed = FIRST_SEED[use] + number
        base = replace(clinic(seed, seconds, fps), subjects=subjects)
        config = rehabilitation(base, movement_file, recipe.movement, recipe.equipment, recipe.passers_by)
        found[f"{recipe.equipment}-{recipe.movement}", seed] = config
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """List the scenes, or write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--movements", type=Path, required=True, help="the Kinect skeletons of UI-PRMD as .npz")
    parser.add_argument("--use", choices=("tuning", "held-out"), default="tuning")
    parser.add_argument("--out", type=Path, help="folder to write the recordings to, one folder each")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--fps", type=float, default=15.0)
    options = parser.parse_args(arguments)
    if not options.movements.is_file():
        sys.exit(
            f"There is no file {options.movements} with captured movements; the hard scenes cannot be made without."
        )
    for (name, seed), config in hard_scenes(options.use, options.movements, options.seconds, options.fps).items():
        print(f"{name}-{seed}", flush=True)
        if options.out is not None:
            write_scene(options.out / f"{name}-{seed}", config)


def write_scene(folder: Path, config: SimulationConfig) -> None:
    """Simulate into ``folder`` unless it is there already."""
    from anchorpose.simulate.write import simulate_recording

    if not folder.exists():
        simulate_recording(folder, config)


if __name__ == "__main__":
    main()
