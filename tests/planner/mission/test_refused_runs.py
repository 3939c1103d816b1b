"""A simulated run that is refused leaves the simulated map of the run before as it was."""

from __future__ import annotations

import pytest

import semmap
from tests.conftest import MakeDatabase

MISSIONS = (
    "SELECT m.name, s.goal, s.state FROM mission s JOIN map m ON m.id = s.map_id ORDER BY 1, 2"
)
MAPS = "SELECT name FROM map ORDER BY 1"


@pytest.mark.parametrize("world", [None, "cellar.sqlite"])
def test_a_refused_run_changes_nothing(make_database: MakeDatabase, tmp_path, world) -> None:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        cellar = db.create_map("cellar")
        cellar.add_room("west", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.7)
        cellar.add_room("east", [(4.2, 0), (8, 0), (8, 3), (4.2, 3)], floor=0, ceiling=2.7)
        cellar.add_door("gap", "west", "east", [(4.1, 1), (4.1, 2)])
        known = {"speed": 1e5, "start": "west", "world": world and tmp_path / world}
        assert cellar.run("in(robot, east)", **known).done
        before = [list(db.session.execute(sql)) for sql in (MISSIONS, MAPS)]
        assert len(before[0]) == 1
        if world is not None:  # the next run begins with a new world
            (tmp_path / world).unlink()
        for goal, wrong in (
            ("on(nothing, nowhere)", {}),
            ("in(robot, attic)", {}),
            ("in(robot, east)", {"put": ["mug on shelf"]}),
            ("in(robot, east)", {"start": "attic"}),
            ("in(robot, east)", {"robot": "no_such_class"}),
            ("in(robot", {}),
        ):
            try:
                ended = cellar.run(goal, **(known | wrong))
            except (ValueError, LookupError):
                assert [list(db.session.execute(sql)) for sql in (MISSIONS, MAPS)] == before
            else:
                pytest.fail(f"{goal} {wrong}: {ended}")
        assert cellar.run("in(robot, east)", **known).done
        assert [list(db.session.execute(sql)) for sql in (MISSIONS, MAPS)] == before
