"""An entity's names, holders, shapes and history; judged by Shapely and trimesh."""

from __future__ import annotations

import math
import random
from datetime import UTC, datetime, timedelta
from itertools import pairwise

import numpy as np
import pytest
import shapely
import shapely.affinity
import trimesh
from scipy.spatial.transform import Rotation

import semmap
from tests.api.round_trips import round_trips


def test_an_entity_is_renamed(flat: semmap.Map) -> None:
    mug, other = flat["mug7"], flat["mug7"]
    mug.name = "cup"
    assert (mug.name, "cup" in flat, "mug7" in flat) == ("cup", True, False)
    assert other.type == "mug"
    assert (other.name, repr(other)) == ("cup", "<object cup>"), "read with the type"
    for taken, message in (
        ("desk4", "has an entity desk4 already"),
        ("", "a name is not empty"),
        ("outside", "give another name"),
    ):
        with pytest.raises(ValueError, match=message):
            mug.name = taken
    assert mug.describe()["name"] == "cup"
    renamed = mug.describe()["since"]
    mug.move_to(1, 1, 0)
    assert mug.describe()["since"] > renamed, "what is told of it is as of its last move"


def test_an_entity_that_is_gone_says_so(flat: semmap.Map) -> None:
    mug, door = flat["mug7"], flat.doors["door1"]
    mug.delete()
    door.delete()
    for read in (lambda: mug.type, lambda: mug.geometry, lambda: door.state, lambda: door.places):
        with pytest.raises(LookupError, match=r"(mug7|door1) is no longer in the map flat"):
            read()
    assert repr(mug) == "<object mug7>"


def test_room_storey_and_relation_follow_the_holders(flat: semmap.Map) -> None:
    mug, desk, kitchen = flat["mug7"], flat["desk4"], flat["kitchen"]
    assert (mug.room, mug.storey, mug.relation) == (kitchen, flat["ground"], "on")
    assert (desk.room, desk.relation) == (kitchen, "in")
    assert (kitchen.room, kitchen.storey) == (None, flat["ground"])
    assert (flat["ground"].storey, flat["ground"].relation) == (None, None)
    desk.move_to(6, 1.5, 0)
    assert mug.room == flat["hall"]


def test_a_storey_holds_the_rooms_on_its_floor_that_were_there_before(db: semmap.Database) -> None:
    made = db.create_map("late")
    kitchen = made.add_room("kitchen", shapely.box(0, 0, 4, 3), floor=0.1, ceiling=2.7)
    attic = made.add_room("attic", shapely.box(0, 0, 4, 3), floor=3, ceiling=5)
    desk = made.add_object("desk", type="table", size=(1, 1, 0.7), in_="kitchen")
    ground = made.add_storey("ground", height=2.8)
    assert (kitchen.storey, desk.storey, desk.room) == (ground, ground, kitchen)
    assert attic.storey is None
    other = made.add_storey("cellar", elevation=-3)
    assert (kitchen.storey, other.contents) == (ground, [])
    top = made.add_storey("top", elevation=3)
    assert (attic.storey, kitchen.storey) == (top, ground)


def test_what_has_no_placement_is_not_put_anywhere(flat: semmap.Map) -> None:
    bare = flat.add_object("bare", type="mug")
    assert (bare.pose, bare.geometry, bare.footprint, bare.box, bare.size, bare.mesh) == (None,) * 6
    assert bare.history() == []
    with pytest.raises(ValueError, match="bare has no placement, so it cannot be put on desk4"):
        bare.put_on("desk4")
    with pytest.raises(ValueError, match="bare has no placement, so it cannot be put in kitchen"):
        bare.put_in("kitchen")


def test_doors_have_state_places_width_and_form(flat: semmap.Map) -> None:
    door = flat.doors["door1"]
    assert isinstance(door, semmap.Door)
    assert (door.state, door.form, door.width) == ("open", "door", 1)
    assert door.places == (flat["kitchen"], flat["hall"])
    door.state = "locked"
    assert flat.execute("SELECT state FROM gis_connector WHERE name = 'door1'") == [("locked",)]
    with pytest.raises(ValueError, match='door1: state "ajar" is not one of open, closed, locked'):
        door.state = "ajar"
    out = flat.add_door("out", "hall", None, ((8.05, 1), (8.05, 1.8)))
    assert out.places == (flat["hall"], None)
    assert door.geometry.equals_exact(shapely.LineString([(4.05, 1), (4.05, 2)]), 1e-9) or (
        door.geometry.equals_exact(shapely.LineString([(4.05, 2), (4.05, 1)]), 1e-9)
    )


def test_shapes_are_those_of_shapely_and_trimesh(flat: semmap.Map) -> None:
    rng = random.Random(7)
    solid = trimesh.creation.annulus(0.1, 0.3, 0.4)
    solid.apply_translation((0.05, 0.1, 0.3))
    thing = flat.add_object("ring", mesh=solid, pose=(6, 1, 0))
    for _ in range(5):
        x, y, z, yaw = rng.uniform(5, 7), rng.uniform(1, 2), rng.uniform(0, 1), rng.uniform(-3, 3)
        thing.move_to(x, y, z, yaw)
        turn = trimesh.transformations.rotation_matrix(yaw, (0, 0, 1))
        turn[:3, 3] = x, y, z
        placed = solid.copy().apply_transform(turn)
        mesh = thing.mesh
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(solid.volume)
        np.testing.assert_allclose(mesh.bounds, placed.bounds, atol=1e-9)
        np.testing.assert_allclose(np.reshape(thing.box, (2, 3)), placed.bounds, atol=1e-9)
        np.testing.assert_allclose(thing.size, solid.extents, atol=1e-9)
        np.testing.assert_allclose(thing.pose.matrix, turn, atol=1e-9)
        np.testing.assert_allclose(
            thing.pose.rotation.as_matrix(), Rotation.from_euler("z", yaw).as_matrix(), atol=1e-9
        )
        hull = shapely.MultiPoint(placed.vertices[:, :2]).convex_hull
        assert thing.footprint.symmetric_difference(hull).area < 0.01 * hull.area or (
            thing.footprint.within(hull.buffer(1e-9))
        )
        assert thing.geometry.equals(thing.footprint)


def test_outlines_are_polygons_and_multipolygons(flat: semmap.Map) -> None:
    two = shapely.MultiPolygon([shapely.box(0, 5, 1, 6), shapely.box(2, 5, 3, 7)])
    both = flat.add_region("both", two)
    assert both.geometry.geom_type == "MultiPolygon"
    assert both.geometry.symmetric_difference(two).area == pytest.approx(0, abs=1e-9)
    kitchen = flat["kitchen"].geometry
    assert kitchen.geom_type == "Polygon"
    assert kitchen.symmetric_difference(shapely.box(0, 0, 4, 3)).area == pytest.approx(0, abs=1e-9)
    assert flat["kitchen"].mesh.volume == pytest.approx(4 * 3 * 2.7)
    assert flat["ground"].geometry.geom_type == "Point"


def test_an_entity_is_a_feature(flat: semmap.Map) -> None:
    desk = flat["desk4"]
    made = desk.__geo_interface__
    assert made["type"] == "Feature"
    assert (made["properties"]["name"], made["properties"]["type"]) == ("desk4", "table")
    assert "state" not in made["properties"]
    assert shapely.geometry.shape(made["geometry"]).equals(desk.geometry)
    assert flat["mug7"].__geo_interface__["properties"]["colour"] == "red"
    assert flat["door1"].__geo_interface__["properties"]["state"] == "open"


def test_history_has_the_poses_that_it_moved_through(flat: semmap.Map) -> None:
    """The oracle writes down pose and holder after each step, also where the desk is carried."""
    rng = random.Random(3)
    mug, desk = flat["mug7"], flat["desk4"]
    expected = [(mug.pose, mug.holder.name)]
    for step in range(12):
        if step % 3 == 2:
            desk.move_to(rng.uniform(1, 3), rng.uniform(1, 2), 0, rng.uniform(-3, 3))
        elif step % 3 == 1:
            mug.put_on("desk4")
        else:
            mug.move_to(rng.uniform(4.5, 7.5), rng.uniform(0.5, 2.5), 0.05)
        expected.append((mug.pose, mug.holder.name))
    middle = flat.execute("SELECT clock_timestamp()")[0][0]
    expected.append(expected[-1])
    history = mug.history()
    told = [(version.pose, version.holder) for version in history]
    remaining = iter(told)
    for pose, holder in expected[:-1]:
        assert any(h == holder and np.allclose(p, pose, atol=1e-9) for p, h in remaining), (
            f"{pose} in {holder} comes in this order"
        )
    assert all(a.end == b.begin for a, b in pairwise(history))
    microsecond = timedelta(microseconds=1)
    assert all(a.end - a.begin > microsecond for a in history[:-1] if a.end is not None)
    assert history[-1].end is None
    assert history[0].begin.tzinfo is not None
    assert mug.history(middle) == [history[-1]]
    assert mug.history(datetime(2000, 1, 1, tzinfo=UTC)) == history
    for version in history[1:]:
        row = flat.describe("mug7", version.begin)["then"]
        assert (row["holder"]) == version.holder
        np.testing.assert_allclose(row["pose"], version.pose, atol=1e-6)


def test_what_is_found_is_printed_without_another_statement(flat: semmap.Map) -> None:
    for number in range(50):
        flat.add_agent(f"robot{number:02}", pose=(1 + 0.01 * number, 0.6, 0))
    with round_trips(flat.connection) as found:
        entities = flat.find("agent", in_="kitchen", near="desk4", within=9)
    with round_trips(flat.connection) as printed:
        text = " ".join(f"{entity} {entity.name} {entity.kind}" for entity in entities)
    with round_trips(flat.connection) as one:
        entities[0].type  # noqa: B018
    assert (found, printed, one) == ([1], [0], [1])
    assert text.startswith("<agent robot")
    assert len(entities) == 50


def test_a_card_shows_the_entity(flat: semmap.Map) -> None:
    desk = flat["desk4"]
    desk.properties = {"note": "<b>&"}
    card = desk._repr_html_()
    assert all(text in card for text in ("desk4", "in kitchen", "ground", "mug7", "<svg"))
    assert "&lt;b&gt;&amp;" in card
    door = flat["door1"]._repr_html_()
    assert all(text in door for text in ("kitchen - hall, open", ">kitchen<", ">hall<"))
    assert "bare" in flat.add_object("bare")._repr_html_()
    assert math.isfinite(len(flat["ground"]._repr_html_()))
