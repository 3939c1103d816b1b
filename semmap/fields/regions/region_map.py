"""The region map: one grid that states for each voxel the set of entities that have it.

Source: "VDB-based Spatially Grounded Semantics for Interactive Robots", sections III-A and III-B.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import semmap_vdb
from semmap.fields.checks import as_points, positive
from semmap.fields.regions.shaped_region import Region, shape_of

FARTHEST = 1000
"""The largest gap in voxels for which neighbours are searched."""

EntityRegions = Mapping[Hashable, Region] | Iterable[tuple[Hashable, Region]]


@dataclass(frozen=True)
class Overlap:
    """The space that two entities share: a number of voxels, and a volume in cubic metres."""

    voxels: int
    volume: float


class Neighbour(NamedTuple):
    """How one entity is placed relative to another."""

    shared: int  # number of voxels that both have
    # distance in voxels between the two nearest voxels as cubes; 0 where these touch, even if only
    # at a corner
    gap: float


class Support(NamedTuple):
    """How many voxels of the lowest layer of an entity rest on another entity.

    A voxel rests on an entity that has the voxel below it or the same voxel, but not the voxel
    above; so of two that begin at one height only the higher can rest on the other. All numbers are
    0 where an entity begins too low.
    """

    layer: int  # number of voxels in the lowest layer
    firm: int  # number of those that rest on the other entity
    loose: int  # number of those that rest on it if the entity is shifted up or down by a voxel


@dataclass(frozen=True)
class Memory:
    """The memory of a region map in bytes, and what it contains.

    `grid` is that of the voxels, `index` that of the list of blocks of each entity, `sets` that of
    the register of sets. `leaves` are blocks of 8 x 8 x 8 voxels with several sets, `tiles` such
    with one set.
    """

    grid: int
    index: int
    sets: int
    active_voxels: int
    leaves: int
    tiles: int
    set_count: int

    @property
    def bytes_per_voxel(self) -> float:
        """All bytes divided by the active voxels; NaN where there are none."""
        whole = self.grid + self.index + self.sets
        return whole / self.active_voxels if self.active_voxels else float("nan")


class RegionMap:
    """The voxels of entities, on one grid. Safe for several threads.

    Each voxel has the number of a set, and a register maps the number to the set of entities. A set
    keeps its number while a voxel has it. `insert_many` uses at most `threads`, by default one for
    each processor; the result does not depend on it.

    Examples
    --------
    >>> from semmap.fields import Box
    >>> regions = RegionMap(0.1)
    >>> regions.insert("desk", Box((0, 0, 0.4), (1, 1, 0.8)))
    >>> regions.entities_at([(0, 0, 0.5), (0, 0, 2)])
    [{'desk'}, set()]
    """

    def __init__(self, voxel_size: float, *, threads: int | None = None) -> None:
        self._native = semmap_vdb.RegionMap(positive(voxel_size, "voxel_size"))
        self._voxel_size = float(voxel_size)
        self._threads = (os.cpu_count() or 1) if threads is None else int(threads)
        if self._threads < 1:
            raise ValueError(f"threads is {threads}: give at least 1")
        # The native map counts entities from 0; numbers of released entities are used again.
        self._number: dict[Hashable, int] = {}
        self._entity: list[Hashable] = []
        self._free: list[int] = []
        self._lock = threading.RLock()

    @property
    def voxel_size(self) -> float:
        """Edge of a voxel in metres."""
        return self._voxel_size

    def __contains__(self, entity: object) -> bool:
        return entity in self._number

    def __len__(self) -> int:
        return len(self._number)

    def entities(self) -> set[Hashable]:
        """Return the entities that have voxels."""
        with self._lock:
            return set(self._number)

    def insert(self, entity: Hashable, region: Region) -> None:
        """Add a region to the voxels of an entity.

        Raises ValueError: it has more voxels than `semmap.limits` allow; the map is not changed.
        """
        shape = shape_of(region)
        with self._lock:
            self._change(entity, lambda number: self._native.insert(number, shape))

    def move(self, entity: Hashable, region: Region) -> None:
        """Replace the voxels of an entity, new or not, by those of a region; raises as `insert`."""
        shape = shape_of(region)
        with self._lock:
            self._change(entity, lambda number: self._native.move(number, shape))

    def insert_many(self, regions: EntityRegions) -> None:
        """Add many regions in one pass, some for one entity; all, or none as in `insert`."""
        for entity, reason in self._insert_many(regions, skip=False).items():
            raise ValueError(f"{entity}: {reason}")

    def insert_possible(self, regions: EntityRegions) -> dict[Hashable, str]:
        """Add many regions, and return by entity why those with too many voxels were skipped."""
        skipped = self._insert_many(regions, skip=True)
        for entity in skipped:
            self.remove(entity)
        return skipped

    def remove(self, entity: Hashable) -> None:
        """Remove all voxels of an entity. Does nothing if the entity is unknown."""
        with self._lock:
            number = self._number.get(entity)
            if number is not None:
                self._native.remove(number)
                self._release_if_empty(entity)

    def voxels(self, entity: Hashable) -> NDArray[np.int32]:
        """Return the voxels (N, 3) of an entity, each once; none for an unknown entity."""
        with self._lock:
            number = self._number.get(entity)
            if number is None:
                return np.zeros((0, 3), np.int32)
            return self._native.voxels(number)

    def centres(self, entity: Hashable) -> NDArray[np.float64]:
        """Return the centres (N, 3) of the voxels of an entity in metres."""
        return np.asarray((self.voxels(entity) + 0.5) * self._voxel_size, np.float64)

    def size(self, entity: Hashable) -> int:
        """Return the number of voxels of an entity; 0 for an unknown entity."""
        with self._lock:
            number = self._number.get(entity)
            return 0 if number is None else self._native.size(number)

    def set_numbers_at(self, points: ArrayLike) -> NDArray[np.int32]:
        """Return the number of the set (N,) at each of (N, 3) points; 0 is the empty set."""
        return self._native.set_numbers_at(as_points(points, "points"))

    def sets(self, numbers: ArrayLike) -> dict[int, frozenset[Hashable]]:
        """Return the set of each number; the empty set for numbers that are not in use."""
        wanted: list[int] = np.unique(np.asarray(numbers, dtype=np.int32)).tolist()
        with self._lock:
            members = self._native.members(wanted)
            return {
                number: frozenset(self._entity[n] for n in each)
                for number, each in zip(wanted, members, strict=True)
            }

    def entities_at(self, points: ArrayLike) -> list[set[Hashable]]:
        """Return the set of entities at each of (N, 3) points in metres."""
        with self._lock:
            numbers = self.set_numbers_at(points)
            sets = self.sets(numbers)
        return [set(sets[number]) for number in numbers.tolist()]

    def overlap(self, a: Hashable, b: Hashable) -> Overlap:
        """Return the space that two entities share; 0 if one is unknown."""
        with self._lock:
            one, other = self._number.get(a), self._number.get(b)
            shared = 0 if one is None or other is None else self._native.overlap(one, other)
        return Overlap(shared, shared * self._voxel_size**3)

    def neighbours(self, entity: Hashable, reach: float | None = None) -> dict[Hashable, Neighbour]:
        """Return the entities around an entity; none for an unknown entity.

        `reach` is the largest gap in metres, up to 1,000 voxels; if not given, only the entities
        that share a voxel. Entities further away take no time.
        """
        farthest = -1
        if reach is not None:
            if not 0 <= reach <= FARTHEST * self._voxel_size:
                raise ValueError(
                    f"reach is {reach!r}: give metres from 0 to {FARTHEST * self._voxel_size:g} "
                    f"({FARTHEST} voxels), or None"
                )
            farthest = math.floor((reach / self._voxel_size) ** 2 * (1 + 1e-9))
        with self._lock:
            number = self._number.get(entity)
            if number is None:
                return {}
            return {
                self._entity[other]: Neighbour(shared, math.sqrt(gap))
                for other, shared, gap in self._native.neighbours(number, farthest)
            }

    def support(self, a: Hashable, b: Hashable) -> Support:
        """Return how much of the underside of `a` rests on `b`; 0 if one is unknown."""
        with self._lock:
            one, other = self._number.get(a), self._number.get(b)
            if one is None or other is None:
                return Support(0, 0, 0)
            return Support(*self._native.support(one, other))

    def memory(self) -> Memory:
        """Return the memory of the map."""
        return Memory(*self._native.memory())

    def write(self, path: str | Path) -> None:
        """Write the numbers of the sets to a `.vdb` file."""
        self._native.write(str(path))

    def state(self) -> tuple[semmap_vdb.Int32Grid, dict[int, list[Hashable]]]:
        """Return each voxel's number of a set, and the members of the sets: see `from_state`."""
        with self._lock:
            grid, sets = self._native.state()
            return grid, {number: [self._entity[n] for n in each] for number, each in sets}

    @classmethod
    def from_state(
        cls,
        grid: semmap_vdb.Int32Grid,
        sets: Mapping[int, Iterable[Hashable]],
        *,
        threads: int | None = None,
    ) -> RegionMap:
        """Return the map that had a `state`, with the same numbers; ValueError if it is none."""
        made = cls(grid.voxel_size, threads=threads)
        rows = [
            (number, sorted({made._assign(entity) for entity in members}))
            for number, members in sets.items()
        ]
        made._native.restore(grid, rows)
        return made

    def _assign(self, entity: Hashable) -> int:
        """Return the number of an entity, new or not."""
        number = self._number.get(entity)
        if number is None:
            number = self._free.pop() if self._free else len(self._entity)
            self._entity[number : number + 1] = [entity]
            self._number[entity] = number
        return number

    def _change(self, entity: Hashable, change: Any) -> None:
        number = self._assign(entity)
        try:
            change(number)
        except ValueError as error:
            raise ValueError(f"{entity}: {error}") from None
        finally:
            self._release_if_empty(entity)

    def _insert_many(self, regions: EntityRegions, *, skip: bool) -> dict[Hashable, str]:
        pairs = list(regions.items() if isinstance(regions, Mapping) else regions)
        shapes = [shape_of(region) for _, region in pairs]
        with self._lock:
            numbers = [self._assign(entity) for entity, _ in pairs]
            try:
                reasons = self._native.insert_many(numbers, shapes, self._threads, skip)
            finally:
                for entity, _ in pairs:
                    self._release_if_empty(entity)
        found = zip((entity for entity, _ in pairs), reasons, strict=True)
        return {entity: reason for entity, reason in found if reason}

    def _release_if_empty(self, entity: Hashable) -> None:
        number = self._number.get(entity)
        if number is not None and not self._native.has(number):
            del self._number[entity]
            self._entity[number] = None
            self._free.append(number)


Role = Literal["object", "building part", "agent", "room", "region", "view", "personal space"]
"""What an entity of a region map is. Only bodies occupy their voxels."""

BODIES: tuple[Role, ...] = ("object", "building part", "agent")
SPACES: tuple[Role, ...] = ("room", "region", "personal space")


@dataclass(frozen=True, eq=False)
class WithRole:
    """The entities with one of some roles, always as `roles` has them now."""

    roles: Mapping[Any, Role]
    among: tuple[Role, ...] = SPACES

    def __contains__(self, entity: object) -> bool:
        return self.roles.get(entity, "object") in self.among


@dataclass(eq=False)
class NamedRegionMap:
    """A region map with what its entities are; those of a map are ids, those of sources names.

    An agent of the map that a source sees is one entity: it has the voxels that are seen, and its
    own ones again when the source sees it no more.
    """

    regions: RegionMap
    # of each entity; one without has `str` of it as its name, and is an object
    names: dict[Any, str] = field(default_factory=dict)
    roles: dict[Any, Role] = field(default_factory=dict)
    views: dict[Any, str] = field(default_factory=dict)  # the agent of each field of view
    # the room of each entity in the map's inventory, None for no room; others have no entry
    homes: dict[Any, Any] = field(default_factory=dict)
    # the agents of the map that have the voxels that sources see, and their own voxels
    seen: set[int] = field(init=False, default_factory=set)
    own: RegionMap = field(init=False)
    # held while voxels of agents change: the map and sources may do so at a time
    changing: Any = field(init=False, default_factory=threading.RLock)

    def __post_init__(self) -> None:
        self.own = RegionMap(self.regions.voxel_size)

    @property
    def spaces(self) -> WithRole:
        """The entities that are parts of space."""
        return WithRole(self.roles)

    @property
    def rooms(self) -> WithRole:
        """The entities that are rooms."""
        return WithRole(self.roles, ("room",))

    @property
    def parts(self) -> WithRole:
        """The entities that are parts of the building."""
        return WithRole(self.roles, ("building part",))

    def stated_rooms(self, entity: Any) -> tuple[Any, ...] | None:
        """Return the room in which the map states an entity to be, if any; None: voxels decide."""
        if entity in self.seen or entity not in self.homes or entity not in self.regions:
            return None
        home = self.homes[entity]
        return (home,) if home in self.rooms else ()

    def entities(self, *roles: Role) -> dict[str, list[Any]]:
        """Return the entities that have voxels, by name; only those with one of `roles` if given.

        Several entities may have one name: an agent of the map, and its body as a source sees it.
        """
        found: dict[str, list[Any]] = {}
        for each in self.regions.entities():
            if not roles or self.roles.get(each, "object") in roles:
                found.setdefault(self.names.get(each, str(each)), []).append(each)
        return found

    def at(self, point: Sequence[float]) -> list[tuple[str, Role]]:
        """Return name and role of the entities that have the voxel at a point (3,), metres."""
        (found,) = self.regions.entities_at([point])
        return sorted((self.names[each], self.roles[each]) for each in found)

    def sizes(self) -> list[tuple[str, Role, int]]:
        """Return name, role and number of voxels of each entity."""
        size, names = self.regions.size, dict(self.names)
        return sorted((name, self.roles[each], size(each)) for each, name in names.items())

    def agents(self) -> dict[str, int]:
        """Return the agents of the map by name; those that only sources know are left out."""
        ids = {each for each in dict(self.names) if isinstance(each, int)}
        return {self.names[each]: each for each in ids if self.roles.get(each) == "agent"}

    def show(self, agent: int, points: NDArray[np.float64]) -> None:
        """Give an agent of the map the voxels at points that a source sees, until `restore`."""
        with self.changing:
            if agent not in self.seen:
                self.own.move(agent, self.regions.centres(agent))
                self.seen.add(agent)
            self.regions.move(agent, points)

    def restore(self, agent: int) -> None:
        """Give an agent its own voxels again; does nothing if no source saw it."""
        with self.changing:
            if agent in self.seen:
                self.regions.move(agent, self.own.centres(agent))
                self.own.remove(agent)
                self.seen.remove(agent)

    def own_regions(self, entity: Any) -> RegionMap:
        """Return the region map with the own voxels of an entity, not those that sources see."""
        return self.own if entity in self.seen else self.regions

    def own_state(self) -> tuple[semmap_vdb.Int32Grid, dict[int, list[Hashable]]]:
        """Return `RegionMap.state` where each agent has its own voxels."""
        with self.changing:
            state = self.regions.state()
            if not self.seen:
                return state
            unseen = RegionMap.from_state(*state)
            for agent in self.seen:
                unseen.move(agent, self.own.centres(agent))
            return unseen.state()

    def forget_sources(self) -> None:
        """Remove all that sources see."""
        for agent in tuple(self.seen):
            self.restore(agent)
        for entity in self.regions.entities():
            if not isinstance(entity, int):
                self.regions.remove(entity)
                for each in (self.names, self.roles, self.views):
                    each.pop(entity, None)

    def occupied(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return at which of (N, 3) points a body is."""
        numbers, place = np.unique(self.regions.set_numbers_at(points), return_inverse=True)
        bodies = {each for several in self.entities(*BODIES).values() for each in several}
        sets = self.regions.sets(numbers)
        full = np.array([not bodies.isdisjoint(sets[n]) for n in numbers.tolist()], np.bool_)
        found: NDArray[np.bool_] = full[place] if len(full) else np.zeros(0, np.bool_)
        return found
