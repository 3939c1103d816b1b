from planner.tasks import State, Thing, World, plan_task
from semmap.geometry.pose import Pose
from tests.planner.office import office

FIGURE_4 = """\
pass_door(door1, lab1, corridor1)
pass_door(door2, corridor1, foyer-1st)
call_elevator
pass_door(edoor1, foyer-1st, elevator-1st)
use_elevator(floor-1st, floor-3rd)
pass_door(edoor3, elevator-3rd, foyer-3rd)
pass_door(door5, foyer-3rd, corridor3)
pass_door(door6, corridor3, office4)
pickup(muffin, desk4)
pass_door(door7, office4, corridor3)
pass_door(door8, corridor3, lab2)
place(muffin, desk1)"""


def office_world() -> World:
    return World(
        [
            Thing("desk4", ("desk", "table", "furniture"), holder="office4", place="office4",
                  pose=Pose(6.8, 9, 6.4 + 0.37), height=0.37, fixed=True),
            Thing("desk1", ("desk", "table", "furniture"), holder="lab2", place="lab2",
                  pose=Pose(2, 1, 6.4 + 0.37), height=0.37, fixed=True),
            Thing("muffin1", ("muffin", "food"), holder="desk4", place="office4",
                  pose=Pose(6.8, 9, 6.4 + 0.8), size=(0.1, 0.1, 0.1)),
        ]
    )  # fmt: skip


def test_figure_4():
    plan = plan_task(office().network(), office_world(), State("lab1"), "on(muffin, desk1)")
    assert "\n".join(map(str, plan.actions)) == FIGURE_4
    assert plan.optimal
