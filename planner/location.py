"""What the start and the goal of a route stand for: names are resolved here, once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import shapely

from planner.route import NoRouteError
from planner.topology import Place, PlaceRegion, Topology, UnknownPlaceError
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


class EntityLookup:
    """Finds entities by name, label or type, and places by pose; this one knows no map."""

    def find(self, word: str) -> Sequence[LocatedEntity]:
        """The entity of this name, or else all entities of this label or type."""
        return ()

    def place_at(self, pose: Pose) -> str | None:
        """The name of the place in which a pose lies; None if it lies in no place."""
        return None

    def similar_names(self, word: str) -> Sequence[str]:
        """Names, labels and types that may be meant by a word that means nothing."""
        return ()


Point: TypeAlias = tuple[float, float] | tuple[float, float, float]

LocationLike: TypeAlias = str | Pose | Point | tuple[str, Pose] | LocatedEntity
"""Where a route begins or ends: a name, a label or a type; a pose or a point in the map's frame,
metres; a place and a pose in it; an entity that was looked up."""


@dataclass(frozen=True)
class Location:
    """A place by its name, and what in it is meant."""

    place: str
    pose: Pose | None = None  # in the map's frame; None: anywhere in the place
    entity: LocatedEntity | None = None  # to be reached, or stood in; None: the place


@dataclass(frozen=True)
class LocationFinder:
    """Finds what a start or a goal may stand for."""

    topology: Topology
    lookup: EntityLookup
    occupants: Callable[[Pose], Sequence[str]] = lambda pose: ()  # names of what is at a pose

    def find(self, given: LocationLike) -> list[Location]:
        """All locations that are meant, at least one.

        Raises UnknownPlaceError, with similar names, for a name that the map does not have;
        NoRouteError for what is in no room.
        """
        if isinstance(given, str):
            return self._of_word(given)
        if isinstance(given, LocatedEntity):
            return [self._of_entity(given)]
        if isinstance(given, Pose):
            return [self._at(given)]
        if isinstance(given[0], str):
            return [Location(given[0], given[1])]
        return [self._at(Pose(*given))]

    def entity(self, name: str) -> LocatedEntity:
        """The entity of a name, with its room; raises UnknownPlaceError."""
        found = self.lookup.find(name)
        if not found:
            raise self._unknown(name)
        return self._with_place(found[0])

    def check_avoided(self, name: str) -> None:
        """Raise UnknownPlaceError for what no place, connector, region or elevator is called."""
        topology = self.topology
        cabins = topology.cabins()
        labelled: list[Place | PlaceRegion] = [*topology.places.values(), *topology.regions]
        known = (
            name in cabins
            or any(name in (c.name, c.type) for c in topology.connectors.values())
            or any(name in (e.name, e.label, *e.types) for e in labelled)
        )
        if not known:
            raise UnknownPlaceError(name, [*self._names(), *cabins])

    def _of_word(self, word: str) -> list[Location]:
        places = self.topology.places
        if word in places:
            return [Location(word)]
        found = [self._with_place(entity) for entity in self.lookup.find(word)]
        entities = [self._of_entity(e) for e in found if e.place in places]
        if found and not entities:
            raise NoRouteError(f"no room holds {found[0].name}: move it into one, or draw its room")
        named = [Location(p.name) for p in places.values() if word == p.label or word in p.types]
        if not entities and not named:
            raise self._unknown(word)
        return entities or named

    def _of_entity(self, entity: LocatedEntity) -> Location:
        entity = self._with_place(entity)
        if entity.place is None:
            raise NoRouteError(f"no room holds {entity.name}")
        return Location(entity.place, entity.pose, entity)

    def _at(self, pose: Pose) -> Location:
        place = self.lookup.place_at(pose)
        if place is None:
            names = self.occupants(pose)
            there = f"; {', '.join(names)} is there" if names else ""
            raise NoRouteError(f"({pose.x:.2f}, {pose.y:.2f}, {pose.z:.2f}) is in no room{there}")
        return Location(place, pose)

    def _with_place(self, entity: LocatedEntity) -> LocatedEntity:
        """The entity with the room in which its pose lies, if no room holds it."""
        if entity.place is not None or entity.pose is None:
            return entity
        return replace(entity, place=self.lookup.place_at(entity.pose))

    def _names(self) -> list[str]:
        topology = self.topology
        return [*topology.places, *topology.connectors, *(r.name for r in topology.regions)]

    def _unknown(self, word: str) -> UnknownPlaceError:
        return UnknownPlaceError(word, {*self._names(), *self.lookup.similar_names(word)})
