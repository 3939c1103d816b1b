"""Missions in a simulated office: what is done, what fails, and what the map says of it."""

from __future__ import annotations

from tests.planner.mission.conftest import World


def test_the_muffin_of_figure_4_is_brought_to_desk1(world: World) -> None:
    assert world.run().state == "done"
    assert world.holder("muffin1") == ("desk1", "on")
    world.check()
    with world.journal() as journal:
        (mission,) = journal.missions()
        steps = journal.steps(mission["id"])
    assert {s["state"] for s in steps} == {"done"}
    shown = ("navigate", "switch_map", "open_door")
    assert [(s["action"], *s["arguments"][:1]) for s in steps if s["action"] not in shown] == [
        ("pass_door", "door1"), ("pass_door", "door2"), ("call_elevator", "elevator"),
        ("pass_door", "edoor1"), ("use_elevator", "elevator"), ("pass_door", "edoor3"),
        ("pass_door", "door5"), ("pass_door", "door6"), ("pickup", "muffin1"),
        ("pass_door", "door7"), ("pass_door", "door8"), ("place", "muffin1"),
    ]  # fmt: skip
    assert world.ask("SELECT count(*) FROM reservation") == [(0,)]
    took = dict(world.ask("SELECT behaviour, count(*) FROM execution WHERE succeeded GROUP BY 1"))
    assert took == {"pass_door": 8, "call_elevator": 1, "use_elevator": 1, "open_door": 2}
