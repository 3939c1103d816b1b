"""Objects are put where the hand gets: on levels in reach, and inside where the goal says so."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import semmap
from planner.tasks import NoPlanError
from semmap import Map
from tests.boards import of_boards
from tests.conftest import MakeDatabase

REACHED = 1.6  # of the robot without a class, metres


def cupboard(boards: list[float], height: float, *, front: bool) -> trimesh.Trimesh:
    """A cupboard 0.7 m wide and 0.5 m deep with boards at heights, open to -y without a front."""
    parts = [((-0.35, 0.23, 0), (0.35, 0.25, height))]
    parts += [((x, -0.25, 0), (x + 0.02, 0.25, height)) for x in (-0.35, 0.33)]
    parts += [((-0.35, -0.25, z - 0.02), (0.35, 0.25, z)) for z in (*boards, height)]
    if front:
        parts.append(((-0.35, -0.25, 0), (0.35, -0.23, height)))
    return of_boards(parts)


@pytest.fixture
def pantry(make_database: MakeDatabase):
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        made = db.create_map("pantry")
        made.add_room("west", [(0, 0), (6, 0), (6, 5), (0, 5)], floor=0.4, ceiling=3.2)
        made.add_room("east", [(6.1, 0), (9, 0), (9, 5), (6.1, 5)], floor=0.4, ceiling=3.2)
        made.add_door("gap", "west", "east", ((6.05, 1), (6.05, 2)))
        made.add_object("desk", type="table", size=(1.2, 0.6, 0.7), pose=(1, 1, 0.4, 0))
        made.add_object("tin", type="can", size=(0.07, 0.07, 0.11), on="desk")
        yield made


def below(mesh: trimesh.Trimesh, made: Map, name: str) -> list[float]:
    """Heights above the floor of the faces of the cupboard that a ray down from a tin meets."""
    pose = made[name].pose
    placed = mesh.copy()
    placed.apply_transform(made["cupboard"].pose.matrix)
    met, _, _ = placed.ray.intersects_location([(pose.x, pose.y, 9.0)], [(0, 0, -1.0)])
    return sorted((met[:, 2] - 0.4).round(3))


@pytest.mark.parametrize(
    ("boards", "height", "goal"),
    [
        ([0.6, 1.2], 1.9, "on"),  # its top is above the reach
        ([0.6, 1.2], 1.9, "in"),
        ([0.5], 1.1, "in"),  # its top is in reach, but not inside
        ([0.5], 1.1, "on"),
        ([0.9, 1.75], 2.0, "in"),  # one of its boards is above the reach
    ],
)
def test_the_tin_stands_on_a_level_that_the_hand_reaches(
    pantry: Map, tmp_path, boards: list[float], height: float, goal: str
) -> None:
    mesh = cupboard(boards, height, front=False)
    pantry.add_object("cupboard", type="cupboard", mesh=mesh, pose=(3, 3.5, 0.4, 0.5))
    world = tmp_path / "w.sqlite"
    ended = pantry.run(f"{goal}(can, cupboard)", start="west", speed=500.0, world=world)
    assert ended.state == "done", ended.reason
    after = pantry.database.map(ended.map)
    stands = after["tin"].box[2] - 0.4
    levels = below(mesh, after, "tin")
    assert np.abs(np.array(levels) - stands).min() < 0.01
    assert stands <= REACHED
    highest = max(levels)
    if goal == "in":
        assert stands < highest - 0.1
    elif height <= REACHED:
        assert stands == pytest.approx(highest, abs=0.01)


@pytest.mark.parametrize(
    ("boards", "height", "front", "goal", "why"),
    [
        ([], 1.8, True, "on", "cupboard is 1.8 m high, the robot reaches 1.6 m"),
        ([0.6], 1.5, True, "in", "tin cannot be put in cupboard: at heights from 0.0 to 1.6 m"),
        ([0.6], 1.9, True, "on", "tin cannot be put on or in cupboard: at heights from 0.0"),
        ([1.7], 2.0, False, "in", "cupboard has no level surface below its top, 2.00 m high"),
        ([], 1.0, True, "in", "cupboard has no level surface below its top, 1.00 m high"),
    ],
)
def test_what_the_hand_does_not_reach_is_refused(
    pantry: Map, boards: list[float], height: float, front: bool, goal: str, why: str
) -> None:
    if boards:
        mesh = cupboard(boards, height, front=front)
    else:
        mesh = trimesh.creation.box(bounds=((-0.3, -0.2, 0), (0.3, 0.2, height)))
    pantry.add_object("cupboard", type="cupboard", mesh=mesh, pose=(3, 3.5, 0.4, 0.5))
    with pytest.raises(NoPlanError, match=why):
        pantry.plan(f"{goal}(tin, cupboard)", start="west")


def test_what_is_on_top_is_not_inside(pantry: Map) -> None:
    mesh = cupboard([0.6], 1.2, front=False)
    pantry.add_object("cupboard", type="cupboard", mesh=mesh, pose=(3, 3.5, 0.4, 0.5))
    pantry["tin"].move_to(3, 3.5, 1.6)
    assert pantry["tin"].holder == pantry["cupboard"]
    with pytest.raises(NoPlanError, match="tin is on top of cupboard: put it elsewhere first"):
        pantry.plan("in(tin, cupboard)", start="west")
    assert not pantry.plan("on(tin, cupboard)", start="west").actions
    pantry["tin"].move_to(3, 3.5, 1.0)
    assert pantry["tin"].holder == pantry["cupboard"]
    assert not pantry.plan("in(tin, cupboard)", start="west").actions
