"""Regions by methods of a map, also of the small house; Shapely and trimesh judge them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import datetime
from typing import Any

import numpy as np
import pytest
import shapely
from sqlalchemy import Engine

import semmap
from semmap.manipulation.store.model_shapes import model_mesh
from tests.conftest import MakeDatabase
from tests.seen import seen_by
from tests.worlds.conftest import house as real_house

__all__ = ["real_house"]

ROOM, TABLE = shapely.box(0, 0, 5, 4), shapely.box(1, 1.6, 2, 2.4)


@pytest.fixture(scope="module")
def flat(make_database: MakeDatabase) -> Iterator[semmap.Map]:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        flat = db.create_map("flat")
        flat.add_room("kitchen", ROOM, ceiling=2.5)
        flat.add_object("table", type="table", size=(1, 0.8, 0.8), pose=(1.5, 2, 0))
        flat.add_object("note", type="notepad")
        yield flat


def test_surfaces_floors_and_rings_have_the_areas_of_shapely(flat: semmap.Map) -> None:
    (top,) = flat.find_regions("surfaces", "table")
    assert (top["area"], top["low"], top["of"]) == (0.8, 0.8, "table")
    (floor,) = flat.find_regions("floor", type="room")
    assert floor["area"] == pytest.approx(ROOM.difference(TABLE).area, abs=0.01)
    (ring,) = flat.find_regions("observation", ["table"], near=0.3, far=1.0)
    expected = TABLE.buffer(1.0).difference(TABLE.buffer(0.3)).intersection(ROOM)
    assert ring["area"] == pytest.approx(expected.area, rel=0.01)
    found = flat.find_regions("surfaces", type="notepad")
    assert not found
    wet = flat.draw_region("wet", [(0, 0), (1, 0), (1, 1)], holder="kitchen", properties={"x": 1})
    assert (wet["area"], wet["high"], wet["holder"]) == (0.5, 2.5, "kitchen")
    drawn = flat.draw_region("wet", shapely.Point(2, 2).buffer(0.5), holder="kitchen")
    assert drawn["area"] == pytest.approx(shapely.Point(2, 2).buffer(0.5).area, abs=1e-3)
    home = flat.draw_region("home", box=(1, 1, 0, 2, 2, 0.5), since=datetime(2026, 1, 1))
    assert (home["low"], home["high"]) == (0, 0.5)
    (since,) = flat.execute("SELECT lower(valid) FROM region r JOIN entity e ON e.id = r.entity_id "
                            "WHERE e.name = 'home'")  # fmt: skip
    assert since[0] == datetime(2026, 1, 1).astimezone(), "local without a time zone"
    names = [row["name"] for row in flat.list_regions()]
    assert names == ["home", "kitchen_floor", "table_observation", "table_surface_1", "wet"]


def test_surfaces_of_real_furniture_are_faces_that_look_up(real_house: Engine) -> None:
    url = real_house.url.render_as_string(hide_password=False)
    with semmap.connect(url) as db:
        house = db.map("house")
        found = house.find_regions("surfaces", ["KitchenTable_01_001", "CoffeeTable_01_001"])
        assert {row["of"] for row in found} == {"KitchenTable_01_001", "CoffeeTable_01_001"}
        for row in found:
            pose = house[row["of"]].pose
            assert pose is not None
            mesh = model_mesh(seen_by(house.connection), row["of"])
            mesh.apply_transform(pose.matrix)
            up = mesh.face_normals[:, 2] > math.cos(math.radians(5))
            level = up & (np.abs(mesh.triangles_center[:, 2] - row["low"]) < 0.02)
            shadow = shapely.union_all(
                [shapely.Polygon(t[:, :2]) for t in mesh.triangles[level]], grid_size=1e-4
            )
            assert row["area"] <= shadow.area * 1.02
        assert not found.problems


NAN = math.nan
BOX = (0, 0, 0, 1, 1, 1)
REFUSED: dict[str, tuple[str, tuple[Any, ...], dict[str, Any], str]] = {
    "sort": ("find_regions", ("walls", "table"), {}, "sort is .walls.: give one of surfaces"),
    "nothing": ("find_regions", ("floor",), {}, "name rooms or objects, or give their type"),
    "name": ("find_regions", ("surfaces", "tabel"), {}, "no entity tabel; did you mean table"),
    "NUL": ("find_regions", ("surfaces", "tab\0"), {}, "no entity tab"),
    "type": ("find_regions", ("surfaces",), {"type": "tabel"}, "did you mean table"),
    "headroom": ("find_regions", ("floor", "kitchen"), {"headroom": math.inf}, "json|headroom"),
    "near": ("find_regions", ("observation", "table"), {"near": NAN}, "give 0 <= near < far"),
    "unnamed": ("draw_region", ("",), {"box": BOX}, "a region needs a name"),
    "name NUL": ("draw_region", ("a\0",), {"box": BOX}, "NUL"),
    "taken": ("draw_region", ("table",), {"box": BOX}, "has another table, an object"),
    "both": ("draw_region", ("r", TABLE), {"box": BOX}, "either an outline or a box"),
    "corners": ("draw_region", ("r", [(0, 0), (1, 0)]), {}, "three corners"),
    "bow": ("draw_region", ("r", [(0, 0), (1, 1), (1, 0), (0, 1)]), {}, "crosses its own border"),
    "NaN": ("draw_region", ("r", [(0, 0), (1, 0), (1, NAN)]), {}, "three corners"),
    "text": ("draw_region", ("r", "abc"), {}, "three corners"),
    "point": ("draw_region", ("r", shapely.Point(0, 0)), {}, "a Point, not as a polygon"),
    "empty": ("draw_region", ("r", shapely.Polygon()), {}, "nothing, not as a polygon"),
    "five": ("draw_region", ("r",), {"box": BOX[:5]}, r"a box is \(x0, y0, z0"),
    "flat box": ("draw_region", ("r",), {"box": (0, 0, 0, 1, 1, 0)}, "from a lower to a higher"),
    "sofa": ("draw_region", ("r",), {"box": BOX, "type": "sofa"}, "no type of region sofa"),
    "holder": ("draw_region", ("r",), {"box": BOX, "holder": "tabel"}, "did you mean table"),
    "itself": ("draw_region", ("r",), {"box": BOX, "holder": "r"}, "is not in itself"),
    "unplaced": ("draw_region", ("r",), {"box": BOX, "holder": "note"}, "note is not placed"),
    "value": ("draw_region", ("r",), {"box": BOX, "properties": {"a": NAN}}, "that JSON has"),
    "object": ("draw_region", ("r",), {"box": BOX, "properties": {"a": object()}}, "JSON has"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_input_is_refused_in_words(flat: semmap.Map, case: str) -> None:
    method, words, options, message = REFUSED[case]
    before = flat.list_regions()
    with pytest.raises((ValueError, LookupError), match=message):
        getattr(flat, method)(*words, **options)
    assert flat.list_regions() == before
