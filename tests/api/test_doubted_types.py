"""A goal that names a type is judged by what is believed, as one that names the object."""

from __future__ import annotations

from pathlib import Path

import pytest

import semmap


@pytest.fixture
def canteen(db: semmap.Database) -> semmap.Map:
    """Two rooms with a table each; a cup on the first, which was then seen on the other one."""
    made = db.create_map("refectory")
    made.add_storey("eg", height=3)
    for name, x in (("west", 0.0), ("east", 5.2)):
        made.add_room(name, [(x, 0), (x + 4.8, 0), (x + 4.8, 4), (x, 4)], floor=0, ceiling=2.7)
    made.add_door("gap", "west", "east", ((5.0, 1), (5.0, 2)))
    made.add_object("bench", type="table", size=(1.2, 0.8, 0.75), pose=(2.5, 3, 0))
    made.add_object("desk", type="table", size=(1.0, 0.8, 0.7), pose=(7, 2.5, 0))
    made.add_object("goblet", type="cup", size=(0.08, 0.08, 0.1), on="bench")
    doubt(made, "goblet")
    return made


def doubt(made: semmap.Map, name: str) -> None:
    made.observe_point(name, (7.2, 2.4, 0.75), hit=0.9, false_alarm=0.02)
    made.observe(name, "bench", seen=False)
    assert made[name].holder == made["bench"]
    assert made.where(name)["desk"] > made.where(name)["bench"]


@pytest.mark.parametrize("goal", ["on(cup, bench)", "carries(robot, cup)", "on(cup, desk)"])
def test_a_doubtful_one_is_searched_for(canteen: semmap.Map, goal: str) -> None:
    named = canteen.plan(goal.replace("cup", "goblet"), start="west")
    plan = canteen.plan(goal, start="west")
    assert [action.name for action in plan.actions] == [action.name for action in named.actions]
    assert plan.seconds == pytest.approx(named.seconds, rel=0.05)
    assert plan.actions[0].name == "search"


def test_a_mission_does_not_end_before_it_has_looked(canteen: semmap.Map, tmp_path: Path) -> None:
    world = tmp_path / "world.sqlite"
    ended = canteen.run("on(cup, bench)", start="west", speed=1e5, try_grasps=False, world=world)
    assert ended.done
    assert any("look" in str(step) for step in ended.steps)


def test_of_a_known_and_a_doubtful_one_the_known_one_is_taken(canteen: semmap.Map) -> None:
    canteen.add_object("beaker", type="cup", size=(0.08, 0.08, 0.1), on="desk")
    plan = canteen.plan("on(cup, bench)", start="west")
    taken = [action.names[0] for action in plan.actions if action.name == "pickup"]
    assert taken == ["beaker"]
    assert any("goblet" in reason for reason in plan.reasons)
    assert canteen.plan("on(cup, desk)", start="west").actions == ()
