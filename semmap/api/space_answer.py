"""What the methods of fields return: rows, counts and changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from semmap.html_table import html_table


class EntityVoxels(NamedTuple):
    """An entity, its kind, the number of its voxels and their volume in cubic metres."""

    name: str
    kind: str
    voxels: int
    volume: float


class KeptField(NamedTuple):
    """A stored field: its property, the entity it is about, its voxels and its versions."""

    name: str
    property: str
    about: str | None
    voxels: int
    versions: int


class FieldChanges(NamedTuple):
    """What an update changed: the names of new regions by blank node, and all changed names."""

    new: dict[str, str]
    changed: list[str]


@dataclass(frozen=True)
class SpaceAnswer(Sequence[tuple[Any, ...]]):
    """The answer of a query on fields: a sequence of rows; it is true if an ASK is.

    Attributes
    ----------
    names : the variables of a SELECT
    rows : names of entities, numbers, texts, and voxels as (x, y, z), metres in the map's frame
    total : the number of rows without the limit
    truth : the answer of an ASK
    stored : of STORE, a mapping with `property` and `voxels`, and `file`, `kept` and `version`
    left_out : the entities without voxels, of which the answer says nothing
    notes : who answered, and from what
    """

    names: tuple[str, ...] = ()
    rows: tuple[tuple[Any, ...], ...] = ()
    total: int = 0
    truth: bool | None = None
    stored: dict[str, Any] | None = None
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        """Whether an ASK is true; else, whether there are rows, or a map."""
        return bool(self.rows or self.stored) if self.truth is None else self.truth

    def __len__(self) -> int:
        """The number of rows."""
        return len(self.rows)

    def __getitem__(self, index: Any) -> Any:
        """A row, or a tuple of rows for a slice."""
        return self.rows[index]

    def _repr_html_(self) -> str:
        if self.truth is not None:
            return f"<p>{'yes' if self.truth else 'no'}</p>"
        if self.stored is not None:
            return html_table(list(self.stored), [tuple(self.stored.values())])
        return html_table(self.names, self.rows)
