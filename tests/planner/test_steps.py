"""A step of exactly the highest one is driven over, wherever the floor is; a higher one is not."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
import shapely

import semmap
from navgrid.terrain import DriveLimits, drivable
from planner.robot_class import BODY, RobotClass
from planner.topology import PlaceConnector
from semmap.geometry.pose import Pose

CART = RobotClass("cart", (replace(BODY, interval=(0.0, 1.2)),), DriveLimits(max_step=0.02))
FLOORS = (0.0, 0.1 + 0.2, 2.7, 7.1, -3.3)
STEPS = [(0.02, True), (0.0205, True), (0.0199, True), (0.022, False), (0.05, False)]


@pytest.mark.parametrize("floor", FLOORS)
@pytest.mark.parametrize(("step", "passes"), STEPS)
def test_thresholds_and_slabs(floor: float, step: float, passes: bool) -> None:
    height = (floor + step) - floor  # with the last digits of a sum
    door = PlaceConnector("d", ("a", "b"), (Pose(-1.0, 0.0), Pose(1.0, 0.0)), step=height)
    assert (CART.blocking_reason(door) is None) == passes
    square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    slab = square.reshape(2, 3, 3) + np.array((0, 0, floor + step))
    assert drivable(slab, [floor], CART.drive_limits).all() == passes
    assert drivable(slab - np.array((0, 0, 2 * step)), [floor], CART.drive_limits).all() == passes


def is_blocked(here: semmap.Map) -> bool:
    """Whether SQL shuts the only door of a map for the cart."""
    ((blocked,),) = here.execute(
        "SELECT is_blocked_for(r, c, 1) FROM connector c JOIN entity e ON e.id = c.entity_id, "
        "jsonb_populate_record(NULL::robot_class, %s) r WHERE e.map_id = current_map()",
        '{"width": 0.6, "max_step": 0.02}',
    )
    return bool(blocked)


def test_a_sill_in_a_doorway_and_the_threshold_of_a_door(database: str) -> None:
    with semmap.connect(database) as db:
        for number, (step, passes) in enumerate(STEPS):
            floor = FLOORS[number]
            here = db.create_map(f"lodge{number}")
            for name, x in (("porch", 0.0), ("lobby", 4.2)):
                here.add_room(name, shapely.box(x, 0, x + 4, 4), floor=floor, ceiling=floor + 2.6)
            here.add_door("gate", "porch", "lobby", ((4.1, 1.2), (4.1, 2.8)), height=floor)
            here.add_object("sill", size=(0.2, 4.0, step), pose=(4.1, 2, floor))
            try:
                here.route("porch", "lobby", robot=CART)
            except ValueError:
                assert not passes
            else:
                assert passes
            here["sill"].delete()
            here.execute("UPDATE connector SET step = %s", (floor + step) - floor)
            assert is_blocked(here) != passes


def test_floors_of_two_heights_at_a_door_are_a_step(database: str) -> None:
    """Without meshes; SQL, routes and the check agree, and stairs have no such step."""
    with semmap.connect(database) as db:
        for number, (step, passes) in enumerate(STEPS):
            here = db.create_map(f"split{number}")
            for name, x, floor in (("low", 0.0, 1.5), ("high", 4.2, 1.5 + step)):
                here.add_room(name, shapely.box(x, 0, x + 4, 4), floor=floor, ceiling=4.5)
            here.add_door("gate", "low", "high", ((4.1, 1.2), (4.1, 2.8)), height=1.5)
            assert is_blocked(here) != passes
            assert ("step in a door" in {each.kind for each in here.check()}) != passes
            with (
                nullcontext()
                if passes
                else pytest.raises(ValueError, match=f"a step of {step:.2f}")
            ):
                here.route("low", "high", robot=CART)
            climber = replace(CART, drive_limits=DriveLimits(max_step=0.1))
            assert here.route("low", "high", robot=climber).metres > 1


@pytest.mark.parametrize("form", ["stairs", "ramp"])
@pytest.mark.parametrize(("height", "clearance"), [(0.3, 0.9), (0.9, 1.4)])
def test_the_slab_at_a_landing_is_no_obstacle(
    database: str, form: str, height: float, clearance: float
) -> None:
    """Of a split level: the upper room has no occupied cell, up to the edge of its slab."""
    with semmap.connect(database) as db:
        here = db.create_map(f"landing {form} {height}")
        here.add_storey("ground", elevation=0, height=4)
        upper = shapely.box(5.1, 0, 10, 4)
        here.add_room("low", shapely.box(0, 0, 5, 4), floor=0, ceiling=3)
        here.add_room("high", upper, floor=height, ceiling=3.9)
        here.add_object("deck", size=(5, 4, 0.2), pose=(7.6, 2, height - 0.2), type="floor")
        line = ((4.55, 1.4), (4.55, 2.6))
        here.add_door("way", "low", "high", line, form=form, clearance=clearance)  # type: ignore[arg-type]
        made = here.grid("ground")
        rows, columns = np.nonzero(made.cells == 100)
        x, y = (
            made.grid.origin[k] + (cells + 0.5) * made.grid.resolution
            for k, cells in ((0, columns), (1, rows))
        )
        assert not shapely.contains_xy(upper.buffer(-0.1), x, y).any()
        assert here.route("low", (9, 3.5, height)).metres > 4
