"""Base poses, checked with shapely against the triangles of what stands there."""

import math

import numpy as np
import pytest
import shapely

from planner.base_pose import NoBasePoseError, poses_in, poses_to_reach
from planner.location import LocatedEntity
from planner.storey_costmaps import StoreyCostmaps
from semmap.geometry.pose import Pose
from tests.planner.test_storey_costmaps import ROBOT, box, ground, rooms, scene

NOWHERE = shapely.Point()


def target_of(thing, place="left"):
    x0, y0, x1, y1 = thing.bounds
    z = thing.triangles[:, :, 2]
    pose = Pose((x0 + x1) / 2, (y0 + y1) / 2, float(z.min()))
    return LocatedEntity(
        thing.name,
        "object",
        place,
        pose,
        shapely.box(x0, y0, x1, y1),
        (float(z.min()), float(z.max())),
    )


def turned(part, pose):
    """The footprint of a part of a robot at a pose."""
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    corners = [(pose.x + c * x - s * y, pose.y + s * x + c * y) for x, y in part.footprint]
    return shapely.Polygon(corners)


def obstacles(things, interval):
    """What of the triangles of things is between two heights, on the ground."""
    shapes = []
    for thing in things:
        for triangle in thing.triangles:
            z = triangle[:, 2]
            if z.max() < interval[0] or z.min() > interval[1]:
                continue
            points = list(triangle[(z >= interval[0]) & (z <= interval[1])])
            for a, b in ((0, 1), (1, 2), (2, 0)):
                p, q = triangle[a], triangle[b]
                for level in interval:
                    if (p[2] - level) * (q[2] - level) < 0:
                        points.append(p + (q - p) * (level - p[2]) / (q[2] - p[2]))
            if points:
                shapes.append(shapely.MultiPoint(np.array(points)[:, :2]).convex_hull)
    return shapely.union_all(shapes)


def is_free(robot, things, pose):
    return all(
        shapely.distance(turned(part, pose), obstacles(things, part.interval)) > 0
        for part in robot.parts
    )


def check(robot, things, target, poses, walls=NOWHERE):
    assert poses
    sides = set()
    for pose in poses:
        assert is_free(robot, things, pose)
        at = shapely.Point(pose.x, pose.y)
        away = at.distance(target.footprint)
        assert robot.reach[0] <= away <= robot.reach[1]
        near = target.footprint.intersection(at.buffer(robot.reach[1]))
        to = np.array([near.centroid.x - pose.x, near.centroid.y - pose.y])
        assert math.cos(pose.yaw - math.atan2(to[1], to[0])) == pytest.approx(1.0)
        line = shapely.shortest_line(at, target.footprint)
        assert not shapely.intersects(line, walls)
        middle = target.footprint.centroid
        around = math.atan2(pose.y - middle.y, pose.x - middle.x)
        sides.add(math.floor((around / (2 * math.pi) + 1) * 24) % 24)
    assert len(sides) == len(poses)


def test_poses_around_a_crate_are_free_face_it_and_reach_it():
    crate = box(10, 1.5, 1.2, 0.2, name="crate", high=0.6)
    made = ground([crate])
    poses = poses_to_reach(made.ground("left"), target_of(crate), most=24)
    check(ROBOT, [crate], target_of(crate), poses)
    assert len(poses) > 12
    assert len(poses_to_reach(made.ground("left"), target_of(crate), most=3)) == 3


def test_along_a_long_counter_the_robot_faces_what_is_before_it():
    counter = box(10, 1.5, 3.0, 1.4, name="counter")
    made = ground([counter])
    target = target_of(counter)
    poses = poses_to_reach(made.ground("left"), target, most=24)
    check(ROBOT, [counter], target, poses)


def test_with_a_cupboard_in_front_other_sides_are_taken():
    crate = box(10, 1.5, 1.2, 0.15, name="crate")
    things = [crate, box(11, 0.9, 1.2, 0.2), box(12, 1.5, 1.9, 0.2)]
    poses = poses_to_reach(ground(things).ground("left"), target_of(crate), most=24)
    check(ROBOT, things, target_of(crate), poses)


def test_no_robot_stands_in_a_doorway():
    crate = box(10, 2.5, 2.5, 0.2, name="crate")
    poses = poses_to_reach(ground([crate]).ground("left"), target_of(crate), most=24)
    door = shapely.LineString([(3.1, 1.0), (3.1, 2.0)])
    assert not any(turned(p, pose).intersects(door) for pose in poses for p in ROBOT.parts)


def test_no_wall_is_between():
    """A thin wall through the room; on its other side the crate would be near enough."""
    crate = box(10, 1.2, 1.5, 0.1, name="crate")
    wall = box(11, 1.5, 1.5, 0.05, name="wall")
    triangles = wall.triangles.copy()
    triangles[..., 1] = (triangles[..., 1] - 1.5) * 60 + 1.5  # 3 m long in y
    wall = type(wall)(11, "wall", "object", ("wall", "building_element"), triangles)
    poses = poses_to_reach(ground([crate, wall]).ground("left"), target_of(crate), most=24)
    x0, y0, x1, y1 = wall.bounds
    check(ROBOT, [crate, wall], target_of(crate), poses, shapely.box(x0, y0, x1, y1))
    assert all(p.x < 1.4 for p in poses)


def test_what_cannot_be_reached_is_said():
    made = ground([box(10, 1.5, 1.5, 0.2)])
    high = LocatedEntity(
        "lamp", "object", "left", Pose(1.0, 1.0, 2.2), shapely.box(0.9, 0.9, 1.1, 1.1), (2.2, 2.4)
    )
    with pytest.raises(
        NoBasePoseError, match=r"lamp is 2.20 to 2.40 m above the floor; cube reach"
    ):
        poses_to_reach(made.ground("left"), high)
    with pytest.raises(NoBasePoseError, match="no room holds lamp"):
        poses_to_reach(made.ground("left"), LocatedEntity("lamp", "object", None))
    with pytest.raises(NoBasePoseError, match="does not say where in left lamp is"):
        poses_to_reach(made.ground("left"), LocatedEntity("lamp", "object", "left"))
    full = ground([box(10, 1.5, 1.5, 1.4)])
    inside = LocatedEntity("lamp", "object", "left", Pose(1.5, 1.5), None, (0.0, 1.0))
    with pytest.raises(NoBasePoseError, match=r"finds no free place within 0.80 m of lamp in left"):
        poses_to_reach(full.ground("left"), inside)
    with pytest.raises(NoBasePoseError, match="does not say where in above lamp is"):
        poses_to_reach(made.ground("above"), LocatedEntity("lamp", "object", "above", Pose()))


@pytest.mark.parametrize("seed", range(4))
def test_poses_drawn_in_a_region_are_in_it_and_free(seed):
    things = [box(10, 1.0, 1.0, 0.2), box(11, 2.0, 1.3, 0.2)]
    made = ground(things)
    area = shapely.Polygon([(0.3, 0.3), (2.8, 0.4), (2.5, 2.7), (1.0, 2.4)])
    target = LocatedEntity("home", "region", "left", Pose(1.5, 1.5), area)
    poses = poses_in(made.ground("left"), target, np.random.default_rng(seed))
    assert len(poses) == 12
    assert len({(p.x, p.y) for p in poses}) == 12
    for pose in poses:
        assert area.covers(shapely.Point(pose.x, pose.y))
        assert is_free(ROBOT, things, pose)
    again = poses_in(made.ground("left"), target, np.random.default_rng(seed))
    assert poses == again


def test_a_narrow_region_has_poses_along_it():
    """Between two crates the robot stands only as its footprint is turned."""
    long = np.array([[-0.5, -0.15], [0.5, -0.15], [0.5, 0.15], [-0.5, 0.15]])
    part = type(ROBOT.parts[0])("base", ("base",), (0.0, 0.5), long, 0.15, 0.55)
    robot = type(ROBOT)("long", (part,))
    things = [box(10, 1.5, 0.9, 0.35), box(11, 1.5, 2.1, 0.35)]
    made = StoreyCostmaps(rooms(), robot, lambda storey: scene(things), resolution=0.05)
    area = shapely.box(1.4, 1.4, 1.6, 1.6)
    target = LocatedEntity("slot", "region", "left", Pose(1.5, 1.5), area)
    for seed in range(4):
        for pose in poses_in(made.ground("left"), target, np.random.default_rng(seed), 2):
            assert is_free(robot, things, pose)
            assert abs(math.sin(pose.yaw)) < 0.5


def test_a_full_region_is_said():
    target = LocatedEntity(
        "home", "region", "left", Pose(1.5, 1.5), shapely.box(1.2, 1.2, 1.8, 1.8)
    )
    with pytest.raises(NoBasePoseError, match="cube finds no free pose in home"):
        poses_in(ground([box(10, 1.5, 1.5, 0.4)]).ground("left"), target, np.random.default_rng(0))
    with pytest.raises(NoBasePoseError, match="in which room home is, or has no outline"):
        poses_in(
            ground().ground("left"),
            LocatedEntity("home", "region", "left"),
            np.random.default_rng(0),
        )


@pytest.mark.parametrize("with_pose", [True, False])
def test_at_a_waypoint_the_robot_stands_on_the_point_if_it_fits(with_pose):
    """A region that is a point: exactly there, else as near as the robot fits, else an error."""
    at, rng = Pose.planar(1.5, 1.2, 0.5), np.random.default_rng(0)
    target = (
        LocatedEntity("lounge", "region", "left", at)
        if with_pose
        else LocatedEntity("lounge", "region", "left", None, shapely.Point(1.5, 1.2))
    )
    (pose,) = poses_in(ground().ground("left"), target, rng)
    assert (pose.x, pose.y) == (1.5, 1.2)
    assert pose.yaw == pytest.approx(0.5 if with_pose else 0.0)
    things = [box(10, 1.5, 0.9, 0.2)]  # 0.1 m from the point
    (pose,) = poses_in(ground(things).ground("left"), target, rng)
    assert is_free(ROBOT, things, pose)
    assert 0 < math.dist(pose[:2], at[:2]) <= 0.3
    with pytest.raises(NoBasePoseError, match=r"no free pose within 0\.3 m of lounge"):
        poses_in(ground([box(10, 1.5, 1.2, 0.4)]).ground("left"), target, rng)
