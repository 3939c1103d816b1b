"""What leaves an opening free decides exactly, wherever the cells of the grid fall."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from scipy.optimize import linprog

from navgrid.terrain import DriveLimits
from planner.robot_class import BODY, RobotClass
from planner.storey_costmaps import StoreyCostmaps
from planner.straight_passage import free_offsets
from planner.topology import Place, PlaceConnector, Topology
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.query.storey_scene import FloorArea, SceneEntity, StoreyScene
from semmap.robot import Part

PERSON = RobotClass("person", (BODY,))
CORNERS = np.array([[-0.3, -0.2], [0.25, -0.2], [0.25, 0.15], [-0.3, 0.15]])
CARRIER = RobotClass(
    "carrier",
    (
        Part("base", ("base",), (0.0, 0.4), CORNERS, 0.15, 0.4),
        Part("tray", ("tray",), (0.6, 0.9), CORNERS * 1.5, 0.225, 0.6),
    ),
    DriveLimits(max_step=0.05),
)
LOW, HIGH = 0.0, 4.0  # of the rooms along their wall, which is from x = 4.0 to 4.2


def solid(number, y0, y1, z0, z1, door, x0=0.0, x1=0.2, types=("wall", "building_element")):
    """A box in the frame of a wall, as a map's entity."""
    triangles = box_mesh((4 + x0, y0, z0), (4 + x1, y1, z1)).triangles
    moved = door.apply(triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    return SceneEntity(number, f"solid{number}", "object", types, moved)


def building(width, solids, frame, robot=PERSON, resolution=0.05, middle=2.0, walled=True):
    """Two rooms on both sides of a wall with a door in it, turned and moved by a frame."""

    def outline(x0, y0, x1, y1):
        corners = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])
        return shapely.Polygon(frame.apply(corners)[:, :2])

    poses = (
        frame @ Pose.planar(3.5, middle, 0.0),
        frame @ Pose.planar(4.7, middle, math.pi),
    )
    door = PlaceConnector("door", ("one", "two"), poses, width=width, id=3)
    half = width / 2
    floors = (
        FloorArea("one", outline(0, LOW, 4, HIGH), 0.0),
        FloorArea("two", outline(4.2, LOW, 8.2, HIGH), 0.0),
        FloorArea("door", outline(3.5, middle - half, 4.7, middle + half), 0.0),
    )
    walls = [
        solid(20, LOW, middle - half, 0, 2.6, frame),
        solid(21, middle + half, HIGH, 0, 2.6, frame),
    ]
    walls = walls if walled else []
    scene = StoreyScene("", 0.0, (*walls, *solids), floors, (-0.5, 3.0))
    known = Topology.of([Place(n, id=i) for i, n in enumerate(("one", "two"))], [door])
    return StoreyCostmaps(known, robot, lambda storey: scene, resolution)


def passes(made):
    door = made.topology.connectors["door"]
    found = [made.obstruction(*end) is None for end in zip(door.places, door.poses, strict=True)]
    assert found[0] == found[1]
    return found[0]


def widest(width, boxes, robot):
    """How much wider than each part the widest gap is, that all get through on one line."""
    centres = np.linspace(-width / 2, width / 2, 20001)
    free = np.full(len(centres), np.inf)
    for part in robot.parts:
        right, left = part.footprint[:, 1].min(), part.footprint[:, 1].max()
        free = np.minimum(free, np.minimum(centres + right + width / 2, width / 2 - centres - left))
        for y0, y1, z0, z1 in boxes:
            if z1 <= robot.drive_limits.max_step or z0 > part.interval[1] or z1 < part.interval[0]:
                continue
            free = np.minimum(free, np.maximum(y0 - centres - left, centres + right - y1))
    return float(free.max())


@pytest.mark.parametrize(("end", "free"), [(2.2, False), (1.85, True)])
def test_walls_without_a_shape_are_beside_an_opening(end, free):
    """A box leaves 0.3 or 0.65 m of an opening of one metre; there is no way past its other end."""
    box = solid(30, 1.5, end, 0.0, 2.0, Pose())
    assert passes(building(1.0, [box], Pose(), walled=False)) is free


@pytest.mark.parametrize("robot", [PERSON, CARRIER], ids=["disc", "shape"])
@pytest.mark.parametrize("seed", range(60))
def test_a_gap_is_passed_where_the_robot_fits_and_nowhere_else(seed, robot):
    draw = np.random.default_rng(seed)
    x, y = draw.uniform(-0.1, 0.1, 2)
    frame = Pose.planar(x, y, draw.choice([0, math.pi / 2, draw.uniform(-4, 4)]))
    width, boxes = draw.uniform(0.55, 1.6), []
    for _ in range(draw.integers(0, 3)):
        y, half = draw.uniform(-width / 2, width / 2), draw.uniform(0.02, 0.3)
        z0, high = draw.choice([0.0, 0.3, 0.45, 1.2, 1.6]), draw.choice([0.01, 0.1, 0.5, 2.0])
        boxes.append((y - half, y + half, z0, z0 + high))
    kinds = draw.choice(["wall", "box"], len(boxes))
    solids = [
        solid(30 + k, 2 + a, 2 + b, c, d, frame, types=(kind, "object"))
        for k, ((a, b, c, d), kind) in enumerate(zip(boxes, kinds, strict=True))
    ]
    room = widest(width, boxes, robot)
    assert abs(room) > 1e-4, "rounding would decide: take another seed"
    made = building(width, solids, frame, robot)
    if room < 0 and robot is CARRIER:  # cells may show a way at another heading
        return
    assert passes(made) == (room > 0), (room, boxes)
    door = made.topology.connectors["door"]
    if room < 0:
        return
    stands = [made.standing(*end)[:2] for end in zip(door.places, door.poses, strict=True)]
    way = shapely.LineString([stands[0], *made.bends(door), stands[1]])
    for there in solids if robot is PERSON else ():
        z = there.triangles[:, :, 2]
        if z.max() > robot.drive_limits.max_step and z.min() <= BODY.interval[1]:
            ground = shapely.MultiPoint(there.triangles[:, :, :2].reshape(-1, 2)).convex_hull
            assert way.distance(ground) > BODY.inscribed_radius - 0.03


@pytest.mark.parametrize("offset", np.linspace(0, 0.05, 7))
@pytest.mark.parametrize("gap", [0.5, 0.53, 0.57, 0.599, 0.6, 0.62, 0.66])
@pytest.mark.parametrize("kind", ["wall", "box"])
def test_the_offset_of_the_grid_changes_nothing(gap, offset, kind):
    """A door of 0.9 m of which a post, or a wall on both of its sides, leaves a gap."""
    frame = Pose(offset, offset / 3)
    types = (kind, "object")
    solids = [solid(30, 1.55, 2.45 - gap, 0, 2, frame, types=types)]
    if kind == "wall":
        rest = (0.9 - gap) / 2
        solids = [
            solid(30, 1.5, 1.55 + rest, 0, 2, frame, types=types),
            solid(31, 2.45 - rest, 2.5, 0, 2, frame, types=types),
        ]
    assert passes(building(0.9, solids, frame)) == (gap >= 0.6)


@pytest.mark.parametrize("resolution", [0.03, 0.05])
@pytest.mark.parametrize("seed", range(20))
def test_gaps_between_things_in_a_room_are_passed_with_an_error_of_three_cells(seed, resolution):
    """Two blocks from wall to wall leave a gap: never one narrower than the body."""
    draw = np.random.default_rng(seed)
    gap = draw.choice([0.55, 0.595, 0.6 + 3 * resolution, 0.9])
    y, frame = draw.uniform(1.2, 2.8), Pose(*draw.uniform(-0.1, 0.1, 2))
    blocks = [
        solid(30, -0.2, y - gap / 2, 0, 1, frame, -1.6, -1.1, ("box",)),
        solid(31, y + gap / 2, 4.2, 0, 1, frame, -1.6, -1.1, ("box",)),
    ]
    made = building(0.9, blocks, frame, resolution=resolution)
    ends = [frame @ Pose.planar(x, 2.0) for x in (1.0, 3.4)]
    found = made.between("one", ends[:1], ends[1:]).seconds
    assert np.isfinite(found).all() == (gap > 0.6)


def test_a_moved_post_changes_the_places_of_its_door():
    """By a centimetre, which no cell shows."""
    frame = Pose()
    post = solid(30, 1.5, 1.85, 0, 2, frame, types=("box",))
    made = building(0.9, [post], frame)
    assert passes(made)
    nearer = solid(30, 1.5, 1.8501, 0, 2, frame, types=("box",))
    assert made.update([30], [replace(nearer, name="post")]) == {"one", "two"}
    assert not passes(made)


def meets(corners, low, high):
    """Whether a point of a triangle (3, 3) is in a box, by a linear program."""
    inside = np.concatenate([corners.T, -corners.T])
    bounds = np.concatenate([high, -low])
    return linprog(np.zeros(3), inside, bounds, np.ones((1, 3)), [1.0]).success


@pytest.mark.parametrize("robot", [PERSON, CARRIER], ids=["disc", "shape"])
@pytest.mark.parametrize("seed", range(10))
def test_offsets_are_free_where_no_triangle_meets_the_robot(seed, robot):
    """Triangles of any tilt, before, in and beside the opening, also beyond its posts."""
    draw = np.random.default_rng(seed)
    x, y, turn = draw.uniform((-1, -1, -4), (1, 1, 4))
    frame, width, things = Pose.planar(x, y, turn), 1.6, []
    for number in range(6):
        middle = draw.uniform((3.3, 0.5, 0.0), (4.9, 3.5, 1.6))
        corners = middle + draw.uniform(-0.3, 0.3, (4, 3, 3)) * draw.choice([0.3, 1.0])
        moved = frame.apply(corners.reshape(-1, 3)).reshape(-1, 3, 3)
        things.append(SceneEntity(30 + number, f"t{number}", "object", ("box", "object"), moved))
    made = building(width, things, frame, robot, walled=False)
    door, costmap = made.topology.connectors["door"], made.costmap("")
    padding = {
        entity: layer.padding
        for layer in costmap.policy.layers
        for entity in costmap.obstacles.members.layers[layer.name]
    }
    found = free_offsets(costmap, door)
    ends = np.array(found).ravel()
    asked = [0.5 * (a + b) for a, b in found] + [*draw.uniform(-1.5, 1.5, 12)]
    for at in asked:
        if len(ends) and np.abs(ends - at).min() < 1e-6:
            continue
        free = True
        for part, (low, high) in zip(robot.parts, costmap.intervals, strict=True):
            right, left = at + part.footprint[:, 1].min(), at + part.footprint[:, 1].max()
            free &= -width / 2 <= right and left <= width / 2
            for thing in things:
                wide = padding.get(thing.id, math.nan)
                corners = frame.inverse().apply(thing.triangles.reshape(-1, 3)) - (4.1, 2.0, 0.0)
                box = [-0.6 - wide, right - wide, low], [0.6 + wide, left + wide, high]
                for each in corners.reshape(-1, 3, 3):
                    free &= not meets(each, *map(np.array, box))
        assert any(a <= at <= b for a, b in found) == free, at


def test_there_is_no_gap_beside_an_opening():
    """Of two boxes beyond the left post, a narrow robot passes between, but not the wall."""
    boxes = [solid(30 + k, y, y + 0.02, 0, 0.4, Pose()) for k, y in enumerate((2.82, 3.36))]
    made = building(1.6, boxes, Pose(), CARRIER, walled=False)
    offsets = np.ravel(free_offsets(made.costmap(""), made.topology.connectors["door"]))
    assert offsets == pytest.approx([-0.5, 0.575], abs=1e-3)


def measured(made, poses):
    """All that is kept of the door and of both places."""
    door = made.topology.connectors["door"]
    found = [made.bends(door)]
    for (place, pose), others in zip(zip(door.places, door.poses, strict=True), poses, strict=True):
        found += [made.obstruction(place, pose), made.standing(place, pose)]
        travel = made.between(place, others, [pose, *others])
        found += [travel.seconds.tolist(), travel.metres.tolist()]
        found += [bits.tolist() for bits in made.space(place)]
    return found


@pytest.mark.parametrize("robot", [PERSON, CARRIER], ids=["disc", "shape"])
@pytest.mark.parametrize("seed", range(4))
def test_what_was_kept_is_that_of_a_new_map(seed, robot):
    """A box stands in the opening, beside it, and elsewhere in the rooms, in turn."""
    draw = np.random.default_rng(seed)
    made, moves = building(0.9, [solid(30, 1.5, 1.6, 0, 2, Pose())], Pose(), robot), []
    poses = [
        [Pose.planar(*draw.uniform((x, 0.3), (x + 3.4, 3.7))) for _ in range(3)] for x in (0.3, 4.5)
    ]
    measured(made, poses)
    for _ in range(15):
        y, x = draw.choice([draw.uniform(1.4, 2.4), draw.uniform(0, 4)]), draw.uniform(-4, 4)
        x *= draw.choice([0.3, 1.0])
        box = solid(30, y, y + draw.uniform(0.02, 0.4), 0, 2, Pose(), x, x + 0.3, ("box",))
        made.update([30], [box])
        moves.append(measured(made, poses))
        assert moves[-1] == measured(building(0.9, [box], Pose(), robot), poses)
    assert len({*map(str, moves)}) > 8
