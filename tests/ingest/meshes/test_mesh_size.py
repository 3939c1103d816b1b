"""Mesh files of some hundred bytes that would unfold to gigabytes, or never end."""

from __future__ import annotations

import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from semmap.ingest.meshes.mesh_file import read_mesh
from semmap.ingest.meshes.mesh_size import MeshFileError

TRIANGLE = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
ACCESSOR = {"componentType": 5126, "count": 3, "type": "VEC3", "bufferView": 0}


def glb(path: Path, **changes: Any) -> None:
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"byteLength": len(TRIANGLE)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(TRIANGLE)}],
        "accessors": [ACCESSOR],
    } | changes
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(TRIANGLE), b"BIN\0") + TRIANGLE
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body)


def three_mf(path: Path, objects: str, item: int) -> None:
    mesh = (
        '<object id="1"><mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/>'
        '<vertex x="0" y="1" z="0"/></vertices><triangles><triangle v1="0" v2="1" v3="2"/>'
        "</triangles></mesh></object>"
    )
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr(
            "3D/3dmodel.model",
            '<model unit="meter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
            f"<resources>{mesh}{objects}</resources><build><item objectid='{item}'/></build>"
            "</model>",
        )


def doubled(count: int) -> str:
    """Objects of which each places the one before twice."""
    return "".join(
        f'<object id="{i}"><components><component objectid="{i - 1}"/>'
        f'<component objectid="{i - 1}" transform="1 0 0 0 1 0 0 0 1 {2.0**i} 0 0"/></components>'
        "</object>"
        for i in range(2, count + 2)
    )


def dae(path: Path, count: int, leaf: str = '<instance_geometry url="#g"/>') -> None:
    """Nodes of which each instances the one before twice."""
    nodes = f'<node id="n0">{leaf}</node>' + "".join(
        f'<node id="n{i}"><instance_node url="#n{i - 1}"/><instance_node url="#n{i - 1}"/></node>'
        for i in range(1, count + 1)
    )
    path.write_text(f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"
 version="1.4.1"><asset><unit meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="a" count="9">0 0 0 1 0 0 0 1 0</float_array>
<technique_common><accessor source="#a" count="3" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
</mesh></geometry></library_geometries><library_nodes>{nodes}</library_nodes>
<library_visual_scenes><visual_scene id="s"><node><instance_node url="#n{count}"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>
</COLLADA>""")


Write = Callable[[Path], None]
LARGE: dict[str, tuple[str, Write, str]] = {
    "an accessor without data": (
        "a.glb",
        lambda p: glb(p, accessors=[{**ACCESSOR, "count": 10**12} | {"bufferView": None}]),
        "cannot be read",
    ),
    "an accessor of no buffer view": (
        "a.glb",
        lambda p: glb(
            p,
            accessors=[
                {k: v for k, v in ACCESSOR.items() if k != "bufferView"} | {"count": 60_000_000}
            ],
        ),
        "accessor 0 is sparse or compressed",
    ),
    "a sparse accessor": (
        "a.glb",
        lambda p: glb(
            p,
            accessors=[
                {"componentType": 5126, "count": 60_000_000, "type": "VEC3", "sparse": {"count": 1}}
            ],
        ),
        "accessor 0 is sparse or compressed",
    ),
    "a stride below the item": (
        "a.glb",
        lambda p: glb(p, bufferViews=[{"buffer": 0, "byteLength": 36, "byteStride": 1}]),
        "accessor 0 exceeds its buffer view",
    ),
    "a count below 0": (
        "a.glb",
        lambda p: glb(p, accessors=[{**ACCESSOR, "count": -3}]),
        "accessor 0 exceeds",
    ),
    "one accessor in many primitives": (
        "a.glb",
        lambda p: glb(p, meshes=[{"primitives": [{"attributes": {"POSITION": 0}}] * 30_000}]),
        "parts, the limit is 20,000 parts.*SEMMAP_MAX_PARTS",
    ),
    "one mesh in many nodes": (
        "a.glb",
        lambda p: glb(p, nodes=[{"children": [*range(1, 30_000)]}, *[{"mesh": 0}] * 29_999]),
        "SEMMAP_MAX_PARTS",
    ),
    "deep nodes": (
        "a.glb",
        lambda p: glb(p, nodes=[*({"children": [i]} for i in range(1, 5000)), {"mesh": 0}]),
        "nests 5,000 levels, the limit is 64 levels.*SEMMAP_MAX_NESTING",
    ),
    "components that double": (
        "a.3mf",
        lambda p: three_mf(p, doubled(60), 61),
        "parts, the limit is 20,000 parts",
    ),
    "components that contain each other": (
        "a.3mf",
        lambda p: three_mf(
            p, '<object id="2"><components><component objectid="2"/></components></object>', 2
        ),
        "contain each other",
    ),
    "instances that double": ("a.dae", lambda p: dae(p, 60), "parts, the limit is 20,000 parts"),
    "instances of nothing that double": ("a.dae", lambda p: dae(p, 60, ""), "SEMMAP_MAX_PARTS"),
}


@pytest.mark.parametrize("case", LARGE)
def test_files_that_would_unfold_are_refused(case: str, tmp_path: Path) -> None:
    name, write, text = LARGE[case]
    write(tmp_path / name)
    assert (tmp_path / name).stat().st_size < 2**21
    with pytest.raises(MeshFileError, match=text):
        read_mesh(tmp_path / name)


def test_files_that_unfold_to_a_few_parts_are_read(tmp_path: Path) -> None:
    three_mf(tmp_path / "a.3mf", doubled(3), 4)
    assert len(read_mesh(tmp_path / "a.3mf").faces) == 2**3
    dae(tmp_path / "a.dae", 3)
    assert len(read_mesh(tmp_path / "a.dae").faces) == 2**3
    glb(tmp_path / "a.glb", nodes=[{"children": [1, 2]}, {"mesh": 0}, {"mesh": 0}])
    assert len(read_mesh(tmp_path / "a.glb").faces) == 2


def test_a_variable_changes_a_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    three_mf(tmp_path / "a.3mf", doubled(3), 4)
    monkeypatch.setenv("SEMMAP_MAX_TRIANGLES", "7")
    with pytest.raises(MeshFileError, match="has 8 triangles, the limit is 7 triangles"):
        read_mesh(tmp_path / "a.3mf")
    monkeypatch.setenv("SEMMAP_MAX_TRIANGLES", "many")
    with pytest.raises(MeshFileError, match="SEMMAP_MAX_TRIANGLES is 'many'"):
        read_mesh(tmp_path / "a.3mf")
    monkeypatch.setenv("SEMMAP_MAX_TRIANGLES", "8")
    assert len(read_mesh(tmp_path / "a.3mf").faces) == 8
