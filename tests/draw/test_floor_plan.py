import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from matplotlib.colors import to_rgb
from PIL import Image

from semmap.draw.floor_plan import floor_plan, left_out, middle_of_object
from semmap.draw.palette import PATH, ROOMS, STATES
from semmap.draw.view import DoorView, ObjectView, OccupancyView, RoomView, StoreyView
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from tests.draw.storeys import two_rooms


def pixels(path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB"), float) / 255


def share(picture: np.ndarray, colour: str) -> float:
    """Of the picture's pixels, those of a colour."""
    return float((np.abs(picture - to_rgb(colour)).max(axis=-1) < 0.02).mean())


def drawn(storey: StoreyView, tmp_path, **more) -> np.ndarray:
    return pixels(floor_plan(storey, tmp_path / "plan.png", width=7, dpi=80, **more))


def test_rooms_cover_their_share_in_the_colours_of_their_types(tmp_path):
    picture = drawn(two_rooms(), tmp_path)
    assert picture.shape[1] == 560
    # both rooms measure 12 m2; furniture, names and regions cover some of it
    assert 0.12 < share(picture, ROOMS["lab"]) < 0.4
    assert 0.12 < share(picture, ROOMS["kitchen"]) < 0.4
    assert share(picture, ROOMS["bedroom"]) == 0


def test_what_hangs_is_an_outline_and_what_is_overhead_is_not_on_the_plan(tmp_path):
    """Whatever its type: a plan shows what a robot or a person meets."""
    plain = drawn(two_rooms(), tmp_path)
    changed = []
    for low in (1.0, 1.6, 2.2):
        plan = two_rooms()
        mesh = box_mesh((1, 1, plan.elevation + low), (2, 2, plan.elevation + low + 0.2))
        plan.objects.append(ObjectView("thing", ("object",), mesh, shapely.box(1, 1, 2, 2)))
        changed.append(int((drawn(plan, tmp_path) != plain).any(axis=-1).sum()))
    solid, outlined, overhead = changed
    assert solid > 3 * outlined > 0 == overhead


def test_a_route_is_drawn(tmp_path):
    storey = two_rooms()
    with_route, without = drawn(storey, tmp_path), drawn(replace(storey, path=[]), tmp_path)
    assert share(with_route, PATH) > 0.002
    assert share(without, PATH) == 0


def test_the_grid_is_drawn_where_it_is_occupied(tmp_path):
    cells = np.zeros((62, 168), np.int8)
    free = OccupancyView((-0.1, -0.1), 0.05, cells)
    half = cells.copy()
    half[:31] = 100  # the lower half of the plan
    plain = drawn(replace(two_rooms(), occupancy=free, objects=[], path=[]), tmp_path)
    dark = drawn(
        replace(two_rooms(), occupancy=replace_cells(free, half), objects=[], path=[]), tmp_path
    )
    darker = dark.sum(axis=-1) < plain.sum(axis=-1) - 0.5
    rows = np.nonzero(darker.mean(axis=1) > 0.5)[0]
    per_metre = 80 * 6.1 / (8.2 + 2 * 0.55)  # dots an inch, inches, metres with their margin
    assert len(rows) == pytest.approx(31 * 0.05 * per_metre, abs=2)
    assert rows.min() > 0.45 * len(dark)  # low y is low in the picture


def replace_cells(grid: OccupancyView, cells: np.ndarray) -> OccupancyView:
    return OccupancyView(grid.origin, grid.resolution, cells)


@pytest.fixture(scope="module")
def without_doors(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    return drawn(replace(two_rooms(), doors=[]), tmp_path_factory.mktemp("bare"))


def test_a_thousand_rooms_keep_their_names_and_thin_walls(tmp_path):
    """Each name fits in its room, in letters that are as small as need be."""
    rooms = [
        RoomView(f"Room {r}.{c}", shapely.box(5 * c, 6 * r, 5 * c + 4.9, 6 * r + 5.9), 0.0, 3.0)
        for r in range(25)
        for c in range(40)
    ]
    cells = np.zeros((3000, 4000), np.int8)
    cells[:, 2001] = 100  # between two rows of pixels
    kept = []
    storey = StoreyView("ground", rooms=rooms, occupancy=OccupancyView((0, 0), 0.05, cells))
    picture = pixels(floor_plan(storey, tmp_path / "plan.png", over=kept.append))
    assert {text.get_text() for text in kept[0].texts} == {room.name for room in rooms}
    assert (picture.mean(axis=-1) < 0.4).mean(axis=0).max() > 0.7, "the wall is a line"


def test_long_names_of_small_rooms_are_on_lines_and_no_thin_wall_is_lost(tmp_path):
    rooms = [
        RoomView(f"Zimmer {c}/{r} Ä", shapely.box(4.2 * c, 4.2 * r, 4.2 * c + 4, 4.2 * r + 4), 0, 3)
        for r in range(25)
        for c in range(40)
    ]
    cells = np.zeros((25 * 84, 40 * 84), np.int8)
    cells[:, 81::84] = cells[81::84] = 100
    kept = []
    storey = StoreyView("ground", rooms=rooms, occupancy=OccupancyView((0, 0), 0.05, cells))
    picture = pixels(floor_plan(storey, tmp_path / "plan.png", over=kept.append))
    texts = {text.get_text().replace("\n", "").replace(" ", "") for text in kept[0].texts}
    assert texts == {room.name.replace(" ", "") for room in rooms}
    dark = picture.mean(axis=-1) < 0.5
    lines = [np.flatnonzero(dark.mean(axis=axis) > 0.6) for axis in (0, 1)]
    assert [int((np.diff(at) > 3).sum()) + 1 for at in lines] == [40, 25]


@pytest.mark.parametrize("type_", ["door", "elevator_door", "stairs", "ramp"])
@pytest.mark.parametrize("state", ["open", "closed", "locked"])
@pytest.mark.parametrize("width", [None, 1.8, 4.0])
def test_doors_of_all_kinds_are_drawn(tmp_path, without_doors, type_, state, width):
    door = DoorView("d", (Pose.planar(3, 1.5), Pose.planar(5, 1.5)), width, type_, state)
    picture = drawn(replace(two_rooms(), doors=[door]), tmp_path)
    assert picture.shape == without_doors.shape
    assert (np.abs(picture - without_doors).max(axis=-1) > 0.2).sum() > 40


def test_a_plan_without_rooms_shows_objects_and_an_empty_one_is_refused(tmp_path):
    bare = replace(two_rooms(), rooms=[], doors=[], regions=[], path=[])
    fewer = replace(bare, objects=[o for o in bare.objects if o.name != "table1"])
    whole = drawn(bare, tmp_path)
    assert drawn(fewer, tmp_path).shape != whole.shape, "no rooms: things make the plan"
    with pytest.raises(ValueError, match="nothing to draw"):
        floor_plan(StoreyView("empty"), tmp_path / "x.png")
    assert not (tmp_path / "x.png").exists()


def test_a_plan_counts_what_it_shows_and_says_what_it_leaves_out(tmp_path):
    """Things near to the rooms make it larger; far ones and those without a shape are named."""
    bare = replace(two_rooms(), objects=[], path=[])
    mesh = box_mesh((0, 0, bare.elevation), (1, 1, bare.elevation + 1))
    boxes = {
        "in": shapely.box(1, 1, 2, 2),
        "near": shapely.box(14, 0, 15, 1),
        "far": shapely.box(60, 0, 61, 1),
        "flat": None,
    }
    things = [ObjectView(name, ("desk",), mesh, shape) for name, shape in boxes.items()]
    plan = replace(bare, objects=things)
    assert left_out(plan) == {"without a shape": ["flat"], "beyond the plan": ["far"]}
    only = replace(bare, objects=things[:2])
    assert left_out(only) == {}
    texts = []
    floor_plan(plan, tmp_path / "plan.svg", over=lambda axes: texts.append(axes.figure.texts))
    assert "2 objects  ·  1 without a shape  ·  1 beyond the plan" in texts[0][0].get_text()
    assert drawn(plan, tmp_path).shape == drawn(only, tmp_path).shape
    assert drawn(only, tmp_path).shape != drawn(bare, tmp_path).shape
    ground = ObjectView("ground", ("object",), mesh, shapely.box(-99, -99, 99, 99))
    assert (
        drawn(replace(only, objects=[*things[:1], ground]), tmp_path).shape
        == drawn(replace(only, objects=things[:1]), tmp_path).shape
    )
    lawns = [ObjectView("lawn", ("object",), mesh, shapely.box(5, 0, x, 9)) for x in (99, 999)]
    wide, wider = (replace(only, objects=[lawn]) for lawn in lawns)
    assert left_out(wide) == {}
    assert drawn(wide, tmp_path).shape == drawn(wider, tmp_path).shape, "cut 10 m from the rooms"


def test_the_name_of_an_object_is_on_it_or_in_its_hole() -> None:
    angle = shapely.box(0, 0, 3, 3) - shapely.box(0.5, 0.7, 3, 3)
    middle = middle_of_object(angle)
    assert not angle.covers(angle.centroid)
    assert middle.distance(angle.boundary) > 0.3
    ring = shapely.Point(1, 2).buffer(1) - shapely.Point(1, 2).buffer(0.8)
    assert middle_of_object(ring).distance(shapely.Point(1, 2)) < 1e-6
    both = shapely.union(angle, shapely.box(3.1, 0, 3.2, 0.1))
    assert angle.covers(middle_of_object(both))


def test_a_small_scale_shows_doors_as_their_openings(tmp_path):
    """Rooms of 4.8 m in 60 columns: each door of 1 m is a line of its length, and nothing else."""
    rooms, doors = [], []
    for i in range(60):
        rooms.append(RoomView(f"r{i}", shapely.box(5 * i, 0, 5 * i + 4.8, 5), 0.0, 2.5))
        poses = Pose.planar(5 * i + 4.4, 0.6, 0.0), Pose.planar(5 * i + 5.4, 0.6, math.pi)
        doors.append(DoorView(f"d{i}", poses, 1.0, "door", "open"))
    storey = StoreyView("long", rooms=rooms, doors=doors[:-1])
    picture = pixels(floor_plan(storey, tmp_path / "long.png", width=13, dpi=400))
    found = np.abs(picture - to_rgb(STATES["open"])).max(axis=-1) < 0.02
    found[-int(0.95 * 400) :] = False  # the legend
    per_metre = 400 * 12.1 / (300 - 0.2 + 1.1)
    columns = np.flatnonzero(found.any(axis=0))
    lines = np.split(columns, np.flatnonzero(np.diff(columns) > 1) + 1)
    assert len(lines) == 59
    heights = [found[:, line].sum(axis=0).max() for line in lines]
    assert heights == pytest.approx([per_metre] * 59, abs=2)
