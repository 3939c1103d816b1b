"""Entities of real worlds: shapes, distances and exports, against trimesh and Shapely."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import geopandas
import numpy as np
import pytest
import shapely
import trimesh
from sqlalchemy import Engine

import semmap
from tests.api.round_trips import round_trips


@pytest.fixture(params=["house", "hotel", "clinic"])
def world(request: pytest.FixtureRequest) -> Iterator[semmap.Map]:
    engine: Engine = request.getfixturevalue(request.param)
    url = engine.url.render_as_string(hide_password=False)
    with semmap.connect(url) as db:
        yield db.map(request.param)


def test_all_entities_are_found_and_printed_in_one_round_trip(world: semmap.Map) -> None:
    assert world.connection.info.dbname
    with round_trips(world.connection) as counted:
        shown = [f"{entity} {entity.name} {entity.kind}" for entity in world.find("object")]
    assert counted == [1]
    assert len(shown) == len(world.find("object")) > 80


def test_meshes_boxes_and_footprints_agree(world: semmap.Map) -> None:
    """Box and footprint come from hulls and outlines, the mesh from the triangles."""
    checked = 0
    for entity in [*world.find("object", limit=60), *world.rooms]:
        mesh, box = entity.mesh, entity.box
        if mesh is None:
            continue
        checked += 1
        np.testing.assert_allclose(np.reshape(box, (2, 3)), mesh.bounds, atol=1e-5)
        local = mesh.copy().apply_transform(np.linalg.inv(entity.pose.matrix))
        np.testing.assert_allclose(entity.size, local.extents, atol=1e-5)
        hull = shapely.MultiPoint(mesh.vertices[:, :2]).convex_hull.buffer(2e-3)
        assert hull.covers(entity.footprint)
        assert entity.geometry.equals(entity.footprint)
    assert checked >= 4


def test_near_is_the_distance_to_the_triangles(world: semmap.Map) -> None:
    rng = np.random.default_rng(4)
    shaped = [*world.find("object", limit=40), *world.rooms]
    objects = [entity for entity in shaped if entity.mesh is not None]
    for target in rng.choice(len(objects), 4, replace=False):
        low, high = np.reshape(objects[target].box, (2, 3))
        point = rng.uniform(low - 0.5, high + 0.5)
        rows = world.table(near=point)
        told = {row["name"]: float(row["distance"]) for row in rows if row["distance"] is not None}
        for entity in objects:
            mesh = entity.mesh
            (expected,) = trimesh.proximity.closest_point(mesh, [point])[1]
            if entity.kind == "room":
                level = mesh.bounds[0, 2] <= point[2] <= mesh.bounds[1, 2]
                expected *= not (level and entity.footprint.covers(shapely.Point(point[:2])))
            elif mesh.is_watertight and mesh.contains([point])[0]:
                expected = 0
            # a mesh of closed parts has an inside as well, which trimesh's contains does not see
            inside = told[entity.name] == 0 and expected > 0 and not mesh.is_watertight
            assert inside or told[entity.name] == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("ending", [".gpkg", ".geojson"])
def test_an_export_is_read_back(world: semmap.Map, tmp_path: Path, ending: str) -> None:
    path = world.export(tmp_path / f"{world.name}{ending}")
    again = world.database.create_map(f"{world.name}_again")
    try:
        summary = again.import_file(path)
        left_out = {skipped.element for skipped in summary.skipped}
        assert len(left_out) == len(summary.skipped) <= 0.02 * len(world)
        for word in ("storeys", "rooms", "doors", "regions", "objects"):
            here = {entity.name for entity in getattr(world, word)}
            there = {entity.name for entity in getattr(again, word)}
            assert there <= here
            assert len(here - there) <= len(left_out)
        for kind in ("room", "connector", "object"):
            compare(world, again, kind)
        for door in again.doors:
            old = world.doors[door.name]
            assert isinstance(door, semmap.Door)
            assert isinstance(old, semmap.Door)
            assert (door.state, door.form, door.width) == (old.state, old.form, old.width)
            assert [p and p.name for p in door.places] == [p and p.name for p in old.places]
    finally:
        world.database.drop_map(again.name)


def compare(world: semmap.Map, again: semmap.Map, kind: str) -> None:
    """Outlines, heights, types and labels are as they were."""
    features = {f["properties"]["name"]: f for f in world.__geo_interface__["features"]}
    for feature in again.__geo_interface__["features"]:
        given = feature["properties"]
        if given["kind"] != kind:
            continue
        before = features[given["name"]]
        for key in ("type", "label", "storey"):
            assert given[key] == before["properties"][key] or (
                kind == "connector" and before["properties"][key] is None
            )
        for key in ("low", "high"):
            assert given[key] == pytest.approx(before["properties"][key], abs=1e-4) or (
                kind == "connector"
            )
        if before["geometry"] is not None:
            one = shapely.geometry.shape(before["geometry"])
            other = shapely.geometry.shape(feature["geometry"])
            assert one.hausdorff_distance(other) < 2e-3


def test_a_map_is_a_feature_collection(world: semmap.Map) -> None:
    made = world.__geo_interface__
    assert made["type"] == "FeatureCollection"
    assert len(made["features"]) == len(world)
    areas = {
        f["properties"]["name"]: shapely.geometry.shape(f["geometry"]).area
        for f in made["features"]
        if f["properties"]["kind"] == "room" and f["geometry"] is not None
    }
    for room in world.rooms:
        if room.footprint is not None:
            assert areas[room.name] == pytest.approx(room.footprint.area)


def test_geopandas_takes_a_map(world: semmap.Map) -> None:
    frame = world.to_geodataframe("room")
    assert sorted(frame["name"]) == [room.name for room in world.rooms]
    assert frame.crs is None
    whole = geopandas.GeoDataFrame.from_features(world)
    assert len(whole) == len(world) == len(world.to_geodataframe())


def test_a_notebook_shows_the_lowest_storey(world: semmap.Map) -> None:
    """The SVG has a path for each room of it, whose corners lie where the room is."""
    svg = ElementTree.fromstring(world._repr_svg_())
    x, y, width, height = map(float, svg.attrib["viewBox"].split())
    lowest = min(world.storeys, key=lambda s: s.pose.z) if len(world.storeys) else None
    titles = {
        title.text: path.attrib["d"]
        for path in svg.iter("{http://www.w3.org/2000/svg}path")
        if (title := path.find("{http://www.w3.org/2000/svg}title")) is not None
    }
    rooms = [r for r in world.rooms if r.storey in (lowest, None) and r.footprint is not None]
    assert rooms
    for room in rooms:
        data = titles[f"{room.type or 'room'} {room.name}"]
        corners = [
            tuple(map(float, pair.split(",")))
            for pair in data.replace("M", "L").replace("Z", "").split("L")
            if pair
        ]
        x0, y0, x1, y1 = room.footprint.bounds
        drawn = shapely.MultiPoint(corners).bounds
        np.testing.assert_allclose(drawn, (x0, -y1, x1, -y0), atol=0.06)
        assert x <= drawn[0] <= drawn[2] <= x + width
        assert y <= drawn[1] <= drawn[3] <= y + height
    html = world._repr_html_()
    assert f"{len(world.rooms)} room" in html
