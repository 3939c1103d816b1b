"""The formats to which a map is exported, by the ending of a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from semmap.export.features import MapFeatures, read_map
from semmap.export.gis_file import write_geojson, write_geopackage
from semmap.export.gltf import write_gltf
from semmap.export.indoor_gml import write_indoor_gml
from semmap.export.rmf_building import write_rmf
from semmap.export.sdf_world import write_sdf
from semmap.query.snapshot import Snapshot
from semmap.whole_file import whole_file


class Format(NamedTuple):
    """What writes a format, and of what."""

    write: Callable[[MapFeatures, Path], None]
    on_earth: bool = True  # whether it can have the coordinates of a CRS
    boxes: bool = False  # whether boxes and prisms are meshes, too
    within: bool = False  # whether meshes are in the file itself


FORMATS = {
    ".gpkg": Format(write_geopackage),
    ".geojson": Format(write_geojson),
    ".gml": Format(write_indoor_gml),
    ".glb": Format(write_gltf, on_earth=False, boxes=True, within=True),
    ".gltf": Format(write_gltf, on_earth=False, boxes=True, within=True),
    ".yaml": Format(write_rmf, on_earth=False, within=True),
    ".sdf": Format(write_sdf, on_earth=False, boxes=True),
    ".world": Format(write_sdf, on_earth=False, boxes=True),
}


def export_map(seen: Snapshot, path: Path, *, crs: Any = None, meshes: bool = True) -> Path:
    """Write a map to a file, its meshes to a folder beside it; return the path.

    The file appears as a whole, or not at all.
    """
    format_ = FORMATS.get(path.suffix.lower())
    if format_ is None:
        known = ", ".join(FORMATS)
        raise ValueError(f"{path.name}: a map is exported to {known}, not to {path.suffix!r}")
    if crs is not None and not format_.on_earth:
        kinds = ", ".join(ending for ending, each in FORMATS.items() if each.on_earth)
        raise ValueError(f"{path.name} has metres of the map's frame: crs is for {kinds}")
    folder = f"{path.stem}_meshes" if meshes else None
    found = read_map(seen, folder=folder, boxes=format_.boxes, crs=crs)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as made:
        format_.write(found, made)
        if not format_.within:
            found.write_meshes(path)
    return path
