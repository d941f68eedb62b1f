"""The interface of all methods that are compared: each matches the nodes of two frames."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import pkgutil
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.association.hypotheses import Matcher
from anchorpose.errors import InputError
from anchorpose.research.features.nearest import Metric, nearest_descriptor
from anchorpose.tracker.association import Associate
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation

PROPOSED: Final = "anchors"
"""Key of the paper's method as a whole."""

OWN: Final = "own"
"""Key of this project's tracker; the other methods of its family are its ablation."""

CACHED_FRAMES: Final = 8  # frames whose descriptors are kept: twice the look-ahead


class Family(StrEnum):
    """The kind of a method, by the paper's related work."""

    PROPOSED = "proposed"  # distances to anchors
    LOCAL = "local"  # local appearance
    SPECTRAL = "spectral"  # local, from the surface's spectrum
    MESH = "mesh"  # local, on the mesh
    GLOBAL = "global"  # all distances
    NONE = "none"  # no association: the framework by itself
    TRACKER = "tracker"  # not in the framework: this project's own tracker


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """A method and its settings, of which the training recordings choose one.

    associate: makes the association of two frames from a setting; None for a complete tracker. configure: other changes
    to the framework's configuration (for a tracker: to the defaults). sampled: slow or less important, so it runs on a
    random sample of the segments. frame_ms: approximate time of a frame of 2,000 nodes on one core, to estimate the
    duration of an experiment. several: it makes several hypotheses per node, among which only the tree can choose.
    content: digest of the file that it comes from; empty for those of the package.
    """

    key: str
    title: str
    family: Family
    source: str
    settings: tuple[Any, ...] = (None,)
    associate: Callable[[Any], Associate] | None = None
    configure: Callable[[TrackConfig, Any], TrackConfig] = lambda config, setting: config
    sampled: bool = True
    several: bool = False
    content: str = ""
    frame_ms: float = 100.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DescriptorSetting:
    """A descriptor's own configuration, and the metric of its nearest neighbour."""

    config: Any
    metric: Metric = Metric.EUCLIDEAN


def by_descriptor(describe: Callable[[Observation, Any], np.ndarray]) -> Callable[[Any], Associate]:
    """Each node is matched with the node of the next frame whose descriptor is nearest (paper, Section V-A).

    describe: (n, d) descriptors of a frame's seen nodes under a configuration, NaN rows where undefined.
    """

    def associate(setting: DescriptorSetting) -> Associate:
        @cached_per_frame
        def described(seen: Observation) -> np.ndarray:
            return describe(seen, setting.config)

        def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
            def find(nodes: np.ndarray) -> np.ndarray:
                return nearest_descriptor(described(now)[nodes], described(following), setting.metric)[:, None]

            return Matcher(find, len(now.surface), NO_SUBSET)

        return pair

    return associate


def cached_per_frame(describe: Callable[[Observation], np.ndarray]) -> Callable[[Observation], np.ndarray]:
    """The same function, computed once for each frame of the look-ahead."""
    recent: deque[tuple[Observation, np.ndarray]] = deque(maxlen=CACHED_FRAMES)

    def described(seen: Observation) -> np.ndarray:
        for known, descriptor in recent:
            if known is seen:
                return descriptor
        recent.append((seen, describe(seen)))
        return recent[-1][1]

    return described


NO_SUBSET: Final = np.empty((1, 0), np.int64)
"""The subsets of a method without anchors: one, empty."""


def load_methods(wanted: Sequence[str]) -> tuple[Method, ...]:
    """The methods of these keys or files, in this order; all of the package where none is named.

    A file is a Python module with ``METHODS``, a tuple of one. Raises InputError for an unknown key and a file without
    a method.
    """
    shipped = shipped_methods()
    if not wanted:
        return shipped
    by_key = {method.key: method for method in shipped}
    methods = tuple(by_key[name] if name in by_key else _from_file(name, list(by_key)) for name in wanted)
    for method in methods:
        if sum(other.key == method.key for other in methods) > 1 or (method.content and method.key in by_key):
            raise InputError(Path(method.key), "is the key of two methods", "give each method a key of its own")
    return methods


def shipped_methods() -> tuple[Method, ...]:
    """All METHODS of the modules in ``methods``, by family."""
    from anchorpose.research.experiment import methods

    modules = [importlib.import_module(f"{methods.__name__}.{m.name}") for m in pkgutil.iter_modules(methods.__path__)]
    found = [method for module in modules for method in module.METHODS]
    return tuple(sorted(found, key=lambda method: list(Family).index(method.family)))


def _from_file(name: str, keys: Sequence[str]) -> Method:
    path = Path(name)
    if path.suffix != ".py" or not path.is_file():
        raise InputError(path, "is not a method", f"choose among {', '.join(keys)}, or name a Python file with METHODS")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise InputError(path, "cannot be imported", "check the file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    methods = getattr(module, "METHODS", None)
    if not (isinstance(methods, tuple) and len(methods) == 1 and isinstance(methods[0], Method)):
        raise InputError(
            path, "has no METHODS of one Method", "see anchorpose/research/experiment/methods for examples"
        )
    return replace(methods[0], content=hashlib.sha256(path.read_bytes()).hexdigest())
