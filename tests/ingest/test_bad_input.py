"""Each importer and each kind of bad file, in one table: nothing is silent, and nothing is left.

A format without a row is a failure.
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import geopandas
import numpy as np
import pye57
import pytest
import shapely
import trimesh
from PIL import Image
from pypcd4.pypcd4 import PointCloud

import semmap
from navgrid.explored_map import is_map_file, read_explored_map
from semmap.ingest.importer import KNOWN, read_world
from semmap.ingest.world import WorldError
from semmap.limits import LIMITS
from tests.conftest import MakeDatabase
from tests.export.test_indoor_gml import file_of
from tests.fuzz.files import octomap as octree
from tests.ingest.ifc.building_by_hand import BuildingByHand
from tests.ingest.meshes.test_point_cloud_file import write_las
from tests.ingest.test_indoor_formats import feature as on_earth
from tests.ingest.test_indoor_formats import write_zip

Ring = Sequence[tuple[float, float]]

ROOM: Ring = [(0, 0), (4, 0), (4, 3), (0, 3)]
CROSSED: Ring = [(0, 0), (4, 0), (0, 3), (4, 3)]


def scaled(scale: float) -> Ring:
    return [(scale * x, scale * y) for x, y in ROOM]


def solid(ring: Ring) -> trimesh.Trimesh:
    """A prism above a ring, as high as it is wide."""
    corners = np.array([(*p, z) for z in (0.0, max(map(max, ring))) for p in ring])
    sides = [[i, (i + 1) % 4, 4 + i] for i in range(4)]
    sides += [[4 + i, (i + 1) % 4, 4 + (i + 1) % 4] for i in range(4)]
    faces = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], *sides]
    return trimesh.Trimesh(corners, faces, process=False)


def mesh(path: Path, ring: Ring) -> None:
    if path.suffix == ".gltf":
        exporter: Any = trimesh.exchange.gltf
        made = exporter.export_gltf(solid(ring).scene(), embed_buffers=True)
        path.write_bytes(made["model.gltf"])
    else:
        solid(ring).export(path)


def sdf(path: Path, ring: Ring) -> None:
    points = "".join(f"<point>{x} {y}</point>" for x, y in ring)
    shape = f"<polyline>{points}<height>2</height></polyline>"
    link = f"<link name='l'><visual name='v'><geometry>{shape}</geometry></visual></link>"
    model = f"<model name='thing'>{link}</model>"
    path.write_text(f"<sdf version='1.9'><world name='w'>{model}</world></sdf>")


def building(path: Path, ring: Ring) -> None:
    numbers = list(range(len(ring)))
    level = {
        "elevation": 0.0,
        "vertices": [[x, y, 0.0, ""] for x, y in ring],
        "walls": [[i, (i + 1) % 4, {}] for i in numbers],
        "floors": [{"parameters": {}, "vertices": numbers}],
    }
    root = {"name": "b", "coordinate_system": "cartesian_meters", "levels": {"L1": level}}
    path.write_text(json.dumps({**root, "lifts": {}}))


def features(path: Path, ring: Ring) -> None:
    geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    about = {"kind": "room", "name": "thing"}
    feature = {"type": "Feature", "properties": about, "geometry": geometry}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))


def geopackage(path: Path, ring: Ring) -> None:
    frame = geopandas.GeoDataFrame({"name": ["thing"]}, geometry=[shapely.Polygon(ring)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # no CRS
        frame.to_file(path, layer="rooms", engine="pyogrio")


def osm(path: Path, ring: Ring) -> None:
    about = {"indoor": "room", "level": "0", "name": "thing"}
    rest = on_earth(shapely.Polygon(ROOM), {**about, "name": "rest"})
    made = {"type": "FeatureCollection", "features": [on_earth(shapely.Polygon(ring), about), rest]}
    path.write_text(json.dumps(made))


def imdf(path: Path, ring: Ring) -> None:
    level = on_earth(
        shapely.Polygon(ROOM),
        {"ordinal": 0, "short_name": {"en": "g"}},
        id="l",
        feature_type="level",
    )
    about = {"level_id": "l", "category": "room", "name": {"en": "thing"}}
    unit = on_earth(shapely.Polygon(ring), about, id="u", feature_type="unit")
    members = {"level": [level], "unit": [unit]}
    root = {"type": "FeatureCollection"}
    write_zip(path, {name: {**root, "name": name, "features": f} for name, f in members.items()})


def indoor_gml(path: Path, ring: Ring) -> None:
    corners = "".join(f"<gml:pos>{x} {y} 0</gml:pos>" for x, y in (*ring, ring[0]))
    cell = f"""<cellSpaceMember><CellSpace gml:id="C1"><gml:name>thing</gml:name>
      <cellSpaceGeometry><Geometry2D><gml:Polygon gml:id="P1"><gml:exterior>
      <gml:LinearRing>{corners}</gml:LinearRing></gml:exterior></gml:Polygon></Geometry2D></cellSpaceGeometry>
      </CellSpace></cellSpaceMember>"""
    path.write_text(file_of([cell], []))


def ifc(path: Path, ring: Ring) -> None:
    made = BuildingByHand(prefix=None)
    wide, deep = ring[2]
    made.add("IfcSpace", "thing", made.storey("ground", 0.0), ((0, 0, 0), (wide, deep, 2.6)))
    made.write(path)


def mjcf(path: Path, ring: Ring) -> None:
    x, y = ring[2]
    box = f'<geom type="box" size="{x / 2} {y / 2} 1"/>'
    body = f'<worldbody><body name="thing">{box}</body></worldbody>'
    path.write_text(f'<mujoco><compiler meshdir="."/>{body}</mujoco>')


def urdf(path: Path, ring: Ring) -> None:
    x, y = ring[2]
    visual = f'<visual><geometry><box size="{x} {y} 1"/></geometry></visual>'
    path.write_text(f'<robot name="r"><link name="thing">{visual}</link></robot>')


def usd(path: Path, ring: Ring) -> None:
    from pxr import Usd, UsdGeom, UsdUtils

    drawn = path.with_suffix(".usdc") if path.suffix == ".usdz" else path
    stage: Any = Usd.Stage.CreateNew(str(drawn))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    made: Any = UsdGeom.Mesh.Define(stage, "/thing")
    made.CreatePointsAttr([(x, y, z) for z in (0, 1) for x, y in ring])
    made.CreateFaceVertexCountsAttr([4, 4])
    made.CreateFaceVertexIndicesAttr([0, 3, 2, 1, 4, 5, 6, 7])
    stage.GetRootLayer().Save()
    if drawn != path:
        UsdUtils.CreateNewUsdzPackage(str(drawn), str(path))


def cloud(path: Path, ring: Ring) -> None:
    points = solid(ring).vertices
    if path.suffix == ".pcd":
        PointCloud.from_xyz_points(points.astype(np.float32)).save(path)
    elif path.suffix == ".e57":
        file = pye57.E57(str(path), mode="w")
        file.write_scan_raw({f"cartesian{axis}": points[:, i] for i, axis in enumerate("XYZ")})
        file.close()
    else:
        write_las(path, points)


def octomap(path: Path, ring: Ring) -> None:
    (tree,) = octree(path.suffix[1:])
    path.write_bytes(tree.replace(b"res 0.1", f"res {ring[2][0] / 4}".encode()))


def scanned(path: Path, ring: Ring) -> None:
    cells = np.full((12, 12), 254, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 0
    Image.fromarray(cells).save(path.with_name("scan.png"))
    resolution = ring[2][0] / 12
    path.write_text(
        f"image: scan.png\nmode: trinary\nresolution: {resolution}\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


class Format(NamedTuple):
    """How a file of a format is made, and what is done with a bad one; None: there is none."""

    write: Callable[[Path, Ring], None]
    crossed: str | None = None
    millimetres: str | None = "noted"
    vast: str | None = "refused"
    most: str | None = "refused"


def drawn(write: Callable[[Path, Ring], None], crossed: str = "skipped") -> Format:
    return Format(write, crossed, vast="skipped")


FORMATS = {
    "house.sdf": drawn(sdf),
    "house.building.yaml": Format(building, "taken"),  # as the rooms that walls enclose
    "house.geojson": drawn(features),
    "house.gpkg": drawn(geopackage),
    "osm.geojson": Format(osm, "skipped", None, "skipped"),  # degrees
    "imdf.zip": Format(imdf, "skipped", None, "skipped"),
    "house.gml": drawn(indoor_gml),
    "house.ifc": Format(ifc),
    "scene.xml": Format(mjcf, vast="skipped"),
    "scene.urdf": Format(urdf, vast="skipped"),
    "scene.usda": Format(usd, "taken", vast="skipped"),
    "scene.usdc": Format(usd, "taken", vast="skipped"),
    "scene.usdz": Format(usd, "taken", vast="skipped"),
    **{f"thing.{ending}": Format(mesh) for ending in ("dae", "glb", "gltf", "off", "ply")},
    "thing.obj": Format(mesh, most="taken"),  # it does not say how much it has
    "thing.stl": Format(mesh),
    "thing.3mf": Format(mesh, millimetres=None),  # in millimetres, as it states
    "thing.bt": Format(octomap),
    "thing.ot": Format(octomap),
    "scan.las": Format(cloud, vast=None),  # it has whole millimetres, of 32 bits
    "scan.laz": Format(cloud, vast=None),
    "scan.pcd": Format(cloud),
    "scan.e57": Format(cloud),
    "scan.yaml": Format(scanned),
}
"""The formats by a name of a file."""


ALIKE = {".world": ".sdf", ".yml": ".yaml", ".json": ".geojson", ".mjcf": ".xml", ".usd": ".usdc"}
"""Endings that are read as others are."""


def outcome(path: Path) -> tuple[str, str]:
    """What is done with a file, and what is said about it."""
    try:
        world = read_explored_map(path) if is_map_file(path) else read_world(path)
    except WorldError as error:
        return "refused" if error.problem and error.fix else "mute", str(error)
    if world.skipped:
        first = world.skipped[0]
        return "skipped" if first.problem and first.fix else "mute", str(first)
    about = [note for note in world.notes if "millimetres" in note]
    return ("noted", about[0]) if about else ("taken", "")


def test_each_ending_has_a_row() -> None:
    endings = {ALIKE.get(ending, ending) for ending in KNOWN}
    assert endings == {Path(name).suffix for name in FORMATS}


@pytest.fixture(scope="module")
def maps(make_database: MakeDatabase) -> Iterator[semmap.Database]:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        yield db


@pytest.mark.parametrize("name", FORMATS)
def test_bad_files(
    name: str, maps: semmap.Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each within seconds; what is refused leaves no map, and the limits are named."""
    path, format_ = tmp_path / name, FORMATS[name]
    format_.write(path, ROOM)
    whole = path.read_bytes()
    assert outcome(path) == ("taken", "")
    cases: dict[str, tuple[str | None, bytes | Ring]] = {
        "empty": ("refused", b""),
        "half": ("refused", whole[: len(whole) // 2]),
        "most": (format_.most, whole[: len(whole) * 9 // 10]),
        "another format": ("refused", b"\x89PNG\r\n\x1a\n" + bytes(range(256))),
        "crossed": (format_.crossed, CROSSED),
        "millimetres": (format_.millimetres, scaled(1e3)),
        "vast": (format_.vast, scaled(1e7)),
    }
    for case, (expected, content) in cases.items():
        if expected is None:
            continue
        path.unlink()  # pye57 and pyogrio add to a file that is there
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            format_.write(path, content)
        began = time.perf_counter()
        done, said = outcome(path)
        assert (case, done) == (case, expected), said
        assert time.perf_counter() - began < 20, case
        if done == "refused":
            with pytest.raises(semmap.Error):
                maps.import_file(path, map="bad")
            assert maps.maps == []
    path.unlink()
    format_.write(path, ROOM)
    limits = [each.variable for each in LIMITS if each.unit == "bytes"]
    for limit in limits:
        monkeypatch.setenv(limit, "8")
    done, said = outcome(path)
    assert done == "refused"
    assert any(limit in said for limit in limits), said
