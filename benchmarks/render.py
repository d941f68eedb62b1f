"""How long one simulated frame takes, by step: python benchmarks/render.py [--sensor kinect-v2]."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from anchorpose.simulate.clinic import draw_clinic, random_stream
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.render import draw_figures
from anchorpose.simulate.sensor import SENSORS, sense
from anchorpose.simulate.shoot import set_up
from anchorpose.simulate.write import simulate_recording, touches

REPEATS = 25


def milliseconds(step: Callable[[], object]) -> float:
    """Median time of a step, compilation left out."""
    step()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        step()
        times.append(time.perf_counter() - start)
    return 1000.0 * median(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sensor", choices=list(SENSORS), default="kinect-v2")
    config = SimulationConfig(seed=2, seconds=4.0, fps=15.0, therapists=2, sensor=parser.parse_args().sensor)
    clinic = draw_clinic(config)
    studio = set_up(clinic)
    performance, camera, still = studio.performances[0], clinic.cameras[0], studio.stills[0]
    figures = performance.figures(30)
    picture = draw_figures(camera, still, figures)
    rng = random_stream(config, "sensor", 0, 30)
    steps: list[tuple[str, Callable[[], object]]] = [
        ("draw the cast and the scenery", lambda: draw_clinic(config)),
        (f"poses of three people, {config.frames} frames", lambda: clinic.act(performance.times_s)),
        ("skin of three people", lambda: performance.figures(30)),
        ("one camera's picture of three people", lambda: draw_figures(camera, still, figures)),
        (
            "sensor error",
            lambda: sense(rng, SENSORS[config.sensor], picture.depth_m, picture.cosine, studio.readers[0].wiggle_m),
        ),
        ("contacts", lambda: touches(clinic, performance, figures, 30)),
    ]
    for name, step in steps:
        print(f"{name:45s} {milliseconds(step):8.1f} ms")
    with TemporaryDirectory() as folder:
        start = time.perf_counter()
        simulate_recording(Path(folder) / "clinic", config)
        each = (time.perf_counter() - start) / (config.frames * config.cameras)
        print(f"{'all of it, files written, a camera and frame':45s} {1000.0 * each:8.1f} ms")


if __name__ == "__main__":
    main()
