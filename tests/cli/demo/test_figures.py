"""Figure 5 of a cellar: the opening in its floor, and the grids without and with the region."""

import numpy as np
import shapely
from matplotlib.colors import to_rgb
from PIL import Image

from navgrid.costmap import Costmap
from navgrid.grid import Grid
from semmap.cli.demo.figures import blocked_region
from semmap.draw.palette import BOX_COLOURS
from semmap.draw.view import ObjectView, storey_view
from semmap.geometry.mesh import box_mesh
from semmap.query.storey_scene import FloorArea, SceneEntity, StoreyScene
from tests.navgrid.scenes import part, square


def test_figure_5_has_the_region_and_its_grid(tmp_path):
    room = SceneEntity(
        1, "hall", "room", ("room",), footprint=shapely.box(0, 0, 4, 3), floor=0.0, ceiling=2.5
    )
    stairs = SceneEntity(
        2,
        "stairs",
        "region",
        ("staircase", "region"),
        footprint=shapely.box(1, 1, 2, 2),
        floor=-1.7,
        ceiling=2.0,
    )
    floors = (FloorArea("hall", room.footprint, 0.0),)
    scene = StoreyScene("cellar", 0.0, (stairs,), floors, (-0.5, 3.0), inventory=(room, stairs))
    costmap = Costmap(scene, [part("base", 0.0, 0.6, square(0.2))], Grid((0, 0), 0.05, (60, 80)))
    view = storey_view(scene)
    step = box_mesh((1, 1, -1.0), (2, 2, -0.8))
    view.objects.append(ObjectView("step", ("stair_flight",), step, stairs.footprint, "#ff0000"))
    path = blocked_region(costmap, view, tmp_path)
    assert [each.name for each in tmp_path.iterdir()] == [path.name] == ["figure5_staircase.png"]
    picture = np.asarray(Image.open(path).convert("RGB"), float) / 255
    left = picture[:, :1100]
    assert (np.abs(left - to_rgb(BOX_COLOURS[0])).max(axis=-1) < 0.06).sum() > 300, "its box"
    red = (left[..., 0] > 0.5) & (left[..., 1:] < 0.2).all(axis=-1)
    assert red.sum() > 3000, "what is below the floor"
    view.objects.clear()
    bare = np.asarray(Image.open(blocked_region(costmap, view, tmp_path)).convert("RGB"), float)
    np.testing.assert_array_equal(bare[:, 1100:] / 255, picture[:, 1100:])
    grids = np.array_split(picture[:, 1100:], 2, axis=1)
    without, with_it = ((np.abs(g - to_rgb("#c800c8")).max(axis=-1) < 0.1).mean() for g in grids)
    assert without == 0
    assert with_it > 0.05
