"""The shapes of a building's models, where their SDF files are on this machine."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.sdf.models import Models, Role
from semmap.ingest.sdf.resources import Resources
from semmap.ingest.world import Shape, World


class ModelShapes:
    """Finds models by their names (``owner/model``), each once: see `Resources.fuel_model`."""

    def __init__(self, world: World, geometry: Role, model_path: Sequence[Path]) -> None:
        self._source, self._geometry = world.source, geometry
        self._resources = Resources(model_path)
        self._models = Models(world, self._resources)
        self._known: dict[str, tuple[Pose, list[Shape]]] = {}

    def of(self, name: str, where: str) -> tuple[Pose, list[Shape]]:
        """Return the shapes of a model, and the pose of their frame in the model's frame."""
        if name not in self._known:
            self._known[name] = self._read(name, where)
        return self._known[name]

    def _read(self, name: str, where: str) -> tuple[Pose, list[Shape]]:
        folder = self._resources.fuel_model(name, self._source)
        model = None if folder is None else self._models.model(folder, where)
        if model is None:
            return IDENTITY, []
        innermost, inside = model.unwrapped()
        shape = self._models.shape(innermost, self._geometry)
        return inside, [] if shape is None else [shape]
