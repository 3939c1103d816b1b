"""Routes, plans, searches and missions without a robot are those of one body, by one function."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import shapely

import semmap
from planner.robot_class import BODY
from planner.route import NoRouteError
from tests.robot.robots import real_robot

ROOMS = ("pantry", "parlour")


@pytest.fixture(params=[True, False], ids=["filled", "free"])
def cottage(db: semmap.Database, request: pytest.FixtureRequest) -> tuple[semmap.Map, bool]:
    """Two rooms and a jug in the second; a wall of another file fills the only doorway, or not."""
    made = db.create_map("cottage")
    made.add_storey("ground", height=3)
    outlines = [shapely.box(0, 0, 4, 4), shapely.box(4.2, 0, 8.2, 4)]
    for name, outline in zip(ROOMS, outlines, strict=True):
        made.add_room(name, outline, floor=0, ceiling=2.6)
    made.add_door("hatch", *ROOMS, ((4.1, 1.5), (4.1, 2.5)))
    made.add_object("bench", type="table", size=(1.2, 0.6, 0.7), pose=(7.4, 2, 0))
    made.add_object("jug", type="mug", size=(0.08, 0.08, 0.12), on="bench")
    if request.param:
        made.add_object("partition", type="wall", size=(0.2, 4.0, 2.6), pose=(4.1, 2, 0))
    return made, request.param


def test_no_answer_leads_through_a_wall(cottage: tuple[semmap.Map, bool], tmp_path: Path) -> None:
    made, filled = cottage
    goal, start = "carries(robot, jug)", "pantry"
    for ask in (lambda: made.route(start, "jug"), lambda: made.plan(goal, start=start)):
        if filled:
            with pytest.raises(ValueError, match=r"partition|hatch|doors"):
                ask()
        else:
            ask()
    world = tmp_path / "world.sqlite"
    ended = made.run(goal, start=start, speed=1e6, try_grasps=False, world=world)
    assert ended.done != filled, ended
    rooms = {look.room for look in made.search("jug", start="pantry").tour}
    assert rooms == ({"pantry"} if filled else {*ROOMS})


def test_a_route_within_a_room_begins_anywhere(cottage: tuple[semmap.Map, bool]) -> None:
    made, _ = cottage
    assert str(made.route("parlour", "jug")).startswith("<route from anywhere in parlour to ")
    assert "anywhere" not in str(made.route((5, 1, 0), "jug"))


def test_a_place_without_an_outline_is_named_as_that(cottage: tuple[semmap.Map, bool]) -> None:
    made, _ = cottage
    made.add_room("shed", shapely.box(8.4, 0, 12.4, 4), floor=0, ceiling=2.6)
    made.add_door("gate", "parlour", "shed", ((8.3, 1.5), (8.3, 2.5)))
    made.execute("DELETE FROM entity_model WHERE entity_id = entity_id('parlour')")
    made.database.add_robot("cart", real_robot("tiago"))
    with pytest.raises(NoRouteError, match="the map has no outline of parlour") as told:
        made.route("pantry", "shed", robot="cart")
    assert "finds no path" not in str(told.value)


def test_the_ways_of_a_plan_are_clear_by_half_the_width(
    cottage: tuple[semmap.Map, bool],
) -> None:
    made, filled = cottage
    made.add_object("crate", type="box", size=(1.0, 1.0, 1.0), pose=(5.4, 2, 0))
    plan = made.plan("carries(robot, jug)", start="parlour" if filled else "pantry")
    (pickup,) = [a for a in plan.actions if a.name == "pickup"]
    assert pickup.at is not None
    base = shapely.Point(pickup.at[:2])
    for name in ("bench", "crate"):
        away = made[name].footprint.distance(base)
        assert away >= BODY.inscribed_radius - 0.05


def test_answers_say_which_body_they_assume(cottage: tuple[semmap.Map, bool]) -> None:
    made, filled = cottage
    start = "parlour" if filled else "pantry"
    told: list[Any] = [
        made.route(start, "jug"),
        made.plan("carries(robot, jug)", start=start),
        made.search("jug", start=start),
    ]
    assert {answer.as_json()["assumed_body"] for answer in told} == {told[0].assumed_body}
    assert "0.6 m wide and 1.5 m high" in str(told[0].assumed_body)


@pytest.mark.parametrize("width", [0.5, 1.0])
def test_the_ways_of_a_urdf_are_those_of_its_shape(db: semmap.Database, width: float) -> None:
    """TIAGo's base is 0.54 m wide, folded; the door in a wall is narrower, or wider."""
    made = db.create_map("hall")
    made.add_storey("ground", height=3)
    for number, name in enumerate(ROOMS):
        x = 4.2 * number
        made.add_room(name, shapely.box(x, 0, x + 4, 4), floor=0, ceiling=2.6)
    low, high = 2 - width / 2, 2 + width / 2
    made.add_door("hatch", *ROOMS, ((4.1, low), (4.1, high)))
    for name, middle in (("left", low / 2), ("right", (4 + high) / 2)):
        made.add_object(name, type="wall", size=(0.2, low, 2.6), pose=(4.1, middle, 0))
    urdf = str(real_robot("tiago"))
    if width < 0.54:
        with pytest.raises(NoRouteError):
            made.route((1, 2), (7, 2), robot=urdf)
    else:
        assert made.route((1, 2), (7, 2), robot=urdf).doors
        assert made.routing_graph(urdf).robot.parts


def test_a_route_at_a_moment_with_other_regions_is_refused(db: semmap.Database) -> None:
    made = db.create_map("wing")
    made.add_storey("ground", height=3)
    for number, name in enumerate(ROOMS):
        x = 4.2 * number
        made.add_room(name, shapely.box(x, 0, x + 4, 4), floor=0, ceiling=2.6)
    made.add_door("hatch", *ROOMS, ((4.1, 1.5), (4.1, 2.5)))
    now, hour = datetime.now(UTC), timedelta(hours=1)
    wet = shapely.box(4.2, 0, 8.2, 4)
    times = {"since": now + hour, "until": now + 2 * hour}
    made.draw_region("wet", polygon=wet, type="blocked_region", **times)
    for hours in (0.5, 2.5):
        assert made.route(*ROOMS, at=now + hours * hour).doors
    for ask in (made.route, lambda *ends, at: made.routes(*ends, 2, at=at)):
        with pytest.raises(ValueError, match=r"regions of now, .* others hold \(wet\)"):
            ask(*ROOMS, at=now + 1.5 * hour)
