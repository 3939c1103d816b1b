"""Places and the connectors that join them (Deeken et al., section 3.4, "Topological Information").

Arrays and plain dataclasses: `planner.source` reads them from the map.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import networkx as nx
import shapely

from semmap.geometry.pose import Pose

if TYPE_CHECKING:
    from datetime import datetime

    from planner.ask import Asker, Said
    from planner.network import Network
    from planner.robot_class import RobotClass
    from planner.route import Route
    from planner.times import Times
    from planner.walks import Walks

__all__ = [
    "OUTSIDE",
    "Connector",
    "Place",
    "Region",
    "Topology",
    "TopologyError",
    "UnknownPlaceError",
]

OUTSIDE = "outside"
"""What lies beyond the building: the second place of an exterior door."""


class TopologyError(ValueError):
    """Places and connectors that do not fit together."""


class UnknownPlaceError(LookupError):
    """A place that the topology does not have; the message names the closest ones."""

    def __init__(self, name: str, known: Iterable[str]) -> None:
        known = sorted(known)
        near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
        near += [k for k in known if name and name.lower() in k.lower() and k not in near][
            : 3 - len(near)
        ]
        if near:
            mend = f"did you mean {' or '.join(near)}?"
        elif known:
            mend = f"there are: {', '.join(known[:12])}{', ...' if len(known) > 12 else ''}"
        else:
            mend = "the map has no rooms: import a world or an annotation that has"
        super().__init__(f"there is no place named {name}; {mend}")


# A map has thousands of these two; frozen ones would take three times as long to make.


@dataclass(slots=True)
class Place:
    """A room, or an elevator's cabin on one storey.

    Attributes
    ----------
    name : unique in the map
    type, label : semantic type and function (``kitchen``), where known
    storey : name of the storey, where known
    elevator : name of the elevator whose cabin this is
    types : the type, and then what subsumes it
    properties : as the map has them
    floor : z of its ground, metres in the map's frame
    id : of its entity, where it comes from a map
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


@dataclass(slots=True)
class Connector:
    """A door, elevator door, flight of stairs or ramp between two places (section 3.4).

    Attributes
    ----------
    places : the two places that it joins; the second may be `OUTSIDE`
    poses : in the map's frame, one in each place, at which a robot stands facing the connector
    type : door, elevator_door, stairs or ramp
    direction : forward passes only from the first place to the second
    state : open, closed or locked
    behaviour : the robot behaviour that passing needs
    width, height : of the clear opening in metres, where known
    step : height of its threshold, metres
    permissions : of which a robot needs one to pass; none: everybody may
    properties : as the map has them
    id : of its entity, where it comes from a map
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

    @property
    def metres(self) -> float:
        """From the pose before it to the pose behind it."""
        a, b = self.poses
        return math.dist(a[:3], b[:3])

    @property
    def shut(self) -> bool:
        """Whether who passes has to open it; elevators open their own doors."""
        return self.state == "locked" or (self.state == "closed" and self.type != "elevator_door")

    def passes(self, side: int) -> bool:
        """True where the direction allows leaving from ``places[side]``."""
        return self.direction == "both" or (self.direction == "forward") == (side == 0)


@dataclass(frozen=True, eq=False)
class Region:
    """A part of one place or several, drawn on the map, with a meaning of its own (section 3.4)."""

    name: str
    outline: shapely.Geometry
    places: tuple[str, ...]
    label: str | None = None
    types: tuple[str, ...] = ()
    properties: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Topology:
    """What joins what: places by name, connectors by name; and regions of places.

    `asker` answers on the map that the topology was read from, for a class of robots.

    `OUTSIDE` is a place wherever a connector leads there.

    Raises
    ------
    TopologyError
        Where a connector names a place that is not there, or a name comes twice.
    """

    places: dict[str, Place] = field(default_factory=dict)
    connectors: dict[str, Connector] = field(default_factory=dict)
    regions: tuple[Region, ...] = ()
    asker: Callable[[str | RobotClass | None], Asker] | None = field(
        default=None, compare=False, repr=False
    )

    @classmethod
    def of(
        cls,
        places: Iterable[Place],
        connectors: Iterable[Connector],
        regions: Iterable[Region] = (),
    ) -> Topology:
        """A topology of lists, checked."""
        by_name: dict[str, Place] = {}
        for place in places:
            if place.name in by_name:
                raise TopologyError(f"two places are named {place.name}; rename one of them")
            by_name[place.name] = place
        joined: dict[str, Connector] = {}
        for connector in connectors:
            if connector.name in joined:
                raise TopologyError(f"two connectors are named {connector.name}; rename one")
            if connector.places[0] == connector.places[1]:
                raise TopologyError(
                    f"connector {connector.name} joins {connector.places[0]} with itself; "
                    "name the place on its other side"
                )
            for name in connector.places:
                if name == OUTSIDE:
                    by_name.setdefault(OUTSIDE, Place(OUTSIDE))
                elif name not in by_name:
                    raise TopologyError(
                        f"connector {connector.name} joins {name}, which is no place; "
                        "add the room or correct the connector"
                    )
            joined[connector.name] = connector
        return cls(by_name, joined, tuple(regions))

    def place(self, name: str) -> Place:
        """The place of that name.

        Raises
        ------
        UnknownPlaceError
        """
        try:
            return self.places[name]
        except KeyError:
            raise UnknownPlaceError(name, self.places) from None

    def doors_of(self, place: str) -> list[tuple[Connector, int]]:
        """The connectors of a place, each with the side (0 or 1) on which the place lies."""
        return [
            (c, side)
            for c in self.connectors.values()
            for side in (0, 1)
            if c.places[side] == place
        ]

    def cabins(self) -> dict[str, list[str]]:
        """Elevators and the places that are their cabins, one a storey."""
        found: dict[str, list[str]] = {}
        for place in self.places.values():
            if place.elevator is not None:
                found.setdefault(place.elevator, []).append(place.name)
        return found

    def route(
        self,
        start: Said,
        goal: Said,
        *,
        robot: str | RobotClass | None = None,
        avoid: Sequence[str] = (),
        at: datetime | None = None,
    ) -> Route:
        """The route that takes the least time for a class of robots.

        From a place, or a pose in one, to the like, or to the nearest place of a label or type;
        where the topology follows a map (`planner.live.Live`), from and to its things and regions,
        too, over the robot's costmaps. See `planner.ask.Asker.route`.

        Raises
        ------
        UnknownPlaceError, NoRouteError
        """
        if self.asker is not None:
            return self.asker(robot).route(start, goal, avoid=avoid, at=at)[0]
        from planner.ask import Asker  # which stands on this module

        if isinstance(robot, str):
            raise ValueError(f"a topology of no map knows no robot {robot}: give a RobotClass")
        return Asker(self.network(robot)).route(start, goal, avoid=avoid, at=at)[0]

    def network(
        self,
        robot: RobotClass | None = None,
        *,
        times: Times | None = None,
        walks: Walks | None = None,
    ) -> Network:
        """The topology as a network of travel times for a class of robots."""
        from planner.network import Network  # which stands on this module

        return Network(self, robot, times=times, walks=walks)

    def storeys(self) -> list[str]:
        """The names of the storeys that places are on."""
        return sorted({p.storey for p in self.places.values() if p.storey is not None})

    def graph(self) -> nx.MultiGraph:
        """Places as nodes; connectors and elevator rides as edges, keyed by their names."""
        graph = nx.MultiGraph()
        for place in self.places.values():
            graph.add_node(place.name, place=place)
        for c in self.connectors.values():
            graph.add_edge(*c.places, key=c.name, connector=c)
        for elevator, cabins in self.cabins().items():
            for i, a in enumerate(cabins):
                for b in cabins[i + 1 :]:
                    graph.add_edge(a, b, key=elevator, elevator=elevator)
        return graph
