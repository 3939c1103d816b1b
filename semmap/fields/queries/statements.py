"""What properties state, as columns: the form in which queries take fields.

A voxel is one 64-bit key, so that a join of two fields is a search in sorted integers.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from datetime import datetime
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from semmap.language.property import Property

__all__ = [
    "Catalogue",
    "Column",
    "Numbers",
    "Relation",
    "Statements",
    "Things",
    "Voxels",
    "keys_of",
    "voxels_of_keys",
]

_BITS = 21
_HALF = 1 << (_BITS - 1)


def keys_of(voxels: NDArray[np.int32]) -> NDArray[np.int64]:
    """(N,) a key for each of (N, 3) voxels, ascending as they do; indices within 2**20 of 0.

    Raises
    ------
    ValueError
        A voxel further away (52 km at 5 cm).
    """
    shifted = voxels.astype(np.int64) + _HALF
    if shifted.size and (shifted.min() < 0 or shifted.max() >= 2 * _HALF):
        raise ValueError(f"a voxel lies more than {_HALF} voxels from the origin")
    keys: NDArray[np.int64] = (
        (shifted[:, 0] << (2 * _BITS)) | (shifted[:, 1] << _BITS) | shifted[:, 2]
    )
    return keys


def voxels_of_keys(keys: NDArray[np.int64]) -> NDArray[np.int32]:
    """(N, 3) the voxels of (N,) keys."""
    low = (1 << _BITS) - 1
    return np.column_stack(
        [((keys >> shift) & low) - _HALF for shift in (2 * _BITS, _BITS, 0)]
    ).astype(np.int32)


@dataclass(frozen=True, eq=False)
class Voxels:
    """(N,) keys of voxels."""

    keys: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.keys)


@dataclass(frozen=True, eq=False)
class Things:
    """Entities or semantic types by name: (N,) places in `names`."""

    codes: NDArray[np.int32]
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.codes)

    @classmethod
    def of(cls, names: Iterable[str]) -> Things:
        """A row a name."""
        rows = list(names)
        known = tuple(dict.fromkeys(rows))
        code = {name: i for i, name in enumerate(known)}
        return cls(np.array([code[name] for name in rows], np.int32), known)


@dataclass(frozen=True, eq=False)
class Numbers:
    """(N,) values."""

    values: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.values)


Column = Voxels | Things | Numbers


class Statements(NamedTuple):
    """Rows of subject and object; none twice."""

    subject: Column
    object: Column


class Relation(Protocol):
    """What states a property: a map, a region map, or what is computed from them."""

    @property
    def property(self) -> Property: ...

    def statements(
        self,
        *,
        subjects: Collection[str] | None = None,
        objects: Collection[str] | None = None,
        within: NDArray[np.int64] | None = None,
    ) -> Statements:
        """All that it states.

        Parameters
        ----------
        subjects, objects : things to which that side is limited
        within : ascending keys of voxels to which the subjects are limited; what lies elsewhere may
            be given all the same
        """
        ...


class Catalogue(Protocol):
    """What a query may ask: properties, and names for constants."""

    @property
    def voxel_size(self) -> float:
        """Metres; all voxels of a catalogue are of one lattice."""
        ...

    def relation(self, iri: str) -> Relation:
        """The relation that states a property; LookupError, naming near ones, if there is none."""
        ...

    def relations(self) -> Iterable[Relation]:
        """All of them."""
        ...

    def things(self, name: str, range_: str | None) -> frozenset[str]:
        """The things that a constant names: an entity, or a semantic type and its subtypes.

        Raises
        ------
        LookupError
            No such entity or type.
        TypeError
            There is one, but not of the type `range_`.
        """
        ...

    def at(self, moment: datetime) -> Catalogue:
        """The same as it was then."""
        ...

    def during(self, begin: datetime, end: datetime) -> Catalogue:
        """The same, stating all that was stated at any time between."""
        ...
