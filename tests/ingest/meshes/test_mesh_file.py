"""Mesh files: units, axes, parts, and what is not a mesh."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from semmap.geometry.mesh import Mesh
from semmap.ingest.importer import read_world
from semmap.ingest.meshes.mesh_file import read_mesh, read_mesh_world, read_shape
from semmap.ingest.meshes.mesh_size import MeshFileError
from semmap.ingest.world import PlaceDetail, WorldError

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], float)
"""A tetrahedron with sides 1, 2 and 3 along x, y and z; its volume is 1."""
OUTWARD = "0 2 1 0 3 2 0 1 3 1 2 3"
"""Its faces, with normals outward."""


def dae(
    unit: str = "1",
    up: str = "Z_UP",
    matrix: str = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1",
    faces: str = OUTWARD,
    inside: str = "",
    head: str = "",
) -> str:
    floats = " ".join(f"{v:g}" for v in CORNERS.ravel())
    return f"""<?xml version="1.0" encoding="utf-8"?>{head}
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit meter="{unit}" name="u"/><up_axis>{up}</up_axis></asset>
  <library_geometries><geometry id="g" name="solid"><mesh>{inside}
    <source id="p"><float_array id="a" count="12">{floats}</float_array>
      <technique_common><accessor source="#a" count="4" stride="3">
        <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
      </accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>{faces}</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s"><node id="n" name="arm">
    <matrix>{matrix}</matrix><instance_geometry url="#g"/></node></visual_scene>
  </library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""


def volume(mesh: Mesh) -> float:
    """Signed: positive where all normals point outward."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_a_3mf_that_inflates_beyond_measure_is_not_inflated(tmp_path: Path) -> None:
    path = tmp_path / "bomb.3mf"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed,
        packed.open("3D/3dmodel.model", "w", force_zip64=True) as member,
    ):
        for _ in range(600):
            member.write(bytes(2**20))
    assert path.stat().st_size < 2**20
    with pytest.raises(MeshFileError, match="inflates to 600 MiB"):
        read_mesh(path)


@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "off", "glb", "3mf", "dae"])
def test_formats(tmp_path: Path, ending: str) -> None:
    if ending == "3mf":
        pytest.importorskip("lxml")
    solid = trimesh.creation.box(extents=(1, 2, 3))
    solid.apply_translation((4, 5, 6))
    if ending == "3mf":
        solid.apply_scale(1000)  # a 3MF file without a unit is in millimetres
    path = tmp_path / f"box.{ending}"
    solid.export(path)
    mesh = read_mesh(path, dae_up_axis=False)  # trimesh writes a DAE without <up_axis>
    expected = [[3.5, 4, 4.5], [4.5, 6, 7.5]]
    if ending == "glb":  # (x, y, z) with y up is (x, -z, y) with z up
        expected = [[3.5, -7.5, 4], [4.5, -4.5, 6]]
    np.testing.assert_allclose(mesh.bounds, expected, atol=1e-5)
    assert mesh.faces.shape == (12, 3)
    assert mesh.vertices.shape == (8, 3), "vertices that coincide are one"
    assert volume(mesh) == pytest.approx(6, rel=1e-5)


@pytest.mark.parametrize(("unit", "metres"), [("1", 1.0), ("0.01", 0.01), ("0.001", 0.001)])
def test_dae_unit(tmp_path: Path, unit: str, metres: float) -> None:
    mesh = read_mesh(write(tmp_path / "a.DAE", dae(unit)))
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], metres * np.array([1, 2, 3])], atol=1e-12)


@pytest.mark.parametrize(
    ("up", "low", "high"),
    [
        ("Z_UP", (0, 0, 0), (1, 2, 3)),
        ("Y_UP", (0, -3, 0), (1, 0, 2)),
        ("X_UP", (-2, -3, 0), (0, 0, 1)),
    ],
)
def test_dae_up_axis(
    tmp_path: Path, up: str, low: tuple[float, ...], high: tuple[float, ...]
) -> None:
    path = write(tmp_path / "a.dae", dae(up=up))
    np.testing.assert_allclose(read_mesh(path).bounds, [low, high], atol=1e-12)
    assert volume(read_mesh(path)) == pytest.approx(1)
    np.testing.assert_allclose(read_mesh(path, dae_up_axis=False).bounds, [(0, 0, 0), (1, 2, 3)])


def test_dae_node_matrix_scales_and_mirrors(tmp_path: Path) -> None:
    path = write(tmp_path / "a.dae", dae(matrix="-2 0 0 10  0 1 0 20  0 0 1 30  0 0 0 1"))
    mesh = read_mesh(path)
    np.testing.assert_allclose(mesh.bounds, [[8, 20, 30], [10, 22, 33]])
    assert volume(mesh) == pytest.approx(2), "the faces of a mirrored node point outward"


def test_a_comment_inside_a_dae_mesh_loses_nothing(tmp_path: Path) -> None:
    mesh = read_mesh(write(tmp_path / "a.dae", dae(inside="<!-- <polylist/> \n -->")))
    assert len(mesh.faces) == 4


def test_part_by_node_or_geometry_name_and_center(tmp_path: Path) -> None:
    path = write(tmp_path / "a.dae", dae())
    for part in ("arm", "solid", "g"):
        assert len(read_mesh(path, part=part).faces) == 4
    np.testing.assert_allclose(
        read_mesh(path, part="arm", center=True).bounds, [(-0.5, -1, -1.5), (0.5, 1, 1.5)]
    )
    with pytest.raises(MeshFileError, match="'leg'"):
        read_mesh(path, part="leg")


def test_scale_is_for_formats_without_a_unit(tmp_path: Path) -> None:
    path = tmp_path / "a.stl"
    trimesh.creation.box(extents=(1000, 2000, 3000)).export(path)
    np.testing.assert_allclose(np.ptp(read_mesh(path, scale=0.001).bounds, axis=0), (1, 2, 3))
    assert "millimetres" in read_world(path).notes[0]
    assert read_world(path, scale=0.001).notes == []


def _text(text: str) -> Callable[[Path], object]:
    return lambda path: path.write_text(text)


BOMB = """<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>"""

UNUSABLE: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "absent": ("a.obj", lambda path: None, "does not exist"),
    "folder": ("a.obj", lambda path: path.mkdir(), "does not exist"),
    "empty": ("a.stl", _text(""), "empty file|cannot be read|no faces"),
    "picture": ("a.stl", lambda p: p.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(200)), "not an STL"),
    "unknown ending": ("a.docx", _text("solid"), "cannot be read"),
    "gltf that is none": ("a.gltf", _text("<xml/>"), "not a .gltf"),
    "points without faces": (
        "a.obj",
        _text("v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        "no faces|cannot be read",
    ),
    "NaN": ("a.obj", _text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), "not finite"),
    "does not exist": (
        "a.obj",
        _text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
        "cannot be read|vertices",
    ),
    "giant": ("a.obj", _text("v 0 0 0\nv 1e9 0 0\nv 0 1 0\nf 1 2 3\n"), "reaches"),
    "dae truncated": ("a.dae", _text(dae()[:900]), "cannot be read|well-formed"),
    "dae bomb": ("a.dae", _text(dae(head=BOMB, matrix="&b;")), "document type"),
    "dae unit": ("a.dae", _text(dae(unit="0")), "unit"),
    "dae unit nan": ("a.dae", _text(dae(unit="nan")), "unit"),
    "dae index": (
        "a.dae",
        _text(dae(faces=OUTWARD.replace("3", "7"))),
        "cannot be read|vertices|unreadable",
    ),
    "dae without scene": (
        "a.dae",
        _text(dae().replace('<instance_geometry url="#g"/>', "")),
        "no faces",
    ),
}


@pytest.mark.parametrize("case", UNUSABLE)
def test_unusable_files_say_why(tmp_path: Path, case: str) -> None:
    name, make, problem = UNUSABLE[case]
    make(tmp_path / name)
    with pytest.raises(MeshFileError, match=problem) as error:
        read_mesh(tmp_path / name)
    assert error.value.fix
    with pytest.raises(WorldError) as world_error:
        read_mesh_world(tmp_path / name)
    assert name in str(world_error.value)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_points_without_faces_are_a_point_cloud(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "scan.ply"
    points = np.random.default_rng(1).uniform(0, 2, (50, 3)).astype(np.float32)
    cloud = trimesh.PointCloud(points)
    path.write_bytes(trimesh.exchange.ply.export_ply(cloud, encoding=encoding))
    (entry,) = read_mesh_world(path, scale=0.5).entries
    (shape,) = entry.shapes
    assert (entry.name, entry.kind, shape.kind) == ("scan", "object", "cloud")
    assert shape.mesh is not None
    expected = points[np.lexsort(points.T[::-1])] / 2
    np.testing.assert_allclose(shape.mesh.vertices, expected, atol=1e-5)
    with pytest.raises(MeshFileError, match="no faces"):
        read_mesh(path)
    with pytest.raises(WorldError, match="no faces"):
        read_mesh_world(path, "room")
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(WorldError):
        read_mesh_world(path)


def test_truncated_points(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    head = "ply\nformat ascii 1.0\nelement vertex 100\n{}end_header\n{}"
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    path.write_text(head.format(axes, "\n".join(f"{n} {n} 0" for n in range(50))))
    with pytest.raises(MeshFileError, match="fewer points than its header says"):
        read_shape(path)


def test_truncated_binary_stl(tmp_path: Path) -> None:
    path = tmp_path / "a.stl"
    trimesh.creation.box().export(path)
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(MeshFileError, match="truncated"):
        read_mesh(path)


def test_case_of_a_name_is_hinted_at(tmp_path: Path) -> None:
    trimesh.creation.box().export(tmp_path / "Box.stl")
    with pytest.raises(MeshFileError, match=r"There is Box\.stl"):
        read_mesh(tmp_path / "box.stl")


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    ending=st.sampled_from(["stl", "obj", "ply", "off", "glb", "dae"]),
    cut=st.floats(0, 1),
    noise=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), max_size=3),
)
def test_damaged_files_are_refused_or_give_a_sound_mesh(
    tmp_path: Path, ending: str, cut: float, noise: list[tuple[float, int]]
) -> None:
    good = tmp_path / f"good.{ending}"
    if not good.exists():
        trimesh.creation.box().export(good)
    data = bytearray(good.read_bytes())
    for place, byte in noise:
        data[int(place * len(data))] = byte
    bad = tmp_path / f"bad.{ending}"
    bad.write_bytes(data[: round(cut * len(data))])
    try:
        mesh = read_mesh(bad)
    except MeshFileError:
        return
    assert np.isfinite(mesh.vertices).all()
    assert len(mesh.faces)
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.vertices)


def test_object(tmp_path: Path) -> None:
    trimesh.creation.box(extents=(1, 2, 3)).export(tmp_path / "OfficeChair_01.stl")
    world = read_mesh_world(tmp_path / "OfficeChair_01.stl")
    (entry,) = world.entries
    assert (entry.name, entry.kind, entry.type) == ("OfficeChair_01", "object", "office_chair")
    assert entry.shapes[0].mesh is not None


def test_room_has_heights_and_its_outline(tmp_path: Path) -> None:
    outline = shapely.Polygon([(0, 0), (4, 0), (4, 2), (2, 2), (2, 5), (0, 5)])
    shell = trimesh.creation.extrude_polygon(outline, height=2.5)
    shell.apply_translation((0, 0, 3))
    shell.export(tmp_path / "lab.obj")
    (entry,) = read_mesh_world(tmp_path / "lab.obj", "room").entries
    assert (entry.kind, entry.type) == ("room", "room")
    assert entry.detail == PlaceDetail(3.0, 5.5)
    found = entry.shapes[0].outline
    assert found is not None
    assert found.symmetric_difference(outline).area < 1e-3


def test_outline_of_a_room_of_thick_walls_is_filled(tmp_path: Path) -> None:
    ring = shapely.box(0, 0, 5, 4).difference(shapely.box(0.1, 0.1, 4.9, 3.9))
    trimesh.creation.extrude_polygon(ring, height=2.5).export(tmp_path / "cell.obj")
    (entry,) = read_mesh_world(tmp_path / "cell.obj", "room").entries
    found = entry.shapes[0].outline
    assert found is not None
    assert found.symmetric_difference(shapely.box(0, 0, 5, 4)).area < 1e-3


def test_room_of_thin_walls_falls_back_on_the_hull(tmp_path: Path) -> None:
    text = (
        "v 0 0 0\nv 4 0 0\nv 4 0 2\nv 0 0 2\nv 4 3 0\nv 4 3 2\nf 1 2 3\nf 1 3 4\nf 2 5 6\nf 2 6 3\n"
    )
    world = read_mesh_world(write(tmp_path / "thin.obj", text), "room")
    outline = world.entries[0].shapes[0].outline
    assert outline is not None
    assert outline.equals(shapely.Polygon([(0, 0), (4, 0), (4, 3)]))
    assert "convex hull" in world.notes[0]


def test_no_part_of_an_off_file_is_a_mesh(tmp_path: Path) -> None:
    text = trimesh.creation.box().export(file_type="off")
    path = tmp_path / "box.off"
    for end in range(len(text.rstrip()) - 1):  # its last figure may be of a shorter number
        path.write_text(text[:end])
        with pytest.raises(MeshFileError):
            read_mesh(path)
    path.write_text(f"OFF {text.removeprefix('OFF').lstrip()}# end")
    assert len(read_mesh(path).faces) == 12
