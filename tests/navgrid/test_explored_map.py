"""The map of a SLAM program: what a scanner saw of rooms that are known, by cells drawn here."""

import numpy as np
import pytest
import shapely
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


def test_walls_are_the_occupied_cells_and_the_border_is_not_free(tmp_path):
    shades = scan(7)
    world = read_explored_map(write(tmp_path, shades))
    assert world.name == tmp_path.name
    of = {entry.name: entry.shapes[0].outline for entry in world.entries if entry.kind == "object"}
    assert set(of) == {"walls", "obstacles", "unexplored"}
    assert sum(of[n].area for n in ("walls", "obstacles")) == pytest.approx(
        (shades == 0).sum() * SIDE**2
    )
    cells = shades[::-1]
    free = cells == 254
    touched = np.zeros_like(free)  # unknown cells with a free neighbour, by shifts alone
    padded = np.pad(free, 1)
    for down in (0, 1, 2):
        for right in (0, 1, 2):
            touched |= padded[down : down + free.shape[0], right : right + free.shape[1]]
    rim = touched & (cells == 205)
    assert of["unexplored"].area == pytest.approx(rim.sum() * SIDE**2)
    rows, columns = np.nonzero(rim)
    x, y = ORIGIN[0] + (columns + 0.5) * SIDE, ORIGIN[1] + (rows + 0.5) * SIDE
    assert shapely.contains_xy(of["unexplored"], x, y).all()


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
