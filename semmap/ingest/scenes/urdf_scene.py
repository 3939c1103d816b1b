"""URDF files as scenes: an object for each link, with all joints at zero."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import isfinite
from pathlib import Path
from xml.etree.ElementTree import Element

from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.scenes.scene_nodes import SceneJoint, SceneNode, scene_world
from semmap.ingest.scenes.solids import solid_element
from semmap.ingest.sdf.elements import Unusable, leaving_out, numbers
from semmap.ingest.sdf.geometries import Geometries
from semmap.ingest.sdf.models import Role
from semmap.ingest.sdf.resources import Resources
from semmap.ingest.world import Skipped, World, WorldError
from semmap.ingest.xml_file import read_xml
from semmap.limits import PARTS

ATTRIBUTES = {
    "box": {"size": "size"},
    "cylinder": {"radius": "radius", "length": "length"},
    "capsule": {"radius": "radius", "length": "length"},
    "sphere": {"radius": "radius"},
    "mesh": {"filename": "uri", "scale": "scale"},
}
"""The attributes of URDF's geometries, and the elements of SDF that mean the same."""

LIMITED = ("revolute", "prismatic")
"""Types of joints whose limits matter."""

MOVING = (*LIMITED, "continuous", "planar", "floating")
"""Types of joints that are not fixed."""


def read_urdf_scene(
    path: Path, *, geometry: Role = "visual", model_path: Sequence[Path] = ()
) -> World:
    """Return the world of a URDF file: an object for each link that has geometry.

    The frame of the root link is that of the map. An object has the pose of its link; the nearest
    link above it that has geometry holds it, and its joint is a property. A link without geometry
    of the required kind has that of the other; one whose geometry is missing has its pose alone.
    Meshes are searched as those of SDF (`semmap.ingest.sdf.resources.Resources`).

    Raises
    ------
    WorldError
        The file is not URDF, or its joints do not make one tree.
    """
    root = read_xml(path, ("robot",))
    links = {link.get("name", ""): link for link in root.iterfind("link")}
    joints = list(root.iterfind("joint"))
    shapes = len(root.findall("link/visual")) + len(root.findall("link/collision"))
    PARTS.check(shapes, partial(WorldError, path, "robot"), "Join its shapes.")
    geometries, skipped = Geometries(Resources(model_path)), list[Skipped]()
    nodes: dict[str, SceneNode] = {}
    moving = {_attribute(joint.find("child"), "link"): joint for joint in joints}
    for name, above, pose in _tree(path, links, joints):
        node = nodes[name] = SceneNode(name, pose, [], nodes.get(above))
        if name in moving:
            with leaving_out(skipped):
                node.joint = _joint(moving[name])
        for role in (geometry, "collision" if geometry == "visual" else "visual"):
            for element in links[name].iterfind(role):
                node.lost = True  # unless one of its surfaces is usable
                with leaving_out(skipped):
                    node.meshes.append(_surface(element, geometries, path, f"link {name}: {role}"))
            if node.meshes:
                break
        node.meshes = [mesh.moved(pose) for mesh in node.meshes]
    return scene_world(path, [*nodes.values()], root.get("name", ""), skipped)


def _tree(
    path: Path, links: dict[str, Element], joints: list[Element]
) -> list[tuple[str, str, Pose]]:
    """Return the links with the link above each and its pose, parents before their children."""
    below: dict[str, list[tuple[str, Pose]]] = {}
    roots = dict.fromkeys(links)
    for joint in joints:
        where = f"joint {joint.get('name', '')}".rstrip()
        parent, child = (_attribute(joint.find(end), "link") for end in ("parent", "child"))
        for end in (parent, child):
            if end not in links:
                raise WorldError(path, where, f"there is no link {end!r}", "Correct its name.")
        if child not in roots:
            raise WorldError(path, where, f"link {child} has another joint above it", "Remove one.")
        del roots[child]
        try:
            pose = _origin(joint.find("origin"), where)
        except Unusable as error:
            raise WorldError(path, where, error.skipped.problem, error.skipped.fix) from error
        below.setdefault(parent, []).append((child, pose))
    if len(roots) != 1:
        problem = f"its links have {len(roots)} roots ({', '.join(list(roots)[:5]) or 'a circle'})"
        raise WorldError(path, "robot", problem, "Join all links by joints into one tree.")
    found: list[tuple[str, str, Pose]] = []
    level = [(next(iter(roots)), "", IDENTITY)]
    while level:
        found += level
        level = [(c, name, pose @ p) for name, _, pose in level for c, p in below.get(name, ())]
    if len(found) < len(links):
        missing = next(name for name in links if name not in {n for n, *_ in found})
        fix = "Join all links by joints into one tree."
        raise WorldError(path, f"link {missing}", "is in a circle of joints", fix)
    return found


def _joint(joint: Element) -> SceneJoint | None:
    """Return how a joint moves its child, whose frame is the joint's; None for a fixed one."""
    kind = joint.get("type", "")
    if kind not in MOVING:
        return None
    where = f"joint {joint.get('name', '')}".rstrip()
    words = Element("axis")
    given = joint.find("axis")
    words.text = "1 0 0" if given is None else given.get("xyz", "1 0 0")
    x, y, z = numbers(words, 3, f"{where}: axis")
    lower, upper = None, None
    if kind in LIMITED:
        ends = [_limit(joint.find("limit"), name, where) for name in ("lower", "upper")]
        lower, upper = ends
        if lower > upper:
            problem = f"its limits are {lower:g} and {upper:g}"
            raise Unusable(where, problem, "Give lower <= upper.")
    return SceneJoint(kind, (0.0, 0.0, 0.0), (x, y, z), lower, upper)


def _limit(limit: Element | None, name: str, where: str) -> float:
    """Return an end of a joint's way, which URDF takes as 0 where it is not stated."""
    text = "0" if limit is None else limit.get(name, "0")
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise Unusable(f"{where}: limit", f"{name} is {text!r}", "Give a finite number.")
    return value


def _surface(element: Element, geometries: Geometries, path: Path, where: str) -> Mesh:
    shape = element.find("geometry/*")
    if shape is None or shape.tag not in ATTRIBUTES:
        problem = f"<{'geometry' if shape is None else shape.tag}> has no surface"
        raise Unusable(where, problem, f"Use one of {', '.join(ATTRIBUTES)}.")
    known_as = ATTRIBUTES[shape.tag]
    values = {tag: shape.attrib[name] for name, tag in known_as.items() if name in shape.attrib}
    mesh = geometries.mesh(solid_element(shape.tag, **values), path, where)
    return mesh.moved(_origin(element.find("origin"), where))


def _origin(origin: Element | None, where: str) -> Pose:
    """Return the pose of an `<origin>`: xyz, and rpy about fixed axes."""
    if origin is None:
        return IDENTITY
    words: list[float] = []
    for name in ("xyz", "rpy"):
        element = Element(name)
        element.text = origin.get(name, "0 0 0")
        words += numbers(element, 3, f"{where}: origin {name}")
    return Pose.from_rpy(*words)


def _attribute(element: Element | None, name: str) -> str:
    return "" if element is None else element.get(name, "")
