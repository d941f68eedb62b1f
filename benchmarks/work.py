"""Count the work of tracking and time its kernels alone, to find what a frame needs at least, on any machine.

Every kernel that Python calls is wrapped: the package's numba functions, the decoding of a depth image, and the
network. A call from one kernel to another belongs to the calling kernel. Counting begins when the body is learnt.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final
from unittest.mock import patch

from numba.core.dispatcher import Dispatcher

from anchorpose import pipeline
from anchorpose.body import fit, pose_probability
from anchorpose.descriptor import learnt
from anchorpose.recording import depth_image
from anchorpose.surface import mesh
from anchorpose.tracker.config import TrackConfig

SAMPLES: Final = 24  # calls of each kernel that are kept to be repeated
REPEATS: Final = 5  # repetitions of each kept call, of which the fastest counts


@dataclass(slots=True)
class Kernel:
    """Calls of a kernel, and some of their arguments."""

    call: Callable[..., Any]
    calls: int = 0
    kept: list[tuple[tuple[Any, ...], dict[str, Any]]] = field(default_factory=list)

    def note(self, args: tuple[Any, ...], kwargs: dict[str, Any]) -> None:
        """Count a call; keep its arguments if it is among the first calls or the number of calls is a power of two."""
        self.calls += 1
        if len(self.kept) < SAMPLES and (self.calls <= SAMPLES // 2 or self.calls & (self.calls - 1) == 0):
            self.kept.append((args, kwargs))

    def best_ms(self) -> float:
        """Return the mean over the kept calls, in milliseconds, of the fastest repetition of each call."""
        fastest = list[float]()
        for args, kwargs in self.kept:
            took = list[float]()
            for _ in range(REPEATS):
                begun = time.perf_counter()
                self.call(*args, **kwargs)
                took.append(time.perf_counter() - begun)
            fastest.append(min(took))
        return 1e3 * sum(fastest) / len(fastest) if fastest else 0.0


@dataclass(slots=True)
class Work:
    """What tracking did after the body was learnt.

    frames: number of tracked frames; spent_ms: their processor time; kernels: by name; counts: of the operations in
    ``COUNTED``.
    """

    frames: int = 0
    spent_ms: float = 0.0
    kernels: dict[str, Kernel] = field(default_factory=dict)
    counts: dict[str, float] = field(default_factory=dict)

    def per_frame(self) -> dict[str, float]:
        """Return the counts per frame: of compiled calls, and of the operations in ``COUNTED``."""
        calls = sum(kernel.calls for kernel in self.kernels.values())
        return {"compiled calls": calls / self.frames} | {k: n / self.frames for k, n in self.counts.items()}


Count = Callable[[tuple[Any, ...], Any], float]
COUNTED: Final[dict[str, tuple[Callable[..., Any], Count]]] = {
    "depth images decoded": (depth_image.decode_grey_png, lambda args, made: 1.0),
    "images described by the network": (learnt.describe, lambda args, made: 1.0),
    "nodes meshed": (mesh.build_surface, lambda args, made: float(len(made))),
    "steps of the solver": (fit.damped_step, lambda args, made: 1.0),
    "rows in them": (fit.damped_step, lambda args, made: float(len(args[2]))),
    "poses whose probability is asked for": (pose_probability.log_probability, lambda args, made: 1.0),
}


@contextmanager
def counted(work: Work) -> Iterator[None]:
    """Count kernel calls and the operations in ``COUNTED`` into ``work`` until the context ends."""
    wrappers = dict[int, Callable[..., Any]]()
    for name, (function, count) in COUNTED.items():
        work.counts[name] = 0.0
        wrappers[id(function)] = _counting(work, name, count, wrappers.get(id(function), function))
    kernels = [depth_image.decode_grey_png, learnt.describe, *_compiled()]
    for kernel in kernels:
        name = f"{kernel.__module__.removeprefix('anchorpose.')}.{kernel.__name__}"
        work.kernels[name] = Kernel(kernel)
        wrappers[id(kernel)] = _noting(work.kernels[name], wrappers.get(id(kernel), kernel))
    places = [
        (module, name, wrappers[id(value)])
        for module in _modules()
        for name, value in list(vars(module).items())
        if id(value) in wrappers
    ]
    patches = [patch.object(module, name, wrapper) for module, name, wrapper in places]
    for each in patches:
        each.start()
    try:
        yield
    finally:
        for each in patches:
            each.stop()


def _modules() -> list[Any]:
    return [module for name, module in list(sys.modules.items()) if name.startswith("anchorpose.") and module]


def _compiled() -> list[Any]:
    found = {id(value): value for module in _modules() for value in vars(module).values()}
    return [value for value in found.values() if isinstance(value, Dispatcher)]


def _counting(work: Work, name: str, count: Count, call: Callable[..., Any]) -> Callable[..., Any]:
    def counting(*args: Any, **kwargs: Any) -> Any:
        made = call(*args, **kwargs)
        work.counts[name] += count(args, made)
        return made

    return counting


def _noting(kernel: Kernel, call: Callable[..., Any]) -> Callable[..., Any]:
    def noting(*args: Any, **kwargs: Any) -> Any:
        kernel.note(args, kwargs)
        return call(*args, **kwargs)

    return noting


def work_of(recording: Path, config: TrackConfig) -> Work:
    """Track twice, and count in the second run, when all kernels are compiled."""
    work, tracked = Work(), pipeline.track_on

    def tracking(*args: Any) -> Any:
        begun = time.process_time()
        with counted(work):
            frames = list(tracked(*args))
        work.frames, work.spent_ms = len(frames), 1e3 * (time.process_time() - begun)
        return frames

    with TemporaryDirectory() as folder:
        for number in range(2):
            results = Path(folder) / str(number)
            results.mkdir()
            with patch.object(pipeline, "track_on", tracking if number else tracked):
                pipeline.track_recording(recording, results, config, lambda done, total: None)
    return work
