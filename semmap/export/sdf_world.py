"""A map as a world of Gazebo (SDF 1.9): a model for each object, and what they mean as features.

Simulators leave elements of other namespaces alone (http://sdformat.org/tutorials?tut=custom_elements_attributes_proposal).
In one of them is the GeoJSON of the map, in which `model_name` names an object's model.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent, register_namespace

from semmap.export.features import MapFeature, MapFeatures
from semmap.export.gis_file import collection
from semmap.ingest.georeference import to_degrees
from semmap.ingest.sdf.world_file import FEATURES, NAMESPACE
from semmap.ingest.world import unique_name

LOOSE = ("agent",)
"""Kinds that move by themselves; objects are static unless their property `static` is false."""


def write_sdf(found: MapFeatures, path: Path) -> None:
    """Write a map as an SDF world; its models name meshes beside it."""
    register_namespace("semmap", NAMESPACE)
    root = Element("sdf", version="1.9")
    world = SubElement(root, "world", name=_printable(found.name))
    if found.georeference is not None:
        _place(world, found.georeference)
    taken: set[str] = set()
    things = []
    for each in found.all("objects"):
        if each.pose is not None and str(each.keys.get("mesh", "")).endswith(".obj"):
            name = unique_name(_printable(each.name).replace("::", "_"), taken)
            taken.add(name)
            _add_model(world, name, each)
            each = replace(each, keys={**each.keys, "model_name": name})
        things.append(each)
    found.layers["objects"] = things
    SubElement(world, FEATURES).text = json.dumps(collection(found))
    indent(root)
    ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _add_model(world: Element, name: str, thing: MapFeature) -> None:
    """Add a model where a thing stands, with its mesh to be seen and to collide with."""
    assert thing.pose is not None
    model = SubElement(world, "model", name=name)
    loose = thing.keys["kind"] in LOOSE or thing.free.get("static") is False
    SubElement(model, "static").text = "false" if loose else "true"
    pose = SubElement(model, "pose", rotation_format="quat_xyzw")
    pose.text = " ".join(map(repr, map(float, thing.pose)))
    link = SubElement(model, "link", name="link")
    for role in ("visual", "collision"):
        geometry = SubElement(SubElement(link, role, name=role), "geometry")
        SubElement(SubElement(geometry, "mesh"), "uri").text = str(thing.keys["mesh"])


def _place(world: Element, georeference: dict[str, float]) -> None:
    """Add where on the earth the origin of a map is, and how its frame is turned."""
    where = SubElement(world, "spherical_coordinates")
    SubElement(where, "surface_model").text = "EARTH_WGS84"
    SubElement(where, "world_frame_orientation").text = "ENU"
    for key, value in to_degrees(georeference).items():
        SubElement(where, key).text = repr(value)


def _printable(name: str) -> str:
    """Return a name without the characters that XML does not have."""
    return "".join(c if c.isprintable() else "_" for c in name).strip() or "_"
