"""Grasps, places and pushes by methods of a map; trimesh, Shapely and yourdfpy judge them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh
import yourdfpy

from semmap import Map
from semmap.geometry.pose import Pose
from semmap.manipulation.gripper_reader import read_gripper
from semmap.manipulation.retrieval import DEFAULT_GRIPPER
from semmap.manipulation.store.model_shapes import model_mesh
from tests.manipulation.grippers import real_gripper, urdf
from tests.seen import seen_by

BOX, VASE = "SeasoningBox_01", "Vase_01"
TABLE = shapely.box(1.2 - 0.8, 1.0 - 0.4, 1.2 + 0.8, 1.0 + 0.4)
TOP = 0.75
READY = {"panda_joint2": -0.6, "panda_joint4": -2.2, "panda_joint6": 1.6, "panda_joint7": 0.8}


def placed(map: Map, name: str) -> trimesh.Trimesh:
    """The mesh of an object in the map's frame."""
    mesh: trimesh.Trimesh = model_mesh(seen_by(map.connection), name).copy()
    pose = map[name].pose
    assert pose is not None
    mesh.apply_transform(pose.matrix)
    return mesh


@pytest.mark.parametrize("name", [BOX, VASE])
def test_the_fingers_of_a_grasp_close_on_the_object(house: Map, name: str) -> None:
    found = house.grasps(name, limit=15)
    assert found.generated == [name]
    assert not found.problems
    assert len(found) == len(found.rows) > 5
    mesh = placed(house, name)
    half = read_gripper(DEFAULT_GRIPPER).opening / 2
    across = []
    for row in found:
        centre, axis = row["pose"].matrix[:3, 3], half * row["pose"].matrix[:3, 0]
        ends, _, _ = mesh.ray.intersects_location(
            [centre - axis, centre + axis], [axis, -axis], multiple_hits=False
        )
        if len(ends) == 2:  # else the middle of the pads is beside an edge
            across.append(abs((ends[0] - ends[1]) @ axis) / half - row["width"])
    assert len(across) > 2 / 3 * len(found)
    assert max(across) < 0.005, "the pads are beside it"
    # The neck of a vase is thinner than its belly, which the pads touch, too.
    assert np.median(across) > -0.012
    assert not house.grasps(name).generated, "they are stored now"
    of_type = house.grasps(house[name].type, limit=15)
    assert [row["action_id"] for row in of_type] == [row["action_id"] for row in found]


def test_an_object_is_placed_free_and_level_on_its_support(house: Map) -> None:
    found = house.places(BOX, "table", towards=(0.7, 1.2), limit=4)
    vase = shapely.convex_hull(shapely.MultiPoint(placed(house, VASE).vertices[:, :2]))
    distances = []
    for row in found:
        corners = row["spot"].apply(model_mesh(seen_by(house.connection), BOX).vertices)
        assert corners[:, 2].min() == pytest.approx(TOP, abs=5e-3)
        outline = shapely.convex_hull(shapely.MultiPoint(corners[:, :2]))
        assert TABLE.buffer(1e-6).contains(outline)
        assert outline.disjoint(vase)
        distances.append(math.dist(row["spot"].matrix[:2, 3], (0.7, 1.2)))
    assert len(distances) == 4
    assert distances == sorted(distances)


def test_a_push_goes_its_distance_in_its_direction(house: Map) -> None:
    found = house.pushes(BOX, distance=0.05)
    assert len(found) > 0
    for row in found:
        way = row["end"].matrix[:3, 3] - row["pose"].matrix[:3, 3]
        assert np.linalg.norm(way) == pytest.approx(0.05)
        assert way[2] == pytest.approx(0, abs=1e-6)
        turn = row["direction"] - math.degrees(math.atan2(way[1], way[0]))
        assert abs((turn + 180) % 360 - 180) < 0.1


def test_objects_are_named_by_function_point_and_shape(cups: Map) -> None:
    by_name = cups.grasps("cup1", gripper="two_fingers", stored=True)
    assert by_name.problems == ["no grasp is stored for such an object"]
    own = cups.database.add_gripper(urdf("panda"), "hand")
    (best,) = cups.grasps("cup1", gripper=own, limit=1)
    for asked in ({"for_": "drink"}, {"at": (1.2, 1.4, 0.8)}):
        drinks = cups.grasps(gripper=own, limit=1000, **asked)
        assert {row["entity"] for row in drinks} <= {"cup1", "cup2", "bottle"}
        assert drinks
    size = cups.find_shapes(["cup1"])[0]["size"]
    alike = cups.grasps(shape=("cylinder", *size), gripper=own, tolerance=1e-6, limit=1000)
    assert best["action_id"] in {row["action_id"] for row in alike}
    none = cups.grasps(shape=("cylinder", *[2 * v for v in size]), gripper=own, stored=True)
    assert none.problems == ["no grasp of a similar cylinder is stored"]
    assert "<td>cup1</td>" in cups.grasps("cup1", gripper=own, limit=1)._repr_html_()


def test_a_planned_motion_ends_at_the_grasp(cups: Map) -> None:
    cups.database.add_manipulator(urdf("panda"), "panda")
    base = (0.85, 1.0, 0.6, 0.7)
    found = cups.grasps("cup1", robot="panda", base=base, plan=True, state=READY)
    motion, (row,) = found.motion, found
    assert motion is not None
    assert row["path"] == motion.path
    assert row["to_pre_grasp"] == motion.to_pre_grasp.tolist()
    robot = yourdfpy.URDF.load(
        str(urdf("panda")), load_meshes=False, filename_handler=lambda file: file
    )
    robot.update_cfg(dict(zip(motion.joints, motion.approach[-1], strict=True)))
    gripper = real_gripper("panda")
    palm = Pose.planar(*base).matrix @ robot.get_transform(gripper.palm)
    np.testing.assert_allclose(palm @ gripper.frame, row["pose"].matrix, atol=5e-3)
    far = cups.grasps("cup1", robot="panda", base=(3.5, 1, 0))
    assert not far
    assert "panda reaches none of" in far.problems[0]


NAN = math.nan
REFUSED: dict[str, tuple[str, tuple[Any, ...], dict[str, Any], str]] = {
    "nothing asked": ("grasps", (), {}, "give one of name, for_, at and shape"),
    "two asked": ("grasps", ("cup1",), {"for_": "drinking"}, "give one of name"),
    "an empty shape": ("grasps", (), {"shape": ()}, "shape is a name and sizes"),
    "another shape": ("grasps", (), {"shape": ("torus", 1)}, "give one of sphere"),
    "a size of text": ("grasps", (), {"shape": ("sphere", "a")}, "is not a shape"),
    "a kind of a shape": ("grasps", (), {"shape": ("sphere", 1), "kind": "throw"}, "not one of"),
    "a point of two": ("grasps", (), {"at": (1, 2)}, "a point is x, y, z in metres"),
    "a point of text": ("grasps", (), {"at": "abc"}, "a point is x, y, z in metres"),
    "a tolerance": ("grasps", (), {"at": (1, 2, 3), "tolerance": NAN}, "the tolerance is nan"),
    "a NUL": ("grasps", ("cup\0",), {}, "cannot be stored"),
    "a NUL for": ("grasps", (), {"for_": "drink\0"}, "cannot be stored"),
    "no rows": ("grasps", ("cup1",), {"stored": True, "limit": -1}, "limit is -1"),
    "a kind": ("grasps", ("cup1",), {"kind": "throw"}, "throw is not one of grasp"),
    "a gripper": ("grasps", ("cup1",), {"gripper": "tow_fingers"}, "did you mean two_fingers"),
    "a file": ("grasps", ("cup1",), {"gripper": "gone.urdf"}, "gone.urdf: does not exist"),
    "a robot": ("grasps", ("cup1",), {"robot": "gone"}, "there is no robot gone"),
    "a base": ("grasps", ("cup1",), {"base": (1, 2, 0)}, "base: only for a robot"),
    "a plan": ("places", ("cup1", "table"), {"plan": True}, "plan: only for a robot"),
    "two hands": ("pushes", ("cup1",), {"robot": "a", "gripper": "wide"}, "has its own gripper"),
    "itself": ("places", ("cup1", "cup1"), {}, "cannot be put on itself"),
    "towards NaN": ("places", ("cup1", "table"), {"towards": (1, NAN)}, "is not a point"),
    "no places": ("places", ("cup1", "table"), {"limit": 0}, "limit is 0"),
    "a distance of NaN": ("pushes", ("cup1",), {"distance": NAN}, "distance is nan"),
    "no pushes": ("pushes", ("cup1",), {"limit": 0}, "limit is 0"),
    "an unknown shape": ("find_shapes", (["cup3"],), {}, "no entity cup3; did you mean cup"),
    "an action": ("record_attempt", ("cup1", 999999, "completed"), {}, "there is no action 999999"),
    "a huge one": ("record_attempt", ("cup1", 2**70, "completed"), {}, "there is no action 11805"),
    "an outcome": (
        "record_attempt",
        ("cup1", None, "won"),
        {},
        "outcome of an attempt is completed or error",
    ),
    "a message": ("record_attempt", ("cup1", None, "error"), {"message": "\0"}, "cannot be stored"),
    "no tries": ("practise", ("cup1",), {"tries": 0}, "tries is 0"),
    "both": (
        "practise",
        ("cup1",),
        {"on": "table", "push": True},
        "give one of on, push, open_ and turn",
    ),
    "no tasks": ("list_manipulations", (-1,), {}, "limit is -1"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_input_is_refused_in_words(cups: Map, case: str) -> None:
    method, words, options, message = REFUSED[case]
    with pytest.raises((ValueError, LookupError), match=message) as refused:
        getattr(cups, method)(*words, **options)
    assert type(refused.value) not in (KeyError, IndexError)
