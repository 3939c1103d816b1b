"""The import of a file: read it, store it, derive the inventories, summarise."""

from __future__ import annotations

import hashlib
import math
import time
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import psycopg
from numpy.typing import NDArray
from psycopg.types.json import Jsonb
from sqlalchemy import Connection, Engine

from semmap.database.maps import driver_of, see_map
from semmap.geometry.extent import extent
from semmap.geometry.pose import Pose
from semmap.ingest.annotation.annotation import read_annotation
from semmap.ingest.building_shell import recognise_shells
from semmap.ingest.georeference import frame_in_frame, on_grid
from semmap.ingest.ifc import read_ifc
from semmap.ingest.imdf import is_imdf, read_imdf
from semmap.ingest.indoor_gml import read_indoor_gml
from semmap.ingest.meshes.mesh_file import read_mesh_world
from semmap.ingest.meshes.point_cloud_file import READERS, read_point_cloud
from semmap.ingest.naming import GUESS
from semmap.ingest.ontology.tbox import own_tbox
from semmap.ingest.ontology.type_store import load_tbox
from semmap.ingest.rmf import read_rmf
from semmap.ingest.route_graph.graph_file import EDGE, is_route_graph, read_route_graph
from semmap.ingest.route_graph.node_store import check_names, settle_nodes
from semmap.ingest.scenes.mesh_scene import is_mesh_scene, read_mesh_scene
from semmap.ingest.scenes.mjcf_scene import read_mjcf
from semmap.ingest.scenes.urdf_scene import read_urdf_scene
from semmap.ingest.scenes.usd_scene import read_usd
from semmap.ingest.sdf.models import Role
from semmap.ingest.sdf.world_file import read_sdf
from semmap.ingest.store.holder_store import (
    derive_inventories,
    postpone_derivation,
    recognise_parts,
)
from semmap.ingest.store.model_store import Progress
from semmap.ingest.store.world_store import LOCK_IMPORTS, store_world
from semmap.ingest.storeys import FOUND, found_storeys
from semmap.ingest.world import Shape, Skipped, StoreyDetail, World, WorldError, poses_in_map
from semmap.limits import ENTRIES, EXTENT, NAME_CHARACTERS
from semmap.query.geometry_notes import SHOWN, names_note, read_names_without_geometry
from semmap.query.snapshot import Snapshot

IFC, GML, IMDF = (".ifc",), (".gml",), (".zip",)
IFC, URDF, MJCF = (".ifc",), (".urdf",), (".xml", ".mjcf")
USD = (".usd", ".usda", ".usdc", ".usdz")
SDF, RMF, FEATURES = (".sdf", ".world"), (".yaml", ".yml"), (".geojson", ".json", ".gpkg")
MESHES = (".3mf", ".bt", ".dae", ".glb", ".gltf", ".obj", ".off", ".ot", ".ply", ".stl")
"""The mesh formats that trimesh reads and whose triangles can be counted."""

KNOWN = (*SDF, *RMF, *IFC, *GML, *IMDF, *FEATURES, *MESHES, *READERS, *USD, *MJCF, *URDF)
"""The endings of all files that are read."""

LONG = 200.0
"""Metres from which an object or a room is noted: its file may be in another unit."""

SMALL, TINY, WIDE = 0.5, 0.02, 2000.0
"""Metres across below which a building and a single object, and above which a site is noted."""

SAME_FRAME = 1e-6
"""Metres, and lengths of quaternions, within which two frames of the earth are one."""

MeshAs = Literal["object", "room", "scene"]
"""What a mesh file is: one object, the shell of a room, or an object for each of its nodes."""


def read_world(
    path: Path,
    geometry: Role = "visual",
    mesh_as: MeshAs | None = None,
    *,
    model_path: Sequence[Path] = (),
    scale: float = 1.0,
    types: Collection[str] | None = None,
    georeference: Mapping[str, float] | None = None,
    progress: Progress = lambda stage, done, total: None,
) -> World:
    """Return the world of a file, read by the parser for its ending.

    Parameters
    ----------
    geometry : of SDF models, also those of an Open-RMF building, and of MJCF, URDF and USD
    mesh_as : what a mesh file is; `scene`: an object for each of its nodes; by default that where
        they are several and larger than furniture, else an object
    model_path : folders of SDF models, also of Open-RMF buildings, searched first
    scale : metres per unit of a mesh file
    types : of drawn features; others are left out. By default any type is taken
    georeference : of the map; features with coordinates of the earth are brought into its frame
    progress : called with the stage, and how much of how much is done, while IFC is read

    Raises
    ------
    WorldError
        The file is missing, its ending is unknown, or it cannot be trusted as a whole.
    """
    if not path.is_file() and not is_imdf(path):
        raise WorldError(path, "file", "is not there", "Check the path.")
    ending = path.suffix.lower()
    if scale != 1.0 and ending not in (*MESHES, *READERS):
        raise WorldError(
            path, "scale", "is of meshes and point clouds only", "Leave it out for this file."
        )
    if ending in SDF:
        world = read_sdf(
            path,
            geometry=geometry,
            model_path=model_path,
            types=types,
            georeference=georeference,
        )
    elif ending in RMF:
        world = read_rmf(path, geometry=geometry, model_path=model_path, georeference=georeference)
    elif ending in FEATURES:
        if is_route_graph(path):
            world = read_route_graph(path)
        else:
            world = read_annotation(path, types, georeference)
    elif ending in READERS:
        world = read_point_cloud(path, scale=scale, georeference=georeference)
    elif ending in IMDF or path.is_dir():
        world = read_imdf(path, types, georeference)
    elif ending in GML:
        world = read_indoor_gml(path, types, georeference)
    elif ending in IFC:
        world = read_ifc(path, progress)
    elif ending in USD:
        world = read_usd(path, geometry=geometry)
    elif ending in MJCF:
        world = read_mjcf(path, geometry=geometry)
    elif ending in URDF:
        world = read_urdf_scene(path, geometry=geometry, model_path=model_path)
    elif ending in MESHES:
        if mesh_as == "scene" or (mesh_as is None and is_mesh_scene(path, scale=scale)):
            world = read_mesh_scene(path, scale=scale, types=types)
            if mesh_as is None:
                world.notes.append("a scene of named nodes: --as object keeps it one object")
        else:
            world = read_mesh_world(path, mesh_as or "object", scale=scale)
    else:
        known = f"Known: {', '.join(sorted(KNOWN))}."
        raise WorldError(path, "ending", f"{path.suffix or 'none'} is not known", known)
    _check_names(path, world)
    _note_unit(world, can_scale=ending in (*MESHES, *READERS))
    return world


def _note_unit(world: World, can_scale: bool) -> None:
    """Note a world of a size that buildings do not have: its file may be in another unit."""
    things = [entry for entry in world.entries if entry.kind in ("object", "room")]
    longest = {e.name: max((_side(_corners(s)) for s in e.shapes), default=0.0) for e in things}
    name = max(longest, key=lambda each: longest[each], default="")
    if longest.get(name, 0.0) > LONG:
        fix = "import it with --scale 0.001" if can_scale else "divide its coordinates by 1000"
        note = f"{name} is {longest[name]:.0f} m long: if the file is in millimetres, {fix}"
        world.notes.append(note)
        return
    across = _across(world)
    is_building = len(things) > 1 or any(entry.kind == "room" for entry in things)
    if across > WIDE or 0 < across < (SMALL if is_building else TINY):
        fix = "import it with --scale METRES_PER_UNIT" if can_scale else "scale its coordinates"
        note = (
            f"the whole file is {round(across, 4):g} m across: if its unit is not the metre, {fix}"
        )
        world.notes.append(note)


def _across(world: World) -> float:
    """The longest side of the box around all objects and rooms, metres."""
    poses = poses_in_map(world.entries)
    corners = [
        poses[entry.name].apply(_corners(shape))
        for entry in world.entries
        if entry.kind in ("object", "room")
        for shape in entry.shapes
    ]
    return _side(np.concatenate(corners)) if corners else 0.0


def _side(points: NDArray[np.float64]) -> float:
    """The longest side of the box around points (n, 3), metres."""
    return float(np.ptp(points, axis=0).max()) if len(points) else 0.0


def _corners(shape: Shape) -> NDArray[np.float64]:
    """The corners (8, 3) of the box around a shape, in the frame of its entry; else none."""
    if shape.mesh is not None and len(shape.mesh.vertices):
        low, high = extent(shape.mesh.vertices)
    elif shape.outline is not None and not shape.outline.is_empty:
        left, lower, right, upper = shape.outline.bounds
        low, high = np.array([left, lower, 0.0]), np.array([right, upper, 0.0])
    else:
        return np.empty((0, 3))
    return np.array([*product(*zip(low, high, strict=True))])


def _check_content(path: Path, world: World) -> None:
    """Refuse a file of which nothing is left: a map without anything looks like a success."""
    if world.entries or world.links:
        return
    if not world.skipped:
        raise WorldError(path, "file", "has nothing that a map can hold", "Give another file.")
    first, more = world.skipped[0], len(world.skipped) - 1
    problem = f"{first.problem}{f' (and {more} more)' if more else ''}"
    raise WorldError(path, first.element, f"{problem}, so nothing of the file is left", first.fix)


def _check_names(path: Path, world: World) -> None:
    """Refuse names that the database cannot index, and more entries than one would wait for."""
    ENTRIES.check(len(world.entries), partial(WorldError, path, "file"), "Split the file.")
    for entry in world.entries:
        for what, text in (("name", entry.name), ("type", entry.type), ("label", entry.label)):
            where = f"{entry.kind} {entry.name[:60]}"
            refused = partial(WorldError, path, where)
            NAME_CHARACTERS.check(len(text or ""), refused, "Shorten it.", f"its {what} has")


WITHOUT_SHAPES = (
    "to give them a shape: import again with --model-path and the folder of their models; or "
    "--assume-sizes, which grids, costmaps, routes and plans take"
)

MANY = 50
"""Number of added entities from which tables are analysed again: without, PostgreSQL scans them."""


@dataclass
class ImportSummary:
    """The imported entities, the skipped ones and why, and the objects without geometry."""

    map: str
    source: str  # the name under which a repeated import finds its entities
    kinds: dict[str, int] = field(default_factory=dict)  # how many entities of each kind
    added: int = 0  # entities, as those of the next three
    changed: int = 0
    removed: int = 0
    unchanged: int = 0
    models: int = 0  # how many meshes were stored, each once
    triangles: int = 0  # of these models
    holders: int = 0  # how many entities were given a holder by their geometry
    guessed: list[dict[str, Any]] = field(default_factory=list)  # types that names suggested
    skipped: list[Skipped] = field(default_factory=list)  # the elements that were left out
    notes: list[str] = field(default_factory=list)  # sentences for a person
    no_geometry: list[str] = field(default_factory=list)  # names of objects of the map
    moved: bool = False  # from the file's georeference into the frame of the map's
    seconds: float = 0.0

    def as_json(self) -> dict[str, Any]:
        """The summary as plain values."""
        return asdict(self)


def import_file(
    engine: Engine,
    path: Path,
    *,
    map_name: str | None = None,
    geometry: Role = "visual",
    mesh_as: MeshAs | None = None,
    strict: bool = False,
    source: str | None = None,
    model_path: Sequence[Path] = (),
    scale: float = 1.0,
    define: bool = False,
    progress: Progress = lambda stage, done, total: None,
    world: World | None = None,
) -> ImportSummary:
    """Import a world file in one transaction, into the map of a name, by default the file's own.

    `strict` takes nothing if anything has to be left out or a door leads from no room to another;
    `define` adds the types of features that the map does not have, which are left out otherwise. A
    repeated import finds its entities again by `source`, by default the file's path. `world` is
    what a caller has read of the file. After a WorldError, nothing is written.
    """
    start = time.perf_counter()
    progress(f"reading {path.name}", 0, 0)
    types = None if define else _known_types(engine)
    if world is None:
        world = read_world(
            path,
            geometry,
            mesh_as,
            model_path=model_path,
            scale=scale,
            types=types,
            georeference=_georeference(engine, map_name),
            progress=progress,
        )
    if strict and world.skipped:
        first = world.skipped[0]
        problem = f"{first.problem} (and {len(world.skipped) - 1} more)"
        fix = f"{first.fix} Or import without strict=True, which leaves it out."
        raise WorldError(path, first.element, problem, fix)
    _check_content(path, world)
    recognise_shells(world.entries)
    source = source or str(path.resolve())
    moved = _settle_frame(engine, map_name or world.name, path, world, source)
    with engine.begin() as connection:
        connection.exec_driver_sql(LOCK_IMPORTS)  # drop_map takes it before the row of the map
        load_tbox(connection)
        map_id = _map_id(connection, map_name or world.name)
        session = driver_of(connection)
        postpone_derivation(session)
        _settle_storeys(session, map_id, world, source)
        is_graph = any(link.relation == EDGE for link in world.links)
        if is_graph:
            check_names(session, map_id, world, source)
        stored = store_world(session, map_id, world, source, progress)
        if is_graph:
            settle_nodes(session, map_id, world, source)
        progress("inventories", 0, 0)
        parts = recognise_parts(session, map_id)
        summary = ImportSummary(
            map=map_name or world.name,
            source=source,
            kinds=dict(Counter(entry.kind for entry in world.entries)),
            holders=derive_inventories(session, map_id),
            guessed=_guessed(world, parts),
            skipped=world.skipped,
            moved=moved,
            **vars(stored),
        )
        seen = Snapshot.of(connection, see_map(connection, summary.map))
        summary.no_geometry = read_names_without_geometry(seen)
        if summary.no_geometry and (stored.added or stored.changed):
            summary.notes += [names_note(summary.no_geometry), WITHOUT_SHAPES]
        if stored.added or stored.changed:
            faults = session.execute(
                "SELECT name, name || ' ' || fault FROM door_faults WHERE map_id = %s ORDER BY 1",
                (map_id,),
            ).fetchall()
            own = {entry.name for entry in world.entries}
            if strict and (fault := next((f for name, f in faults if name in own), None)):
                fix = "Or import without strict=True, which notes it."
                raise WorldError(path, "doors", fault, fix)
            summary.notes += [f"error: {fault}" for _, fault in faults[:SHOWN]]
            if len(faults) > SHOWN:
                more = f"error: {len(faults) - SHOWN} more such doors: semmap check has all"
                summary.notes.append(more)
        if stored.added or stored.changed or stored.removed:
            _log(connection, map_id, path, summary)
    if summary.added >= MANY:
        with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.exec_driver_sql(
                "ANALYZE entity, placement, world, object_type, entity_model, entity_chunk"
            )
    summary.seconds = round(time.perf_counter() - start, 3)
    return summary


def _known_types(engine: Engine) -> set[str]:
    """The types of the database, and those of the T-Box that an import loads."""
    with engine.connect() as connection:
        stored = connection.exec_driver_sql("SELECT name FROM semantic_type").scalars()
        return {*stored, *(record.name for record in own_tbox())}


def _georeference(engine: Engine, map_name: str | None) -> dict[str, float] | None:
    """The georeference of a map that has one."""
    with engine.connect() as connection:
        found = connection.exec_driver_sql(
            "SELECT crs, easting, northing, height, rotation FROM map "
            "WHERE name = %(name)s AND crs IS NOT NULL",
            {"name": map_name},
        )
        row = found.mappings().one_or_none()
        return None if row is None else dict(row)


def _settle_frame(engine: Engine, map_name: str, path: Path, world: World, source: str) -> bool:
    """Let a world with a georeference agree with what the map has of other sources.

    A map with a georeference keeps it, and the world is moved into its frame, unless the map has
    taken the world in its own frame before: then that follows the file. A map without one gets that
    of the world, but none that was chosen for coordinates of the earth.
    """
    if not world.georeference:
        return False
    with engine.connect() as connection:
        sources = connection.exec_driver_sql(
            "SELECT DISTINCT e.source IS NOT DISTINCT FROM %(source)s AND NOT coalesce("
            "(SELECT (i.summary ->> 'moved')::boolean FROM import i WHERE i.map_id = e.map_id "
            "AND i.source = e.source ORDER BY i.id DESC LIMIT 1), false) "
            "FROM entity e JOIN placement p ON p.entity_id = e.id "
            "WHERE e.map_id = (SELECT id FROM map WHERE name = %(name)s)",
            {"name": map_name, "source": source},
        )
        known = set(sources.scalars())
    frame = _georeference(engine, map_name)
    if False not in known or (frame is not None and True in known):
        return False
    if frame is None:
        if world.surveyed:
            raise WorldError(
                path,
                "coordinates",
                f"are of the earth, but the map {map_name} has entities and no georeference",
                "Import a file with the georeference of the map first, or this one into a new map.",
            )
        return False
    here = frame_in_frame(on_grid(world.georeference), frame)
    away = math.hypot(*here[:3])
    if not away <= EXTENT.value:
        raise WorldError(
            path,
            "georeference",
            f"is {away / 1000:.0f} km from that of the map {map_name}",
            "Correct one of them, or import the file into a new map.",
        )
    world.georeference = None
    if max(map(abs, here[:6])) < SAME_FRAME:
        return False
    _move(world, here)
    world.notes.append(
        "the file has another georeference than the map: it is brought into the map's frame, by "
        f"{here.x:.2f}, {here.y:.2f}, {here.z:.2f} m and {math.degrees(here.yaw):.2f} degrees"
    )
    return True


def _move(world: World, pose: Pose) -> None:
    """Move all that a world contains, in its own frame, as one."""
    names = {entry.name for entry in world.entries}
    for entry in world.entries:
        if entry.pose is not None and entry.holder not in names:
            entry.pose = pose @ entry.pose
        if isinstance(entry.detail, StoreyDetail):
            entry.detail.elevation += pose.z


def _settle_storeys(
    connection: psycopg.Connection[Any], map_id: int, world: World, source: str
) -> None:
    """Find storeys where neither file nor map states any; stated ones replace found ones."""
    if any(entry.kind == "storey" for entry in world.entries):
        connection.execute(
            "DELETE FROM entity WHERE map_id = %s AND kind = 'storey' AND properties ? %s",
            (map_id, FOUND),
        )
        return
    stated = connection.execute(
        "SELECT 1 FROM entity WHERE map_id = %s AND kind = 'storey' "
        "AND (source IS DISTINCT FROM %s OR NOT properties ? %s)",
        (map_id, source, FOUND),
    )
    if stated.fetchone() is None:
        storeys, notes = found_storeys(world.entries)
        world.entries[:0] = storeys
        world.notes += notes


def _map_id(connection: Connection, name: str) -> int:
    made = connection.exec_driver_sql(
        "INSERT INTO map (name) VALUES (%(name)s) ON CONFLICT (name) DO UPDATE SET name = map.name "
        "RETURNING id",
        {"name": name},
    )
    return int(made.scalar_one())


def _guessed(world: World, parts: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The entities whose types are guessed from names or shapes, the least certain first."""
    by_shape = {part["name"] for part in parts}
    found = [
        {"name": e.name, **e.properties[GUESS]}
        for e in world.entries
        if GUESS in e.properties and e.name not in by_shape
    ]
    return sorted(found + parts, key=lambda guess: (guess["confidence"], guess["name"]))


def _digest(path: Path) -> str:
    """The digest of a file, or of the files in a folder."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    made = hashlib.sha256()
    for file in (each for each in files if each.is_file()):
        made.update(file.read_bytes())
    return made.hexdigest()


def _log(connection: Connection, map_id: int, path: Path, summary: ImportSummary) -> None:
    connection.exec_driver_sql(
        "INSERT INTO import (map_id, source, digest, summary) VALUES "
        "(%(map)s, %(source)s, %(digest)s, %(summary)s)",
        {
            "map": map_id,
            "source": summary.source,
            "digest": _digest(path),
            "summary": Jsonb(summary.as_json()),
        },
    )
