"""The size of a mesh file once it is loaded, computed from its structure before loading.

A few hundred bytes can claim millions of vertices, or place one mesh a million times.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import ZipFile

from defusedxml.ElementTree import iterparse

from semmap.error import Error
from semmap.limits import MESH_BYTES, NESTING, PARTS, TRIANGLES

SIMPLER = "Export a simpler mesh."

_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
"""Bytes of glTF's component types."""

_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


class MeshFileError(Error):
    """A mesh file that cannot be used: what is wrong, and how to fix it."""

    def __init__(self, problem: str, fix: str) -> None:
        super().__init__(f"{problem}. {fix}")
        self.problem, self.fix = problem, fix


def check_size(path: Path) -> None:
    """Raise a MeshFileError for a file that is larger than limits allow, or would be once loaded.

    The structure of `.3mf`, `.dae`, `.glb` and `.gltf` is read; a malformed one raises anything.
    """
    MESH_BYTES.check(path.stat().st_size, MeshFileError, SIMPLER)
    check = {".3mf": _check_3mf, ".dae": _check_dae, ".glb": _check_glb, ".gltf": _check_gltf}
    if path.suffix.lower() in check:
        check[path.suffix.lower()](path)


def _check_glb(path: Path) -> None:
    with path.open("rb") as file:
        file.seek(12)
        length = int.from_bytes(file.read(4), "little")
        file.seek(20)
        _check_document(path, json.loads(file.read(length)))


def _check_gltf(path: Path) -> None:
    _check_document(path, json.loads(path.read_bytes()))


def _check_document(path: Path, document: Mapping[str, Any]) -> None:
    """Check what is loaded of glTF: files beside it as often as buffers name them, and views."""
    uris = (str(buffer.get("uri", "")).strip() for buffer in document.get("buffers", []))
    names = Counter(uri for uri in uris if uri and "base64," not in uri)
    beside = ((path.parent / name, times) for name, times in names.items())
    size = sum(times * file.stat().st_size for file, times in beside if file.is_file())
    MESH_BYTES.check(size, MeshFileError, SIMPLER)
    views = sum(view["byteLength"] for view in document.get("bufferViews", []))  # copies
    MESH_BYTES.check(views, MeshFileError, SIMPLER, "has views of")
    _check_accessors(document)


def _check_accessors(document: Mapping[str, Any]) -> None:
    """Check that each accessor has its data in the file, and the number of placed triangles."""
    accessors: Sequence[Mapping[str, Any]] = document.get("accessors", [])
    views: Sequence[Mapping[str, Any]] = document.get("bufferViews", [])
    total = 0
    for number, accessor in enumerate(accessors):
        if "sparse" in accessor or "bufferView" not in accessor:
            raise MeshFileError(
                f"its accessor {number} is sparse or compressed",
                "Export it without sparse accessors and without Draco compression.",
            )
        item = _BYTES[accessor["componentType"]] * _COMPONENTS[accessor["type"]]
        view = views[accessor["bufferView"]]
        stride = view.get("byteStride", item)
        count = accessor["count"]
        if count < 0 or stride < item or (count - 1) * stride + item > view["byteLength"]:
            raise MeshFileError(
                f"its accessor {number} exceeds its buffer view", "Export it again."
            )
        total += count * item
    MESH_BYTES.check(total, MeshFileError, SIMPLER)

    primitives = [mesh["primitives"] for mesh in document.get("meshes", [])]
    corners = [sum(_vertices(each, accessors) for each in mesh) for mesh in primitives]
    nodes: Sequence[Mapping[str, Any]] = document.get("nodes", [])
    roots = [n for scene in document.get("scenes", []) for n in scene.get("nodes", [])]
    placed = [*roots, *(child for node in nodes for child in node.get("children", []))]
    meshes = [*range(len(corners)), *(nodes[n]["mesh"] for n in placed if "mesh" in nodes[n])]
    PARTS.check(len(placed) + sum(len(primitives[m]) for m in meshes), MeshFileError, SIMPLER)
    TRIANGLES.check(sum(corners[m] for m in meshes) / 3, MeshFileError, SIMPLER)
    NESTING.check(_depth(nodes, roots), MeshFileError, SIMPLER, verb="nests")


def _vertices(primitive: Mapping[str, Any], accessors: Sequence[Mapping[str, Any]]) -> int:
    """Return the number of corners of a primitive's triangles, or of its vertices if larger."""
    position = accessors[primitive["attributes"]["POSITION"]]["count"]
    indices = accessors[primitive["indices"]]["count"] if "indices" in primitive else 0
    return int(max(position, indices))


def _depth(nodes: Sequence[Mapping[str, Any]], roots: Sequence[int]) -> int:
    """Return how deep nodes are nested; more than the number of nodes if they form a cycle."""
    level, depth = set(roots), 0
    while level and depth <= len(nodes):
        level = {child for n in level for child in nodes[n].get("children", [])}
        depth += 1
    return depth


def _check_3mf(path: Path) -> None:
    """Check a 3MF, whose objects place others as components: a few lines can place many meshes."""
    with ZipFile(path) as packed:
        members = {m.filename: m.file_size for m in packed.infolist()}
        MESH_BYTES.check(
            sum(members.values()),
            MeshFileError,
            "Export a simpler mesh, or as binary STL.",
            "inflates to",
        )
        model = next(n for n in members if "3d/3dmodel.model" in n.lower())
        components: dict[str, list[str]] = {}
        triangles: dict[str, int] = {}
        items: list[str] = []
        referred = count = 0
        ends = (e for event, e in _events(packed.read(model)) if event == "end")
        for element in ends:
            match element.tag.rpartition("}")[2]:
                case "triangle":
                    count += 1
                case "component":
                    others = (v for k, v in element.attrib.items() if k.endswith("path"))
                    referred += sum(members.get(other.strip("/"), 0) for other in others)
                    components.setdefault("", []).append(element.attrib["objectid"])
                case "object":
                    components[element.attrib["id"]] = components.pop("", [])
                    triangles[element.attrib["id"]], count = count, 0
                case "item":
                    items.append(element.attrib["objectid"])
    MESH_BYTES.check(referred, MeshFileError, SIMPLER)
    components["world"] = items
    PARTS.check(_placed(components), MeshFileError, SIMPLER)
    TRIANGLES.check(unfolded(components, triangles, "world"), MeshFileError, SIMPLER)


def _check_dae(path: Path) -> None:
    """Check a COLLADA file, whose nodes place others as instances."""
    children: dict[str, list[str]] = {"world": []}
    open_: list[str] = ["world"]
    for event, element in _events(path.read_bytes()):
        tag = element.tag.rpartition("}")[2]
        if tag == "node" and event == "start":
            name = element.attrib.get("id") or f" {len(children)}"
            children.setdefault(name, [])
            children[open_[-1]].append(name)
            open_.append(name)
            NESTING.check(len(open_), MeshFileError, SIMPLER, verb="nests")
        elif tag == "node":
            open_.pop()
        elif tag == "instance_node" and event == "start":
            children[open_[-1]].append(element.attrib.get("url", "").lstrip("#"))
    PARTS.check(_placed(children), MeshFileError, SIMPLER)


def _events(data: bytes) -> Iterator[tuple[str, Any]]:
    """Yield starts and ends of XML elements; ended elements are freed."""
    for event, element in iterparse(BytesIO(data), events=("start", "end"), forbid_dtd=True):
        yield event, element
        if event == "end":
            element.clear()


def _placed(parts: Mapping[str, Sequence[str]]) -> float:
    """Return the number of parts of the world."""
    count = unfolded(parts, dict.fromkeys(parts, 1), "world")
    if math.isinf(count):
        raise MeshFileError("its parts contain each other", "Remove the cycle.")
    return count


def unfolded(parts: Mapping[str, Sequence[str]], weights: Mapping[str, int], root: str) -> float:
    """Return the weight of all parts of a root, each as often as it is placed; inf in a cycle."""
    whole: dict[str, float] = {}
    entered: set[str] = set()
    stack = [root]
    while stack:
        name = stack[-1]
        inner = parts.get(name, ())
        if name not in entered:
            entered.add(name)
            missing = [part for part in inner if part not in whole]
            if not entered.isdisjoint(missing):
                return math.inf
            stack += missing
            continue
        stack.pop()
        if name not in whole:
            whole[name] = float(weights.get(name, 0)) + sum(whole[part] for part in inner)
    return whole[root]
