"""Buildings of the Industry Foundation Classes (IFC 2x3, 4 and 4.3), read by IfcOpenShell."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from semmap.ingest.ifc.building import IfcBuilding
from semmap.ingest.ifc.doors import add_doors, add_openings
from semmap.ingest.ifc.georeference import georeference_of
from semmap.ingest.ifc.ifc_file import IfcFile
from semmap.ingest.ifc.stairs import add_stairs
from semmap.ingest.world import World, WorldError


def read_ifc(
    path: Path, progress: Callable[[str, int, int], None] = lambda stage, done, total: None
) -> World:
    """Return the world of an IFC file: each element with its surface, type and property sets.

    Storeys are those that have spaces, else those that have elements. Doors join the two spaces
    that they bound (`IfcRelSpaceBoundary`), else those on both sides; spaces that touch are joined
    by an opening where nothing stands between them. Needs the extra `semmap[ifc]`.

    Raises
    ------
    WorldError
        The file cannot be read, is truncated, or exceeds the limits.
    """
    try:
        building = IfcBuilding(IfcFile(path, progress))
        building.out.georeference = georeference_of(building)
        building.add_storeys()
        building.add_lifts()
        building.add_spaces()
        add_doors(building)
        add_openings(building)
        add_stairs(building)
        building.add_elements()
        return building.out
    except (AttributeError, IndexError, KeyError, TypeError) as error:
        # IfcOpenShell gives what the file says, also where the schema demands something else
        problem = f"has an entity that is not of its schema ({' '.join(str(error).split())[:160]})"
        raise WorldError(path, "file", problem, "Export the building again.") from error
