"""Walks are those of SciPy on the costmap's cells; changes are those of a ground made anew."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from navgrid.inflation import INSCRIBED
from navgrid.slabs import area_cells
from planner.robot_class import RobotClass
from planner.route import NoRouteError
from planner.route_search import find_route
from planner.routing_graph import RoutingGraph
from planner.storey_costmaps import SNAP, StoreyCostmaps
from planner.topology import Place, PlaceConnector, PlaceRegion, Topology
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.query.storey_scene import FloorArea, SceneEntity, StoreyScene
from semmap.robot import Part
from tests.oracles.drive import scipy_prices

OUTLINE = np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])
BASE = Part("base", ("base",), (0.0, 0.5), OUTLINE, 0.2, 0.2 * 2**0.5)
ROBOT = RobotClass("cube", (BASE,), speed=0.5)


def box(number, x, y, half, kind="object", name=None, high=1.0):
    mesh = box_mesh((x - half, y - half, 0.02), (x + half, y + half, high))
    return SceneEntity(number, name or f"box{number}", kind, (kind,), mesh.triangles)


def rooms():
    """Two rooms of 3 m by 3 m side by side, a wall between them, a door of 1 m in it."""
    connector = PlaceConnector(
        "door",
        ("left", "right"),
        (Pose.planar(2.3, 1.5, 0.0), Pose.planar(3.9, 1.5, math.pi)),
        width=1.0,
        id=3,
    )
    hatch = replace(
        connector,
        name="hatch",
        id=4,
        poses=(Pose.planar(0.5, 2.5, math.pi / 2), Pose.planar(0.5, 3.5, -math.pi / 2)),
        places=("left", "above"),
    )
    return Topology.of(
        [Place(n, storey="ground", id=i) for i, n in enumerate(("left", "right", "above"))],
        [connector, hatch],
    )


def scene(things=()):
    floors = (
        FloorArea("left", shapely.box(0, 0, 3, 3), 0.0),
        FloorArea("right", shapely.box(3.2, 0, 6, 3), 0.0),
        FloorArea("door", shapely.box(2.3, 1.0, 3.9, 2.0), 0.0),
        FloorArea("hatch", shapely.box(0.0, 2.5, 1.0, 3.5), 0.0),
    )
    return StoreyScene("ground", 0.0, tuple(things), floors, (-0.5, 3.0))


def ground(things=(), topology=None):
    return StoreyCostmaps(
        topology or rooms(), ROBOT, lambda storey: scene(things), resolution=0.1, slow=2.0
    )


boxes = st.lists(
    st.tuples(st.floats(0.3, 5.7), st.floats(0.3, 2.7), st.sampled_from([0.1, 0.25, 0.5])),
    max_size=4,
)


def things_of(said):
    return [box(10 + i, *b) for i, b in enumerate(said)]


def snapped(costs, grid, pose):
    """The passable cell nearest to a pose, by brute force: its own, or the nearest middle."""
    own = (
        math.floor((pose.y - grid.origin[1]) / grid.resolution),
        math.floor((pose.x - grid.origin[0]) / grid.resolution),
    )
    if all(0 <= v < n for v, n in zip(own, costs.shape, strict=True)) and costs[own] < INSCRIBED:
        return own, 0.0
    cells = np.argwhere(costs < INSCRIBED)
    if not len(cells):
        return None
    x, y = ((cells[:, 1 - k] + 0.5) * grid.resolution + grid.origin[k] for k in (0, 1))
    away = np.hypot(x - pose.x, y - pose.y)
    best = int(away.argmin())
    assume((away < away[best] + 1e-9).sum() == 1)  # of two that are as near, either may be taken
    return (tuple(map(int, cells[best])), float(away[best])) if away[best] <= SNAP else None


@settings(max_examples=6)
@given(
    boxes, st.lists(st.tuples(st.floats(0.0, 3.2), st.floats(-0.3, 3.3)), min_size=2, max_size=4)
)
def test_walks_are_those_of_scipy(said, points):
    made = ground(things_of(said))
    poses = [Pose.planar(x, y, 0.0) for x, y in points]
    walked = made.between("left", poses[:2], poses)
    costs, room = made.costs("left"), made.room("left")
    ends = [snapped(costs, room.grid, p) for p in poses]
    for i, j in np.ndindex(2, len(poses)):
        if ends[i] is None or ends[j] is None:
            assert math.isinf(walked.seconds[i, j])
            continue
        price = scipy_prices(costs, made.space("left"), 0.1, 2.0, ends[i][0])[ends[j][0]]
        expected = (price + ends[i][1] + ends[j][1]) / ROBOT.speed
        assert walked.seconds[i, j] == pytest.approx(expected)
        path = made.path("left", poses[i], poses[j])
        if math.isinf(expected):
            assert path is None
            continue
        length = np.linalg.norm(np.diff(path[1:-1], axis=0), axis=1).sum()
        assert walked.metres[i, j] == pytest.approx(length + ends[i][1] + ends[j][1])
        assert tuple(path[0]) == points[i]
        assert tuple(path[-1]) == points[j]
        rows, columns = np.floor((path[1:-1] - room.grid.origin) / 0.1 + 1e-9).astype(int).T[::-1]
        assert (costs[rows, columns] < INSCRIBED).all()


def wall(number, low, high):
    """A part of the wall between the rooms, from one y to another."""
    mesh = box_mesh((3.0, low, 0.0), (3.2, high, 1.0))
    return SceneEntity(number, f"wall{number}", "room", ("room",), mesh.triangles)


@pytest.mark.parametrize(
    ("things", "opening", "passes"),
    [
        ([], (1.0, 2.0), True),
        ([box(10, 3.1, 1.5, 0.15)], (1.0, 2.0), False),  # the rest of the opening is too narrow
        ([box(10, 3.1, 1.15, 0.1)], (1.0, 2.0), True),
        ([box(10, 2.35, 1.5, 0.2)], (1.0, 2.0), True),  # where the robot faces the door
        ([box(10 + k, 2.45, 1.0 + k / 2, 0.25) for k in range(3)], (1.0, 2.0), False),
        ([], (1.35, 1.65), False),  # walls leave less than the stated width of the door
        ([], (1.29, 1.71), True),  # cells of 0.1 m do not show this gap
    ],
)
def test_a_robot_passes_aside_of_what_stands_at_a_door_and_not_through_it(things, opening, passes):
    made = ground([*things, wall(20, -0.2, opening[0]), wall(21, opening[1], 3.2)])
    poses = Pose.planar(2.3, 1.5, 0.0), Pose.planar(0.8, 1.5, 0.0)
    assert np.isfinite(made.between("left", poses[:1], poses[1:]).seconds).all() == passes
    assert (made.path("left", *poses) is not None) == passes


@pytest.mark.parametrize(
    ("at", "moved", "bent"),
    [
        (None, False, False),
        ((2.35, 1.5, 0.2), True, True),  # where the robot faces the door
        ((3.1, 1.3, 0.1), False, True),  # in the way through the opening
    ],
)
def test_steps_name_points_where_the_robot_is_and_their_lengths(at, moved, bent):
    things = [] if at is None else [box(10, *at)]
    made = ground([*things, wall(20, -0.2, 1.0), wall(21, 2.0, 3.2)])
    graph = RoutingGraph(made.topology, ROBOT, made)
    goal = Pose.planar(0.8, 1.5, 0.0)
    found = find_route(graph, graph.endpoint("right"), graph.endpoint("left", goal))
    start, passage, drive = found.steps
    way = shapely.LineString([passage.approach[:2], *passage.bends, passage.leave[:2]])
    if at is not None:  # half the robot's width, but for a cell
        assert way.distance(shapely.Point(at[:2]).buffer(at[2], cap_style="square")) > 0.2 - 0.1
    assert way.intersects(made.topology.connectors["door"].leaf())
    assert passage.metres == pytest.approx(way.length)
    assert passage.seconds == pytest.approx(way.length / ROBOT.speed)
    assert (start.approach, start.leave, start.metres) == (None, passage.approach, 0.0)
    assert drive.approach == passage.leave
    assert drive.leave == goal
    line = made.path("left", drive.approach, goal)
    # from the middle of a cell to that of another one
    driven = np.linalg.norm(np.diff(line[1:-1], axis=0), axis=1).sum()
    assert drive.metres == pytest.approx(driven, abs=1e-6)
    assert (found.seconds, found.metres) == pytest.approx(
        tuple(sum(getattr(s, k) for s in found.steps) for k in ("seconds", "metres"))
    )
    poses = [pose[:2] for pose in made.topology.connectors["door"].poses]
    assert ([passage.leave[:2], passage.approach[:2]] != poses) == moved
    assert bool(passage.bends) == bent
    for pose, sign in ((passage.approach, 1), (passage.leave, -1)):  # to the door, away from it
        x, y = np.subtract((3.1, 1.5), pose[:2]) * sign
        off = pose.yaw - math.atan2(y, x)
        assert math.cos(off) == pytest.approx(1.0)


def test_between_neighbours_a_route_does_not_lead_through_what_closes_the_door():
    walls = [wall(20, -0.2, 1.0), wall(21, 2.0, 3.2)]
    for things, reason in (([], None), ([box(10, 3.1, 1.5, 0.15)], "box10 .*through door")):
        made = ground([*things, *walls])
        graph = RoutingGraph(made.topology, ROBOT, made)
        ends = graph.endpoint("left"), graph.endpoint("right")
        if reason is None:
            assert [s.behaviour for s in find_route(graph, *ends).steps][-1:] == ["pass_door"]
            continue
        with pytest.raises(NoRouteError, match=reason):
            find_route(graph, *ends)


@pytest.mark.parametrize(
    ("above", "below", "passes"),
    [(True, False, True), (False, True, True), (True, True, False), (False, False, True)],
)
def test_gaps_of_an_opening_are_a_way_where_they_meet(above, below, passes):
    things = [box(10, 3.1, 1.5, 0.25)]  # in the middle of an opening of 2.2 m
    things += [box(30 + k, 2.75, 1.8 + k * 0.2, 0.15) for k in range(5 * above)]
    things += [box(40 + k, 3.45, 0.4 + k * 0.2, 0.15) for k in range(5 * below)]
    known = rooms()
    wide = replace(known.connectors["door"], width=2.2)
    known = replace(known, connectors=known.connectors | {"door": wide})
    there = scene([*things, wall(20, -0.2, 0.4), wall(21, 2.6, 3.2)])
    opening = FloorArea("door", shapely.box(2.3, 0.4, 3.9, 2.6), 0.0)
    there = replace(there, floors=(*there.floors[:2], opening))
    made = StoreyCostmaps(known, ROBOT, lambda storey: there, resolution=0.1, slow=2.0)
    ends = [*zip(wide.places, wide.poses, strict=True)]
    reasons = [made.obstruction(*end) for end in ends]
    assert [reason is None for reason in reasons] == [passes, passes]
    assert passes or all("box10" in str(reason) for reason in reasons)
    assert bool(made.bends(wide)) == passes
    # The plane says the same, for the disc in the robot's base.
    free = shapely.box(0, 0, 6, 3) - shapely.union_all(
        [
            shapely.MultiPoint(t.triangles[:, :, :2].reshape(-1, 2)).envelope.buffer(0.2)
            for t in there.entities
        ]
    )
    stands = shapely.MultiPoint([made.standing(*end)[:2] for end in ends])
    assert any(part.covers(stands) for part in shapely.get_parts(free)) == passes


@pytest.mark.parametrize("seed", range(40))
def test_walls_in_a_way_are_passed_where_a_disc_gets_past_them(seed):
    """Surely where a disc around the robot gets with two cells to spare; else where one in it does.

    Walls are of any size, at any place of an opening of 1 m, or of 2.2 m.
    """
    draw = np.random.default_rng(seed)
    width = draw.choice([1.0, 2.2])
    known = rooms()
    door = replace(known.connectors["door"], width=float(width))
    known = replace(known, connectors=known.connectors | {"door": door})
    low, high = 1.5 - width / 2, 1.5 + width / 2
    things = [wall(20, -0.2, low), wall(21, high, 3.2)]
    for k in range(draw.integers(1, 3)):
        half = draw.choice([0.06, 0.15, 0.4, 1.0])
        x, y = draw.uniform(2.6, 3.6), draw.uniform(low - 0.2, high + 0.2)
        block = box(30 + k, x, y, half)
        things.append(replace(block, types=("wall", "building_element")))
    floors = (*scene().floors[:2], FloorArea("door", shapely.box(2.3, low, 3.9, high), 0.0))
    made = StoreyCostmaps(
        known,
        ROBOT,
        lambda storey: replace(scene(things), floors=floors),
        resolution=0.05,
    )
    taken = shapely.union_all(
        [shapely.MultiPoint(t.triangles[:, :, :2].reshape(-1, 2)).envelope for t in things]
    )
    hall = shapely.box(0, 0, 6, 3)
    stands = [shapely.Point(pose[:2]) for pose in door.poses]

    def gets(radius, reach):
        pieces = shapely.get_parts(hall - taken.buffer(radius))
        return any(all(piece.dwithin(spot, reach) for spot in stands) for piece in pieces)

    passes = made.obstruction("left", door.poses[0]) is None
    sure = gets(BASE.circumscribed_radius + 0.1, 0.0)
    assert sure <= passes <= gets(BASE.inscribed_radius - 0.1, SNAP + 0.1)


def test_a_base_stands_in_its_room_and_not_in_a_doorway():
    made = ground()
    free = np.argwhere(made.ground("left").costs < INSCRIBED)
    grid = made.room("left").grid
    points = np.array(grid.origin) + (free[:, ::-1] + 0.5) * grid.resolution
    assert points.max() < 3.0 + grid.resolution


def test_ways_lead_over_the_place_and_its_doorways_alone():
    made = ground()
    room = made.room("left")
    cells = area_cells(
        shapely.union_all(
            [shapely.box(0, 0, 3, 3), shapely.box(2.3, 1, 3.9, 2), shapely.box(0, 2.5, 1, 3.5)]
        ),
        room.grid,
    )
    assert (room.cells == cells).all()
    assert (made.costs("left")[~cells] == 255).all()
    assert made.room("above") is None
    walked = made.between("above", [Pose()], [Pose(1.0)])
    assert np.isinf(walked.seconds).all()
    assert np.isinf(walked.metres).all()
    # cells that touch the room from outside are no further than one cell away from it
    away = distance_transform_edt(~area_cells(shapely.box(0, 0, 3, 3), room.grid))
    assert away[cells].max() > 1


def test_a_closed_door_changes_no_walk():
    topology = rooms()
    door = box(3, 3.1, 1.5, 0.5, "connector", "door")
    for state in ("open", "closed", "locked"):
        leaf = replace(door, state=state)
        made = RoutingGraph(topology, ROBOT, costs=ground([leaf]))
        plain = RoutingGraph(topology, ROBOT, costs=ground())
        assert (made.base == plain.base).all()
        assert np.isfinite(made.base[made.travel_edges["left"]]).all()


@settings(max_examples=15)
@given(boxes, boxes, st.data())
def test_changed_things_change_what_they_touch(said, then, data):
    before = things_of(said)
    made = ground(before)
    for place in ("left", "right"):
        made.room(place)
    former = {p: made.costs(p) for p in ("left", "right")}
    kept = data.draw(st.sets(st.sampled_from([t.id for t in before]))) if before else set()
    now = [t for t in before if t.id in kept] + [
        t for t in (box(10 + i, *b) for i, b in enumerate(then)) if t.id not in kept
    ]
    ids = ({t.id for t in before} | {t.id for t in now}) - kept
    changed = made.update(ids, [t for t in now if t.id in ids])
    anew = ground(now)
    for place in ("left", "right"):
        assert (made.costs(place) == anew.costs(place)).all()
        differs = (made.costs(place) != former[place]).any()
        doors = [c.way for c, _ in made.topology.connectors_of(place)]
        at_door = any(  # within the reach of costs and a few cells
            math.dist(at, xy) <= 2.5
            for way in doors
            for at in way.coords
            for xy in [(x, y) for x, y, _ in [*said, *then]]
        )
        assert differs <= (place in changed) <= (differs or at_door)


def test_a_region_blocks_and_leaves():
    made, free = ground(), ground().costs("left")
    made.room("left"), made.room("right")
    wet = SceneEntity(
        20,
        "wet",
        "region",
        ("region",),
        footprint=shapely.box(1, 1, 2, 2),
        properties={"blocked": True},
    )
    assert "left" in made.update({20}, (), {"ground": [wet]})
    assert (made.costs("left") == ground([wet]).costs("left")).all()
    assert "left" in made.update({20})
    assert (made.costs("left") == free).all()


def test_avoided_regions_are_gone_around_while_they_are_avoided():
    made = ground()
    a, b = Pose.planar(0.5, 1.5, 0.0), Pose.planar(2.5, 1.5, 0.0)
    free = made.between("left", [a], [b]).metres[0, 0]
    band = PlaceRegion("band", shapely.box(1.2, 0.6, 1.8, 3.0), ("left",))
    with made.also_avoiding({"ground": [band]}):
        around = made.between("left", [a], [b]).metres[0, 0]
        assert around > free + 0.5
        path = made.path("left", a, b)
        assert not shapely.LineString(path).intersects(band.outline.buffer(-0.11))
        assert (
            made.blocking_reason("left", Pose(1.5, 1.5))
            == "the pose is in band, which is to be avoided"
        )
    assert made.between("left", [a], [b]).metres[0, 0] == free


def test_a_pose_too_near_to_something_is_snapped_and_one_in_it_refused():
    made = ground([box(10, 1.5, 1.5, 0.4, name="crate")])
    assert made.blocking_reason("left", Pose(0.5, 0.5)) is None
    assert made.blocking_reason("left", Pose(1.0, 1.5)) is None  # 0.1 m before it
    assert made.blocking_reason("left", Pose(1.2, 1.5)) == "crate is in the way"
    assert made.blocking_reason("left", Pose(1.2, 1.5), measured=True) is None
    assert made.blocking_reason("left", Pose(5.0, 1.5)) == "the pose is outside of left"
    assert made.blocking_reason("left", Pose(50.0, 1.5)) == "the pose is outside of left"
    assert made.blocking_reason("above", Pose(0.5, 4.0)) == "the map has no outline of above"


def test_a_robot_without_a_shape_has_no_ground():
    with pytest.raises(ValueError, match=r"robot robot has no shape.*semmap robot add"):
        StoreyCostmaps(rooms(), RobotClass(), lambda storey: scene())


def test_a_closed_leaf_is_the_door_and_a_wall_in_its_place_is_none() -> None:
    """A leaf in its opening is passed, for the door is opened; a wall there is not."""
    panel = box(30, 3.05, 1.5, 0.5)
    flat = panel.triangles.copy()
    flat[:, :, 0] = 3.05 + (flat[:, :, 0] - 3.05) * 0.05
    ground = shapely.box(3.025, 1.0, 3.075, 2.0)
    for types, state, passes in (
        (("door_leaf", "building_element"), "closed", True),
        (("wall", "building_element"), None, False),
    ):
        leaf = replace(panel, triangles=flat, footprint=ground, types=types, state=state)
        made = StoreyCostmaps(
            rooms(),
            ROBOT,
            lambda storey, leaf=leaf: scene([wall(20, -0.2, 1.0), wall(21, 2.0, 3.2), leaf]),
            resolution=0.05,
        )
        reason = made.obstruction("left", rooms().connectors["door"].poses[0])
        assert (reason is None) == passes, reason
