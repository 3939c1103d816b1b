"""The entities of a scene, sorted to the layers of a policy (Deeken et al., section 4.2)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from navgrid.policy import FLOOR, NONE, Policy
from navgrid.terrain import DriveLimits, drivable
from semmap.geometry.voxels import Voxels
from semmap.query.storey_scene import Bounds, SceneEntity, StoreyScene


@dataclass
class LayerChange:
    """The ground rectangles, metres, that changed entities covered or cover, and their layers.

    `floors`: a floor changed, and with it the heights above it.
    """

    bounds: list[Bounds] = field(default_factory=list)
    layers: set[str] = field(default_factory=set)
    floors: bool = False


class LayerMembers:
    """Which entity is on which layer, and which faces of floors are driven on.

    Floors and the meshes of rooms are divided: a robot drives on the faces that are level enough
    and connected to a room's floor; their other faces, such as walls, are obstacles. Of voxels, the
    floor is those that a room's floor passes through. `layers` has by layer its entities by id;
    `ramps` the (F, 3, 3) drivable faces that are not level with a floor of the scene.
    """

    def __init__(self, scene: StoreyScene, policy: Policy, limits: DriveLimits) -> None:
        self.scene = scene
        self.policy = policy
        self.limits = limits
        self._entities = {entity.id: entity for entity in scene.entities}
        self.layers: dict[str, dict[int, SceneEntity]] = {}
        self.ramps: NDArray[np.float64] = np.empty((0, 3, 3))
        self.sort()

    def __contains__(self, number: int) -> bool:
        """Whether there is an entity of this id, on a layer or not."""
        return number in self._entities

    @property
    def floors(self) -> list[float]:
        """The heights z of the scene's floors, ascending; without rooms that of the storey."""
        return sorted({area.floor for area in self.scene.floors} or {self.scene.elevation})

    def obstacles(self) -> list[SceneEntity]:
        """All entities on any layer, in the order of the layers."""
        return [entity for members in self.layers.values() for entity in members.values()]

    def sort(self) -> None:
        """Put every entity on its layer, from the start."""
        self.layers = {layer.name: {} for layer in self.policy.layers}
        floors = []
        for entity in self._entities.values():
            layer = self.policy.layer_of(entity)
            if layer == FLOOR:
                floors.append(entity)
            elif layer != NONE and entity.bounds is not None:
                self.layers[layer][entity.id] = entity
        self._divide(floors)

    def _divide(self, floors: list[SceneEntity]) -> None:
        """Divide floors into what is driven on and obstacles."""
        fixed = self.layers[self.policy.fixed_layer]
        faces = np.concatenate([*(floor.triangles for floor in floors), np.empty((0, 3, 3))])
        driven = drivable(faces, self.floors, self.limits)
        start = 0
        for floor in floors:
            on = driven[start : start + len(floor.triangles)]
            start += len(floor.triangles)
            voxels = self._above_floors(floor.voxels)
            if not on.all() or voxels is not None:
                fixed[floor.id] = replace(floor, triangles=floor.triangles[~on], voxels=voxels)
        ground = faces[driven]
        level = np.zeros(len(ground), np.bool_)
        for height in self.floors:
            level |= (np.abs(ground[:, :, 2] - height) < self.limits.ground).all(axis=1)
        self.ramps = ground[~level]

    def _above_floors(self, voxels: Voxels | None) -> Voxels | None:
        """The voxels of a floor that the surface of no floor passes through; None for none."""
        if voxels is None:
            return None
        bottom = voxels.indices[:, 2] * voxels.size
        ground = np.zeros(len(bottom), np.bool_)
        for height in self.floors:
            ground |= (bottom <= height + self.limits.ground) & (bottom + voxels.size >= height)
        if ground.all():
            return None
        faces = voxels.triangles
        if faces is not None:
            faces = faces[~drivable(faces, self.floors, self.limits)]
        return Voxels(voxels.size, voxels.indices[~ground], faces)

    def update(self, entities: Iterable[SceneEntity], gone: Iterable[int] = ()) -> LayerChange:
        """Replace or add entities and remove those that are gone; return what this changed.

        Where a floor changed, call `sort`.
        """
        change = LayerChange()
        for number, entity in [*((e.id, e) for e in entities), *((g, None) for g in gone)]:
            former = self._entities.pop(number, None)
            if former is not None and (layer := self._noted(former, change)) is not None:
                self.layers[layer].pop(number, None)
            if entity is not None:
                self._entities[number] = entity
                if (layer := self._noted(entity, change)) is not None:
                    self.layers[layer][number] = entity
        return change

    def _noted(self, entity: SceneEntity, change: LayerChange) -> str | None:
        """Enter an entity in a change; return its layer, None for one without cells of its own."""
        layer = self.policy.layer_of(entity)
        if layer == FLOOR:
            change.floors = True
        if layer in (FLOOR, NONE) or entity.bounds is None:
            return None
        change.bounds.append(entity.bounds)
        change.layers.add(layer)
        return layer
