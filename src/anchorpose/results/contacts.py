"""contacts.parquet: which part of the patient was touched by whom, from when to when."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pyarrow as pa

from anchorpose.body.contact_regions import REGIONS
from anchorpose.errors import InputError
from anchorpose.results.tables import RowGroups, open_parquet, read_parquet

CONTACTS_FILE: Final = "contacts.parquet"

CONTACTS_SCHEMA: Final = pa.schema(
    [
        pa.field("part", pa.string(), nullable=False),
        pa.field("person", pa.string(), nullable=False),
        pa.field("first_frame", pa.int32(), nullable=False),
        pa.field("last_frame", pa.int32(), nullable=False),
        pa.field("start_s", pa.float64(), nullable=False),
        pa.field("end_s", pa.float64(), nullable=False),
        pa.field("state", pa.string(), nullable=False),
        pa.field("seen_share", pa.float64(), nullable=False),
        pa.field("area_cm2", pa.float64(), nullable=False),
        pa.field("gap_mm", pa.float64(), nullable=False),
    ]
)

CONTACTS_PER_ROW_GROUP: Final = 1024
"""Fixed, since row groups decide the bytes of the file."""

SEEN, INFERRED = "seen", "inferred"


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """One part of the patient touched by one person without a break.

    part: one of ``REGIONS``. person: a name that stays the same as long as this person is followed. first_frame,
    last_frame and start_s, end_s: both ends belong to it. seen_share: of the touching skin, how much some camera saw at
    the time; the rest was remembered from shortly before. area_cm2: of the patient's skin that is in reach, mean over
    the frames. gap_mm: least distance of the two skins as measured, which cameras see from outside.
    """

    part: str
    person: str
    first_frame: int
    last_frame: int
    start_s: float
    end_s: float
    seen_share: float
    area_cm2: float
    gap_mm: float

    @property
    def state(self) -> str:
        """``seen`` where most of the touching skin was, else ``inferred``."""
        return SEEN if self.seen_share >= 0.5 else INFERRED


@contextmanager
def write_contacts(path: Path) -> Iterator[RowGroups[Contact]]:
    """Opens contacts.parquet for writing; rows stand in the order in which contacts end."""
    with open_parquet(path, CONTACTS_SCHEMA) as writer:
        contacts = RowGroups(writer, _to_table, CONTACTS_PER_ROW_GROUP)
        yield contacts
        contacts.flush()


def _to_table(contacts: Sequence[Contact]) -> pa.Table:
    columns = [
        pa.array([getattr(contact, field.name) for contact in contacts], field.type) for field in CONTACTS_SCHEMA
    ]
    return pa.Table.from_arrays(columns, schema=CONTACTS_SCHEMA)


def read_contacts(path: Path) -> tuple[Contact, ...]:
    """All rows of a contacts.parquet; raises InputError where it is none."""
    rows = read_parquet(path, CONTACTS_SCHEMA).to_pylist()
    for row in rows:
        if row["part"] not in REGIONS:
            raise InputError(path, f"holds the unknown part '{row['part']}'", "track the recording again")
    return tuple(Contact(**{name: value for name, value in row.items() if name != "state"}) for row in rows)
