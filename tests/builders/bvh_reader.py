"""A reader of BVH files for the tests: its own parser and its own forward kinematics, nothing of the writer's."""

from dataclasses import dataclass

import numpy as np

_AXES = {"X": 0, "Y": 1, "Z": 2}


@dataclass(eq=False)
class Bvh:
    """paths_cm: the path (n, 3) of every node, and of each chain's end as NAME_end; frame_s: between frames."""

    paths_cm: dict[str, np.ndarray]
    frame_s: float


def read_bvh(text: str) -> Bvh:
    head, motion = text.split("MOTION\n")
    lines = motion.strip().split("\n")
    count, frame_s = int(lines[0].split(":")[1]), float(lines[1].split(":")[1])
    values = np.array([line.split() for line in lines[2:]], dtype=np.float64)
    assert len(values) == count
    words, used = iter(head.split()), 0
    stack: list[tuple[str, np.ndarray, np.ndarray]] = []
    paths: dict[str, np.ndarray] = {}
    name, offset, turn, place = "", np.zeros(3), np.zeros(0), np.zeros(0)
    for word in words:
        if word in ("ROOT", "JOINT"):
            name = next(words)
        elif word == "End":
            next(words)
            name = f"{stack[-1][0]}_end"
        elif word == "OFFSET":
            offset = np.array([float(next(words)) for _ in range(3)])
            above = stack[-2] if len(stack) > 1 else ("", np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))
            turn, place = above[1], above[2] + above[1] @ offset
            stack[-1] = (name, turn, place)
            paths[name] = place
        elif word == "CHANNELS":
            for channel in [next(words) for _ in range(int(next(words)))]:
                column, used = values[:, used], used + 1
                if channel.endswith("position"):
                    place = place + np.outer(column, np.eye(3)[_AXES[channel[0]]])
                else:
                    turn = turn @ _turns(_AXES[channel[0]], np.radians(column))
            stack[-1] = (name, turn, place)
            paths[name] = place
        elif word == "{":
            stack.append((name, turn, place))
        elif word == "}":
            stack.pop()
    assert used == values.shape[1]
    return Bvh(paths, frame_s)


def _turns(axis: int, angle: np.ndarray) -> np.ndarray:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turns = np.zeros((len(angle), 3, 3))
    turns[:, axis, axis] = 1.0
    turns[:, i, i] = turns[:, j, j] = np.cos(angle)
    turns[:, j, i], turns[:, i, j] = np.sin(angle), -np.sin(angle)
    return turns
