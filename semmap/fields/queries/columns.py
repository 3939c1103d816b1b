"""Statements of properties as columns: the form in which queries read fields.

A voxel is one 64-bit key, so that a join of two fields is a search in sorted integers.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from datetime import datetime
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from semmap.error import Error
from semmap.language.schema import Property, Schema


class UnknownError(Error, LookupError):
    """Nothing states what is queried, so that the answer is neither yes nor no."""


@dataclass(frozen=True, eq=False)
class VoxelColumn:
    """A column of voxels: (N,) keys."""

    keys: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.keys)


@dataclass(frozen=True, eq=False)
class Entities:
    """A column of entities or semantic types: (N,) indices into `names`."""

    codes: NDArray[np.int32]
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.codes)

    @classmethod
    def from_names(cls, names: Iterable[str]) -> Entities:
        """Make a column with a row for each name."""
        rows = list(names)
        known = tuple(dict.fromkeys(rows))
        code = {name: i for i, name in enumerate(known)}
        return cls(np.array([code[name] for name in rows], np.int32), known)


@dataclass(frozen=True, eq=False)
class Numbers:
    """A column of numbers: (N,) values."""

    values: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.values)


StatementColumn = VoxelColumn | Entities | Numbers


class Statements(NamedTuple):
    """Rows of subject and object; no row occurs twice."""

    subject: StatementColumn
    object: StatementColumn


class Demand(NamedTuple):
    """Which statements are read."""

    subjects: Collection[str] | None = None  # entities to which that side is limited
    objects: Collection[str] | None = None  # likewise
    # ascending keys of voxels that the subjects may have. Other subjects may be returned, too: this
    # only saves work
    within: NDArray[np.int64] | None = None


ALL = Demand()


class StatementRelation(Protocol):
    """States a property: a map, a region map, or what is computed from them."""

    @property
    def property(self) -> Property:
        """The property that it states."""
        ...

    def statements(self, wanted: Demand = ALL) -> Statements:
        """Return the statements, as far as they are wanted."""
        ...


class Catalogue(Schema, Protocol):
    """The properties that queries may read, and their statements."""

    @property
    def voxel_size(self) -> float:
        """Edge of a voxel in metres; all voxels of a catalogue are of one lattice."""
        ...

    def relation(self, property: Property) -> StatementRelation:
        """Return the relation that states a property of the catalogue."""
        ...

    def during(self, begin: datetime, end: datetime) -> Catalogue:
        """Return a catalogue that states all that was stated at any time in between."""
        ...
