"""A route without a robot is that of a body: it drives around things and ends where it fits."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from sqlalchemy import Engine

import semmap
from planner.robot_class import BODY
from planner.route import NoRouteError


def test_a_route_in_one_room_is_as_long_as_the_way_to_the_object(house: Engine) -> None:
    with semmap.connect(house.url.render_as_string(hide_password=False)) as db:
        small = db.map("house")
        (made,) = small.costmaps([BODY], resolution=0.05)
        scene = made.scene
        driven = 0
        for entity in scene.entities:
            if entity.kind != "object" or entity.bounds is None or "floor" in entity.types:
                continue
            area = next(
                (f for f in scene.floors if f.outline.contains(shapely.box(*entity.bounds))), None
            )
            if area is None or driven > 5:
                continue
            free = np.argwhere(made.master == 0)
            x = made.grid.origin[0] + (free[:, 1] + 0.5) * 0.05
            y = made.grid.origin[1] + (free[:, 0] + 0.5) * 0.05
            shape = shapely.box(*entity.bounds)
            inside = shapely.contains_xy(area.outline, x, y)
            away = np.where(inside, shapely.distance(shapely.points(x, y), shape), -1)
            start = (float(x[away.argmax()]), float(y[away.argmax()]))
            try:
                found = small.route(start, entity.name)
            except NoRouteError:
                continue
            end = found.steps[-1].leave
            driven += 1
            assert found.metres >= np.hypot(end.x - start[0], end.y - start[1]) - 1e-6
            assert found.metres >= away.max() - 0.8 - 0.05
            assert shapely.Point(end.x, end.y).distance(shape) <= 0.8 + 1e-6
        assert driven >= 5


def test_nobody_stands_inside_of_furniture(house: Engine) -> None:
    with semmap.connect(house.url.render_as_string(hide_password=False)) as db:
        small = db.map("house")
        (made,) = small.costmaps([BODY], resolution=0.05)
        bed = next(e for e in made.scene.entities if "bed" in e.types)
        x0, y0, x1, y1 = bed.bounds or (0, 0, 0, 0)
        with pytest.raises(NoRouteError, match=f"{bed.name} is in the way"):
            small.route(((x0 + x1) / 2, (y0 + y1) / 2), "kitchen")
