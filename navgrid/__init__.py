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
    from navgrid.cost_source import CostSource as CostSource
    from navgrid.costmap import Costmap as Costmap
    from navgrid.costmap import Inflation as Inflation
    from navgrid.grid import Grid as Grid
    from navgrid.grid import scene_grid as scene_grid
    from navgrid.inflation import inflate as inflate
    from navgrid.map_file import MapFileError as MapFileError
    from navgrid.map_file import read_map as read_map
    from navgrid.map_file import write_map as write_map
    from navgrid.nav2 import write_nav2 as write_nav2
    from navgrid.occupancy_grid import StoreyGrid as StoreyGrid
    from navgrid.occupancy_grid import storey_grid as storey_grid
    from navgrid.policy import Policy as Policy
    from navgrid.slabs import occupancy as occupancy
    from navgrid.terrain import DriveLimits as DriveLimits

__getattr__, __all__ = load_on_use(__name__)
