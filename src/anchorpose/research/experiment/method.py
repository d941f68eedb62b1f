"""Define the interface of all compared methods, each of which matches the nodes of two frames."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import pkgutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.research.experiment.config import Update
from anchorpose.research.features.nearest import Metric, nearest_descriptor
from anchorpose.track_tree.hypotheses import Matcher
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.observing import Associate

PROPOSED: Final = "anchors"
"""Key of the paper's method with the repairs that docs/experiment.md lists."""

LITERAL: Final = "paper"
"""Key of the paper's method exactly as its text describes it."""

OWN: Final = "own"
"""Key of this project's tracker. The other methods of its family are this tracker without one of its components."""

NEXT: Final = "next"
"""Key of the next generation of the paper's method, which the paper calls future work."""

# bytes of cached descriptors: enough for twelve frames of the largest descriptor, or a segment of most others
CACHED_BYTES: Final = 400_000_000
# pairs of frames whose matches are cached: enough for all pairs of a segment at two sizes of hole in all forms
CACHED_PAIRS: Final = 48


class Family(StrEnum):
    """The family of a method, as in the paper's related work."""

    PROPOSED = "proposed"  # distances to anchors
    LOCAL = "local"  # local appearance
    SPECTRAL = "spectral"  # local descriptors from the surface's spectrum
    MESH = "mesh"  # local descriptors on the mesh
    GLOBAL = "global"  # matches by all distances at once
    LEARNT = "learnt"  # places on the body, found by a network
    NONE = "none"  # no association, only the framework
    TRACKER = "tracker"  # this project's own tracker, outside the framework


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """A method and its settings. The setting that is used is chosen on the training recordings.

    For ``anchored``, ``update`` and ``own_surface`` see ``paper_tracker.Way``. A method that is not anchored is called
    only once for frames that differ only in their anchors.
    """

    key: str
    title: str
    family: Family
    source: str
    settings: tuple[Any, ...] = (None,)
    # function that makes the association of two frames from a setting; None for a complete tracker
    associate: Callable[[Any], Associate] | None = None
    # function that makes further changes to the configuration of the framework, or of a complete tracker
    configure: Callable[[TrackConfig, Any], TrackConfig] = lambda config, setting: config
    several: bool = False  # whether it makes several hypotheses per node, so that the tree must choose
    anchored: bool = True
    update: Update = Update.PARTS
    own_surface: bool = False
    content: str = ""  # digest of the file that defines the method; empty for methods of the package
    frame_ms: float = 100.0  # approximate time per frame of 3,000 nodes on one core, for estimates of durations


@dataclass(frozen=True, slots=True, kw_only=True)
class DescriptorSetting:
    """A descriptor's own configuration, and the metric of its nearest neighbour."""

    config: Any
    metric: Metric = Metric.EUCLIDEAN


def by_descriptor(describe: Callable[[Observation, Any], np.ndarray]) -> Callable[[Any], Associate]:
    """Match each node with the node of the next frame whose descriptor is nearest (paper, Section V-A).

    describe: function that returns the descriptors (n, d) of a frame's seen nodes; NaN for a node without a descriptor.
    """

    def associate(setting: DescriptorSetting) -> Associate:
        described = cached(lambda seen: describe(seen, setting.config), _surface_content)

        def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
            @cache  # nearly all nodes are needed in the end, and computing all at once is faster
            def match() -> np.ndarray:
                return nearest_descriptor(described(now), described(following), setting.metric)

            def find(nodes: np.ndarray) -> np.ndarray:
                return match()[nodes][:, None]

            return Matcher(find, len(now.surface), NO_SUBSET)

        return pair

    return associate


Content = Callable[[Observation], bytes]
"""Function that returns a digest of the part of a frame on which a computation depends."""


def cached(compute: Callable[..., np.ndarray], content: Content) -> Callable[..., np.ndarray]:
    """Return a function of frames with a cache.

    Its value is computed only once for frames of the same content, unless the cache had to drop it.
    """
    recent: dict[bytes, np.ndarray] = {}

    def known(*seen: Observation) -> np.ndarray:
        key = b"".join(map(content, seen))
        recent[key] = recent.pop(key) if key in recent else compute(*seen)
        while len(recent) > 2 and sum(one.nbytes for one in recent.values()) > CACHED_BYTES:
            del recent[next(iter(recent))]  # the entry that has not been used for the longest time
        return recent[key]

    return known


def associate_once(method: Method, setting: Any) -> Associate:
    """Return the method's association with a cache.

    The association of two frames with the same content is made only once for all forms of the framework.
    """
    if method.associate is None:
        raise ValueError(f"{method.key} has no association that the framework could use")
    associate, content = method.associate(setting), whole_content if method.anchored else _surface_content
    recent: dict[bytes, Matcher] = {}

    def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
        key = content(now) + content(following)
        recent[key] = recent.pop(key) if key in recent else associate(now, following, config)
        if len(recent) > CACHED_PAIRS:
            del recent[next(iter(recent))]
        return recent[key]

    return pair


def whole_content(seen: Observation) -> bytes:
    """Return a digest of the surface and the anchors of a frame."""
    return _surface_content(seen) + _digest(seen.anchors.node)


def _surface_content(seen: Observation) -> bytes:
    """Return a digest of the surface."""
    whole = seen.whole
    return _digest(seen.surface.points_m, whole.points_m, whole.ring, whole.link_node, whole.link_length_m)


def seen_content(seen: Observation) -> bytes:
    """Return a digest of the seen nodes and their normals. It does not depend on how the mesh is cut or closed."""
    return _digest(seen.surface.points_m, seen.surface.normals)


def _digest(*arrays: np.ndarray) -> bytes:
    return hashlib.sha256(b"".join(np.ascontiguousarray(one).tobytes() for one in arrays)).digest()


NO_SUBSET: Final = np.empty((1, 0), np.int64)
"""The subsets of a method without anchors: a single empty subset."""


def load_methods(wanted: Sequence[str]) -> tuple[Method, ...]:
    """Return the methods with these keys or from these files, in this order.

    If ``wanted`` is empty, all methods of the package are returned. A file is a Python module with ``METHODS``, a tuple
    of methods. Raises InputError for an unknown key, and for a file without a method.
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
    """Return all METHODS of the modules in ``methods``, by family."""
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
            path,
            "does not define METHODS, one Method in a tuple",
            "see anchorpose/research/experiment/methods for examples",
        )
    return replace(methods[0], content=hashlib.sha256(path.read_bytes()).hexdigest())
