"""The view of a storey for pictures, from its scene."""

from __future__ import annotations

import math

import numpy as np
import shapely

from semmap.draw.view import storey_view
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.query.storey_scene import SceneEntity, StoreyScene

SQUARE = shapely.box(0, 0, 2, 2)
SIDES = (Pose.planar(0.5, 1, 0.0), Pose.planar(1.5, 1, math.pi))
CUP = box_mesh((0, 0, 0), (1, 1, 1)).triangles
INVENTORY = (
    SceneEntity(1, "lab", "room", ("lab", "room"), footprint=SQUARE, floor=3.0, ceiling=5.5),
    SceneEntity(2, "attic", "room", ("room",), floor=6.0, ceiling=8.0),
    SceneEntity(3, "cup1", "object", ("cup", "object"), CUP, SQUARE),
    SceneEntity(4, "bed1", "object", ("bed", "object")),
    SceneEntity(5, "stairs", "region", ("staircase", "region"), footprint=SQUARE),
    SceneEntity(6, "home", "region", ("home_region", "region"), footprint=SQUARE),
    SceneEntity(7, "door1", "connector", ("door",), state="locked", form="door", sides=SIDES),
)


def test_a_view_has_the_inventory_of_the_scene_and_not_its_other_entities() -> None:
    above = SceneEntity(9, "pillar", "object", ("pillar",), CUP)
    scene = StoreyScene("upper", 3.0, (*INVENTORY, above), inventory=INVENTORY)
    view = storey_view(scene)
    assert (view.name, view.elevation) == ("upper", 3.0)
    (lab,) = view.rooms
    assert (lab.name, lab.low, lab.high, lab.types) == ("lab", 3.0, 5.5, ("lab", "room"))
    assert [(o.name, o.mesh is None) for o in view.objects] == [("cup1", False), ("bed1", True)]
    assert [(r.name, r.blocked) for r in view.regions] == [("stairs", True), ("home", False)]
    (door,) = view.doors
    assert (door.type, door.state, door.poses) == ("door", "locked", SIDES)


def test_the_mesh_of_an_object_has_its_triangles() -> None:
    scene = StoreyScene("upper", 3.0, (), inventory=(INVENTORY[2],))
    mesh = storey_view(scene).objects[0].mesh
    assert mesh is not None
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], CUP)
