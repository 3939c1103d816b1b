"""What a word in a query stands for: a place, an object, a region or an agent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import shapely

from semmap.geometry.pose import Pose


@dataclass(frozen=True, eq=False)
class LocatedEntity:
    """An entity of the map, and where it is; None: the map does not say."""

    name: str
    kind: Literal["room", "object", "region", "agent"]
    place: str | None  # the room that holds it or in which it lies
    pose: Pose | None = None  # in the map's frame
    footprint: shapely.Geometry | None = None  # on the ground
    heights: tuple[float, float] | None = None  # lowest and highest z, metres
    id: int | None = None  # in the database


class EntityLookup(Protocol):
    """Finds entities by name, label or type, and places by pose."""

    def find(self, word: str) -> Sequence[LocatedEntity]:
        """The entity of this name, or else all entities of this label or type."""
        ...

    def place_at(self, pose: Pose) -> str | None:
        """The name of the place in which a pose lies; None if it lies in no place."""
        ...

    def similar_names(self, word: str) -> Sequence[str]:
        """Names, labels and types that may be meant by a word that means nothing."""
        ...


class NoLookup:
    """Finds nothing: for a topology that does not come from a map."""

    def find(self, word: str) -> Sequence[LocatedEntity]:
        """No entity."""
        return ()

    def place_at(self, pose: Pose) -> str | None:
        """No place."""
        return None

    def similar_names(self, word: str) -> Sequence[str]:
        """No name."""
        return ()
