"""Rooms as one camera sees them: python benchmarks/room_scenes.py --use tuning --out scenes.

Cluttered rooms with other people, mirrors and moved furniture, one camera at an unknown place, no picture of the empty
room. 40 seeds are for tuning; 40 others are held out. Without --out their names are listed. With --movements some of
the patients do captured rehabilitation movements.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

from hard_scenes import write_scene

from anchorpose.simulate.config import SimulationConfig, room

Use = Literal["tuning", "held-out"]

FIRST_SEED: Final = {"tuning": 51_000, "held-out": 52_000}
ROOMS: Final = 40


def room_scenes(
    use: Use, seeds: int = ROOMS, seconds: float = 6.0, fps: float = 15.0, movement_file: Path | None = None
) -> dict[str, SimulationConfig]:
    """The settings of each room by its name."""
    numbers = range(FIRST_SEED[use], FIRST_SEED[use] + seeds)
    return {f"room-{seed}": room(seed, seconds, fps, movement_file) for seed in numbers}


def main(arguments: Sequence[str] | None = None) -> None:
    """List the rooms, or write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--use", choices=("tuning", "held-out"), default="tuning")
    parser.add_argument("--out", type=Path, help="folder to write the recordings to, one folder each")
    parser.add_argument("--seeds", type=int, default=ROOMS, help=f"how many rooms, at most {ROOMS}")
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--fps", type=float, default=15.0)
    parser.add_argument("--movements", type=Path, help="the Kinect skeletons of UI-PRMD as .npz")
    options = parser.parse_args(arguments)
    if not 1 <= options.seeds <= ROOMS:
        sys.exit(f"There are {ROOMS} rooms for each use; --seeds must be 1 to {ROOMS}, not {options.seeds}.")
    if options.movements is not None and not options.movements.is_file():
        sys.exit(f"There is no file {options.movements} with captured movements.")
    scenes = room_scenes(options.use, options.seeds, options.seconds, options.fps, options.movements)
    for name, config in scenes.items():
        print(f"{name} {summary(config)}", flush=True)
        if options.out is not None:
            write_scene(options.out / name, config)


def summary(config: SimulationConfig) -> str:
    """What is in a room, in a few words."""
    plan = config.room
    if plan is None:
        raise ValueError("only a room can be described")
    extras = ("late", "mirror", "mannequin", "poster", "dark_clothes", "shiny", "interference")
    found = [name.replace("_", " ") for name in extras if getattr(plan, name)]
    place = f"{plan.distance_m:.1f} m away, {plan.camera_height_m:.1f} m high"
    others = f"other people: {len(plan.others)}"
    moved = [f"{plan.moved} is moved"] if plan.moved != "none" else []
    return ", ".join([config.sensor, place, plan.framing, plan.posture, others, *moved, *found])


if __name__ == "__main__":
    main()
