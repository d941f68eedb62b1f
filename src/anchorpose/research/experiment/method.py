"""Define a compared method: a way to match the nodes of the patient's surface in two frames, or a complete tracker."""

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
"""Key of the paper's method, exactly as the paper's text describes the method."""

OWN: Final = "own"
"""Key of this project's tracker. Other methods of ``Family.TRACKER`` are this tracker without one of its components."""

NEXT: Final = "next"
"""Key of the next generation of the paper's method, which the paper calls future work."""

# bytes, maximum size of a cache of one method's descriptors: with the longest descriptor, enough for twelve frames;
# with most other descriptors, for all frames of a segment
CACHED_BYTES: Final = 400_000_000
# maximum number of pairs of frames whose matches are cached: enough for a segment of a recording, in all forms of the
# paper's framework, with two sizes of hole
CACHED_PAIRS: Final = 48


class Family(StrEnum):
    """The family of a method, as in the paper's related work."""

    PROPOSED = "proposed"  # geodesic distances to the anchors, the feature that the paper proposes
    LOCAL = "local"  # descriptors of the points and normals around a node
    SPECTRAL = "spectral"  # descriptors from eigenvalues and eigenvectors of the surface's Laplacian
    MESH = "mesh"  # descriptors of the mesh around a node
    GLOBAL = "global"  # all nodes are matched together, by the distances between them
    LEARNT = "learnt"  # place of a node on the body, found by a network
    NONE = "none"  # no descriptor: nodes are not matched, or are matched with the nearest node
    TRACKER = "tracker"  # this project's complete tracker, which does not run in the paper's framework


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """A method and its possible settings. The setting to use is chosen on the training recordings.

    anchored: whether the method uses anchors (tips of head, hands and feet). update: the way in which matches update
    the pose. own_surface: whether an arm is moved if its hand is seen elsewhere than the pose states. If ``anchored``
    is False, the method is called only once for observations that differ only in their anchors.
    """

    key: str
    title: str
    family: Family
    source: str
    settings: tuple[Any, ...] = (None,)
    # function that returns, for a setting, the function that matches two frames; None for a complete tracker
    associate: Callable[[Any], Associate] | None = None
    # function of the configuration of the paper's framework and of a setting; returns the configuration with which the
    # method runs
    configure: Callable[[TrackConfig, Any], TrackConfig] = lambda config, setting: config
    several: bool = False  # whether a node has several hypotheses (possible matches), from which the track tree chooses
    anchored: bool = True
    update: Update = Update.PARTS
    own_surface: bool = False
    content: str = ""  # digest of the file that defines the method; empty for methods of the package
    frame_ms: float = 100.0  # ms, approximate time per frame of 3,000 nodes on one core, for estimates of durations


@dataclass(frozen=True, slots=True, kw_only=True)
class DescriptorSetting:
    """The configuration of a descriptor, and the metric by which the nearest descriptor is found."""

    config: Any
    metric: Metric = Metric.EUCLIDEAN


def by_descriptor(describe: Callable[[Observation, Any], np.ndarray]) -> Callable[[Any], Associate]:
    """Return a function for ``Method.associate``, by which each node matches the node of the next frame with the
    nearest descriptor.

    Source: the paper, Section VI-A.
    describe: function that returns the descriptors (n, d) of a frame's seen nodes; NaN for a node without a descriptor.
    """

    def associate(setting: DescriptorSetting) -> Associate:
        described = cached(lambda seen: describe(seen, setting.config), _surface_content)

        def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
            # the first call matches all nodes at once and keeps the result; this is faster than matching a few nodes
            # per call, since nearly all matches are requested in the end
            @cache
            def match() -> np.ndarray:
                return nearest_descriptor(described(now), described(following), setting.metric)

            def find(nodes: np.ndarray) -> np.ndarray:
                return match()[nodes][:, None]

            return Matcher(find, len(now.surface), NO_SUBSET)

        return pair

    return associate


Content = Callable[[Observation], bytes]
"""Function that returns a digest of the part of a frame (such as its surface) on which a computation depends."""


def cached(compute: Callable[..., np.ndarray], content: Content) -> Callable[..., np.ndarray]:
    """Return ``compute`` with a cache: its value is computed only once for frames with the same ``content``.

    A full cache (``CACHED_BYTES``) drops values; dropped values are computed again when they are needed.
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
    """Return the method's function that matches two frames, with a cache.

    A pair of frames is matched only once, even if several forms (variants) of the paper's framework need its matches.
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
    """Return a digest of a frame's surface, including the edges of its mesh and the links between its nodes."""
    whole = seen.whole
    return _digest(seen.surface.points_m, whole.points_m, whole.ring, whole.link_node, whole.link_length_m)


def seen_content(seen: Observation) -> bytes:
    """Return a digest of the seen nodes and their normals, but not of the edges and links between them."""
    return _digest(seen.surface.points_m, seen.surface.normals)


def _digest(*arrays: np.ndarray) -> bytes:
    return hashlib.sha256(b"".join(np.ascontiguousarray(one).tobytes() for one in arrays)).digest()


NO_SUBSET: Final = np.empty((1, 0), np.int64)
"""The subsets of anchors of a method that uses no anchors: a single empty subset."""


def load_methods(wanted: Sequence[str]) -> tuple[Method, ...]:
    """Return the methods that ``wanted`` names by their keys or files, in the order of ``wanted``.

    If ``wanted`` is empty, all methods of the package are returned. A file is a Python module with ``METHODS``, a tuple
    of one method. Raises InputError for an unknown key, a key that two methods have, and a file without ``METHODS``.
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
    """Return all METHODS of the modules in the package ``methods``, sorted by family."""
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
