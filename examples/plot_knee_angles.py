"""Knee angles of a results folder as a picture: the band is 1.96 sigma, dots are inferred, gaps stay gaps.

python examples/plot_knee_angles.py RESULTS knees.png        (needs matplotlib)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pyarrow.parquet as pq


def main() -> None:
    """Draws both knees over time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("picture", type=Path)
    given = parser.parse_args()

    figure, axes = plt.subplots(figsize=(9, 3.5), layout="constrained")
    for side, colour, dash in (("left", "#0072b2", "-"), ("right", "#d55e00", "--")):
        rows = pq.read_table(given.results / "angles.parquet", filters=[("angle", "=", f"knee_flexion_{side}")])
        time_s, degrees, sigma_deg = (rows[name].to_numpy() for name in ("time_s", "degrees", "sigma_deg"))
        inferred = np.array([state not in ("observed", "lost") for state in rows["state"].to_pylist()])
        axes.plot(time_s, degrees, dash, color=colour, label=f"{side} knee")
        axes.fill_between(time_s, degrees - 1.96 * sigma_deg, degrees + 1.96 * sigma_deg, color=colour, alpha=0.2, lw=0)
        axes.plot(time_s[inferred], degrees[inferred], ".", color=colour)
    axes.set(xlabel="time (s)", ylabel="knee flexion (degrees)")
    axes.legend()
    figure.savefig(given.picture, dpi=150)


if __name__ == "__main__":
    main()
