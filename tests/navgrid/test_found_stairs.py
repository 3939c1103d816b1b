"""What is stairs and what is not, by objects made by hand; their ends follow from the steps."""

import math

import numpy as np
import pytest
import shapely

from navgrid.found_rooms import FoundRoom, FoundRooms
from navgrid.found_stairs import with_stairs
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.query.storey_scene import SceneEntity, StoreyScene

FLOOR, ABOVE = 0.0, 3.0
HALL = shapely.box(0, 0, 12, 4)


def flight(count=15, rise=0.2, run=0.28, x=2.0, low=0.0, closed=True):
    """Steps along x from (x, 1..2); a closed one stands on the floor."""
    boxes = []
    for i in range(count):
        top = low + (i + 1) * rise
        corner = (x + i * run, 1.0, low if closed else top - 0.04)
        boxes.append(box_mesh(corner, (x + (i + 1) * run, 2.0, top)).triangles)
    return np.concatenate(boxes)


def ramp():
    """In strips that rise by less than a step."""
    strips = []
    for i in range(15):
        a, b = (2 + i * 0.5, 1, i * 0.2), (2 + i * 0.5, 2, i * 0.2)
        c, d = (2.5 + i * 0.5, 2, (i + 1) * 0.2), (2.5 + i * 0.5, 1, (i + 1) * 0.2)
        strips += [(a, d, c), (a, c, b)]
    return np.array(strips, float)


def shelf():
    """Boards above each other: as high as stairs, and as many, but nobody walks up."""
    levels = np.arange(1, 16) * 0.2
    boxes = [box_mesh((2, 1, z - 0.02), (3, 2, z)).triangles for z in levels]
    return np.concatenate(boxes)


def found(triangles, *more):
    return found_below(triangles, *more).stairs


def found_below(triangles, *more):
    thing = SceneEntity(7, "thing", "object", (), triangles)
    scenes = [
        StoreyScene("ground", FLOOR, (thing, *more), (), (FLOOR, ABOVE)),
        StoreyScene("first", ABOVE, (), (), (ABOVE, 2 * ABOVE)),
    ]
    rooms = [
        FoundRooms(s.storey, s.elevation, (FoundRoom(f"{s.storey}_room1", HALL, None, 1.0),))
        for s in scenes
    ]
    lower, upper = with_stairs(scenes, rooms)
    assert upper.stairs == ()
    return lower


@pytest.mark.parametrize("closed", [True, False])
def test_a_flight_of_steps_joins_the_rooms_at_its_ends(closed):
    (stairs,) = found(flight(closed=closed))
    assert stairs.rooms == ("ground_room1", "first_room1")
    assert stairs.floors == (FLOOR, ABOVE)
    assert stairs.treads == "thing"
    (x0, y0, _), (x1, y1, _) = stairs.ends.tolist()
    assert (x0, y0, y1) == pytest.approx((2.0 - 0.5, 1.5, 1.5), abs=0.05)
    assert x1 == pytest.approx(2.0 + 15 * 0.28 + 0.5, abs=0.05)


@pytest.mark.parametrize(
    ("what", "triangles"),
    [
        ("a shelf", shelf()),
        ("a ramp", ramp()),
        ("a stool", flight(count=3)),
        ("a ladder of steps that are too high", flight(count=10, rise=0.3)),
        ("a stage that ends below the next floor", flight(count=8)),
        ("steps that begin above the floor", flight(count=10, low=1.0)),
        ("steps as steep as a ladder", flight(run=0.1)),
        ("steps where no room is", flight(x=30.0)),
    ],
)
def test_what_is_no_way_up_is_no_stairs(what, triangles):
    assert found(triangles) == (), what


@pytest.mark.parametrize(("gap", "foot"), [(0.6, 0.1), (0.35, 0.05), (0.2, 0.1)])
def test_a_robot_stands_in_the_room_before_stairs_beside_a_wall(gap, foot):
    """The wall is at x = 0, where the hall ends."""
    lower = found_below(flight(x=gap))
    (stairs,) = lower.stairs
    assert stairs.ends[0, :2] == pytest.approx((foot, 1.5), abs=1e-6)
    assert [note for note in lower.notes if "ground_room1 has no place" in note] == [*lower.notes]
    assert len(lower.notes) == (gap < 0.3)


def test_stairs_of_the_map_are_not_found_again():
    (stairs,) = found(flight())
    foot, head = stairs.ends[:, :2].tolist()

    def known(shift):
        ends = Pose.planar(foot[0] + shift, foot[1]), Pose.planar(head[0], head[1], math.pi, ABOVE)
        return SceneEntity(8, "known", "connector", ("stairs",), form="stairs", sides=ends)

    assert found(flight(), known(0.5)) == ()
    assert len(found(flight(), known(3.0))) == 1  # other ones that end there
