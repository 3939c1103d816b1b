"""What a Nav2 stack loads: read back by the documented rules of map_server and costmap_2d."""

from __future__ import annotations

import ast
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import yaml
from numpy.typing import NDArray
from PIL import Image

from navgrid.costmap import Costmap
from navgrid.grid import Grid, frame_name
from navgrid.map_file import map_layer, resampled, write_map
from navgrid.nav2 import as_occupancy, write_nav2
from semmap.query.storey_scene import SceneEntity
from tests.navgrid.scenes import ARM, BASE, region, room, scene, solid

GRID = Grid((-1.03, 0.4), 0.05, (60, 90))


@pytest.fixture
def costmap() -> Costmap:
    entities = [
        solid(1, (0.5, 1, 0.72), (1.5, 1.8, 0.76), "table"),
        solid(2, (0, 2.5, 0), (3, 2.6, 2), "wall", "building_element"),
        region(3, shapely.box(2, 0.5, 3, 1.2), "staircase"),
        region(4, shapely.box(0, 2, 1, 2.4), "speed_zone", speed_limit=0.5),
    ]
    return Costmap(scene(*entities, floors=(room("hall", -0.5, 0.5, 3, 3.2),)), [BASE, ARM], GRID)


def map_server(folder: Path, name: str) -> tuple[NDArray[np.int16], dict[str, object]]:
    """A map as `nav_msgs/OccupancyGrid` by map_server's rules (nav2_map_server, map_io.cpp)."""
    files = yaml.safe_load((folder / name).read_text())
    pixels = np.asarray(Image.open(folder / files["image"]).convert("L"), float)[::-1]
    if files["mode"] == "raw":
        raw = pixels.astype(np.int16)
        return np.where(raw > 100, -1, raw), files
    shade = pixels / 255 if files["negate"] else (255 - pixels) / 255
    found = np.full(shade.shape, -1, np.int16)
    found[shade > files["occupied_thresh"]] = 100
    found[shade < files["free_thresh"]] = 0
    return found, files


def static_layer(
    grid: NDArray[np.int16], params: dict[str, Any], inscribed: int | None
) -> NDArray[np.int16]:
    """Costs as costmap_2d's static layer makes them of a grid (static_layer.cpp, interpretValue).

    The thresholds are parameters of the costmap, not of its layer; versions since 2025 read
    `inscribed` as 253.
    """
    lethal = params.get("lethal_cost_threshold", 100)
    found = (grid / lethal * 254).astype(np.int16)
    if params.get("trinary_costmap", True):
        found[:] = 0
    found[grid >= lethal] = 254
    if inscribed is not None:
        found[grid == inscribed] = 253
    found[grid < 0] = 255 if params.get("track_unknown_space", False) else 0
    return found


def mask_filter(value: int, info: dict[str, Any]) -> float | None:
    """What a costmap filter makes of a cell of its mask; None for no effect.

    The message has float32 (CostmapFilterInfo); a speed filter takes ``base + multiplier * value``
    (speed_filter.cpp), a keepout filter the value as it is (keepout_filter.cpp).
    """
    base, multiplier = np.float32(info["base"]), np.float32(info["multiplier"])
    if info["type"] == 0:
        assert (base, multiplier) == (0, 1), "the filter refuses any other"
        return None if value == 0 else round(value * 254 / 100)
    assert value != -1, "the filter reports an error in an unknown cell"
    limit = float(base) + value * float(multiplier)
    assert 0 <= limit <= (100 if info["type"] == 1 else np.inf)
    return None if value == 0 else limit


def test_each_layer_and_the_master_are_read_back(costmap: Costmap, tmp_path: Path) -> None:
    files = write_nav2(costmap, tmp_path)
    assert set(files["maps"]) == {
        "master",
        "base",
        "arm",
        "localisation",
        "keepout_mask",
        "speed_mask",
        *(f"{p}_{la.name}" for p in ("base", "arm") for la in costmap.policy.layers),
    }
    for name, file in files["maps"].items():
        cells, head = map_server(tmp_path, file)
        assert cells.shape == GRID.shape, name
        assert head["resolution"] == GRID.resolution
        assert head["origin"] == [GRID.origin[0], GRID.origin[1], 0.0], "to the last digit"
    for number, part in enumerate(costmap.parts):
        for layer in costmap.policy.layers:
            cells, _ = map_server(tmp_path, f"{part.name}_{layer.name}.yaml")
            assert ((cells == 100) == costmap.occupied[layer.name][number]).all()
            assert ((cells == -1) == (costmap.unknown & (cells != 100))).all()
    assert json.loads((tmp_path / "costmap.json").read_text())["maps"] == files["maps"]


@pytest.mark.parametrize("inscribed", [None, 99])
def test_a_static_layer_reads_the_costs_back(
    costmap: Costmap, tmp_path: Path, inscribed: int | None
) -> None:
    write_nav2(costmap, tmp_path)
    params = yaml.safe_load((tmp_path / "nav2_params.yaml").read_text())
    params = params["global_costmap"]["global_costmap"]["ros__parameters"]
    for name, costs in (("master", costmap.master), ("base", costmap.costs[0])):
        back = static_layer(map_server(tmp_path, f"{name}.yaml")[0], params, inscribed)
        known = costs < 253
        assert (np.abs(back.astype(int) - costs)[known] <= 4).all()
        assert (back[known & (costs > 0)] > 0).all(), "no cost is lost"
        assert (back[known] < 253).all(), "no free cell is closed"
        assert (back[(costs == 253) | (costs == 254)] == 254).all(), "closed to a dot"
        assert (back[costs == 255] == 255).all()


def test_each_cost_has_an_occupancy() -> None:
    every = as_occupancy(np.arange(256, dtype=np.uint8)[None])[0]
    assert every[0] == 0
    assert every[255] == -1
    assert (every[[253, 254]] == 100).all()
    assert ((every[1:253] >= 1) & (every[1:253] <= 98)).all()
    assert (np.diff(every[:254].astype(int)) >= 0).all()


def test_the_parameters_describe_footprints_maps_and_filters(
    costmap: Costmap, tmp_path: Path
) -> None:
    write_nav2(costmap, tmp_path)
    params = yaml.safe_load((tmp_path / "nav2_params.yaml").read_text())
    footprints = params["robot_footprints"]["ros__parameters"]
    for part in costmap.parts:
        corners = np.array(ast.literal_eval(footprints[part.name]))
        np.testing.assert_allclose(corners, part.footprint, atol=1e-3)
    layers = params["global_costmap"]["global_costmap"]["ros__parameters"]
    assert layers["global_frame"] == "map_ground"
    assert layers["filters"] == ["keepout_filter", "speed_filter"]
    for kind, inside, effect in (("speed", (0.5, 2.2), 0.5), ("keepout", (2.5, 0.8), 254)):
        info = params[f"{kind}_filter_info_server"]["ros__parameters"]
        mask, _ = map_server(tmp_path, f"{kind}_mask.yaml")
        found = [mask_filter(int(v), info) for v in mask.ravel()]
        (number,) = {*found} - {None}
        assert number == pytest.approx(effect, abs=1e-6), "float32"
        assert found[np.ravel_multi_index(costmap.grid.cell(*inside), mask.shape)] == number
    for server in ("master_server", "map_server", "keepout_mask_server", "speed_mask_server"):
        files = params[server]["ros__parameters"]
        assert (tmp_path / files["yaml_filename"]).is_file()
        assert files["frame_id"] == "map_ground"


def test_the_bringup_serves_every_map_wherever_the_folder_lies(
    costmap: Costmap, tmp_path: Path
) -> None:
    files = write_nav2(costmap, tmp_path / "made")
    folder = (tmp_path / "made").rename(tmp_path / "moved")
    launch = ElementTree.parse(folder / files["bringup"]).getroot()
    params = yaml.safe_load((folder / files["params"]).read_text())
    nodes = {node.attrib["name"]: node for node in launch.iter("node")}
    served = set()
    for name, node in nodes.items():
        assert re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name), "as rcl wants names of nodes"
        values = {
            p.attrib["name"]: p.attrib["value"] for p in node.iter("param") if "name" in p.attrib
        }
        assert node.find("param").attrib["from"] == "$(dirname)/nav2_params.yaml"
        if node.attrib["exec"] == "map_server":
            path = Path(values["yaml_filename"].replace("$(dirname)", str(folder)))
            served.add(path.name)
            assert path.is_file()
            assert Path(params[name]["ros__parameters"]["yaml_filename"]).name == path.name
        elif node.attrib["exec"] == "lifecycle_manager":
            managed = set(yaml.safe_load(values["node_names"]))
    assert served == set(files["maps"].values())
    assert managed == nodes.keys() - {"lifecycle_manager_maps"}
    assert (folder / files["frames"]).is_file()
    topics = [
        node["ros__parameters"].get("topic_name") for name, node in params.items() if name in nodes
    ]
    assert len({*filter(None, topics)}) == len(served)


def test_every_parameter_is_below_ros__parameters(costmap: Costmap, tmp_path: Path) -> None:
    """The parser of rcl refuses a value above it."""
    write_nav2(costmap, tmp_path)
    params = yaml.safe_load((tmp_path / "nav2_params.yaml").read_text())

    def check(node: object, path: str) -> None:
        assert isinstance(node, dict), path
        for key, value in node.items():
            if key != "ros__parameters":
                check(value, f"{path}/{key}")

    check(params, "")


@pytest.mark.parametrize("name", ["master", "map", "keepout_mask", "base"])
def test_a_part_does_not_take_the_name_of_another_map(name: str, tmp_path: Path) -> None:
    made = Costmap(scene(), [BASE, replace(ARM, name=name)], GRID)
    with pytest.raises(ValueError, match=f"part {name}: another map .* rename the part"):
        write_nav2(made, tmp_path / "made")
    assert not [*tmp_path.iterdir()]


def test_objects_without_geometry_are_listed_in_the_files(tmp_path: Path) -> None:
    bed = SceneEntity(9, "bed1", "object", ("bed",))
    hall = room("hall", -0.5, 0.5, 3, 3.2)
    files = write_nav2(Costmap(scene(bed, floors=(hall,)), [BASE], GRID), tmp_path)
    assert files["no_geometry"] == ["bed1"]
    for name in ("master.yaml", "nav2_params.yaml"):
        assert "treated as free floor: bed1" in (tmp_path / name).read_text()


def test_the_localisation_map_is_the_section_at_the_laser(costmap: Costmap, tmp_path: Path) -> None:
    write_nav2(costmap, tmp_path, laser_height=0.74)
    table, _ = map_server(tmp_path, "localisation.yaml")
    assert table[costmap.grid.cell(1.0, 1.02)] == 100
    write_nav2(costmap, tmp_path, laser_height=0.3)
    shin, _ = map_server(tmp_path, "localisation.yaml")
    assert shin[costmap.grid.cell(1.0, 1.02)] == 0
    assert shin[costmap.grid.cell(1.0, 2.55)] == 100


@pytest.mark.parametrize(
    ("storey", "frame"),
    [("floor-1st", "map_floor_1st"), ("1. OG", "map_1_OG"), ("!", "map_storey")],
)
def test_each_storey_has_a_valid_frame_name(storey: str, frame: str) -> None:
    assert frame_name(storey) == frame


def test_a_slam_map_becomes_a_layer(tmp_path: Path) -> None:
    slam = Grid((-1.0, 0.5), 0.1, (20, 30))
    cells = np.zeros(slam.shape, np.int8)
    cells[5, 7:10] = 100
    cells[0] = -1
    path = write_map(slam, cells, tmp_path / "slam")
    layer = map_layer(path, GRID)
    x0, y0, x1, y1 = -1 + 0.7, 0.5 + 0.5, -1 + 1.0, 0.5 + 0.6
    r, c = np.mgrid[: GRID.shape[0], : GRID.shape[1]]
    squares = shapely.box(
        GRID.origin[0] + c * 0.05,
        GRID.origin[1] + r * 0.05,
        GRID.origin[0] + c * 0.05 + 0.05,
        GRID.origin[1] + r * 0.05 + 0.05,
    )
    wall = shapely.box(x0, y0, x1, y1)
    overlap = shapely.area(shapely.intersection(squares, wall))
    assert (layer == (overlap > 1e-6)).all()
    costmap = Costmap(scene(), [BASE], GRID, static={"slam": layer})
    assert (costmap.master[layer] == 254).all()
    assert costmap.explain(-0.2, 1.05)[0].entities == ("slam",)
    with pytest.raises(ValueError, match="give it that of the grid"):
        Costmap(scene(), [BASE], GRID, static={"slam": cells > 0})


def test_resampling_to_the_same_grid_changes_no_cell() -> None:
    cells = np.random.default_rng(2).random(GRID.shape) < 0.1
    assert (resampled(GRID, cells, GRID) == cells).all()


@pytest.mark.parametrize("side", [0.003, 0.01, 0.07, 0.3, 1e9])
def test_resampling_finds_each_cell_that_an_occupied_one_overlaps(side: float) -> None:
    """The widest cells took days: each was drawn cell by cell."""
    grid = Grid((0.013, -0.021), 0.05, (6, 8))
    source = Grid((-0.04, -0.09), side, (7, 9))
    occupied = np.random.default_rng(3).random(source.shape) < 0.3
    occupied[0, 0] = True

    def overlaps(axis: int) -> np.ndarray:
        """Whether a cell of the grid and one of the source overlap, along an axis."""
        low = grid.origin[axis] + np.arange(grid.shape[1 - axis])[:, None] * grid.resolution
        begin = source.origin[axis] + np.arange(source.shape[1 - axis]) * side
        return (low < begin + side) & (begin < low + grid.resolution)

    expected = overlaps(1).astype(int) @ occupied @ overlaps(0).T.astype(int) > 0
    assert (resampled(source, occupied, grid) == expected).all()
