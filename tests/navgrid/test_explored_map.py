"""The map of a SLAM program: what a scanner saw of rooms that are known, by cells drawn here."""

import numpy as np
import pytest
import shapely
import shapely.affinity
from PIL import Image

import semmap
from navgrid.explored_map import is_map_file, read_explored_map
from semmap.ingest.world import WorldError
from tests.buildings.found_rooms import score_doors, score_rooms

SIDE, ORIGIN = 0.05, (-3.0, 2.0)
ROOMS = [shapely.box(0, 3, 4, 7), shapely.box(4.15, 3, 9, 7), shapely.box(0, 7.15, 9, 9)]
DOORS = [shapely.box(4, 4, 4.15, 4.9), shapely.box(1, 7, 1.9, 7.15), shapely.box(6, 7, 6.9, 7.15)]


def scan(seed: int, furnished: bool = True) -> np.ndarray:
    """Grey shades (rows from the top): walls noisy by a cell, chairs as legs, unknown outside."""
    rng = np.random.default_rng(seed)
    rows, columns = 200, 280
    y, x = np.mgrid[:rows, :columns]
    x, y = ORIGIN[0] + (x + 0.5) * SIDE, ORIGIN[1] + (y + 0.5) * SIDE
    free = shapely.contains_xy(shapely.union_all([*ROOMS, *DOORS]), x, y)
    near = shapely.contains_xy(shapely.union_all([*ROOMS, *DOORS]).buffer(0.12), x, y)
    cells = np.full((rows, columns), 205, np.uint8)
    cells[near] = 0
    cells[free] = 254
    edge = near & ~free & (rng.random(cells.shape) < 0.03)
    cells[edge] = 205  # a scanner misses some of a wall
    if furnished:
        for _ in range(12):
            row, column = rng.integers(40, 130), rng.integers(75, 230)
            cells[row : row + 2, column : column + 2] = np.where(
                cells[row : row + 2, column : column + 2] == 254, 0, cells[row, column]
            )
    return cells[::-1]


BED, CUPBOARD, TABLE, SOFA = (
    shapely.box(1.2, 5.0, 2.8, 7.0),  # at a wall to the next room
    shapely.box(8.2, 3.0, 9.0, 4.2),  # in a corner of the building
    shapely.box(5.5, 4.5, 7.0, 5.3),
    shapely.box(2.5, 7.8, 4.3, 8.6),  # a scanner sees its outline
)


def furnished_scan(turn: float) -> np.ndarray:
    """Grey shades of the rooms with furniture, turned about the middle of the image."""
    y, x = (np.mgrid[:280, :280] + 0.5) * SIDE
    middle = np.array([4.5, 6.0])
    cos, sin = np.cos(turn), np.sin(turn)
    x, y = x - 7.0, y - 7.0
    at = (cos * x + sin * y + middle[0], cos * y - sin * x + middle[1])
    space = shapely.union_all([*ROOMS, *DOORS])
    shades = np.full((280, 280), 205, np.uint8)
    shades[shapely.contains_xy(space.buffer(0.12), *at)] = 0
    things = shapely.union_all([BED, CUPBOARD, TABLE, SOFA.difference(SOFA.buffer(-0.1))])
    shades[shapely.contains_xy(space.difference(things), *at)] = 254
    return shades[::-1]


def test_furniture_divides_no_room_and_opens_no_wall(database, tmp_path):
    with semmap.connect(database) as db:
        db.import_file(write(tmp_path, furnished_scan(0.0)), map="lived_in", find_rooms=True)
        outlines = [room.footprint for room in db.map("lived_in").rooms]
    known = [shapely.affinity.translate(r, ORIGIN[0] + 2.5, ORIGIN[1] + 1.0) for r in ROOMS]
    scores = score_rooms(known, outlines)
    assert (scores.recall, scores.precision) == (1.0, 1.0)
    assert all(max(k.intersection(f).area for f in outlines) > 0.9 * k.area for k in known)


@pytest.mark.parametrize("turn", [0.0, 0.3, 0.6, 1.4])
def test_walls_go_on_behind_furniture(tmp_path, turn):
    world = read_explored_map(write(tmp_path, furnished_scan(turn)))
    of = {entry.name: entry.shapes[0].outline for entry in world.entries if entry.shapes}
    space = shapely.union_all([*ROOMS, *DOORS])
    things = shapely.union_all([BED, CUPBOARD, TABLE, SOFA])
    built = space.buffer(0.12).difference(space)
    cos, sin = np.cos(turn), np.sin(turn)

    def placed(shape):
        return shapely.transform(
            shape, lambda xy: (xy - [4.5, 6.0]) @ [[cos, sin], [-sin, cos]] + np.add(ORIGIN, 7.0)
        )

    walls, obstacles = of["walls"], of["obstacles"]
    assert obstacles.intersection(placed(built)).area < 0.05 * built.area
    assert walls.intersection(placed(things.buffer(-0.1))).area < 0.03 * things.area


def write(folder, shades):
    Image.fromarray(shades).save(folder / "map.pgm")
    path = folder / "map.yaml"
    path.write_text(
        f"image: map.pgm\nmode: trinary\nresolution: {SIDE}\norigin: [{ORIGIN[0]}, "
        f"{ORIGIN[1]}, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return path


@pytest.mark.parametrize("seed", range(4))
def test_rooms_and_doors_of_a_scan_are_found_and_driven(database, tmp_path, seed):
    path = write(tmp_path, scan(seed))
    assert is_map_file(path)
    with semmap.connect(database) as db:
        summary = db.import_file(path, map="scanned", find_rooms=True)
        house = db.map("scanned")
        rooms = score_rooms(ROOMS, [room.footprint for room in house.rooms])
        assert (rooms.recall, rooms.precision) == (1.0, 1.0)
        known = [[door.centroid.coords[0]] for door in DOORS]
        doors = [[door.pose.translation] for door in house.doors]
        assert (len(doors), score_doors(known, doors).recall) == (len(known), 1.0)
        first, *_, last = (room.name for room in house.rooms)
        assert house.route(first, last).metres > 1
        assert "found 3 rooms, 3 doorways" in " ".join(summary.notes)


def test_occupied_cells_are_walls_or_obstacles_and_the_border_is_not_free(tmp_path):
    shades = scan(7)
    world = read_explored_map(write(tmp_path, shades))
    assert world.name == tmp_path.name
    of = {entry.name: entry.shapes[0].outline for entry in world.entries if entry.kind == "object"}
    assert set(of) == {"walls", "obstacles", "unexplored"}
    cells = shades[::-1]
    free = cells == 254
    near = free
    for _ in range(3):  # 0.15 m of what is unknown is as solid as walls, by shifts alone
        padded = np.pad(near, 1)
        near = np.zeros_like(free)
        for down in (0, 1, 2):
            for right in (0, 1, 2):
                near |= padded[down : down + free.shape[0], right : right + free.shape[1]]
    solid = (shades[::-1] == 0) | (near & (cells == 205))
    covered = shapely.union_all(list(of.values()))
    assert covered.area == pytest.approx(solid.sum() * SIDE**2)
    rows, columns = np.nonzero(solid)
    x, y = ORIGIN[0] + (columns + 0.5) * SIDE, ORIGIN[1] + (rows + 0.5) * SIDE
    assert shapely.contains_xy(covered, x, y).all()
    assert not shapely.contains_xy(of["obstacles"], x, y)[shades[::-1][rows, columns] != 0].any()


def test_walls_of_a_coarse_scan_are_read(tmp_path):
    """Cells wider than the piece of a wall that is straightened."""
    shades = np.random.default_rng(1).integers(0, 256, (7, 9)).astype(np.uint8)
    path = write(tmp_path, shades)
    path.write_text(path.read_text().replace(f"resolution: {SIDE}", "resolution: 1.0"))
    assert read_explored_map(path).entries


@pytest.mark.parametrize(
    ("resolution", "says"),
    [
        ("1.0e-9", "resolution: is 1e-09: a cell is narrower than 0.005 m"),
        ("1.0e+9", "image: reaches 8,999,999,997 m, the limit is 10,000 m. Give metres of a cell"),
    ],
)
def test_cells_of_no_building_are_refused(tmp_path, resolution, says):
    """Pieces of walls would have billions of cells; the database has no numbers so large."""
    path = write(tmp_path, np.zeros((7, 9), np.uint8))
    path.write_text(path.read_text().replace(f"resolution: {SIDE}", f"resolution: {resolution}"))
    with pytest.raises(WorldError, match=says):
        read_explored_map(path)


def test_files_that_are_no_map_of_a_building_are_refused(tmp_path):
    path = write(tmp_path, np.full((20, 20), 254, np.uint8))
    with pytest.raises(WorldError, match="no occupied cell"):
        read_explored_map(path)
    (tmp_path / "map.pgm").unlink()
    with pytest.raises(WorldError, match="image"):
        read_explored_map(path)
    building = tmp_path / "a.building.yaml"
    building.write_text("levels: {}\nname: a\n")
    assert not is_map_file(building)


FLOW = "image: map.pgm, resolution: 1, origin: [0, 0, 0], negate: 0"


@pytest.mark.parametrize(
    "text",
    [
        f"{{{FLOW}}}",
        f"# a comment\n---\n!!map {{\n {FLOW}}}\n",
        '{"image": "map.pgm", "resolution": 1, "origin": [0, 0, 0], "negate": 0}',
        "? image\n: map.pgm\n? resolution\n: 1\n? origin\n: [0, 0, 0]\n? negate\n: no\n",
        "a: &a\n  image: map.pgm\n  resolution: 1\n<<: *a\norigin: [0, 0, 0]\nnegate: 0\n",
        f"{'# long' * 1000}\nimage : map.pgm\nresolution : 1\norigin : [0, 0, 0]\nnegate : 0\n",
    ],
)
def test_a_map_in_any_style_of_yaml_is_imported(database, tmp_path, text):
    shades = np.full((9, 9), 254, np.uint8)
    shades[0] = shades[-1] = shades[:, 0] = shades[:, -1] = 0
    Image.fromarray(shades).save(tmp_path / "map.pgm")
    (tmp_path / "map.yaml").write_text(text)
    with semmap.connect(database) as db:
        assert db.import_file(tmp_path / "map.yaml", map="flow").kinds["storey"] == 1


def test_a_building_with_an_image_is_not_a_map(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("lifts: {image: a.png, resolution: 1}\nlevels: {}\n")
    assert not is_map_file(path)


def test_a_resolution_that_is_true_is_refused(tmp_path):
    path = tmp_path / "map.yaml"
    path.write_text(FLOW.replace("1", "true").replace(", ", "\n", 2).replace(", neg", "\nneg"))
    with pytest.raises(WorldError, match="resolution: is True"):
        read_explored_map(path)
