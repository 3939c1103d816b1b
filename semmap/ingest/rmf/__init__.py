"""Open-RMF buildings: `building.yaml` into storeys, rooms, doors, lifts, places and lanes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from semmap.ingest.rmf.building_file import read_building
from semmap.ingest.rmf.building_world import BuildingWorld
from semmap.ingest.rmf.model_shapes import ModelShapes
from semmap.ingest.rmf.storey_entries import StoreyEntries
from semmap.ingest.sdf.models import Role
from semmap.ingest.world import World


def read_rmf(
    path: Path | str,
    *,
    geometry: Role = "visual",
    model_path: Sequence[Path] = (),
    georeference: Mapping[str, float] | None = None,
) -> World:
    """Return the world of an Open-RMF building, in pixels, metres, or degrees (``wgs84``).

    The map's frame is the reference level's drawing in metres, y up; the frame of a storey is the
    same, raised to its elevation. Rooms are the faces that walls, doors and floor outlines
    enclose. Each named vertex and each end of a lane is a region, each lane a link. Models have the
    shapes of their SDF files, where these are on this machine.

    Parameters
    ----------
    geometry : of these files
    model_path : folders of models, searched first (see `semmap.ingest.sdf.resources.Resources`)
    georeference : of the map; a building in degrees comes into its frame, and sets it otherwise

    Raises
    ------
    WorldError
        The file cannot be trusted as a whole; nothing of it is used.
    """
    world = BuildingWorld(read_building(Path(path), georeference))
    shapes = ModelShapes(world.out, geometry, model_path)
    for plan in world.building.levels.values():
        StoreyEntries(world, plan, shapes).add_all()
    return world.out
