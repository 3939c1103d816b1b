"""The catalogue of a mirror: what fills space, zones, and relations between entities.

In the past, entities have former poses and present geometry; those that were deleted since are
unknown. Sources state what they kept.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from typing import Any

from semmap.fields.maps.live_entities import LiveEntities, agents_seen
from semmap.fields.maps.map_buffer import MapBuffer, SourceUpdate
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.queries.catalogue import FieldCatalogue
from semmap.fields.queries.columns import UnknownError
from semmap.fields.queries.relations import EntityRelation, Relations
from semmap.fields.regions.region_map import NamedRegionMap, RegionMap
from semmap.fields.relations.facts import RelationFact
from semmap.fields.relations.rules import RULES, RelationRule
from semmap.fields.relations.tracker import RelationTracker
from semmap.fields.store.map_store import load_maps_during
from semmap.fields.store.mirror_state import MirrorState
from semmap.fields.store.past_poses import beginning, moments_of_moves, poses_at, present_poses
from semmap.fields.store.source_history import load_updates
from semmap.geometry.pose import Pose
from semmap.language.names import NameIndex
from semmap.query.snapshot import Snapshot

MOST_STATES = 1000
"""The most moments at which relations are compared."""

Open = Callable[[], AbstractContextManager[Snapshot]]


def mirror_catalogue(
    mirror: MirrorState,
    names: NameIndex,
    vocabulary: Vocabulary,
    tracker: Callable[[], RelationTracker] | None = None,
    open_snapshot: Open | None = None,
) -> FieldCatalogue:
    """Return the catalogue of a mirror; relations are computed when the first of them is read.

    `tracker` returns them if something else updates them. `open_snapshot` opens a state of the map,
    for its past; without it, only the maps of `mirror` are known of the past.
    """

    @cache
    def computed() -> RelationTracker:
        relations = RelationTracker.of(mirror)
        relations.update(mirror.regions.entities())
        return relations

    def during(begin: datetime, end: datetime) -> FieldCatalogue:
        assert open_snapshot is not None
        return _past_catalogue(mirror, names, vocabulary, open_snapshot, begin, end)

    return _catalogue(
        mirror,
        mirror.maps,
        names,
        vocabulary,
        tracker or computed,
        past=None if open_snapshot is None else during,
    )


def _catalogue(
    entities: NamedRegionMap,
    maps: MapBuffer,
    names: NameIndex,
    vocabulary: Vocabulary,
    relations: Callable[[], Relations],
    past: Callable[[datetime, datetime], FieldCatalogue] | None = None,
) -> FieldCatalogue:
    def unknown() -> set[str]:
        agents = set(entities.views.values())  # an agent sees by its view, whether seen or not
        return {*names.entities} - entities.entities().keys() - agents

    def missing() -> str | None:
        provided = {name for update in maps.current() for name in update.provides}
        return None if entities.views or "inFieldOfView" in provided else "inFieldOfView"

    return FieldCatalogue(
        vocabulary,
        maps,
        names,
        occupancy=entities,
        relations=[
            EntityRelation(
                vocabulary[name], relations, unknown, missing if name == "sees" else lambda: None
            )
            for name in dict.fromkeys(rule.name for rule in RULES)
            if name in vocabulary
        ],
        voxel_size=entities.regions.voxel_size,
        past=past,
    )


def _past_catalogue(
    mirror: MirrorState,
    names: NameIndex,
    vocabulary: Vocabulary,
    open_snapshot: Open,
    begin: datetime,
    end: datetime,
) -> FieldCatalogue:
    """Return what was so at any time in between; a voxel is free if it was so all the time."""
    with open_snapshot() as seen:
        first = beginning(seen)
        if begin < first:
            raise LookupError(f"the map begins at {first.isoformat()}: give a later time")
        updates = _updates(mirror, vocabulary, seen, begin, end)
        moments = [begin, *moments_of_moves(seen, begin, end)]
        past = _PastEntities(mirror, present_poses(seen))
        states = [poses_at(seen, moment) for moment in moments]
    everywhere = _everywhere(past, list(zip(moments, states, strict=True)), updates)

    @cache
    def relations() -> _Held:
        return _held(past, list(zip(moments, states, strict=True)), updates)

    maps = MapBuffer()
    for number, update in enumerate(updates):
        maps.put(str(number), update.maps, update.time, provides=update.provides)
    return _catalogue(everywhere, maps, names, vocabulary, relations)


def _everywhere(
    past: _PastEntities,
    states: Sequence[tuple[datetime, Mapping[int, Pose]]],
    updates: Sequence[SourceUpdate],
) -> NamedRegionMap:
    """Return the entities with all voxels that they had at any of the moments.

    An agent has the voxels that sources see, and its own ones while none saw it.
    """
    seen = _agents_seen(past.agents(), updates, states[0][0])
    past.bring(states[0][1])
    everywhere = past.copy()
    hidden: set[Any] = set()  # whose own voxels are not in `everywhere`
    for number, (moment, state) in enumerate(states):
        moved = past.bring(state)
        end = states[number + 1][0] if number + 1 < len(states) else None
        meanwhile = [each for at, each in seen if at > moment and (end is None or at < end)]
        always = [each for at, each in seen if at <= moment][-1].intersection(*meanwhile)
        if number == 0:
            hidden = set(always)
            for agent in hidden:
                everywhere.regions.remove(agent)
            continue
        for entity in (moved | hidden) - always:
            everywhere.regions.insert(entity, past.regions.centres(entity))
        hidden = (moved | hidden) & always
    LiveEntities(everywhere).update([map for update in updates for map in update.maps])
    for agent in everywhere.seen:
        everywhere.regions.insert(agent, everywhere.own.centres(agent))
    return everywhere


def _agents_seen(
    agents: Mapping[str, int], updates: Sequence[SourceUpdate], begin: datetime
) -> list[tuple[datetime, frozenset[int]]]:
    """Return the agents of the map that sources saw at first, and from each later update on."""
    valid: dict[str, set[str]] = {}
    seen = {begin: frozenset[int]()}
    for update in updates:
        valid[update.source] = {name for map in update.maps for name in agents_seen(map)}
        names = set[str]().union(*valid.values())
        seen[max(update.time, begin)] = frozenset(agents[each] for each in names & agents.keys())
    return sorted(seen.items())


class _PastEntities(NamedRegionMap):
    """The entities of a mirror, brought to former poses."""

    def __init__(self, mirror: MirrorState, present: Mapping[int, Pose]) -> None:
        ids = {n: name for n, name in dict(mirror.names).items() if isinstance(n, int)}
        regions = RegionMap.from_state(*mirror.own_state())
        super().__init__(regions, ids, {n: mirror.roles[n] for n in ids})
        for entity in regions.entities():
            if not isinstance(entity, int):
                regions.remove(entity)
        self._mirror = mirror
        self._present = present
        self._at: dict[int, Pose | None] = dict(present)

    def copy(self) -> NamedRegionMap:
        regions = RegionMap.from_state(*self.regions.state())
        return NamedRegionMap(regions, dict(self.names), dict(self.roles))

    def bring(self, poses: Mapping[int, Pose]) -> set[Any]:
        """Move the entities to the poses of a moment; return those that moved."""
        moved = set()
        for entity in self.names:
            pose = poses.get(entity)
            if pose == self._at.get(entity):
                continue
            self._at[entity] = pose
            moved.add(entity)
            points = self._mirror.own_regions(entity).centres(entity)
            own = self.own_regions(entity)
            if pose is None or not len(points):
                own.remove(entity)
                continue
            if entity in self._present and pose != self._present[entity]:
                points = (pose @ self._present[entity].inverse()).apply(points)
            own.move(entity, points)
        return moved


@dataclass(frozen=True)
class _Held:
    """The facts that were true at any time, as `RelationTracker.holding` returns them."""

    rules: tuple[RelationRule, ...]
    facts: set[RelationFact]

    def holding(self, relation: str | None = None) -> dict[RelationFact, None]:
        return {fact: None for fact in self.facts if relation in (None, fact.relation)}


def _held(
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
    live, tracker = LiveEntities(past), RelationTracker.of(past)
    poses = dict(states)
    facts: set[RelationFact] = set()
    past.bring(states[0][1])
    for number, time in enumerate(times):
        changed = past.bring(poses[time]) if time in poses and number else set()
        valid = {update.source: update for update in updates if update.time <= time}
        changed |= live.update([map for update in valid.values() for map in update.maps])
        tracker.update(past.regions.entities() if number == 0 else changed)
        live.forget(changed)
        facts |= tracker.holding().keys()
    return _Held(tracker.rules, facts)


def _updates(
    mirror: MirrorState,
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
