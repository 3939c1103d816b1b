"""Plans that are tried as missions are: what a mission would refuse, the plan refuses."""

from __future__ import annotations

import pytest
import shapely

import semmap


def test_a_plan_that_fails_in_physics_is_none(database: str) -> None:
    """A mug of 4.9 kg is no more than robots lift, but it slips through the fingers."""
    with semmap.connect(database) as db:
        place = db.create_map("cantina")
        place.add_room("cella", shapely.box(0, 0, 5, 4), floor=0, ceiling=2.7)
        place.add_room("aula", shapely.box(5.2, 0, 9, 4), floor=0, ceiling=2.7)
        place.add_door("porta", "cella", "aula", ((5.1, 1), (5.1, 2)))
        place.add_object("mensa", type="table", size=(1.2, 0.8, 0.7), pose=(1.5, 2, 0))
        place.add_object("banco", type="table", size=(1.2, 0.8, 0.7), pose=(3.5, 2, 0))
        for name, mass in (("light", 0.2), ("heavy", 4.9)):
            size, pose = (0.07, 0.07, 0.1), (1.5, 1.9 + 0.3 * (name == "heavy"), 0.7)
            place.add_object(name, type="mug", size=size, pose=pose, properties={"mass": mass})
        for name in ("light", "heavy"):
            plan = place.plan(f"on({name}, banco)", start="cella")
            assert [action.name for action in plan.actions] == ["pickup", "place"]
        tried = place.plan("on(light, banco)", start="cella", try_grasps=True)
        assert [action.name for action in tried.actions] == ["pickup", "place"]
        with pytest.raises(ValueError, match=r"holds in simulation: .*heavy"):
            place.plan("on(heavy, banco)", start="cella", try_grasps=True)
        assert place.missions() == []
        assert [name for (name,) in db.sql("SELECT name FROM semmap.map")] == ["cantina"]
        ended = place.run("on(heavy, banco)", start="cella", speed=1e5)
        assert not ended.done  # as the plan says
        for name in ("light", "heavy"):
            holder = place[name].holder
            assert holder is not None
            assert holder.name == "mensa"
