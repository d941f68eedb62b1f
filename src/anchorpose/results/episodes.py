"""episodes.parquet: from when to when the patient was upright, stood up and sat down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

import pyarrow as pa

from anchorpose.errors import InputError
from anchorpose.joints import JointState
from anchorpose.results.tables import open_parquet, read_parquet

EPISODES_FILE: Final = "episodes.parquet"

EPISODES_SCHEMA: Final = pa.schema(
    [
        pa.field("kind", pa.string(), nullable=False),
        pa.field("first_frame", pa.int32(), nullable=False),
        pa.field("last_frame", pa.int32(), nullable=False),
        pa.field("start_s", pa.float64(), nullable=False),
        pa.field("end_s", pa.float64(), nullable=False),
        pa.field("state", pa.string(), nullable=False),
    ]
)

UPRIGHT_EPISODE, SIT_TO_STAND, STAND_TO_SIT = "upright", "sit_to_stand", "stand_to_sit"

EPISODE_KINDS: Final = (UPRIGHT_EPISODE, SIT_TO_STAND, STAND_TO_SIT)


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """A stretch of time without a break.

    kind: one of ``EPISODE_KINDS``. first_frame, last_frame and start_s, end_s: both ends belong to it. state: the worst
    of the joints that it was told by, in any of its frames.
    """

    kind: str
    first_frame: int
    last_frame: int
    start_s: float
    end_s: float
    state: JointState

    @property
    def seconds(self) -> float:
        """From its first frame to its last."""
        return self.end_s - self.start_s


def write_episodes(path: Path, episodes: Sequence[Episode]) -> None:
    """Writes episodes.parquet by the time they begin; the same bytes for the same episodes."""
    ordered = sorted(episodes, key=lambda episode: (episode.start_s, EPISODE_KINDS.index(episode.kind)))
    columns = [
        pa.array([str(getattr(e, field.name)) if field.name == "state" else getattr(e, field.name) for e in ordered],
                 field.type)
        for field in EPISODES_SCHEMA
    ]  # fmt: skip
    with open_parquet(path, EPISODES_SCHEMA) as writer:
        writer.write_table(pa.Table.from_arrays(columns, schema=EPISODES_SCHEMA))


def read_episodes(path: Path) -> tuple[Episode, ...]:
    """All rows of an episodes.parquet; raises InputError where it is none."""
    rows = read_parquet(path, EPISODES_SCHEMA).to_pylist()
    states = {str(state) for state in JointState}
    for row in rows:
        for column, known in (("kind", EPISODE_KINDS), ("state", states)):
            if row[column] not in known:
                problem = f"holds the unknown {column} '{row[column]}'"
                raise InputError(path, problem, "run 'anchorpose measure' on its folder again")
    names = [field.name for field in fields(Episode)]
    return tuple(Episode(**{name: row[name] for name in names} | {"state": JointState(row["state"])}) for row in rows)
