"""USD stages, made and measured by Pixar's own library."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Gf, Kind, Sdf, Usd, UsdGeom

import semmap
from semmap.ingest.importer import read_world
from semmap.ingest.scenes.polygon_mesh import polygon_mesh
from semmap.ingest.scenes.usd_scene import read_usd
from semmap.ingest.world import World, WorldError
from tests.ingest.scenes.placed import box, entry, pose

L_SHAPE = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)]


def xform(stage: Usd.Stage, path: str, *, at=(0, 0, 0), turn=(0, 0, 0), scale=(1, 1, 1)):
    made = UsdGeom.Xform.Define(stage, path)
    made.AddTranslateOp().Set(Gf.Vec3d(*at))
    made.AddRotateXYZOp().Set(Gf.Vec3f(*turn))
    made.AddScaleOp().Set(Gf.Vec3f(*scale))
    return made.GetPrim()


def cube(stage: Usd.Stage, path: str, size: float = 2.0) -> Usd.Prim:
    made = UsdGeom.Cube.Define(stage, path)
    made.GetSizeAttr().Set(size)
    return made.GetPrim()


def kitchen(folder: Path, *, up: str = "Y", metres: float = 0.01, ending: str = "usda") -> Path:
    """A room in centimetres: a table of parts, a wrapped mesh, a nested cup, hidden things."""
    path = folder / f"kitchen.{ending}"
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    root = xform(stage, "/World", at=(100, 0, 0))
    stage.SetDefaultPrim(root)
    cube(stage, "/World/Wall_a", 250)
    table = xform(stage, "/World/Group/Table", at=(200, 50, 0), turn=(0, 30, 0), scale=(1, 2, 1))
    Usd.ModelAPI(table).SetKind(Kind.Tokens.component)
    cube(stage, "/World/Group/Table/parts/top", 80)
    xform(stage, "/World/Group/Table/parts/leg", at=(10, -40, 0))
    UsdGeom.Cylinder.Define(stage, "/World/Group/Table/parts/leg/shape").GetAxisAttr().Set("X")
    xform(stage, "/World/Group/Table/parts/more", at=(0, 90, 0), turn=(20, 0, 0))
    xform(stage, "/World/Bed", at=(-50, 20, 30), turn=(10, 20, 30), scale=(-1, 1, 3))
    mesh = UsdGeom.Mesh.Define(stage, "/World/Bed/Bed_mesh")
    mesh.GetPointsAttr().Set([(x, 5 * y, y) for x, y in L_SHAPE])
    mesh.GetFaceVertexCountsAttr().Set([6])
    mesh.GetFaceVertexIndicesAttr().Set([*range(6)])
    mesh.AddTranslateOp().Set(Gf.Vec3d(0, 0, 7))
    cube(stage, "/World/Shelf", 30)
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/Shelf")).AddTranslateOp().Set(Gf.Vec3d(0, 9, 0))
    cone = UsdGeom.Cone.Define(stage, "/World/Shelf/Cup")
    cone.AddTranslateOp().Set(Gf.Vec3d(0, 21, 0))
    cone.GetHeightAttr().Set(12)
    cone.GetAxisAttr().Set("Y")
    hidden = cube(stage, "/World/Hidden")
    UsdGeom.Imageable(hidden).MakeInvisible()
    UsdGeom.Imageable(cube(stage, "/World/Guide")).GetPurposeAttr().Set(UsdGeom.Tokens.guide)
    UsdGeom.Imageable(cube(stage, "/World/Simple")).GetPurposeAttr().Set(UsdGeom.Tokens.proxy)
    UsdGeom.BasisCurves.Define(stage, "/World/Rope")
    UsdGeom.PointInstancer.Define(stage, "/World/Trees")
    cube(stage, "/World/Trees/Tree")
    stage.GetRootLayer().Save()
    return path


PRIMS = {
    "Wall_a": "/World/Wall_a",
    "Table": "/World/Group/Table",
    "Bed": "/World/Bed",
    "Shelf": "/World/Shelf",
    "Cup": "/World/Shelf/Cup",
}


def turned(point: Any, up: str, metres: float) -> np.ndarray:
    x, y, z = point
    return metres * np.array([x, -z, y] if up == "Y" else [x, y, z])


def check(world: World, path: Path, up: str, metres: float) -> None:
    """Origins and boxes are those of pxr."""
    stage = Usd.Stage.Open(str(path))
    time = Usd.TimeCode.Default()
    for name, prim in PRIMS.items():
        at = stage.GetPrimAtPath(prim)
        matrix = UsdGeom.Xformable(at).ComputeLocalToWorldTransform(time)
        origin = turned(matrix.ExtractTranslation(), up, metres)
        np.testing.assert_allclose(pose(world, name).translation, origin, atol=1e-6)
        if name in ("Shelf", "Table"):
            continue  # a box of pxr has all that is below; rotated boxes are not tight
        bound = UsdGeom.Imageable(at).ComputeWorldBound(time, UsdGeom.Tokens.default_)
        corners = [bound.GetMatrix().Transform(bound.GetRange().GetCorner(k)) for k in range(8)]
        found = np.array([turned(c, up, metres) for c in corners])
        if name == "Wall_a":
            expected = [found.min(axis=0), found.max(axis=0)]
            np.testing.assert_allclose(box(world, name), expected, atol=1e-6)
        low, high = box(world, name)
        assert (low >= found.min(axis=0) - 1e-6).all()
        assert (high <= found.max(axis=0) + 1e-6).all()


@pytest.mark.parametrize("ending", ["usda", "usdc", "usd"])
@pytest.mark.parametrize(("up", "metres"), [("Y", 0.01), ("Z", 1.0)])
def test_objects_stand_where_pxr_has_them(
    up: str, metres: float, ending: str, tmp_path: Path
) -> None:
    path = kitchen(tmp_path, up=up, metres=metres, ending=ending)
    world = read_usd(path)
    assert {e.name for e in world.entries} == {*PRIMS}
    assert {e.name: e.holder for e in world.entries if e.holder} == {"Cup": "Shelf"}
    check(world, path, up, metres)
    assert [entry(world, n).type for n in ("Table", "Bed", "Cup")] == ["table", "bed", "cup"]
    assert {s.element for s in world.skipped} == {"/World/Rope", "/World/Trees"}
    assert "Simple" in {e.name for e in read_usd(path, geometry="collision").entries}


def test_vertices_of_a_mirrored_and_scaled_mesh(tmp_path: Path) -> None:
    path = kitchen(tmp_path)
    world = read_usd(path)
    stage = Usd.Stage.Open(str(path))
    prim = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Bed/Bed_mesh"))
    matrix = prim.ComputeLocalToWorldTransform(Usd.TimeCode.Default())
    expected = np.array(
        [turned(matrix.Transform(Gf.Vec3d(*p)), "Y", 0.01) for p in prim.GetPointsAttr().Get()]
    )
    (shape,) = entry(world, "Bed").shapes
    found = pose(world, "Bed").apply(shape.mesh.vertices)
    assert np.abs(found[:, None] - expected).max(axis=2).min(axis=1).max() < 1e-6
    a, b, c = np.moveaxis(found[shape.mesh.faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    rings = np.roll(expected, -1, axis=0)
    assert area == pytest.approx(np.linalg.norm(np.cross(expected, rings).sum(axis=0)) / 2)


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 2), (-1, -1, -3)])
def test_a_mirrored_solid_faces_outwards(scale: tuple[int, ...], tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    xform(stage, "/World", scale=scale)
    cube(stage, "/World/Box")
    cube(stage, "/World/Other")
    stage.GetRootLayer().Save()
    (shape,) = entry(read_usd(tmp_path / "a.usda"), "Box").shapes
    a, b, c = np.moveaxis(shape.mesh.triangles, 1, 0)
    volume = np.einsum("fk,fk->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(8 * abs(np.prod(scale)))


def test_a_prim_whose_name_says_nothing_has_the_name_above_it(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    UsdGeom.SetStageUpAxis(stage, "Z")
    stage.SetDefaultPrim(xform(stage, "/World"))
    cube(stage, "/World/mesh")  # the root of a stage is no object
    xform(stage, "/World/Table_01", at=(5, 0, 0))
    xform(stage, "/World/Table_01/geom", at=(0, 0, 1))
    cube(stage, "/World/Table_01/geom/Mesh_001")
    xform(stage, "/World/Table_01/Mug", at=(0, 0, 2))
    cube(stage, "/World/Table_01/Mug/g", 0.1)
    xform(stage, "/World/Walls", at=(0, 9, 0))
    cube(stage, "/World/Walls/mesh_0")
    cube(stage, "/World/Walls/mesh_1", 3)
    stage.GetRootLayer().Save()
    world = read_usd(tmp_path / "a.usda")
    assert {(e.name, e.type, e.holder) for e in world.entries} == {
        ("mesh", None, None),
        ("Table_01", "table", None),
        ("Mug", "mug", "Table_01"),
        ("Walls", "wall", None),
        ("Walls_2", "wall", None),
    }
    np.testing.assert_allclose(pose(world, "Table_01").translation, (5, 0, 0))
    np.testing.assert_allclose(box(world, "Table_01"), [(4, -1, 0), (6, 1, 2)])


@pytest.mark.parametrize(
    ("group", "prim", "name", "type_"),
    [
        ("Kitchen", "Table_1", "Table_1", "table"),
        ("Mirror", "Chair_1", "Chair_1", "chair"),
        ("Kitchen", "Cube", "Kitchen", None),
        ("Bed", "Bed_mesh", "Bed", "bed"),
        ("OfficeChair_2", "Chair", "OfficeChair_2", "office_chair"),
        ("Chair_2", "office_chair_data", "Chair_2", "chair"),
        *(("Sofa_3", each, "Sofa_3", "sofa") for each in ("mesh", "geom", "Mesh_01", "node_0")),
    ],
)
def test_the_only_prim_of_a_group_keeps_a_name_that_means_another_type(
    group: str, prim: str, name: str, type_: str | None, tmp_path: Path
) -> None:
    """It stands where pxr has it; with its name, its frame is its own."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    UsdGeom.SetStageUpAxis(stage, "Z")
    stage.SetDefaultPrim(xform(stage, "/World"))
    xform(stage, f"/World/{group}", at=(5, 0, 0), turn=(0, 0, 40))
    shown = UsdGeom.Xformable(cube(stage, f"/World/{group}/{prim}", 1))
    shown.AddTranslateOp().Set(Gf.Vec3d(0, 2, 0.5))
    stage.GetRootLayer().Save()
    world = read_usd(tmp_path / "a.usda")
    assert [(e.name, e.type) for e in world.entries] == [(name, type_)]
    framed = stage.GetPrimAtPath(f"/World/{group}/{prim}" if name == prim else f"/World/{group}")
    time = Usd.TimeCode.Default()
    matrix = UsdGeom.Xformable(framed).ComputeLocalToWorldTransform(time)
    np.testing.assert_allclose(pose(world, name).translation, matrix.ExtractTranslation())
    bound = UsdGeom.Imageable(shown).ComputeWorldBound(time, UsdGeom.Tokens.default_)
    corners = bound.ComputeAlignedRange()
    np.testing.assert_allclose(box(world, name), [corners.GetMin(), corners.GetMax()], atol=1e-6)


def test_references_and_instances_are_followed(tmp_path: Path) -> None:
    chair = Usd.Stage.CreateNew(str(tmp_path / "chair.usda"))
    UsdGeom.SetStageMetersPerUnit(chair, 1.0)
    chair.SetDefaultPrim(xform(chair, "/Chair"))
    Usd.ModelAPI(chair.GetDefaultPrim()).SetKind(Kind.Tokens.component)
    cube(chair, "/Chair/seat", 0.5)
    cube(chair, "/Chair/back", 0.4)
    chair.GetRootLayer().Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "hall.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    for k in range(3):
        prim = xform(stage, f"/Hall/Chair_{k}", at=(k, 0, 0))
        prim.GetReferences().AddReference("./chair.usda")
        prim.SetInstanceable(k > 0)
    xform(stage, "/Hall/Sofa", at=(4, 5, 6)).GetReferences().AddReference("./none.usda")
    lamp = xform(stage, "/Hall/Lamp", at=(7, 8, 9), turn=(0, 0, 90))
    lamp.GetPayloads().AddPayload("./none.usda")
    lamp.SetTypeName("")  # as of a reference that has the type
    hidden = xform(stage, "/Hall/Hidden")
    hidden.GetReferences().AddReference("./none.usda")
    UsdGeom.Imageable(hidden).MakeInvisible()
    stage.GetRootLayer().Save()
    world = read_usd(tmp_path / "hall.usda")
    chairs = {"Chair_0", "Chair_1", "Chair_2"}
    assert {e.name for e in world.entries} == {*chairs, "Sofa", "Lamp"}
    assert {e.name for e in world.entries if e.shapes} == chairs
    assert entry(world, "Sofa").type == "sofa"
    np.testing.assert_allclose(pose(world, "Sofa").translation, (4, 5, 6))
    np.testing.assert_allclose(pose(world, "Lamp").translation, (7, 8, 9))
    np.testing.assert_allclose(pose(world, "Lamp").yaw, np.pi / 2)
    for k in range(3):
        np.testing.assert_allclose(box(world, f"Chair_{k}")[0], (k - 0.25, -0.25, -0.25))
    assert world.skipped
    assert all("none.usda" in skipped.problem for skipped in world.skipped)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.floats(0.2, 3), st.floats(0.1, 1)), min_size=3, max_size=9))
def test_star_shaped_faces_keep_their_area(spokes: list[tuple[float, float]]) -> None:
    angles = np.cumsum([share for _, share in spokes])
    angles *= 2 * np.pi / angles[-1]
    radii = np.array([radius for radius, _ in spokes])
    flat = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    if max(np.diff(angles, append=angles[0] + 2 * np.pi)) > np.pi - 0.1:
        return
    tilted = np.column_stack([flat, flat @ (0.3, -0.2)])
    made = polygon_mesh(tilted, [len(flat)], range(len(flat)), "star")
    corners = made.vertices[made.faces][:, :, :2]
    star = shapely.Polygon(flat)
    assert shapely.area(shapely.polygons(corners)).sum() == pytest.approx(star.area)
    facing = np.linalg.det(corners[:, 1:] - corners[:, :1])
    assert (facing > -1e-9).all(), "as the polygon, against the clock"
    turned = polygon_mesh(tilted, [len(flat)], range(len(flat)), "star", left_handed=True)
    assert (turned.faces == made.faces[:, ::-1]).all()
    covered = shapely.union_all(shapely.polygons(corners), grid_size=1e-9)
    assert covered.symmetric_difference(star).area == pytest.approx(0, abs=1e-6)


def test_a_stage_is_imported_with_its_holders(tmp_path: Path, database: str) -> None:
    with semmap.connect(database) as db:
        summary = db.import_file(kitchen(tmp_path), map="kitchen")
        assert summary.kinds["object"] == len(PRIMS)
        assert db.map("kitchen")["Cup"].holder == db.map("kitchen")["Shelf"]


def test_a_stage_without_a_unit_says_so(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    cube(stage, "/Box", 50)
    stage.GetRootLayer().Save()
    world = read_usd(tmp_path / "a.usda")
    assert np.ptp(box(world, "Box"), axis=0) == pytest.approx(0.5)
    (note,) = world.notes
    assert "states no metersPerUnit" in note


def damaged(path: Path, how: str) -> None:
    data = path.read_bytes()
    layer = Sdf.Layer.FindOrOpen(str(path))
    if how == "empty":
        path.write_bytes(b"")
    elif how == "truncated":
        path.write_bytes(data[: len(data) // 2])
    elif how == "text":
        path.write_bytes(b"no stage")
    elif how == "unit":
        stage = Usd.Stage.Open(layer)
        UsdGeom.SetStageMetersPerUnit(stage, 0)
        layer.Export(str(path))
    else:
        stage = Usd.Stage.CreateNew(str(path.with_name("new.usda")))
        xform(stage, "/Empty")
        stage.GetRootLayer().Export(str(path))


@pytest.mark.parametrize("ending", ["usda", "usdc"])
@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("empty", "is not a stage of USD"),
        ("truncated", "is not a stage of USD"),
        ("text", "is not a stage of USD"),
        ("unit", "metersPerUnit: is 0"),
        ("nothing", "no node has a surface"),
    ],
)
def test_bad_files_are_refused_by_name(how: str, message: str, ending: str, tmp_path: Path) -> None:
    path = kitchen(tmp_path, ending=ending)
    damaged(path, how)
    moved = path.rename(tmp_path / f"damaged.{ending}")  # pxr keeps layers by their names
    with pytest.raises(WorldError, match=message) as refused:
        read_world(moved)
    assert str(moved) in str(refused.value)


def test_faces_without_their_points_are_left_out(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    cube(stage, "/Box")
    for name, points, counts, corners in (
        ("Beyond", [(0, 0, 0)] * 3, [3], [0, 1, 9]),
        ("Fewer", [(0, 0, 0)] * 3, [4], [0, 1, 2]),
        ("Negative", [(0, 0, 0)] * 3, [-3, 6], [0, 1, 2]),
        ("Bare", [], [], []),
        ("Infinite", [(0, 0, 0), (1, 0, 0), (0, float("inf"), 0)], [3], [0, 1, 2]),
        ("Far", [(0, 0, 0), (1, 0, 0), (0, 1e7, 0)], [3], [0, 1, 2]),
    ):
        mesh = UsdGeom.Mesh.Define(stage, f"/{name}")
        mesh.GetPointsAttr().Set(points)
        mesh.GetFaceVertexCountsAttr().Set(counts)
        mesh.GetFaceVertexIndicesAttr().Set(corners)
    stage.GetRootLayer().Save()
    world = read_usd(tmp_path / "a.usda")
    assert [e.name for e in world.entries] == ["Box"]
    assert {s.element.strip("/") for s in world.skipped} == {
        *("Beyond", "Fewer", "Negative", "Bare", "Infinite", "Far")
    }


def test_a_stage_that_takes_too_long_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "slow.usda"
    Usd.Stage.CreateNew(str(path)).Save()
    monkeypatch.setenv("SEMMAP_MAX_READER_SECONDS", "0.01")
    with pytest.raises(WorldError, match=r"slow\.usda: file: .* more than 0\.01 s .*export it"):
        read_usd(path)
