"""What a task knows of things: plain dataclasses; `tasks.source` reads them from the map."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from planner.tasks.goal import Word
from planner.topology import Topology
from semmap.geometry.pose import Pose

__all__ = ["CARRIERS", "State", "Thing", "UnknownThingError", "World"]

CARRIERS = frozenset({"tray", "basket", "box", "bucket"})
"""Types of things that are carried with all that stands on them."""

HEAVIEST = 5.0
"""Kilograms that a robot lifts, of things that say their weight."""

LONGEST = 0.6
"""Metres that the second longest side of a thing may have which a robot lifts."""

_FIXED_TYPES = frozenset(
    {"furniture", "appliance", "building_element", "fixture", "vehicle", "agent"}
)


class UnknownThingError(LookupError):
    """A word that means nothing here; the message names the closest ones."""

    def __init__(self, word: str, known: Iterable[str], *, what: str = "thing or place") -> None:
        known = sorted(set(known))
        near = difflib.get_close_matches(word, known, n=3, cutoff=0.5)
        near += [k for k in known if word.lower() in k.lower() and k not in near][: 3 - len(near)]
        mend = f"did you mean {' or '.join(near)}?" if near else "semmap ls lists what there is"
        super().__init__(f"no {word} is known: no {what} has that name, type or label; {mend}")


@dataclass(frozen=True)
class Thing:
    """A thing that a task can use.

    Attributes
    ----------
    name : unique in the map
    types : its semantic type and what subsumes it, the nearest first
    label : its function, as people say it
    holder : name of the thing or place that it is on or in; None where the robot carries it
    place : name of the room it is in
    pose : in the map's frame
    stand : where the robot's base stands to take or put something there; None: at `pose`
    height : of its middle above the floor, metres
    size : of its box, metres; (0, 0, 0) where unknown
    weight : kilograms, where known
    fixed : it stays where it is (SDF's ``static``)
    graspable : stated by a property; None: decided by type, size and weight
    surface : free area of the level surface that things are put on, square metres; 0 where it has
        none, inf where nobody looked
    surface_height : of that above the floor, metres
    properties : as the map has them
    """

    name: str
    types: tuple[str, ...] = ()
    label: str | None = None
    holder: str | None = None
    place: str | None = None
    pose: Pose | None = None
    stand: Pose | None = None
    height: float = 0.8
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    weight: float | None = None
    fixed: bool = False
    graspable: bool | None = None
    surface: float = float("inf")
    surface_height: float = 0.75
    properties: Mapping[str, Any] = field(default_factory=dict, compare=False)

    @property
    def carrier(self) -> bool:
        """Whether it is carried with what stands on it, as a tray is."""
        said = self.properties.get("carrier")
        return bool(CARRIERS.intersection(self.types)) if said is None else bool(said)

    @property
    def ground(self) -> float:
        """The area that it takes where it stands, square metres."""
        return self.size[0] * self.size[1]

    def obstacle(self, heights: tuple[float, float]) -> str | None:
        """Why a robot that reaches from one height to another does not pick it up; else None."""
        if self.graspable is False:
            return f"{self.name} is not graspable (its property `graspable` says so)"
        if self.graspable is None:
            if self.fixed:
                return f"{self.name} is fixed where it is; no robot moves it"
            kind = next((t for t in self.types if t in _FIXED_TYPES), None)
            if kind is not None:
                return f"{self.name} is {_article(kind)}; no robot carries it about"
            if sorted(self.size)[1] > LONGEST:
                return (
                    f"{self.name} is {sorted(self.size)[1]:.2f} m wide; the robot lifts what is up "
                    f"to {LONGEST:g} m wide"
                )
        if self.weight is not None and self.weight > HEAVIEST:
            return f"{self.name} weighs {self.weight:g} kg; the robot lifts {HEAVIEST:g} kg"
        return _out_of_reach(self.name, self.height, heights)

    def unsuitable(self, thing: Thing, heights: tuple[float, float]) -> str | None:
        """Why `thing` is not put on it by such a robot; else None."""
        if self.surface <= 0.0:
            return f"{self.name} has no level surface to put {thing.name} on"
        if thing.ground > self.surface:
            return (
                f"{self.name} is full: {self.surface:.3f} m² are free, {thing.name} takes "
                f"{thing.ground:.3f} m²"
            )
        return _out_of_reach(self.name, self.surface_height, heights)


def _out_of_reach(name: str, height: float, heights: tuple[float, float]) -> str | None:
    if height > heights[1]:
        return f"{name} is {height:.1f} m high, the robot reaches {heights[1]:.1f} m"
    if height < heights[0]:
        return f"{name} is {height:.1f} m high, the robot reaches down to {heights[0]:.1f} m"
    return None


def _article(kind: str) -> str:
    kind = kind.replace("_", " ")
    return f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"


@dataclass(frozen=True)
class State:
    """Where the robot is, and what it carries: names of things."""

    place: str
    pose: Pose | None = None
    carrying: tuple[str, ...] = ()


class World:
    """The things that a task can use, by name.

    Attributes
    ----------
    things : by name
    above : what is on or in each of them
    """

    def __init__(self, things: Iterable[Thing] = (), known: Iterable[str] = ()) -> None:
        self.things: dict[str, Thing] = {}
        for thing in things:
            if thing.name in self.things:
                raise ValueError(f"two things are named {thing.name}; rename one of them")
            self.things[thing.name] = thing
        self.known = tuple(known)
        self.above: dict[str, list[str]] = {}
        self._by_word: dict[str, list[str]] = {}
        for thing in self.things.values():
            if thing.holder is not None:
                self.above.setdefault(thing.holder, []).append(thing.name)
            for said in {*thing.types, *([thing.label] if thing.label else [])}:
                self._by_word.setdefault(said, []).append(thing.name)

    def of_kind(self, word: Word) -> list[str]:
        """The things that have a type or a label."""
        return self._by_word.get(word.text, [])

    def meant(self, word: Word, topology: Topology) -> tuple[str, list[str]]:
        """What a word means: ("thing" or "place", names); a name wins over a type or a label.

        Raises
        ------
        UnknownThingError
        """
        said = word.text
        if word.number == 0:
            if said in self.things:
                return "thing", [said]
            if said in topology.places:
                return "place", [said]
        things = self.of_kind(word)
        if things:
            return "thing", things
        places = [
            p.name for p in topology.places.values()
            if said in (p.type, p.label) or said in p.types
        ]  # fmt: skip
        if places:
            return "place", places
        words = [*self.things, *self._by_word, *topology.places, *self.known]
        words += [w for p in topology.places.values() for w in (p.type, p.label) if w]
        raise UnknownThingError(said, words)
