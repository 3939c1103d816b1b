"""Puts what sources see on the grid of the map, so that a voxel has the set {book, view, room}.

Source: "VDB-based Spatially Grounded Semantics for Interactive Robots", section III.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.fields.maps.lattice import Lattice
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.regions.region_map import NamedRegionMap, Role

ROLES: dict[str, tuple[Role, str]] = {
    "inFieldOfView": ("view", "{}_view"),
    "inPersonalSpace": ("personal space", "{}_personal_space"),
    "containsPerson": ("agent", "{}"),
    "containsRobot": ("agent", "{}"),
    "inRoom": ("room", "{}"),
    "inZone": ("region", "{}"),
}
"""For each property the role and the name of the entity that a map of it shows.

The objects that sources see are types, not entities of the map: they are not on the grid. An agent
of that name in the map is the entity.
"""


class LiveEntities:
    """The entities that maps of sources show on a region map, such as a mirror."""

    def __init__(self, on: NamedRegionMap) -> None:
        self._on = on
        # by entity the maps, and whether it is an agent of the map that has voxels of them
        self._shown: dict[Any, tuple[tuple[tuple[int, str | None], ...], bool]] = {}
        self._kept: tuple[RepresentationMap, ...] = ()

    def update(self, maps: Sequence[RepresentationMap]) -> set[Any]:
        """Show maps in place of the former ones; return the entities that have other maps now."""
        wanted: dict[Any, list[tuple[RepresentationMap, str | None, Role]]] = {}
        with self._on.changing:  # the agents of the map stay what they are
            agents = self._on.agents()
            for each in maps:
                for name, agent, role in _entities(each):
                    entity = agents.get(name, name) if role == "agent" else name
                    wanted.setdefault(entity, []).append((each, agent, role))
            changed = set(self._shown) - set(wanted)
            for entity in changed:
                self._remove(entity)
                del self._shown[entity]
            # Names and roles stay until the tracker has ended the relations of what is gone.
            for entity, shown in wanted.items():
                key = tuple((id(each), agent) for each, agent, _ in shown)
                if self._shown.get(entity) == (key, entity in self._on.seen):
                    continue
                self._show(entity, shown)
                self._shown[entity] = key, entity in self._on.seen
                changed.add(entity)
        self._kept = tuple(maps)  # an id is unique while its map is alive
        return changed

    def forget(self, entities: set[Any]) -> None:
        """Forget names and roles of entities that are gone, after their relations ended."""
        for entity in entities - set(self._shown):
            if not isinstance(entity, int):
                for each in (self._on.names, self._on.roles, self._on.views):
                    each.pop(entity, None)

    def _show(
        self, entity: Any, shown: Sequence[tuple[RepresentationMap, str | None, Role]]
    ) -> None:
        points = np.concatenate([self._points(each, agent) for each, agent, _ in shown])
        if isinstance(entity, int):
            if len(points):
                self._on.show(entity, points)
            else:  # no voxel of it is seen
                self._on.restore(entity)
            return
        _, agent, role = shown[0]
        self._on.names[entity], self._on.roles[entity] = entity, role
        if role == "view" and agent is not None:
            self._on.views[entity] = agent
        self._on.regions.move(entity, points)

    def _remove(self, entity: Any) -> None:
        if isinstance(entity, int):
            self._on.restore(entity)
        else:
            self._on.regions.remove(entity)

    def _points(self, map: RepresentationMap, agent: str | None) -> NDArray[np.float64]:
        """Return the centres of the voxels that show an entity."""
        placed = map.resampled(Lattice(self._on.regions.voxel_size))
        voxels, values = placed.grid.read()
        if map.legend:
            wanted = [value for value, name in map.legend.items() if name == agent]
            voxels = voxels[np.isin(values, wanted)]
        return np.asarray((voxels + 0.5) * self._on.regions.voxel_size, np.float64)


def agents_seen(map: RepresentationMap) -> set[str]:
    """Return the names of the agents whose bodies a map shows."""
    return {name for name, _, role in _entities(map) if role == "agent"}


def _entities(map: RepresentationMap) -> Iterator[tuple[str, str | None, Role]]:
    """Yield the entities of a map: name, whom it is about, role."""
    if map.property.name in ROLES:
        role, form = ROLES[map.property.name]
        about = map.legend.values() if map.legend else ([map.about] if map.about else [])
        for agent in dict.fromkeys(about):
            yield form.format(agent), agent, role
