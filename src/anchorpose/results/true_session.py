"""Read from a truth.npz what happened in a simulated session: events in which something went wrong, and contacts with
the patient.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.body.contact_regions import REGION_BONES, REGIONS
from anchorpose.errors import InputError
from anchorpose.recording.regular_file import read_arrays
from anchorpose.results.frame_time import runs_of
from anchorpose.results.records import PERSON, Contact
from anchorpose.results.truth import FOOT_BONES

_EVENTS: Final = ("event_kind", "event_start_s", "event_end_s", "event_depth")
_TOUCH: Final = ("touched_regions", "region_names", "on_equipment", "equipment_names", "part_names", "time")
REMEDY: Final = "give the truth.npz of a simulated session as it was written"


@dataclass(frozen=True, slots=True)
class TrueEvent:
    """A true event. kind: as in episodes.parquet, or clonus_left, clonus_right. start_s, end_s: on the truth's clock.
    depth: in the unit of events of this kind.
    """

    kind: str
    start_s: float
    end_s: float
    depth: float


def read_true_events(path: Path) -> tuple[TrueEvent, ...] | None:
    """Return the true events in the order of the file; None if the file is not the truth of a session.

    Raises InputError if its arrays do not fit each other.
    """
    arrays = read_arrays(path, _EVENTS, REMEDY)
    if not arrays:
        return None
    columns = [arrays.get(name, np.zeros(0)) for name in _EVENTS]
    alike = all(column.ndim == 1 and len(column) == len(columns[0]) for column in columns)
    if not alike or any(column.dtype.kind not in "fiu" or not np.isfinite(column).all() for column in columns[1:]):
        raise InputError(path, "its arrays event_kind, _start_s, _end_s and _depth do not fit", REMEDY)
    rows = zip(columns[0].tolist(), *(column.tolist() for column in columns[1:]), strict=True)
    return tuple(TrueEvent(str(kind), *numbers) for kind, *numbers in rows)


@dataclass(frozen=True, slots=True)
class TrueContacts:
    """The true contacts of a session. contacts: contacts of a region of the body with a person or with a part of the
    equipment; equipment: names of all parts of the equipment.
    """

    contacts: tuple[Contact, ...]
    equipment: tuple[str, ...]


def read_true_contacts(path: Path, rows: np.ndarray, frame: np.ndarray, time_s: np.ndarray) -> TrueContacts:
    """Return the contacts in the frames ``rows`` (t,) of the truth, with the numbers frame (t,) and times time_s (t,)
    of the result's frames.

    Raises InputError if the arrays do not fit each other.
    """
    arrays = read_arrays(path, _TOUCH, REMEDY)
    touched, on_equipment = arrays.get("touched_regions"), arrays.get("on_equipment")
    regions, bones, parts = (
        tuple(map(str, arrays.get(name, np.zeros(0)).ravel()))
        for name in ("region_names", "part_names", "equipment_names")
    )
    frames = len(arrays["time"])
    if touched is None or on_equipment is None or set(regions) - set(REGIONS):
        raise InputError(path, "lacks touched_regions and on_equipment of a session", REMEDY)
    if touched.shape[::2] != (frames, len(regions)) or on_equipment.shape != (frames, len(parts), len(bones)):
        raise InputError(path, "its touched_regions and on_equipment do not fit", REMEDY)
    numbered, found = (frame, time_s), list[Contact]()
    for column, region in enumerate(regions):
        found += _contacts(touched[rows][:, :, column].any(axis=1), numbered, region, PERSON)
    for column, part in enumerate(parts):
        for region, own in _judged_regions(bones):
            found += _contacts(on_equipment[rows][:, column, own].any(axis=1), numbered, region, part)
    return TrueContacts(tuple(found), parts)


def _judged_regions(bones: tuple[str, ...]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the regions of the body that consist of bones (knees do not), with the indices (k,) of these bones in
    ``bones``. Feet are left out, since they always touch something.
    """
    for region, names in REGION_BONES.items():
        if not region.startswith("knee") and not set(names) & FOOT_BONES:
            yield region, np.flatnonzero([bone in names for bone in bones])


def _contacts(flags: np.ndarray, numbered: tuple[np.ndarray, np.ndarray], part: str, with_: str) -> Iterator[Contact]:
    """Yield the contacts of a region in the frames that ``flags`` (t,) marks, each as completely seen. numbered: frame
    numbers (t,) and times (t,).
    """
    frame, time_s = numbered
    for run in runs_of(flags):
        first, last = run.start, run.stop - 1
        yield Contact(
            part=part,
            person="somebody" if with_ == PERSON else None,
            with_=with_,
            first_frame=int(frame[first]),
            last_frame=int(frame[last]),
            start_s=float(time_s[first]),
            end_s=float(time_s[last]),
            seen_share=1.0,
            area_cm2=0.0,
            gap_mm=0.0,
        )
