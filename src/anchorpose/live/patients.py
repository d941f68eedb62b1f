"""The results of a live session: of its last patient, and of each earlier one in a folder of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from anchorpose.live.first_seconds import Prepared, in_room
from anchorpose.tracker.frame_record import TrackedFrame
from anchorpose.tracker.journal import Blocks
from anchorpose.writing import write_results


@dataclass(frozen=True, slots=True, eq=False)
class LivePatient:
    """A person who is or was the patient. number: in the session, from 1; blocks: the tracked frames, as stored."""

    number: int
    prepared: Prepared
    blocks: Blocks[TrackedFrame]

    @property
    def first_frame(self) -> int | None:
        """Number of the first frame that is stored, None where none is."""
        return next((one.record.joints.frame for one in self.blocks.read()), None)


def write_patients(results: Path, patients: Sequence[LivePatient], recorded: Path | None, notes: Sequence[str]) -> None:
    """Write the last patient's results into an existing folder, and those of each earlier one into a folder in it.

    recorded: a recording of the session, from which pictures are made; None: they are made of the first seconds. notes:
    on the session, for every ``run.json``.
    """
    *earlier, last = patients
    changes = list[str]()
    for one, following in zip(earlier, patients[1:], strict=True):
        folder, frame = f"earlier-patient-{one.number}", following.first_frame
        (results / folder).mkdir()
        _write(results / folder, one, recorded, [f"from frame {frame} on, another person was the patient", *notes])
        changes.append(f"until frame {frame}, another person was the patient: the results are in {folder}")
    if earlier:
        changes.append("who is the patient now was chosen on the page; nothing was stated of this person")
    _write(results, last, recorded, [*changes, *notes])


def _write(results: Path, patient: LivePatient, recorded: Path | None, notes: Sequence[str]) -> None:
    run, learnt, inputs = patient.prepared.run, patient.prepared.learnt, patient.prepared.inputs
    room = run.room if recorded is None else replace(run.room, recording=in_room(recorded, run.room))
    run = replace(run, room=replace(room, notes=(*room.notes, *notes)))
    write_results(results, patient.blocks.read(), run, learnt, inputs)
