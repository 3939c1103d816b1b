"""Costmaps of the storeys of a map in the database."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from navgrid.costmap import Costmap, Inflation
from navgrid.field_layer import FieldVoxels
from navgrid.grid import MARGIN, scene_grid
from navgrid.map_file import map_layer
from navgrid.policy import Policy
from navgrid.terrain import DriveLimits
from semmap.geometry.voxels import Voxels
from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import read_scene, read_storey_names, read_storeys
from semmap.query.storey_scene import Bounds, StoreyScene
from semmap.robot import Part


def read_costmaps(
    seen: Snapshot,
    parts: Sequence[Part],
    *,
    storey: str | None = None,
    rooms: Sequence[str] | None = None,
    bounds: Bounds | None = None,
    resolution: float = 0.05,
    policy: Policy | None = None,
    inflation: Inflation | None = None,
    limits: DriveLimits | None = None,
    static_map: Path | None = None,
    moment: datetime | None = None,
    fields: Mapping[str, FieldVoxels] | None = None,
    voxels: Mapping[int, Voxels] | None = None,
    assume_sizes: bool = False,
) -> list[Costmap]:
    """Return the costmaps of a robot, one per storey of the current map, the lowest first.

    All are of the storey, rooms (with their doorways) and `bounds` (x0, y0, x1, y1) that are given.
    `static_map` is a map file, such as one from SLAM, for a further layer. Regions that do not hold
    at `moment` are left out. `voxels` by id (`read_mirror`) stand in place of the meshes of
    objects. LookupError if there is no such storey or room, or nothing stands there.
    """
    policy, inflation = policy or Policy.default(), inflation or Inflation()
    # A part of a storey has the costs of the whole: what is within reach of it is read, too.
    reach = (
        max(part.circumscribed_radius for part in parts)
        + inflation.inflation_radius
        + max(layer.padding for layer in policy.layers)
    )
    is_part = rooms is not None or bounds is not None
    costmaps = []
    for scene in _read_scenes(
        seen,
        storey,
        rooms,
        bounds,
        reach,
        moment=moment,
        voxels=voxels,
        assume_sizes=assume_sizes,
    ):
        if not scene.entities and not scene.floors:
            continue
        grid = scene_grid(scene, resolution, bounds, reach if is_part else MARGIN)
        static = {} if static_map is None else {"static_map": map_layer(static_map, grid)}
        costmaps.append(
            Costmap(
                scene,
                parts,
                grid,
                policy=policy,
                inflation=inflation,
                limits=limits,
                static=static,
                fields=fields,
            )
        )
    if not costmaps:
        raise LookupError(
            "there is nothing to make a costmap of; name a storey, rooms or a box of the map"
        )
    return costmaps


def _read_scenes(
    seen: Snapshot,
    storey: str | None,
    rooms: Sequence[str] | None,
    bounds: Bounds | None,
    margin: float,
    **options: Any,
) -> list[StoreyScene]:
    """The scenes of the storeys, or of the parts of them that are asked for."""
    if rooms is None and bounds is None:
        return read_storeys(seen, storey, **options)
    names = read_storey_names(seen) if storey is None else [storey]
    found = []
    for name in names:
        try:
            scene = read_scene(seen, name, bounds=bounds, rooms=rooms, margin=margin, **options)
        except LookupError:
            if rooms is None or len(names) == 1:
                raise
            continue  # these rooms are on another storey
        found.append(scene)
    return found
