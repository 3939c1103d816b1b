"""Places and the connectors that join them (Deeken et al., section 3.4), as plain data."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import shapely

from semmap.error import Error
from semmap.geometry.pose import Pose
from semmap.suggestions import suggestion

OUTSIDE = "outside"  # name of the place beyond the building: the second place of an exterior door
AT_POINT = 0.3  # metres from a waypoint within which a robot is at it
LEAF = 0.9  # width of a door without one, metres
REGION = "_region"  # the end of the names of types of regions, which people leave out


class TopologyError(Error, ValueError):
    """Places and connectors that do not fit together."""


class UnknownPlaceError(Error, LookupError):
    """The topology has no place of this name; the message suggests similar names."""

    def __init__(self, name: str, known: Iterable[str]) -> None:
        known = sorted(known)
        otherwise = "the map has no rooms: import a world or an annotation that has rooms"
        if known:
            few = len(known) <= 12
            otherwise = f"there are: {', '.join(known)}" if few else "`semmap ls` lists the names"
        super().__init__(f"there is no place named {name}{suggestion(name, known, otherwise)}")


# A map has thousands of places and connectors. Frozen classes would take three times as long to
# make, so these two are not; treat them as frozen all the same.


@dataclass(slots=True)
class Place:
    """A room, or the cabin of an elevator on one storey; None: unknown, or the map has none.

    Attributes
    ----------
    name
        Unique in the map.
    type, label
        Semantic type, and function (``kitchen``).
    elevator
        Name of the elevator, if this is its cabin.
    types
        The semantic type, then its supertypes.
    floor
        z of the floor in the map's frame, metres.
    id
        In the database.
    """

    name: str
    type: str | None = None
    label: str | None = None
    storey: str | None = None
    elevator: str | None = None
    types: tuple[str, ...] = ()
    properties: Mapping[str, Any] = field(default_factory=dict)
    floor: float = 0.0
    id: int | None = None


class Narrowing(NamedTuple):
    """What the objects on stairs or a ramp leave free.

    `width` is that of the widest robot that gets past them, metres; `free` is the ground within the
    sides of the way that they do not take, in the map's frame.
    """

    width: float
    objects: tuple[str, ...]
    free: shapely.Geometry


@dataclass(slots=True)
class PlaceConnector:
    """A door, elevator door, flight of stairs or ramp between two places (section 3.4).

    Attributes
    ----------
    name
        Unique in the map.
    places
        Names of the two places; the second may be `OUTSIDE`, or the first again for a door in a
        wall that stands free in a room.
    poses
        The approach poses, one in each place, in the map's frame: there the robot faces the
        connector.
    direction
        ``forward`` is passed only from the first place to the second, ``backward`` only from the
        second to the first.
    behaviour
        Name of the robot behaviour that passes it.
    width, height
        Size of the clear opening, metres; None if unknown.
    step
        Height of the threshold, or between the floors of the two rooms, metres.
    permissions
        A robot needs one of these to pass. If empty, every robot may pass.
    narrowed
        By the objects on stairs or a ramp; None without any.
    id
        In the database; None if the connector comes from elsewhere.
    """

    name: str
    places: tuple[str, str]
    poses: tuple[Pose, Pose]
    type: Literal["door", "elevator_door", "stairs", "ramp"] = "door"
    direction: Literal["both", "forward", "backward"] = "both"
    state: Literal["open", "closed", "locked"] = "open"
    behaviour: str = "pass_door"
    width: float | None = None
    height: float | None = None
    step: float = 0.0
    permissions: frozenset[str] = frozenset()
    properties: Mapping[str, Any] = field(default_factory=dict)
    id: int | None = None
    narrowed: Narrowing | None = None

    @property
    def metres(self) -> float:
        """Distance between the two approach poses."""
        a, b = self.poses
        return math.dist(a[:3], b[:3])

    @property
    def way(self) -> shapely.LineString:
        """The line from one approach pose to the other."""
        return shapely.LineString([pose[:2] for pose in self.poses])

    @property
    def climbs(self) -> bool:
        """True for stairs and ramps."""
        return self.type in ("stairs", "ramp")

    @property
    def must_be_opened(self) -> bool:
        """True if the robot has to open it; elevators open their own doors."""
        return self.state == "locked" or (self.state == "closed" and self.type != "elevator_door")

    def leaf(self, margin: float = 0.0) -> shapely.LineString:
        """The line across the opening, between the approach poses, and so many metres beyond."""
        (a, b), half = self.poses, (self.width or LEAF) / 2 + margin
        turn = math.atan2(b.y - a.y, b.x - a.x)
        x, y, dx, dy = (a.x + b.x) / 2, (a.y + b.y) / 2, -math.sin(turn), math.cos(turn)
        ends = [(x + half * dx, y + half * dy), (x - half * dx, y - half * dy)]
        return shapely.LineString(ends)

    def passes(self, side: int) -> bool:
        """True if the direction allows leaving ``places[side]``."""
        return self.direction == "both" or (self.direction == "forward") == (side == 0)


@dataclass(frozen=True, eq=False)
class PlaceRegion:
    """A part of one or several places, drawn on the map, that has its own meaning (section 3.4).

    `outline` is on the ground, in the map's frame, metres; a point for a waypoint. `places` are the
    names of those that it reaches into.
    """

    name: str
    outline: shapely.Geometry
    places: tuple[str, ...]
    label: str | None = None
    types: tuple[str, ...] = ()
    properties: Mapping[str, Any] = field(default_factory=dict)

    def is_called(self, word: str) -> bool:
        """Whether a word stands for it: its name, label or type, or a property that is true.

        A type ``home_region`` is called ``home``, too.
        """
        words = {self.name, self.label, *self.types}
        return (
            word in words
            or f"{word}{REGION}" in words
            or self.properties.get(word) in (True, "true")
        )

    def contains(self, pose: Pose) -> bool:
        """Whether a robot at a pose is in the region; at a waypoint, within `AT_POINT`."""
        near = AT_POINT if self.outline.area == 0 else 0.0
        return bool(shapely.dwithin(self.outline, shapely.Point(pose.x, pose.y), near))


@dataclass(frozen=True)
class Topology:
    """Places and connectors by name, and the regions of places. Treat it as immutable.

    `OUTSIDE` is a place if a connector leads there. Make one with `Topology.of`, which checks that
    the parts fit together. `astray` are the two places of each connector that is not at them: no
    route leads through it.

    Examples
    --------
    >>> door = PlaceConnector("door1", ("lab", "corridor"), (Pose(0.0, -1.0), Pose(0.0, 1.0)))
    >>> building = Topology.of([Place("lab"), Place("corridor")], [door])
    >>> [connector.name for connector, side in building.connectors_of("lab")]
    ['door1']
    """

    places: Mapping[str, Place] = field(default_factory=dict)
    connectors: Mapping[str, PlaceConnector] = field(default_factory=dict)
    regions: tuple[PlaceRegion, ...] = ()
    astray: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        places: Iterable[Place],
        connectors: Iterable[PlaceConnector],
        regions: Iterable[PlaceRegion] = (),
        astray: Mapping[str, tuple[str, str]] | None = None,
    ) -> Topology:
        """The topology of these places, connectors and regions.

        Raises TopologyError if a connector names a place that is missing, or two parts have the
        same name.
        """
        by_name: dict[str, Place] = {}
        for place in places:
            if place.name in by_name:
                raise TopologyError(f"two places are named {place.name}; rename one of them")
            by_name[place.name] = place
        joined: dict[str, PlaceConnector] = {}
        for connector in connectors:
            if connector.name in joined:
                raise TopologyError(f"two connectors are named {connector.name}; rename one")
            for name in connector.places:
                if name == OUTSIDE:
                    by_name.setdefault(OUTSIDE, Place(OUTSIDE))
                elif name not in by_name:
                    raise TopologyError(
                        f"connector {connector.name} joins {name}, which is not a place; "
                        "add the room or correct the connector"
                    )
            joined[connector.name] = connector
        return cls(by_name, joined, tuple(regions), astray or {})

    def place(self, name: str) -> Place:
        """The place of this name; raises UnknownPlaceError."""
        try:
            return self.places[name]
        except KeyError:
            raise UnknownPlaceError(name, self.places) from None

    def connectors_of(self, place: str) -> list[tuple[PlaceConnector, int]]:
        """The connectors of a place, each with the side (0 or 1) on which the place lies."""
        return [(self.connectors[name], side) for name, side in self._sides.get(place, ())]

    @cached_property
    def _sides(self) -> dict[str, list[tuple[str, int]]]:
        sides: dict[str, list[tuple[str, int]]] = {}
        for connector in self.connectors.values():
            for side, place in enumerate(connector.places):
                sides.setdefault(place, []).append((connector.name, side))
        return sides

    @cached_property
    def between_heights(self) -> frozenset[int]:
        """The ids of the connectors that climb, or join places with floors of two heights."""
        return frozenset(
            c.id
            for c in self.connectors.values()
            if c.id is not None
            and (c.climbs or len({self.places[p].floor for p in c.places if p != OUTSIDE}) > 1)
        )

    def places_on(self, storey: str | None) -> list[Place]:
        """The places of a storey; all where None. Raises LookupError for an unknown storey."""
        found = [p for p in self.places.values() if storey is None or p.storey == storey]
        if storey is not None and not found:
            known = dict.fromkeys(p.storey for p in self.places.values() if p.storey)
            raise LookupError(f"there is no storey {storey}; there are: {', '.join(known)}")
        return found

    def cabins(self) -> dict[str, list[str]]:
        """The cabins of each elevator: names of places, one for each storey that it serves."""
        cabins: dict[str, list[str]] = {}
        for place in self.places.values():
            if place.elevator is not None:
                cabins.setdefault(place.elevator, []).append(place.name)
        return cabins

    def elevators(self) -> dict[str, str]:
        """The elevator of each place that is a cabin."""
        return {p.name: p.elevator for p in self.places.values() if p.elevator is not None}

    def storeys(self) -> list[str]:
        """The names of the storeys that have places, in alphabetical order."""
        return sorted({p.storey for p in self.places.values() if p.storey is not None})

    def without(self, names: Collection[str]) -> Topology:
        """This topology without the connectors and elevators of these names; others have no effect.

        An elevator is left out by leaving out the doors of its cabins.
        """
        closed = {
            cabin
            for elevator, cabins in self.cabins().items()
            if elevator in names
            for cabin in cabins
        }
        kept = {
            name: connector
            for name, connector in self.connectors.items()
            if name not in names and not closed.intersection(connector.places)
        }
        return replace(self, connectors=kept)
