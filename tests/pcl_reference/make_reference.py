"""PCL's numbers for a few points of a fixed cloud: python tests/pcl_reference/make_reference.py (no test).

Writes reference.npz beside this file; the tests compare with it and do not need PCL. Made with Debian's PCL 1.13.0.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from feature_shapes import bumpy_torus

sys.path.insert(0, str(Path(__file__).resolve().parent))
from pcl import SIZES, ask, build

RADIUS_M = 0.12  # some forty neighbours
CHOSEN = 30


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", type=Path, default=Path("build") / "pcl_features", help="where to compile")
    program = build(parser.parse_args().build)
    points, normals, triangles = bumpy_torus()
    chosen = np.linspace(0, len(points) - 1, CHOSEN).astype(np.int32)
    rows = {name: ask(program, name, points, normals, triangles, chosen, RADIUS_M)[0] for name in SIZES}
    cloud = {"points_m": points, "normals": normals, "triangles": triangles.astype(np.int16), "chosen": chosen}
    np.savez_compressed(Path(__file__).parent / "reference.npz", radius_m=RADIUS_M, **cloud, **rows)


if __name__ == "__main__":
    main()
