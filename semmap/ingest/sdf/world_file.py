"""Gazebo worlds and models in SDF (http://sdformat.org/spec), as entries of a world.

Why: docs/decisions/sdf_is_read_by_own_code.md
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import get_args
from xml.etree.ElementTree import Element

import numpy as np

from semmap.geometry.pose import Pose
from semmap.ingest.annotation.annotation import draft_entries
from semmap.ingest.annotation.draft_world import DraftWorld
from semmap.ingest.annotation.feature_file import into_metres, read_collection
from semmap.ingest.georeference import utm_crs
from semmap.ingest.naming import give_type
from semmap.ingest.sdf.elements import Unusable, leaving_out, local_pose, numbers, read_root
from semmap.ingest.sdf.frames import Frames
from semmap.ingest.sdf.models import Models, Role, SdfFile, SdfModel
from semmap.ingest.sdf.resources import Resources
from semmap.ingest.world import Entry, Skipped, World, WorldError, unique_name
from semmap.limits import EXTENT

NAMESPACE = "urn:semmap:sdf"
FEATURES = f"{{{NAMESPACE}}}features"
"""The element of a world that holds the GeoJSON of the map that it shows."""

MADE_AT_RUN_TIME = ("population", "road")
"""Elements whose geometry the simulator makes at run time."""


def read_sdf(
    path: Path,
    *,
    geometry: Role = "visual",
    model_path: Sequence[Path] = (),
    types: Collection[str] | None = None,
    georeference: Mapping[str, float] | None = None,
) -> World:
    """Return the world of an SDF file: models as entries of kind ``object``, actors as ``agent``.

    All links and nested models of a model are baked into one mesh in the model's frame, in the pose
    that the file gives them; instances of one model share one `Mesh`. A model that is nothing but
    one box along its own axes has a shape of kind ``box``. Where no geometry of the requested kind
    can be read, the other kind is used, and noted. Lights, plugins, physics and views are not part
    of the map. Entries have no holder; their `properties` are ``model`` (the name of the model
    file), ``static`` and ``type_guess``. A model that has nothing but another one stands where that
    one does. `georeference` holds latitude_deg, longitude_deg, elevation (metres) and heading_deg.
    A world that semmap exported has the features of its map: their models stand where the world has
    them, and what they mean is as of `read_annotation`.

    Parameters
    ----------
    path : an SDF file with a `<world>`, or with a single `<model>`; what Gazebo reads is read
    model_path : folders of models, searched first (see `resources.Resources`)
    types, georeference : of features, as of `read_annotation`

    Raises
    ------
    WorldError
        The file is absent or malformed, is not SDF, includes itself, or its frames stand relative
        to each other in a circle. An included file with such an error is in `skipped`.
    """
    if geometry not in get_args(Role):
        raise ValueError(f"geometry is visual or collision, not {geometry!r}")
    path = Path(path)
    root = read_root(path)
    world = World(path.stem, path)
    scope = _scope(root, world)
    where = f"world {world.name}"

    models = Models(world, Resources(model_path))
    frames = Frames(path, where, "world")
    placed = models.placed(scope, frames, SdfFile(path))
    models.add_frames(scope, frames, where)
    frames.check()

    for model in placed:
        with leaving_out(world.skipped):
            world.entries.append(_object(model, frames, models, geometry))
    for element in scope.iterfind("actor"):
        with leaving_out(world.skipped):
            world.entries.append(_actor(element, frames))
    for element in (e for e in scope if e.tag in MADE_AT_RUN_TIME):
        world.skipped.append(
            Skipped(
                f"{element.tag} {element.get('name', '')}".rstrip(),
                "its geometry exists only when the simulator runs",
                "Write its models out as <include> elements.",
            )
        )
    described = scope.find(FEATURES)
    return world if described is None else _described(described, world, types, georeference)


def _described(
    described: Element,
    world: World,
    types: Collection[str] | None,
    georeference: Mapping[str, float] | None,
) -> World:
    """Return the world that features describe, with the models of a world and what is new in it."""
    try:
        root = json.loads(described.text or "")
    except (ValueError, RecursionError) as error:
        raise WorldError(
            world.source, "features", f"is not JSON ({error})", "Remove the element."
        ) from error
    file = into_metres(world.source, read_collection(world.source, root), georeference)
    models = {entry.name: entry for entry in world.entries}
    out = draft_entries(DraftWorld(world.source, file, types, models))
    used = {str(feature.properties.get("model_name")) for feature in file.features}
    taken = {entry.name for entry in out.entries}
    for entry in (each for name, each in models.items() if name not in used):
        entry.name = unique_name(entry.name, taken)
        taken.add(entry.name)
        out.entries.append(entry)
    out.name, out.georeference = world.name, out.georeference or world.georeference
    out.skipped, out.notes = world.skipped + out.skipped, world.notes + out.notes
    return out


def _scope(root: Element, world: World) -> Element:
    """Return the element that contains the models: the first world, or the root of a model file."""
    worlds = root.findall("world")
    if worlds:
        if worlds[0].get("name", "") not in ("", "default"):
            world.name = worlds[0].get("name", "")
        if len(worlds) > 1:
            world.notes.append(f"of {len(worlds)} worlds in the file only the first is read")
        with leaving_out(world.skipped):
            world.georeference = _georeference(worlds[0])
        return worlds[0]
    if root.find("model") is None:
        problem = "it contains no <world> and no <model>"
        raise WorldError(world.source, "sdf", problem, "Give a world or model file.")
    return root


def _georeference(world: Element) -> dict[str, object] | None:
    where = "spherical_coordinates"
    values = {
        tag: numbers(element, 1, f"{where}: {tag}")[0]
        for tag in ("latitude_deg", "longitude_deg", "elevation", "heading_deg")
        if (element := world.find(f"{where}/{tag}")) is not None
    }
    if not any(values.values()):
        return None  # Gazebo writes zeros by default
    surface = (world.findtext(f"{where}/surface_model") or "EARTH_WGS84").strip()
    if surface != "EARTH_WGS84":
        problem = f"{surface} is not the surface of the earth"
        raise Unusable(where, problem, "Use EARTH_WGS84, or leave it out.")
    try:
        utm_crs(values.get("latitude_deg", 0.0), values.get("longitude_deg", 0.0))
    except ValueError as error:
        raise Unusable(where, str(error), "Correct the file.") from error
    return {**values}


def _object(model: SdfModel, frames: Frames, models: Models, geometry: Role) -> Entry:
    where = f"model {model.name}"
    innermost, inside = model.unwrapped()
    pose = _in_world(frames.pose(model.name, where) @ inside, where)
    shape = models.shape(innermost, geometry)
    entry = Entry(model.name, "object", pose=pose, shapes=[] if shape is None else [shape])
    entry.properties = {"model": model.source, "static": model.static}
    if model.mass is not None:
        entry.properties["mass"] = model.mass
    give_type(entry, (model.source, model.name))
    return entry


def _actor(element: Element, frames: Frames) -> Entry:
    """Return an actor at its pose, without its skin and script."""
    name = unique_name(element.get("name", "").strip() or "actor", frames)
    where = f"actor {name}"
    pose, relative_to = local_pose(element, where)
    frames.add(name, pose, relative_to)
    return Entry(name, kind="agent", pose=_in_world(frames.pose(name, where), where))


def _in_world(pose: Pose, where: str) -> Pose:
    EXTENT.check(
        float(np.abs(pose.translation).max()),
        partial(Unusable, f"{where}: pose"),
        "Correct its pose, or remove it.",
        f"it stands at ({pose.x:,.0f}, {pose.y:,.0f}, {pose.z:,.0f}) m,",
    )
    return pose
