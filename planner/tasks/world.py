"""The objects of a task, as plain data; `planner.tasks.reader` reads them from the map."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from planner.tasks.goal import Word
from planner.topology import Topology
from semmap.error import Error
from semmap.geometry.pose import Pose
from semmap.geometry.surfaces import RIM
from semmap.suggestions import suggestion

CARRIERS = frozenset({"tray", "basket", "box", "bucket"})
"""Types of objects that are carried with all objects on them."""

HEAVIEST = 5.0  # highest weight that a robot lifts, kilograms
LONGEST = 0.6  # highest second-longest side of an object that a robot lifts, metres

_FIXED_TYPES = frozenset(
    {"furniture", "appliance", "building_element", "connector", "fixture", "vehicle", "agent"}
)
"""Types of objects that no robot carries, whatever their size."""

_HUNG_TYPES = frozenset({"board", "ceiling_lamp", "clock", "mirror", "picture"})
"""Types of objects that are fixed to a wall or ceiling, unless they stand or lie somewhere."""

ASSUME = "give it one, or let sizes be assumed (assume_sizes=True, --assume-sizes)"
"""Where a shape is missing."""

HUNG = 0.25
"""Height of its underside from which on such an object, with nothing below it, hangs, metres."""


class UnknownObjectError(Error, LookupError):
    """A word stands for no entity; the message suggests similar words."""

    def __init__(self, word: str, known: Iterable[str], *, what: str = "object or place") -> None:
        hint = suggestion(word, known, "semmap ls lists the objects")
        if word == "home":
            hint = ": draw a region, map.add_region('home', outline, type='home_region')"
        super().__init__(f"there is no {word}: no {what} has this name, type or label{hint}")


@dataclass(frozen=True)
class TaskObject:
    """An object that a task can use.

    Attributes
    ----------
    types
        The semantic type, then its supertypes.
    label
        Its function, as people call it.
    holder
        Name of the object or place that it is on or in; None if the robot carries it.
    place
        Name of the room in which it is.
    pose
        In the map's frame; its z is that of the object's middle.
    approach_pose
        Base pose at which the robot reaches it; None: at `pose`.
    height
        Of its middle above the floor, metres.
    size
        Of its box, metres; (0, 0, 0) if unknown.
    weight
        Kilograms, if known.
    classified
        Whether the T-Box says what it is.
    graspable
        Given by a property; None: determined by type, size and weight.
    surface, surface_height
        Free area of its level surface, square metres, 0 without one, infinite if unknown; and its
        height above the floor, metres.
    levels
        Heights of its level surfaces above the floor, metres, and whether another one is above
        each; None if unknown.
    assumed
        Whether its size is the typical one of its type: the map has no shape of it.
    """

    name: str
    types: tuple[str, ...] = ()
    label: str | None = None
    holder: str | None = None
    place: str | None = None
    pose: Pose | None = None
    approach_pose: Pose | None = None
    height: float = 0.8
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    weight: float | None = None
    classified: bool = True
    graspable: bool | None = None
    surface: float = float("inf")
    surface_height: float = 0.75
    levels: tuple[tuple[float, bool], ...] | None = None
    properties: Mapping[str, Any] = field(default_factory=dict, compare=False)
    assumed: bool = False

    @property
    def carrier(self) -> bool:
        """Whether it is carried with the objects on it, as a tray is."""
        text = self.properties.get("carrier")
        return bool(CARRIERS.intersection(self.types)) if text is None else bool(text)

    @property
    def ground(self) -> float:
        """The area of its box on the ground, square metres."""
        return self.size[0] * self.size[1]

    @property
    def hangs(self) -> bool:
        """Whether it is fixed to a wall or ceiling: of such a type, with nothing below it."""
        underside = self.height - self.size[2] / 2
        stands = self.holder is not None and self.holder != self.place
        return not _HUNG_TYPES.isdisjoint(self.types) and not stands and underside > HUNG

    def obstacle(self, heights: tuple[float, float]) -> str | None:
        """Why a robot that reaches between two heights cannot pick it up; else None."""
        if self.graspable is False:
            return f"{self.name} is not graspable (its property `graspable` says so)"
        if self.graspable is None:
            if not _FIXED_TYPES.isdisjoint(self.types):
                kind = self.types[0].replace("_", " ")
                article = "an" if kind[0] in "aeiou" else "a"
                return f"{self.name} is {article} {kind}; a robot does not carry it"
            if self.hangs:
                return f"{self.name} hangs; a robot does not take it down"
            if not (self.classified or any(self.size)):
                return (
                    f"{self.name} may be too large: its type is not in the T-Box, and it has no "
                    "shape; add one of them, or give it the property `graspable`"
                )
            if sorted(self.size)[1] > LONGEST:
                return (
                    f"{self.name} is {sorted(self.size)[1]:.2f} m wide; the robot lifts objects up "
                    f"to {LONGEST:g} m wide"
                )
        if self.weight is not None and self.weight > HEAVIEST:
            return f"{self.name} weighs {self.weight:g} kg; the robot lifts {HEAVIEST:g} kg"
        return _out_of_reach(self.name, self.height, heights)

    @property
    def top(self) -> float:
        """Of its highest point above the floor, metres."""
        return self.height + self.size[2] / 2

    def has_inside(self, item: TaskObject) -> bool:
        """Whether an object that it holds stands inside of it, not on its top."""
        return self.levels is None or item.height - item.size[2] / 2 < self.top - RIM

    def is_open(self, heights: tuple[float, float], *, inside: bool = False) -> bool:
        """Whether nothing of it is above one of its levels between two heights, or of no level."""
        found = self._levels(heights, inside)
        return found is None or not all(is_below for _, is_below in found)

    def _levels(
        self, heights: tuple[float, float], inside: bool
    ) -> list[tuple[float, bool]] | None:
        if self.levels is None:
            return None
        return [
            (z, is_below)
            for z, is_below in self.levels
            if heights[0] <= z <= heights[1] and (not inside or z < self.top - RIM)
        ]

    def unsuitable(
        self, item: TaskObject, heights: tuple[float, float], *, inside: bool = False
    ) -> str | None:
        """Why such a robot cannot put an object on it, or `inside` of it; else None."""
        if self.surface <= 0.0:
            why = "" if any(self.size) else f": the map has no shape of it; {ASSUME}"
            return f"{self.name} has no level surface to put {item.name} on{why}"
        if item.ground > self.surface:
            return (
                f"{self.name} is full: {self.surface:.3f} m² are free, {item.name} takes "
                f"{item.ground:.3f} m²"
            )
        if inside and self._levels(heights, inside) == []:
            low, high = heights
            return (
                f"{self.name} has no level surface below its top, {self.top:.2f} m high, that the "
                f"robot reaches, from {low:.1f} to {high:.1f} m; on({item.name}, {self.name}) "
                "means its top"
            )
        return _out_of_reach(self.name, self.surface_height, heights)


def _out_of_reach(name: str, height: float, heights: tuple[float, float]) -> str | None:
    if height > heights[1]:
        return f"{name} is {height:.1f} m high, the robot reaches {heights[1]:.1f} m"
    if height < heights[0]:
        return f"{name} is {height:.1f} m high, the robot reaches down to {heights[0]:.1f} m"
    return None


@dataclass(frozen=True)
class TaskState:
    """Where the robot is, and the names of the objects that it carries."""

    place: str
    pose: Pose | None = None
    carrying: tuple[str, ...] = ()


class TaskWorld:
    """The objects that a task can use, by name.

    `above` has the names of the objects on or in each of them. `misfit` says why no grasp of an
    object fits, by its name; None where one does. `no_place` says why the hand puts an object on no
    level of another one, or inside of it, where others are above its levels.
    """

    def __init__(
        self,
        items: Iterable[TaskObject] = (),
        known: Iterable[str] = (),
        misfit: Callable[[str], str | None] = lambda item: None,
        no_place: Callable[[str, str, bool, bool], str | None] = lambda *asked: None,
    ) -> None:
        self.misfit, self.no_place = misfit, no_place
        self.objects: dict[str, TaskObject] = {}
        for item in items:
            if item.name in self.objects:
                raise ValueError(f"two objects are named {item.name}; rename one of them")
            self.objects[item.name] = item
        self.known = tuple(known)
        self.above: dict[str, list[str]] = {}
        self._by_word: dict[str, list[str]] = {}
        for item in self.objects.values():
            if item.holder is not None:
                self.above.setdefault(item.holder, []).append(item.name)
            for text in {*item.types, *([item.label] if item.label else [])}:
                self._by_word.setdefault(text, []).append(item.name)

    def at_place(self, item: TaskObject, place: str, topology: Topology) -> TaskObject:
        """Return an object as if it were on or in another one, or on the floor of a place."""
        half = item.size[2] / 2
        if place in topology.places:
            return replace(item, holder=place, place=place, pose=None, height=half)
        below = self.objects.get(place)
        if below is None:
            return item
        height = below.surface_height + half
        pose = below.pose and below.pose._replace(z=below.pose.z - below.height + height)
        return replace(item, holder=place, place=below.place, pose=pose, height=height)

    def of_kind(self, word: Word) -> list[str]:
        """The names of the objects of a type or label."""
        return self._by_word.get(word.text, [])

    def find(self, word: Word, topology: Topology) -> tuple[str, list[str]]:
        """The kind, item, place or region, and the names of the entities that a word stands for.

        A name has priority over a type or a label. Raises UnknownObjectError.
        """
        text = word.text
        if word.number == 0:
            if text in self.objects:
                return "item", [text]
            if text in topology.places:
                return "place", [text]
            if any(r.name == text for r in topology.regions):
                return "region", [text]
        items = self.of_kind(word)
        if items:
            return "item", items
        places = [
            p.name for p in topology.places.values() if text in (p.type, p.label) or text in p.types
        ]
        if places:
            return "place", places
        regions = [r.name for r in topology.regions if r.is_called(text)]
        if regions:
            return "region", regions
        words = [*self.objects, *self._by_word, *topology.places, *self.known]
        words += [w for p in topology.places.values() for w in (p.type, p.label) if w]
        words += [w for r in topology.regions for w in (r.name, r.label) if w]
        raise UnknownObjectError(text, words)
