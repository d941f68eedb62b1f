"""Takes part in the association tasks of the benchmark without any code of this project: numpy and scipy only.

python examples/take_part_in_the_benchmark.py BENCHMARK ANSWERS [--part test]

The first frame's nodes are moved onto the second's as a sheet that bends: each node goes to the node nearest to where
it is, all displacements are averaged over their neighbours, and again, over fewer and fewer neighbours.
"""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

NEIGHBOURS = (400, 200, 100, 50, 25, 12)  # over which displacements are averaged, from stiff to soft
ROUNDS = 5  # with each number of neighbours
NO_MATCH_M = 0.05  # farther from every node: hidden in the second frame


def read_nodes(path: Path) -> np.ndarray:
    """(n, 3) places of the nodes, metres."""
    places: np.ndarray = np.loadtxt(path, delimiter=",", skiprows=1)[:, 3:]
    return places


def match(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(n,) the node of the second frame for each of the first, -1 for none."""
    target, moved = cKDTree(second), first.copy()
    neighbours = cKDTree(first).query(first, min(max(NEIGHBOURS), len(first)))[1]
    for count in NEIGHBOURS:
        for _ in range(ROUNDS):
            wanted = second[target.query(moved)[1]] - first
            moved = first + wanted[neighbours[:, :count]].mean(axis=1)
    distance, nearest = target.query(moved)
    return np.where(distance < NO_MATCH_M, nearest, -1)


def main() -> None:
    """Writes a folder of answers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("benchmark", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--part", default="test", choices=["development", "test"])
    given = parser.parse_args()
    given.answers.mkdir(parents=True, exist_ok=True)
    about = {"format": "anchorpose-benchmark-answers", "version": 2, "method": "bending sheet", "source": "an example"}
    (given.answers / "answers.json").write_text(json.dumps(about))
    with (given.benchmark / "pairs.csv").open(newline="") as pairs, (given.answers / "matches.csv").open("w") as out:
        out.write("task,pair,node,match\n")
        for pair in csv.DictReader(pairs):
            if not pair["pair"].startswith(given.part):
                continue
            nodes = (read_nodes(given.benchmark / pair[frame]) for frame in ("first", "second"))
            for node, found in enumerate(match(*nodes)):
                out.write(f"{pair['task']},{pair['pair']},{node},{'' if found < 0 else found}\n")


if __name__ == "__main__":
    main()
