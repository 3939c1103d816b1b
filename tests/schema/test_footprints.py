"""Footprints of entities against the projected triangles of their meshes, by Shapely."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
import shapely
from sqlalchemy import text

import semmap
from semmap.geometry.mesh import prism_mesh
from semmap.geometry.pose import Pose
from semmap.query.map_check.reader import read_checked_entities
from tests.conftest import MakeDatabase

DESK = shapely.box(0, 0, 2, 1.6) - shapely.box(0.6, 0.6, 2, 1.6)


@pytest.fixture(scope="module")
def here(make_database: MakeDatabase) -> Iterator[semmap.Map]:
    """A room with a desk like an L."""
    url = make_database().render_as_string(hide_password=False)
    with semmap.connect(url) as database:
        place = database.create_map("office")
        place.add_room("study", [(-4, -4), (8, -4), (8, 8), (-4, 8)])
        place.add_object("desk", type="desk", mesh=prism_mesh(DESK, 0, 0.75), pose=(1, 1, 0, 0.4))
        yield place


def put(here: semmap.Map, pose: Pose) -> None:
    with here.engine.begin() as connection:
        connection.execute(
            text(
                "UPDATE placement p SET pose = coalesce(pose_compose(pose_inverse("
                "(SELECT h.pose FROM world h WHERE h.entity_id = p.holder_id)), :pose), :pose) "
                "FROM entity e WHERE e.id = p.entity_id AND e.name = 'desk'"
            ),
            {"pose": [float(value) for value in pose]},
        )


def covered(here: semmap.Map) -> shapely.Geometry:
    mesh = here["desk"].mesh
    assert mesh is not None
    flat = shapely.polygons(mesh.triangles[:, :, :2])
    return shapely.union_all(flat[shapely.area(flat) > 1e-12])


@pytest.mark.parametrize("lean", [0.0, 1e-7, 1e-4, 0.02, 0.2, 0.7, math.pi])
def test_a_footprint_is_the_ground_below_the_mesh(here: semmap.Map, lean: float) -> None:
    put(here, Pose.from_rpy(1, 1, 0, lean, 0, 0.4))
    footprint, wanted = here["desk"].footprint, covered(here)
    assert footprint is not None
    assert wanted.difference(footprint.buffer(1e-6)).area < 1e-9
    assert footprint.difference(wanted.convex_hull.buffer(1e-6)).area < 1e-9
    if lean < 0.5:
        assert footprint.difference(wanted.buffer(0.75 * math.sin(lean) + 1e-3)).area < 1e-9
    with here.snapshot() as seen:
        (desk,) = (e for e in read_checked_entities(seen) if e.name == "desk")
    assert desk.ground.symmetric_difference(footprint).area < 1e-6


def test_what_stands_in_the_corner_of_a_desk_is_not_on_it_or_in_it(here: semmap.Map) -> None:
    put(here, Pose.planar(1, 1, 0.4))
    x, y = Pose.planar(1, 1, 0.4).apply(np.array([[1.2, 1.1, 0.0]]))[0, :2]
    for name, size in (("chair", (0.45, 0.45, 0.9)), ("bin", (0.2, 0.2, 0.3))):
        thing = here.add_object(name, size=size, pose=(float(x), float(y), 0, 0.4))
        assert thing.holder == here["study"]
        for relation in ("is_on", "is_in", "is_touching", "is_above"):
            asked = f"SELECT {relation}(entity_id(%s), entity_id('desk'))"
            assert here.sql(asked, name)[0][0] is False
        assert here.sql("SELECT is_near(entity_id(%s), entity_id('desk'), 0.5)", name)[0][0]
        footprint = here["desk"].footprint
        assert footprint is not None
        assert footprint.disjoint(thing.footprint)
        thing.delete()
