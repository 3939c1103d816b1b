"""Small files that claim much, or unfold to much: a case is the name of one and its size."""

from __future__ import annotations

import base64
import json
import math
import sqlite3
import struct
import zipfile
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from PIL import Image

from tests.fuzz.answers import NAMES, house_of
from tests.fuzz.gltf import BIN, triangle
from tests.fuzz.kind import Kind
from tests.fuzz.server import case_map, import_case
from tests.ingest.meshes.test_mesh_file import dae


def glb(folder: Path, **changes: Any) -> Path:
    text = json.dumps(triangle(**({"buffers": [{"byteLength": len(BIN)}]} | changes))).encode()
    text += b" " * (-len(text) % 4)
    chunks = [(b"JSON", text), (b"BIN\0", BIN)]
    body = b"".join(struct.pack("<I4s", len(data), name) + data for name, data in chunks)
    path = folder / "case.glb"
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body)
    return path


def beside(folder: Path, ending: str, uri: str, size: int) -> Path:
    """One file, the buffer of which is read often."""
    (folder / "data.bin").write_bytes(BIN)
    buffers = [{"byteLength": len(BIN), "uri": uri}] * size
    if ending == ".glb":
        return glb(folder, buffers=buffers)
    return write(folder, ".gltf", json.dumps(triangle(buffers)))


def data_uri(folder: Path, size: int) -> Path:
    uri = "data:application/octet-stream;base64," + base64.b64encode(BIN).decode()
    return beside(folder, ".gltf", uri, min(size, 100))


def write(folder: Path, ending: str, text: str) -> Path:
    path = folder / f"case{ending}"
    path.write_text(text)
    return path


def glb_views(folder: Path, size: int) -> Path:
    return glb(folder, bufferViews=[{"buffer": 0, "byteLength": len(BIN) - 1}] * size)


def glb_count(folder: Path, size: int) -> Path:
    accessor = {"componentType": 5126, "count": size * 2**12, "type": "VEC3"}
    sparse = {"count": 1, "indices": {"bufferView": 0, "componentType": 5125}}
    return glb(folder, accessors=[accessor | {"sparse": sparse | {"values": {"bufferView": 0}}}])


def glb_stride(folder: Path, size: int) -> Path:
    view = {"buffer": 0, "byteLength": len(BIN), "byteStride": size}
    return glb(folder, bufferViews=[view])


def glb_copies(folder: Path, size: int) -> Path:
    most = len(BIN) // 12 // 3 * 3
    accessor = {
        "bufferView": 0,
        "componentType": 5126,
        "count": 3 if size < 20_000 else most,
        "type": "VEC3",
    }
    nodes = [{"mesh": 0, "translation": [i % 9000, 0, 0]} for i in range(size)]
    scenes = [{"nodes": [*range(size)]}]
    return glb(folder, accessors=[accessor], nodes=nodes, scenes=scenes)


def glb_doubling(folder: Path, size: int) -> Path:
    nodes: list[object] = [{"children": [i + 1, i + 1]} for i in range(min(size, 60))]
    return glb(folder, nodes=[*nodes, {"mesh": 0}])


def levels(size: int) -> int:
    """Few levels; or more than are read, for between them objects are many, but valid."""
    return size if size < 8 else 20 + size % 40


def entities(folder: Path, ending: str, size: int) -> Path:
    lines = ['<!ENTITY a "aaaaaaaaaa">']
    for level in range(min(size, 25)):
        before, name = chr(97 + level), chr(98 + level)
        lines.append(f'<!ENTITY {name} "{f"&{before};" * 10}">')
    head = f"<!DOCTYPE x [{''.join(lines)}]>"
    last = f"&{chr(97 + min(size, 25))};"
    inside = f"<x>{last}</x>" if ending == ".dae" else last
    text = dae(head=head, inside=inside) if ending == ".dae" else f"{head}<x>{inside}</x>"
    return write(folder, ending, text)


def dae_doubling(folder: Path, size: int) -> Path:
    nodes = "".join(
        f'<node id="n{i}"><instance_node url="#n{i + 1}"/><instance_node url="#n{i + 1}"/></node>'
        for i in range(levels(size))
    )
    nodes += f'<node id="n{levels(size)}"><instance_geometry url="#g"/></node>'
    text = dae().replace("<library_visual_scenes>", f"<library_nodes>{nodes}</library_nodes>\\g")
    return write(folder, ".dae", text.replace("\\g", "<library_visual_scenes>").replace(
        '<instance_geometry url="#g"/></node></visual', '<instance_node url="#n0"/></node></visual'
    ))  # fmt: skip


def dae_stride(folder: Path, size: int) -> Path:
    return write(
        folder, ".dae", dae().replace('count="4" stride="3"', f'count="{size}" stride="{size}"')
    )


def dae_polygon(folder: Path, size: int) -> Path:
    polygon = (
        "<polylist count='1'><input semantic='VERTEX' source='#v' offset='0'/>"
        f"<vcount>{size}</vcount><p>{'0 ' * size}</p></polylist>"
    )
    return write(folder, ".dae", dae().replace("</mesh>", f"{polygon}</mesh>"))


def packed(folder: Path, ending: str, name: str, text: str, size: int) -> Path:
    path = folder / f"case{ending}"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file,
        file.open(name, "w", force_zip64=True) as member,
    ):
        for _ in range(max(1, size // 1000)):
            member.write((text * min(size, 1000)).encode())
    return path


def imdf_lists(folder: Path, size: int) -> Path:
    path = folder / "case.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("level.geojson", '{"features": [' + "[]," * (20 * size) + "0]}")
    return path


def geojson_lists(folder: Path, size: int) -> Path:
    return write(
        folder, ".geojson", '{"type": "FeatureCollection", "features": [' + "[]," * size + "0]}"
    )


def gml_elements(folder: Path, size: int) -> Path:
    return write(folder, ".gml", f"<x>{'<a/>' * size}</x>")


def usda(folder: Path, text: str) -> Path:
    return write(folder, ".usda", f"#usda 1.0\n(\n    metersPerUnit = 1\n)\n{text}\n")


def usda_doubling(folder: Path, size: int, arc: str = "references = ") -> Path:
    """Each prim has twice the one after it."""
    last = levels(size)
    prims = [f'def Cube "n{last}"\n{{\n}}']
    for i in range(last):
        two = "".join(f'def "{side}" (\n{arc}</n{i + 1}>\n)\n{{\n}}\n' for side in "ab")
        prims.append(f'def Xform "n{i}"\n{{\n{two}}}')
    return usda(folder, "\n".join(prims))


def usda_other(folder: Path, file: str) -> Path:
    return usda(folder, f'def Xform "a"\n{{\ndef "b" (\nreferences = @{file}@</a>\n)\n{{\n}}\n}}')


def usdc_polygon(folder: Path, size: int, ending: str = ".usdc") -> Path:
    """A polygon of many corners, which a crate packs well."""
    from pxr import Usd, UsdGeom, UsdUtils, Vt

    path = folder / "case.usdc"
    stage = Usd.Stage.CreateNew(str(path))
    mesh = UsdGeom.Mesh.Define(stage, "/m")
    mesh.GetPointsAttr().Set([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    mesh.GetFaceVertexCountsAttr().Set([size])
    corners = np.arange(size, dtype=np.int32) % 3
    mesh.GetFaceVertexIndicesAttr().Set(Vt.IntArray.FromNumpy(corners))
    stage.GetRootLayer().Save()
    if ending == ".usdz":
        UsdUtils.CreateNewUsdzPackage(str(path), str(folder / "case.usdz"))
    return folder / f"case{ending}"


def mjcf(inside: str) -> str:
    return (
        f'<mujoco>{inside}<worldbody><geom name="g" type="box" size="1 1 1"/></worldbody></mujoco>'
    )


def mjcf_texture(folder: Path, size: int) -> Path:
    side = int(math.sqrt(size)) * 100
    texture = f'<texture name="t" type="2d" builtin="checker" width="{side}" height="{side}"/>'
    return write(folder, ".xml", mjcf(f"<asset>{texture}</asset>"))


def mjcf_hfield(folder: Path, size: int) -> Path:
    side = int(math.sqrt(size)) * 100
    field = f'<hfield name="h" nrow="{side}" ncol="{side}" size="1 1 1 1"/>'
    return write(folder, ".xml", mjcf(f"<asset>{field}</asset>"))


def mjcf_memory(folder: Path, size: int) -> Path:
    return write(folder, ".xml", mjcf(f'<size memory="{size}M"/>'))


def mjcf_users(folder: Path, size: int) -> Path:
    return write(folder, ".xml", mjcf(f'<size nuser_geom="{size * 1000}"/>'))


def mjcf_sphere(folder: Path, size: int) -> Path:
    mesh = f'<mesh name="m" builtin="sphere" params="{min(size, 30)}"/>'
    return write(folder, ".xml", mjcf(f"<asset>{mesh}</asset>"))


def mjcf_includes(folder: Path, size: int) -> Path:
    for i in range(min(size, 30)):
        two = f'<body><include file="i{i + 1}.xml"/></body>' * 2
        write(folder, ".xml", f"<x>{two}</x>").rename(folder / f"i{i}.xml")
    last = folder / f"i{min(size, 30)}.xml"
    last.write_text('<x><geom type="box" size="1 1 1"/></x>')
    return write(folder, ".xml", '<mujoco><worldbody><include file="i0.xml"/></worldbody></mujoco>')


def mjcf_replicate(folder: Path, size: int) -> Path:
    body = f'<replicate count="{size}"><geom type="box" size="1 1 1"/></replicate>'
    return write(folder, ".xml", f"<mujoco><worldbody>{body}</worldbody></mujoco>")


def sdf_itself(folder: Path, size: int) -> Path:
    inside = "<include><uri>case.sdf</uri></include>" * min(size, 20)
    return write(folder, ".sdf", f'<sdf version="1.9"><world name="w">{inside}</world></sdf>')


def sdf_doubling(folder: Path, size: int) -> Path:
    last = levels(size)
    box = "<visual name='v'><geometry><box><size>1 1 1</size></box></geometry></visual>"
    for i in range(last + 1):
        two = "".join(
            f"<include><uri>model://m{i + 1}</uri><name>{side}</name></include>" for side in "ab"
        )
        two = two if i < last else f"<link name='l'>{box}</link>"
        (folder / f"m{i}").mkdir()
        text = f'<sdf version="1.9"><model name="m">{two}</model></sdf>'
        (folder / f"m{i}" / "model.sdf").write_text(text)
    inside = "<include><uri>model://m0</uri></include>"
    return write(folder, ".sdf", f'<sdf version="1.9"><world name="w">{inside}</world></sdf>')


def gpkg_view(folder: Path, size: int) -> Path:
    """A layer that is a query of many rows."""
    path = write(folder, ".geojson", house_of(NAMES))
    with case_map(path) as house:
        made = house.export(folder / "case.gpkg")
    with closing(sqlite3.connect(made)) as file:
        (name,) = file.execute("SELECT table_name FROM gpkg_contents LIMIT 1").fetchone()
        columns = ", ".join(row[1] for row in file.execute(f'PRAGMA table_info("{name}")'))
        file.executescript(
            f"""DELETE FROM gpkg_ogr_contents;  -- rows that the file states
            ALTER TABLE "{name}" RENAME TO old; CREATE VIEW "{name}" AS
            WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n
            WHERE i < {size * 1000}) SELECT {columns} FROM old, n"""
        )
    return made


def map_cells(folder: Path, size: int) -> Path:
    """A picture of cells that touch at corners alone; it is packed well."""
    side = int(math.sqrt(size)) + 2
    cells = np.full((side, side), 254, np.uint8)
    cells[::2, ::2] = 0
    Image.fromarray(cells).save(folder / "map.png")
    text = "image: map.png\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
    return write(folder, ".yaml", text)


def ply_count(folder: Path, size: int) -> Path:
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {size}\n{axes}"
    head += f"element face {size}\nproperty list uchar int vertex_indices\nend_header\n"
    return write(folder, ".ply", head)


def obj_polygon(folder: Path, size: int) -> Path:
    size = min(size, 30_000)
    return write(folder, ".obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + "1 2 3 " * size + "\n")


def off_count(folder: Path, size: int) -> Path:
    return write(folder, ".off", f"OFF\n{size} {size} 0\n")


def stl_count(folder: Path, size: int) -> Path:
    path = folder / "case.stl"
    path.write_bytes(bytes(80) + struct.pack("<I", size) + bytes(50))
    return path


BOMBS: dict[str, Callable[[Path, int], Path]] = {
    "glb views": glb_views,
    "glb count": glb_count,
    "glb stride": glb_stride,
    "glb copies": glb_copies,
    "glb doubling": glb_doubling,
    "glb beside": lambda folder, size: beside(folder, ".glb", "data.bin", size),
    "gltf beside": lambda folder, size: beside(folder, ".gltf", "data.bin", size),
    "gltf spaces": lambda folder, size: beside(folder, ".gltf", " data.bin", size),
    "gltf data": data_uri,
    "gltf device": lambda folder, size: beside(folder, ".gltf", "/dev/zero", 1),
    "dae entities": lambda folder, size: entities(folder, ".dae", size),
    "gml entities": lambda folder, size: entities(folder, ".gml", size),
    "dae doubling": dae_doubling,
    "dae stride": dae_stride,
    "dae polygon": dae_polygon,
    "3mf zeros": lambda folder, size: packed(folder, ".3mf", "3D/3dmodel.model", "\0" * 600, size),
    "imdf lists": imdf_lists,
    "geojson lists": geojson_lists,
    "gml elements": gml_elements,
    "usda doubling": usda_doubling,
    "usda inherits": lambda folder, size: usda_doubling(folder, size, "inherits = "),
    "usda instances": lambda folder, size: usda_doubling(
        folder, size, "instanceable = true\nreferences = "
    ),
    "usda payloads": lambda folder, size: usda_doubling(folder, size, "payload = "),
    "usda itself": lambda folder, _: usda_other(folder, "case.usda"),
    "usda device": lambda folder, _: usda_other(folder, "/dev/zero"),
    "usdc polygon": usdc_polygon,
    "usdz polygon": lambda folder, size: usdc_polygon(folder, size, ".usdz"),
    "mjcf texture": mjcf_texture,
    "mjcf hfield": mjcf_hfield,
    "mjcf memory": mjcf_memory,
    "mjcf users": mjcf_users,
    "mjcf sphere": mjcf_sphere,
    "mjcf includes": mjcf_includes,
    "mjcf replicate": mjcf_replicate,
    "sdf itself": sdf_itself,
    "sdf doubling": sdf_doubling,
    "gpkg view": gpkg_view,
    "map cells": map_cells,
    "ply count": ply_count,
    "obj polygon": obj_polygon,
    "off count": off_count,
    "stl count": stl_count,
}


def other_bomb(random: Random, _: bytes, __: Sequence[bytes]) -> bytes:
    """A bomb of any size up to a million."""
    name = random.choice([*BOMBS])
    return json.dumps([name, int(10 ** random.uniform(0, 6))]).encode()


def run_bomb(data: bytes, folder: Path) -> None:
    name, size = json.loads(data)
    import_case(BOMBS[name](folder, size))


BOMB_KINDS = [Kind("bomb", lambda: [b'["glb views", 1]'], [other_bomb], run_bomb)]
