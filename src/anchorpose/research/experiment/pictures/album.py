"""All pictures of one recording: what is drawn, in which order, and where it is written."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from anchorpose.recording.recording import Recording
from anchorpose.research.experiment.correspondence import Skin
from anchorpose.research.experiment.method import PROPOSED, Method
from anchorpose.research.experiment.pictures.canvas import Picture, View, as_png, own_style, upright_view
from anchorpose.research.experiment.pictures.hypotheses import hypothesis_pictures
from anchorpose.research.experiment.pictures.matches import match_pictures, pairs_of
from anchorpose.research.experiment.pictures.moments import Moment, Stage, set_stage, take_moment, taken_pixels
from anchorpose.research.experiment.pictures.regions import Holed, region_pictures
from anchorpose.research.experiment.pictures.tracked import follow, tracked_picture
from anchorpose.research.experiment.reference import Reference


@dataclass(frozen=True, slots=True, eq=False)
class _Sitting:
    """What is drawn from: the recording as it is and pierced, and the frames before and with the hole in both."""

    view: View
    skin: Skin
    whole: Moment
    hole: Moment
    pierced: Stage


def write_pictures(
    folder: Path, recording: Recording, pierced: Recording, reference: Reference, skin: Skin, hole_frame: int,
    methods: Sequence[Method], settings: Mapping[str, object], motions: Path,
) -> None:  # fmt: skip
    """Write *.png and pictures.json into a folder, a list of {"file", "caption", "section"} in the order to be shown.

    recording: simulated, ``skin`` is its truth; pierced: a copy with holes, one of them in ``hole_frame``, a position,
    and none in the frame before. settings: the chosen one of each method by its key. motions: the reference movements.
    Raises ValueError where the patient is not known in the frame before the hole; MissingPackage without matplotlib.
    """
    with own_style():
        sitting = _sit(recording, pierced, reference, skin, hole_frame, motions)
        seen = sitting.whole.window.observations[1]
        taken = taken_pixels(recording, pierced, hole_frame)
        holed = Holed(f"Frame {hole_frame}", seen.whole, seen.anchors, taken, reference.centre_m[hole_frame])
        pictures = chain(
            _matches(sitting, methods, settings),
            _proposed(sitting, methods, settings, hole_frame - 1),
            region_pictures(sitting.view, holed),
        )
        contents = [write_picture(folder, picture) for picture in pictures]
    (folder / "pictures.json").write_text(json.dumps(contents, indent=1) + "\n", encoding="utf-8")


def write_picture(folder: Path, picture: Picture) -> dict[str, str]:
    """Write the PNG; returns its entry in the list."""
    (folder / picture.file).write_bytes(as_png(picture.figure))
    return {"file": picture.file, "caption": picture.caption, "section": picture.section}


def _sit(
    recording: Recording, pierced: Recording, reference: Reference, skin: Skin, hole_frame: int, motions: Path
) -> _Sitting:
    if hole_frame < 1:
        raise ValueError(f"hole_frame must have a frame before it, got {hole_frame}")
    stages = [set_stage(each, reference, motions) for each in (recording, pierced)]
    whole = take_moment(stages[0], skin, hole_frame - 1, "whole", "Nothing hidden")
    hole = take_moment(stages[1], skin, hole_frame - 1, "hole", "With a hole in the second frame")
    return _Sitting(upright_view(stages[0].room.cameras[0]), skin, whole, hole, stages[1])


def _matches(sitting: _Sitting, methods: Sequence[Method], settings: Mapping[str, object]) -> Iterator[Picture]:
    for moment in (sitting.whole, sitting.hole):
        asked = [
            pairs_of(each, settings[each.key], moment) for each in methods if _on_these_meshes(each, moment, settings)
        ]
        yield from match_pictures(sitting.view, moment, [pairs for pairs in asked if pairs is not None])


def _on_these_meshes(method: Method, moment: Moment, settings: Mapping[str, object]) -> bool:
    """Whether the method pairs nodes, and of the meshes that are drawn: one that closes holes has others."""
    if method.associate is None:
        return False
    config = moment.window.config
    return method.configure(config, settings[method.key]).surface == config.surface


def _proposed(
    sitting: _Sitting, methods: Sequence[Method], settings: Mapping[str, object], start: int
) -> Iterator[Picture]:
    """Tracked joints and hypotheses of the proposed method, where it is among the methods."""
    for method in methods:
        if method.key == PROPOSED:
            setting, stage = settings[method.key], sitting.pierced
            frames = follow(stage, method, setting, start, sitting.skin.performance.joints_m())
            yield tracked_picture(sitting.view, method, frames, stage.room.recording.rate_hz, start)
            for moment in (sitting.whole, sitting.hole):
                yield from hypothesis_pictures(sitting.view, moment, method, setting)
