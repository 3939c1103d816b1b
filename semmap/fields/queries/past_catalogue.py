"""The catalogue of a mirror in the past: former poses, present geometry, what sources kept.

Entities that were deleted since are unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from datetime import datetime
from functools import cache
from typing import TYPE_CHECKING, Any

from semmap.fields.maps.live_entities import LiveEntities
from semmap.fields.maps.map_buffer import MapBuffer, SourceUpdate
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.queries.catalogue import FieldCatalogue
from semmap.fields.queries.entity_relation import EntityRelation
from semmap.fields.queries.statements import UnknownError
from semmap.fields.regions.region_map import NamedRegionMap, RegionMap, Role, SpacesOf
from semmap.fields.relations.facts import RelationFact
from semmap.fields.relations.rules import RULES, RelationRule
from semmap.fields.relations.tracker import RelationTracker
from semmap.fields.store.map_store import load_maps_during
from semmap.fields.store.past_poses import (
    beginning,
    moments_of_moves,
    poses_at,
    present_poses,
)
from semmap.fields.store.source_history import load_updates
from semmap.geometry.pose import Pose
from semmap.language.names import NameIndex
from semmap.query.snapshot import Snapshot

if TYPE_CHECKING:
    from semmap.fields.store.mirror_state import MirrorState
    from semmap.fields.store.voxel_mirror import VoxelMirror

MOST_STATES = 1000
"""The most moments at which relations are compared."""

Open = Callable[[], AbstractContextManager[Snapshot]]


def past_catalogue(
    mirror: MirrorState | VoxelMirror,
    names: NameIndex,
    vocabulary: Vocabulary,
    open_snapshot: Open,
) -> Callable[[datetime, datetime], FieldCatalogue]:
    """Return the function that makes the catalogue of a time, from a mirror of the present.

    It states what was so at any time in between; a voxel is free if it was so all the time.
    """

    def during(begin: datetime, end: datetime) -> FieldCatalogue:
        with open_snapshot() as seen:
            first = beginning(seen)
            if begin < first:
                raise LookupError(f"the map begins at {first.isoformat()}: give a later time")
            updates = _updates(mirror, vocabulary, seen, begin, end)
            moments = [begin, *moments_of_moves(seen, begin, end)]
            past = _PastEntities(mirror, present_poses(seen))
            states = [poses_at(seen, moment) for moment in moments]
        past.bring(states[0])
        everywhere = past.copy()
        for state in states[1:]:
            for entity in past.bring(state):
                _insert(everywhere, entity, past.regions.voxels(entity))
        roles, entity_names, views = past.roles(), past.names(), dict[Any, str]()
        live = LiveEntities(everywhere, entity_names, roles, views)
        live.update([map for update in updates for map in update.maps])
        occupancy = NamedRegionMap(everywhere, entity_names, roles)

        @cache
        def relations() -> _Held:
            return _held(mirror, past, list(zip(moments, states, strict=True)), updates)

        def unknown() -> set[str]:
            return {*names.entities} - occupancy.entities().keys() - set(views.values())

        def missing() -> str | None:
            provided = {name for update in updates for name in update.provides}
            return None if "inFieldOfView" in provided else "inFieldOfView"

        maps = MapBuffer()
        for number, update in enumerate(updates):
            maps.put(str(number), update.maps, update.time, provides=update.provides)
        return FieldCatalogue(
            vocabulary,
            maps,
            names,
            occupancy=occupancy,
            relations=[
                EntityRelation(
                    vocabulary[name],
                    relations,
                    unknown,
                    missing if name == "sees" else lambda: None,
                )
                for name in dict.fromkeys(rule.name for rule in RULES)
                if name in vocabulary
            ],
            voxel_size=mirror.regions.voxel_size,
        )

    return during


class _PastEntities:
    """The entities of a mirror, brought to former poses."""

    def __init__(self, mirror: MirrorState | VoxelMirror, present: Mapping[int, Pose]) -> None:
        grid, sets = mirror.regions.state()
        self.regions = RegionMap.from_state(grid, sets)
        for entity in self.regions.entities():
            if not isinstance(entity, int):
                self.regions.remove(entity)
        self._mirror = mirror
        self._present = present
        self._at: dict[int, Pose | None] = dict(present)

    def names(self) -> dict[Any, str]:
        return {n: name for n, name in dict(self._mirror.names).items() if isinstance(n, int)}

    def roles(self) -> dict[Any, Role]:
        return {n: self._mirror.roles[n] for n in self.names()}

    def copy(self) -> RegionMap:
        return RegionMap.from_state(*self.regions.state())

    def bring(self, poses: Mapping[int, Pose]) -> set[int]:
        """Move the entities to the poses of a moment; returns those that moved."""
        moved = set()
        for entity in self.names():
            pose = poses.get(entity)
            if pose == self._at.get(entity):
                continue
            self._at[entity] = pose
            moved.add(entity)
            voxels = self._mirror.regions.voxels(entity)
            if pose is None or not len(voxels):
                self.regions.remove(entity)
                continue
            size = self.regions.voxel_size
            points = (voxels + 0.5) * size
            if entity in self._present and pose != self._present[entity]:
                points = (pose @ self._present[entity].inverse()).apply(points)
            self.regions.move(entity, points)
        return moved


class _Held:
    """The facts that were true at any time, as `RelationTracker.holding` returns them."""

    def __init__(self, rules: tuple[RelationRule, ...], facts: Iterable[RelationFact]) -> None:
        self.rules = rules
        self._facts = set(facts)

    def holding(self, relation: str | None = None) -> dict[RelationFact, None]:
        return {fact: None for fact in self._facts if relation in (None, fact.relation)}


def _held(
    mirror: MirrorState | VoxelMirror,
    past: _PastEntities,
    states: Sequence[tuple[datetime, Mapping[int, Pose]]],
    updates: Sequence[SourceUpdate],
) -> _Held:
    """Return all relations that were true at any of the moments."""
    begin = states[0][0]
    times = sorted({moment for moment, _ in states} | {max(u.time, begin) for u in updates})
    if len(times) > MOST_STATES:
        raise UnknownError(
            f"entities and sources changed {len(times)} times in between: relations are compared "
            f"at up to {MOST_STATES} moments, give a shorter time"
        )
    names, roles, views = past.names(), past.roles(), dict[Any, str]()
    live = LiveEntities(past.regions, names, roles, views)
    entity_names: dict[Any, Any] = names
    tracker = RelationTracker(past.regions, names=entity_names, views=views, spaces=SpacesOf(roles))
    poses = dict(states)
    facts: set[RelationFact] = set()
    past.bring(states[0][1])
    for number, time in enumerate(times):
        changed: set[Any] = past.bring(poses[time]) if time in poses and number else set()
        shown = [map for update in _valid_at(updates, time) for map in update.maps]
        changed |= live.update(shown)
        tracker.update(past.regions.entities() if number == 0 else changed)
        live.forget(changed)
        facts |= tracker.holding().keys()
    return _Held(tracker.rules, facts)


def _valid_at(updates: Sequence[SourceUpdate], time: datetime) -> Iterator[SourceUpdate]:
    newest: dict[str, SourceUpdate] = {}
    for update in updates:
        if update.time <= time:
            newest[update.source] = update
    yield from newest.values()


def _insert(regions: RegionMap, entity: int, voxels: Any) -> None:
    if len(voxels):
        regions.insert(entity, (voxels + 0.5) * regions.voxel_size)


def _updates(
    mirror: MirrorState | VoxelMirror,
    vocabulary: Vocabulary,
    seen: Snapshot,
    begin: datetime,
    end: datetime,
) -> list[SourceUpdate]:
    """Return what sources stated: from memory, and what they kept from before."""
    found = [each for each in mirror.maps.updates(begin, end) if each.source != "kept"]
    oldest = mirror.maps.oldest()
    for source, kept in load_updates(seen, vocabulary, begin, end).items():
        limit = oldest.get(source)
        found += [each for each in kept if limit is None or each.time < limit]
    found += load_maps_during(seen, vocabulary, begin, end)
    return sorted(found, key=lambda each: each.time)
