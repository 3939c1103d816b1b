"""Occupancy grids and layered costmaps from a semantic map, and their files for Nav2.

Importing this package is cheap: a name is loaded from its module on first use.

Examples
--------
The cells that an object occupies, inflated, written for Nav2 and read back:

>>> import tempfile
>>> from navgrid import Grid, inflate, occupancy, read_map, write_map
>>> from semmap.geometry.mesh import box_mesh
>>> table = box_mesh((1.02, 1.02, 0.0), (2.48, 1.98, 0.75))
>>> grid = Grid.around((0.0, 0.0), (3.4, 2.9), resolution=0.1)
>>> cells = occupancy((table.vertices, table.faces), [(0.05, 1.8)], grid)[0]
>>> costs = inflate(
...     cells, 0.1, inscribed_radius=0.2, inflation_radius=0.5, cost_scaling_factor=3.0
... )
>>> int((costs == 254).sum()), int((costs == 253).sum())
(150, 104)
>>> with tempfile.TemporaryDirectory() as folder:
...     path = write_map(grid, (100 * cells).astype("int8"), f"{folder}/map")
...     _, back = read_map(path)
>>> int((back == 100).sum())
150
"""

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from navgrid.cost_source import CostSource
    from navgrid.costmap import Costmap, Inflation
    from navgrid.grid import Grid, scene_grid
    from navgrid.inflation import inflate
    from navgrid.map_file import MapFileError, read_map, write_map
    from navgrid.nav2 import write_nav2
    from navgrid.occupancy_grid import StoreyGrid, storey_grid
    from navgrid.policy import Policy
    from navgrid.slabs import occupancy
    from navgrid.terrain import DriveLimits

__all__ = [
    "CostSource",
    "Costmap",
    "DriveLimits",
    "Grid",
    "Inflation",
    "MapFileError",
    "Policy",
    "StoreyGrid",
    "inflate",
    "occupancy",
    "read_map",
    "scene_grid",
    "storey_grid",
    "write_map",
    "write_nav2",
]

_MODULES = {
    "Costmap": "costmap",
    "CostSource": "cost_source",
    "Inflation": "costmap",
    "Grid": "grid",
    "scene_grid": "grid",
    "inflate": "inflation",
    "MapFileError": "map_file",
    "read_map": "map_file",
    "write_map": "map_file",
    "write_nav2": "nav2",
    "occupancy": "slabs",
    "Policy": "policy",
    "StoreyGrid": "occupancy_grid",
    "storey_grid": "occupancy_grid",
    "DriveLimits": "terrain",
}

__getattr__ = load_on_use(
    __name__, {name: f"navgrid.{module}" for name, module in _MODULES.items()}
)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
