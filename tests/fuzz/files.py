"""Every reader of files."""

from __future__ import annotations

import base64
import json
import struct
import zipfile
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from io import BytesIO
from os import environ
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from pxr import UsdUtils

from navgrid.grid import Grid
from navgrid.map_file import write_map
from planner.routing_graph import RoutingGraph
from semmap.fields.regions.mesh_regions import mesh_parts
from semmap.fields.regions.region_map import RegionMap
from semmap.geometry.outline import hull_points
from semmap.geometry.tin import encode_chunks
from semmap.ingest.importer import read_world
from semmap.ingest.ontology.tbox import read_tbox
from semmap.ingest.world import World
from semmap.robot import load_robot, robot_parts
from tests.export.test_indoor_gml import THICK, file_of, transition
from tests.fuzz.gltf import BIN, triangle
from tests.fuzz.kind import Kind
from tests.fuzz.mutate import (
    Mutation,
    bytes_of,
    json_tree,
    lines_of,
    words_of,
    xml_tree,
    yaml_tree,
)
from tests.fuzz.server import import_case, loft
from tests.ingest.ifc.building_by_hand import BuildingByHand
from tests.ingest.meshes.test_mesh_file import dae
from tests.ingest.meshes.test_point_cloud_file import write_e57, write_las, write_pcd
from tests.ingest.rmf.test_building import text as building
from tests.ingest.route_graph.test_graph_file import graph
from tests.ingest.scenes.test_mjcf_scene import SCENE
from tests.ingest.scenes.test_urdf_scene import KITCHEN
from tests.ingest.scenes.test_usd_scene import kitchen as stage
from tests.ingest.sdf.test_world_file import FRAMES
from tests.ingest.sdf.worlds_by_hand import LINK, TETRAHEDRON
from tests.ingest.test_indoor_formats import (
    imdf,
    osm,
    two_levels_of_imdf,
    two_levels_of_osm,
    write_zip,
)
from tests.planner.office import office
from tests.planner.tasks.test_domain_file import TIDY
from tests.robot.robots import BY_HAND
from tests.robot.test_srdf import SRDF

ROOT = Path(__file__).parents[2]
OFFICE = ROOT / "examples" / "office"
WORLDS = Path(environ.get("SEMMAP_WORLDS", "/nowhere"))

SIZE = 0.05
"""Metres of a voxel."""


def files(*endings: str, largest: int = 40_000) -> Iterator[bytes]:
    """The small files of an ending in the example, the schema and the real worlds."""
    for folder in (ROOT / "examples", ROOT / "schema", WORLDS):
        for path in sorted(folder.rglob("*")):
            if path.name.endswith(endings) and path.is_file() and path.stat().st_size <= largest:
                yield path.read_bytes()


def use(world: World) -> None:
    """What the mirror does with a world."""
    regions = RegionMap(SIZE)
    for number, entry in enumerate(world.entries):
        assert entry.name
        assert entry.pose is None or np.isfinite(entry.pose).all()
        json.dumps(entry.properties, allow_nan=False)
        for shape in entry.shapes:
            if shape.mesh is None or not len(shape.mesh.faces):
                continue
            hull_points(shape.mesh)
            for chunk in encode_chunks(shape.mesh.triangles):
                assert chunk
            pieces = mesh_parts(shape.mesh).regions(SIZE)
            regions.insert_possible([(number, piece) for piece in pieces])


def run_world(ending: str, data: bytes, folder: Path) -> None:
    path = folder / f"case{ending}"
    path.write_bytes(data)
    use(read_world(path))
    import_case(path)


def sdf() -> Iterator[bytes]:
    yield from files(".sdf", ".world")
    for inside in (f"<model name='m'>{LINK}</model>", FRAMES):
        yield f'<sdf version="1.9"><world name="w">{inside}</world></sdf>'.encode()
    shapes = (
        "<sphere><radius>0.5</radius></sphere>",
        "<cylinder><radius>0.5</radius><length>1</length></cylinder>",
        "<cone><radius>0.5</radius><length>1</length></cone>",
        "<capsule><radius>0.5</radius><length>1</length></capsule>",
        "<ellipsoid><radii>0.5 1 2</radii></ellipsoid>",
        "<plane><normal>0 0 1</normal><size>3 4</size></plane>",
        "<polyline><point>0 0</point><point>1 0</point><point>1 1</point><height>1</height>"
        "</polyline>",
        "<mesh><uri>solid.obj</uri><scale>1 2 3</scale></mesh>",
    )
    models = "".join(
        f"<model name='m{i}'><pose>{i} 0 0 0 0 0.1</pose><link name='l'><visual name='v'><geometry>"
        f"{shape}</geometry></visual></link></model>"
        for i, shape in enumerate(shapes)
    )
    yield f'<sdf version="1.9"><world name="w">{models}</world></sdf>'.encode()


def run_sdf(data: bytes, folder: Path) -> None:
    (folder / "solid.obj").write_text(TETRAHEDRON)
    run_world(".sdf", data, folder)


def urdf_scenes() -> Iterator[bytes]:
    yield KITCHEN.encode()
    yield from urdf()


def run_scene(ending: str, data: bytes, folder: Path) -> None:
    (folder / "solid.obj").write_text(TETRAHEDRON)
    run_world(ending, data, folder)


def usd(ending: str) -> Iterator[bytes]:
    with TemporaryDirectory() as folder:
        yield stage(Path(folder), ending=ending).read_bytes()


def geojson() -> Iterator[bytes]:
    yield from files(".geojson", largest=200_000)
    office_features = json.loads((OFFICE / "office_rooms.geojson").read_bytes())["features"]
    for first in range(0, len(office_features), 4):
        some = {"type": "FeatureCollection", "features": office_features[first : first + 4]}
        yield json.dumps(some).encode()
    yield json.dumps({"type": "FeatureCollection", "features": graph()}).encode()
    square = {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]]}
    place = {"crs": 25832, "easting": 5e5, "northing": 5e6, "height": 0, "rotation": 0.1}
    feature = {"type": "Feature", "geometry": square, "properties": {"kind": "room", "name": "r"}}
    yield json.dumps(
        {"type": "FeatureCollection", "features": [feature], "georeference": place}
    ).encode()


def osm_geojson() -> Iterator[bytes]:
    yield json.dumps(osm()).encode()
    with TemporaryDirectory() as folder:
        yield two_levels_of_osm(Path(folder) / "seed").read_bytes()


def indoor_gml() -> Iterator[bytes]:
    ways = [transition(1, 1, 3), transition(2, 3, 2), transition(3, 2, 4), transition(4, 5, 2)]
    yield file_of(THICK, ways).encode()
    yield file_of(THICK[:2], [transition(1, 1, 2)]).encode()
    about = {"kind": "room", "name": "own", "storey": None}
    meta = f"<gml:metaDataProperty><x>{json.dumps(about)}</x></gml:metaDataProperty>"
    own = [each.replace("<gml:description>", f"{meta}<gml:description>", 1) for each in THICK]
    yield file_of(own, ways).encode()


def imdf_zip() -> Iterator[bytes]:
    with TemporaryDirectory() as folder:
        yield write_zip(Path(folder) / "seed.zip", imdf()).read_bytes()
        yield two_levels_of_imdf(Path(folder) / "seed").read_bytes()


def rmf() -> Iterator[bytes]:
    yield building().encode()
    yield from files(".building.yaml", largest=20_000)


def ifc() -> Iterator[bytes]:
    """A room with a wall, a door and treads in each schema."""
    for schema in ("IFC2X3", "IFC4"):
        made = BuildingByHand(schema)
        level = made.storey("ground", 0.0)
        made.add("IfcSpace", "hall", level, ((0, 0, 0), (4, 3, 2.6)), LongName="Hall")
        made.add("IfcWall", "wall", level, ((4, 0, 0), (4.2, 3, 2.6)))
        made.add("IfcDoor", "door", level, ((4.1, 1, 0), (5, 1.05, 2)), yaw=1.57)
        made.add("IfcStair", "stairs", level, ((1, 1, 0), (2, 2, 0.2)), ((2, 1, 0), (3, 2, 0.4)))
        with TemporaryDirectory() as folder:
            yield made.write(Path(folder) / "seed.ifc").read_bytes()


def clouds(ending: str) -> Iterator[bytes]:
    writers = {"las": write_las, "laz": write_las, "pcd": write_pcd, "e57": write_e57}
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"seed.{ending}"
        writers[ending](path)
        yield path.read_bytes()


@cache
def solids() -> list[trimesh.Trimesh]:
    """Small meshes."""
    return [
        trimesh.creation.box(extents=(1, 2, 3)),
        trimesh.creation.cylinder(radius=0.5, height=1, sections=6),
    ]


def meshes(ending: str) -> Iterator[bytes]:
    for solid in solids():
        made = solid.export(file_type=ending)
        yield made if isinstance(made, bytes) else made.encode()
    yield from files(f".{ending}")


def ascii_ply() -> Iterator[bytes]:
    yield from meshes("ply")
    for solid in solids():
        yield trimesh.exchange.ply.export_ply(solid, encoding="ascii")


def octomap(ending: str) -> Iterator[bytes]:
    """A tree of OctoMap with a leaf of 8 voxels and one of a voxel, 3 levels above the root's."""
    head = "# Octomap OcTree" + (" binary file" if ending == "bt" else " file")
    head += "\nid OcTree\nsize 18\nres 0.1\ndata\n"
    states = [0xC000] + [0x0003] * 13 + [0x0302 | 0x4000, 0x0002]
    marks = [(0.0, 0x80)] + [(0.0, 0x01)] * 13 + [(0.0, 0x11), (0.8, 0), (0.0, 1), (0.5, 0)]
    yield head.encode() + (
        struct.pack("<16H", *states)
        if ending == "bt"
        else b"".join(struct.pack("<fB", *mark) for mark in marks)
    )


def collada() -> Iterator[bytes]:
    yield dae().encode()
    yield from meshes("dae")


def glb_header(random: Random, seed: bytes, others: Sequence[bytes]) -> bytes:
    """A GLB whose JSON header is changed, its lengths made to fit."""
    length = int.from_bytes(seed[12:16], "little")
    texts = [other[20 : 20 + int.from_bytes(other[12:16], "little")] for other in others]
    text = json_tree(random, seed[20 : 20 + length], texts)
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + seed[20 + length :]
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def gltf() -> Iterator[bytes]:
    """A box whose buffers are data URIs; a triangle whose buffer is a file beside it."""
    data = b"data:application/octet-stream;base64,"
    found = solids()[0].scene().export(file_type="gltf")
    text = found.pop("model.gltf")
    for name, content in found.items():
        text = text.replace(name.encode(), data + base64.b64encode(content))
    yield text
    yield json.dumps(triangle([{"byteLength": len(BIN), "uri": "data.bin"}])).encode()


def run_gltf(data: bytes, folder: Path) -> None:
    (folder / "data.bin").write_bytes(BIN)
    run_world(".gltf", data, folder)


def usdz() -> Iterator[bytes]:
    with TemporaryDirectory() as folder:
        path = Path(folder, "kitchen.usdz")
        UsdUtils.CreateNewUsdzPackage(str(stage(Path(folder), ending="usda")), str(path))
        yield path.read_bytes()


def zipped(random: Random, seed: bytes, others: Sequence[bytes]) -> bytes:
    """A 3MF or IMDF whose members are changed, then packed again."""
    made = BytesIO()
    with zipfile.ZipFile(BytesIO(seed)) as old, zipfile.ZipFile(made, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name.endswith(".model"):
                data = random.choice((xml_tree, words_of))(random, data, [data])
            elif name.endswith(".geojson") and random.random() < 0.5:
                data = random.choice((json_tree, words_of))(random, data, [data])
            new.writestr(name, data)
    return made.getvalue()


def map_yaml() -> Iterator[bytes]:
    yield (
        b"image: map.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\n"
        b"occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    yield b"image: map.png\nmode: scale\nresolution: 1\norigin: [0, 0, 0]\nnegate: 1\n"


@cache
def images() -> dict[str, bytes]:
    """Map images of every format that is written, and of some others."""
    shades = np.random.default_rng(1).integers(0, 256, (7, 9)).astype(np.uint8)
    found = {}
    for name, mode in (
        ("pgm", "L"),
        ("png", "L"),
        ("bmp", "L"),
        ("tiff", "L"),
        ("gif", "P"),
        ("jpg", "L"),
        ("webp", "RGB"),
    ):
        made = BytesIO()
        Image.fromarray(shades).convert(mode).save(
            made, {"pgm": "ppm", "jpg": "jpeg"}.get(name, name)
        )
        found[name] = made.getvalue()
    transparent = np.stack([shades] * 4, axis=-1)
    for name, pixels in (("rgba", transparent), ("la", transparent[..., :2])):
        made = BytesIO()
        Image.fromarray(pixels).save(made, "png")
        found[name] = made.getvalue()
    return found


def use_map(path: Path) -> None:
    """Take a map as one of a SLAM program, and as a layer of costmaps."""
    loft().costmap("two_wheels", static_map=path, resolution=0.2)
    import_case(path)


def run_map(data: bytes, folder: Path) -> None:
    (folder / "map.yaml").write_bytes(data)
    for name in ("pgm", "png"):
        (folder / f"map.{name}").write_bytes(images()[name])
    use_map(folder / "map.yaml")


def run_image(data: bytes, folder: Path) -> None:
    grid = Grid((0, 0), 0.1, (2, 2))
    path = write_map(grid, np.zeros((2, 2), np.int8), folder / "map")
    (folder / "map.pgm").write_bytes(data)
    use_map(path)


def tbox() -> Iterator[bytes]:
    for each in files(".ttl"):
        yield each
        prefixes = b"".join(x for x in each.splitlines(True) if x.startswith(b"@prefix"))
        blocks = [b for b in each.split(b"\n\n") if b"@prefix" not in b]
        for first in range(0, len(blocks), 6):
            yield b"\n\n".join([prefixes, *blocks[first : first + 6]])


def run_tbox(data: bytes, folder: Path) -> None:
    path = folder / "case.ttl"
    path.write_bytes(data)
    read_tbox([path])


def urdf() -> Iterator[bytes]:
    yield BY_HAND.encode()
    yield BY_HAND.replace(
        '<sphere radius="0.1"/>', '<mesh filename="solid.obj" scale="1 2 3"/>'
    ).encode()
    yield from files(".urdf")


def run_urdf(data: bytes, folder: Path) -> None:
    (folder / "solid.obj").write_text(TETRAHEDRON)
    path = folder / "case.urdf"
    path.write_bytes(data)
    loft().database.add_robot("case", path)
    for part in robot_parts(load_robot(path), {}):
        assert np.isfinite(part.footprint).all()
        assert np.isfinite([*part.interval, part.inscribed_radius, part.circumscribed_radius]).all()


def run_srdf(data: bytes, folder: Path) -> None:
    (folder / "robot.urdf").write_text(BY_HAND)
    (folder / "robot.srdf").write_bytes(data)
    loft().costmap(folder / "robot.urdf", posture="folded", resolution=0.2)


def parts() -> Iterator[bytes]:
    yield b'base: [base_link, "whe?l"]\narm: [upper, "low*"]\n'
    yield (OFFICE / "delivery_robot_parts.yaml").read_bytes()


def run_parts(data: bytes, folder: Path) -> None:
    (folder / "robot.urdf").write_text(BY_HAND)
    (folder / "parts.yaml").write_bytes(data)
    loft().database.add_robot("case", folder / "robot.urdf", parts=folder / "parts.yaml")


def policy() -> Iterator[bytes]:
    yield (ROOT / "navgrid" / "policy.yaml").read_bytes()
    yield (
        b"layers: {near: {padding: 0.1}, far: }\nrules:\n"
        b"  - {type: cup, properties: {full: true}, layer: far}\n"
        b"  - {type: [cup, plate], kind: object, state: open, layer: near}\n"
    )


def run_policy(data: bytes, folder: Path) -> None:
    path = folder / "policy.yaml"
    path.write_bytes(data)
    loft().grid(policy=path, resolution=0.2)


def rules() -> Iterator[bytes]:
    yield (ROOT / "planner" / "rules.yaml").read_bytes()
    yield (
        b"rules:\n  - {kind: place, name: [lab1], type: lab, properties: {a: 1}, seconds: 3,\n"
        b"     from: '22:00', until: '06:00'}\n  - {kind: connector, forbid: true}\n"
    )


def run_rules(data: bytes, folder: Path) -> None:
    (folder / "rules.yaml").write_bytes(data)
    loft().route("studio", "table", rules=folder / "rules.yaml")


def run_domain(data: bytes, folder: Path) -> None:
    path = folder / "domain.yaml"
    path.write_bytes(data)
    for goal in ("wiped(table)", "wiped(table) and in(robot, studio)"):
        loft().plan(goal, start="studio", domain=path, patience=0.5)


@cache
def network() -> Any:
    """The routes of a small building."""
    return RoutingGraph(office())


TEXT: list[Mutation] = [words_of, words_of, bytes_of, lines_of]
BINARY: list[Mutation] = [bytes_of]
XML: list[Mutation] = [*TEXT, xml_tree, xml_tree]
CLOUDS = ("las", "laz", "pcd", "e57")


def _world(
    name: str, ending: str, seeds: Callable[[], Iterator[bytes]], mutations: list[Mutation]
) -> Kind:
    return Kind(name, lambda: list(seeds()), mutations, partial(run_world, ending))


FILE_KINDS = [
    Kind("sdf", lambda: list(sdf()), [*TEXT, xml_tree, xml_tree], run_sdf),
    _world("geojson", ".geojson", geojson, [*TEXT, json_tree, json_tree, json_tree]),
    _world("osm indoor", ".geojson", osm_geojson, [*TEXT, json_tree, json_tree]),
    _world("indoorgml", ".gml", indoor_gml, [*TEXT, xml_tree, xml_tree]),
    _world("imdf", ".zip", imdf_zip, [zipped, zipped, bytes_of]),
    _world("rmf", ".building.yaml", rmf, [*TEXT, yaml_tree, yaml_tree]),
    _world("ifc", ".ifc", ifc, TEXT),
    Kind("mjcf", lambda: [SCENE.encode()], XML, partial(run_scene, ".xml")),
    Kind("urdf scene", lambda: list(urdf_scenes()), XML, partial(run_scene, ".urdf")),
    _world("usda", ".usda", partial(usd, "usda"), TEXT),
    _world("usdc", ".usdc", partial(usd, "usdc"), BINARY),
    *(_world(f"{cloud} cloud", f".{cloud}", partial(clouds, cloud), BINARY) for cloud in CLOUDS),
    _world("dae", ".dae", collada, [*TEXT, xml_tree, xml_tree]),
    _world("obj", ".obj", partial(meshes, "obj"), TEXT),
    _world("ply", ".ply", ascii_ply, [*TEXT, bytes_of]),
    _world("off", ".off", partial(meshes, "off"), TEXT),
    _world("stl", ".stl", partial(meshes, "stl"), BINARY),
    _world("glb", ".glb", partial(meshes, "glb"), [glb_header, glb_header, bytes_of]),
    Kind("gltf", lambda: list(gltf()), [*TEXT, *[json_tree] * 4], run_gltf),
    _world("usdz", ".usdz", usdz, BINARY),
    _world("octomap", ".bt", partial(octomap, "bt"), BINARY),
    _world("octomap full", ".ot", partial(octomap, "ot"), BINARY),
    _world("3mf", ".3mf", partial(meshes, "3mf"), [zipped, zipped, bytes_of]),
    Kind("map", lambda: list(map_yaml()), [*TEXT, yaml_tree], run_map),
    Kind(
        "image",
        lambda: list(images().values()),
        [bytes_of, bytes_of, words_of],
        run_image,
    ),
    Kind("tbox", lambda: list(tbox()), TEXT, run_tbox),
    Kind("urdf", lambda: list(urdf()), [*TEXT, xml_tree, xml_tree], run_urdf),
    Kind("srdf", lambda: [SRDF.encode()], XML, run_srdf),
    Kind("parts", lambda: list(parts()), [*TEXT, yaml_tree], run_parts),
    Kind("policy", lambda: list(policy()), [*TEXT, yaml_tree], run_policy),
    Kind("rules", lambda: list(rules()), [*TEXT, yaml_tree], run_rules),
    Kind(
        "domain",
        lambda: [TIDY.read_bytes()],
        [*TEXT, yaml_tree, yaml_tree],
        run_domain,
    ),
]
