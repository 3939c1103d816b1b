"""Grasps of what stands inside of furniture: the hand comes in where the furniture is open."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import semmap
from planner.tasks import NoPlanError
from semmap import Map
from tests.boards import of_boards
from tests.conftest import MakeDatabase

SIDES = {"east": (1, 0), "west": (-1, 0), "north": (0, 1), "south": (0, -1)}


def locker(open_to: str | None) -> trimesh.Trimesh:
    """A box of boards, 0.5 m wide and 1.2 m high with a shelf at 0.8 m, open to one side at most.

    The shelf is at a height that no other face of the mesh has.
    """
    low, high, thick, top = -0.25, 0.25, 0.02, 1.2
    boards = [
        ((low, low, 0), (high, high, thick)),
        ((low, low, top - thick), (high, high, top)),
        ((low + thick, low + thick, 0.78), (high - thick, high - thick, 0.8)),
    ]
    walls = {
        "east": ((high - thick, low, 0), (high, high, top)),
        "west": ((low, low, 0), (low + thick, high, top)),
        "north": ((low, high - thick, 0), (high, high, top)),
        "south": ((low, low, 0), (high, low + thick, top)),
    }
    boards += [wall for side, wall in walls.items() if side != open_to]
    return of_boards(boards)


@pytest.fixture
def cellar(make_database: MakeDatabase):
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        made = db.create_map("cellar")
        made.add_room("store", [(0, 0), (7, 0), (7, 5), (0, 5)], floor=0, ceiling=2.6)
        made.add_object("bench", type="table", size=(1.4, 0.7, 0.7), pose=(1, 1, 0, 0))
        yield made


def put_locker(made: Map, mesh: trimesh.Trimesh, yaw: float, **properties: bool) -> None:
    """A locker with a tin on its shelf."""
    made.add_object(
        "locker",
        type="cabinet",
        mesh=mesh,
        pose=(4, 3, 0, yaw),
        properties=properties,
    )
    made.add_object("tin", type="can", size=(0.06, 0.06, 0.12), pose=(4, 3, 0.8, 0))
    assert made["tin"].holder == made["locker"]


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_the_hand_comes_in_by_the_open_side(cellar: Map, side: str, yaw: float) -> None:
    """By rays of trimesh, the hand sees the outside where an approach begins."""
    mesh = locker(side)
    put_locker(cellar, mesh, yaw)
    rows = list(cellar.grasps("tin"))
    assert rows
    cos, sin = np.cos(yaw), np.sin(yaw)
    x, y = SIDES[side]
    outside = np.array((cos * x - sin * y, sin * x + cos * y))
    placed = mesh.copy()
    placed.apply_transform(cellar["locker"].pose.matrix)
    for row in rows:
        begins = row["pre_pose"].matrix[:3, 3]
        assert not placed.ray.intersects_any([begins], [[*outside, 0.0]])[0]
        assert (begins[:2] - (4, 3)) @ outside > -0.06  # not behind the tin
    assert cellar.plan("on(tin, bench)", start="store").actions


@pytest.mark.parametrize("open_to", [None, "south"])
def test_what_nothing_opens_is_not_grasped(cellar: Map, open_to: str | None) -> None:
    """A locker without a gap, and one whose door the map has as shut but not as geometry."""
    if open_to is None:
        assert (
            locker(None)
            .ray.intersects_any(
                np.tile([0.0, 0, 1.0], (4, 1)), [(x, y, 0) for x, y in SIDES.values()]
            )
            .all()
        )
        put_locker(cellar, locker(None), 0.3)
        why = "tin: is inside of locker; from no side"
    else:
        put_locker(cellar, locker(open_to), 0.3, shut=True)
        why = "tin: is inside of locker, which is shut; open it first"
    assert not list(cellar.grasps("tin"))
    assert why in " ".join(cellar.grasps("tin").problems)
    with pytest.raises(NoPlanError, match=why):
        cellar.plan("on(tin, bench)", start="store")
    cellar["tin"].move_to(2.5, 1, 0)
    assert cellar.plan("on(tin, bench)", start="store").actions


def test_what_stands_on_top_is_grasped(cellar: Map) -> None:
    put_locker(cellar, locker(None), 0.3, shut=True)
    cellar["tin"].move_to(4, 3, 1.2)
    assert list(cellar.grasps("tin"))
