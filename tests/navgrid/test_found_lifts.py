"""What is a lift and what is not, by storeys made by hand."""

import numpy as np
import pytest
import shapely

from navgrid.found_lifts import with_lifts
from navgrid.found_rooms import FoundDoorway, FoundRoom, FoundRooms, FoundStairs
from semmap.geometry.mesh import box_mesh
from semmap.query.storey_scene import SceneEntity, StoreyScene

HALL, SHAFT = shapely.box(0, 0, 8, 5), shapely.box(8.1, 1, 9.8, 2.7)
DOOR = shapely.LineString([(8.05, 1.4), (8.05, 2.3)])


def storeys(count=3, floor=HALL, shaft=SHAFT, doors=True, stairs=False):
    """Storeys of 3 m with a hall and a shaft; the slabs cover `floor`."""
    x0, y0, x1, y1 = floor.bounds
    scenes, found = [], []
    for n in range(count):
        z = 3.0 * n
        slab = box_mesh((x0, y0, z - 0.2), (x1, y1, z)).triangles
        things = (SceneEntity(n, f"slab{n}", "object", (), slab),)
        scenes.append(StoreyScene(f"s{n}", z, things, (), (z, z + 3)))
        hall, cabin = f"s{n}_room1", f"s{n}_room2"
        ways = (FoundDoorway(f"s{n}_door1", (hall, cabin), DOOR, 1.0),) if doors else ()
        steps = ()
        if stairs and n < count - 1:
            ends = np.array([(7.5, 2, z), (9, 2, z + 3)])
            steps = (FoundStairs("up", (hall, f"s{n + 1}_room1"), ends, (z, z + 3), "steps"),)
        rooms = FoundRoom(hall, HALL, None, 1.0), FoundRoom(cabin, shaft, None, 1.0)
        found.append(FoundRooms(f"s{n}", z, rooms, ways, steps))
    return scenes, found


def test_a_shaft_with_a_door_on_each_storey_is_a_lift():
    lowest, *others = with_lifts(*storeys())
    (lift,) = lowest.lifts
    assert lift.cabins == ("s0_room2", "s1_room2", "s2_room2")
    assert not any(each.lifts for each in others)
    assert lowest.table()[-1]["by"] == "s0_room2, s1_room2, s2_room2"


@pytest.mark.parametrize(
    "told",
    [
        {"floor": shapely.box(0, 0, 10, 5)},  # closets one above another
        {"floor": shapely.box(20, 0, 21, 1)},  # no floors to compare with
        {"shaft": shapely.box(8.1, 1, 11.8, 4.7)},  # a light well
        {"doors": False},
        {"stairs": True},
        {"count": 1},
    ],
)
def test_what_is_no_lift(told):
    assert not any(each.lifts for each in with_lifts(*storeys(**told)))


def test_a_lift_keeps_clear_of_names_that_are_taken():
    scenes, found = storeys(2)
    named = SceneEntity(9, "lift1", "object")
    scenes[0] = StoreyScene("s0", 0.0, (*scenes[0].entities, named), (), (0.0, 3.0))
    assert with_lifts(scenes, found)[0].lifts[0].name == "lift2"
