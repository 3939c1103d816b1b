from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image
from shapely import box

from semmap.draw.palette import BOX_COLOURS, PATH
from semmap.draw.scene3d import scene3d
from semmap.draw.view import RegionView, RoomView, StoreyView
from semmap.geometry.mesh import Mesh
from tests.draw.storeys import box_view, two_rooms


def drawn(storeys, tmp_path, **more) -> np.ndarray:
    path = scene3d(storeys, tmp_path / "scene.png", width=500, **more)
    return np.asarray(Image.open(path).convert("RGB"), float) / 255


def share(picture: np.ndarray, colour: str) -> float:
    return float((np.abs(picture - to_rgb(colour)).max(axis=-1) < 0.06).mean())


def changed(a: np.ndarray, b: np.ndarray) -> float:
    return float((np.abs(a - b).max(axis=-1) > 0.1).mean())


def test_each_room_has_a_box_in_a_different_colour(tmp_path):
    storey = replace(two_rooms(), path=[])
    boxed, bare = drawn([storey], tmp_path), drawn([storey], tmp_path, boxes=False)
    assert boxed.shape[1] == 500
    for colour in BOX_COLOURS[:2]:
        assert share(boxed, colour) > 0.0005
        assert share(bare, colour) == 0


def test_a_route_is_drawn(tmp_path):
    assert share(drawn([two_rooms()], tmp_path, boxes=False), PATH) > 0.001


def test_walls_are_cut_and_the_ceiling_is_left_out(tmp_path):
    storey = replace(two_rooms(), path=[], regions=[])
    without = replace(storey, objects=[o for o in storey.objects if o.name != "ceiling"])
    cut = drawn([storey], tmp_path, boxes=False)
    np.testing.assert_array_equal(cut, drawn([without], tmp_path, boxes=False))
    higher = drawn([storey], tmp_path, boxes=False, cut=2.4)
    assert higher.shape[0] > cut.shape[0]


def test_objects_on_the_floor_are_seen(tmp_path):
    storey = replace(two_rooms(), path=[])
    more = replace(
        storey, objects=[*storey.objects, box_view("sofa1", ("sofa",), (1, 1, 0), (3, 2, 0.8))]
    )
    assert changed(drawn([storey], tmp_path), drawn([more], tmp_path)) > 0.005


def test_storeys_do_not_hide_each_other(tmp_path):
    lower, upper = two_rooms(0.0, name="low"), two_rooms(2.8, name="high")
    one, two = drawn([lower], tmp_path), drawn([upper, lower], tmp_path)
    assert two.shape[0] > 1.6 * one.shape[0]
    for colour in BOX_COLOURS[:4]:
        assert share(two, colour) > 0.0002


def test_types_of_objects_are_written_on_request(tmp_path):
    plain = drawn([two_rooms()], tmp_path, boxes=False)
    named = drawn(
        [two_rooms()], tmp_path, boxes=False, object_labels=True, title="what stands where"
    )
    assert named.shape[0] == plain.shape[0] + 130
    assert changed(named[130:], plain) > 0.002


def test_an_object_without_faces_is_left_out_and_an_empty_picture_refused(tmp_path):
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    odd = replace(box_view("x", ("chair",), (1, 1, 0), (2, 2, 1)), mesh=empty)
    storey = replace(two_rooms(), objects=[odd])
    assert drawn([storey], tmp_path).shape[1] == 500
    with pytest.raises(ValueError, match="the picture is empty"):
        scene3d([StoreyView("empty")], tmp_path / "none.png")


def test_a_mesh_seen_alone_fills_the_picture(tmp_path):
    cube = replace(
        two_rooms(),
        rooms=[],
        doors=[],
        regions=[],
        path=[],
        objects=[box_view("box1", ("container",), (0, 0, 0), (1, 1, 1))],
    )
    picture = drawn([cube], tmp_path, boxes=False)
    assert (picture.sum(axis=-1) < 2.4).mean() > 0.4


@pytest.mark.parametrize(
    ("low", "blocked", "opens"), [(-1.7, True, True), (0.0, True, False), (-1.7, False, False)]
)
def test_a_blocked_region_below_the_floor_is_an_opening_in_it(tmp_path, low, blocked, opens):
    pit = replace(box_view("pit", ("box",), (1, 1, -1.6), (2, 2, -1.4)), colour="#ff0000")
    stairs = RegionView("stairs", box(1, 1, 2, 2), ("staircase",), blocked, low, 2.0)
    room = RoomView("hall", box(0, 0, 4, 3), 0.0, 2.5, ("room",))
    hall = StoreyView("cellar", 0.0, rooms=[room], objects=[pit], regions=[stairs])
    picture = drawn([hall], tmp_path, boxes=False, elevation=89)
    red = (picture[..., 0] > 0.5) & (picture[..., 1:] < 0.2).all(axis=-1)
    assert (red.mean() > 0.03) == opens
    marked = RoomView("stairs", stairs.outline, -1.7, 2.0)
    boxed = drawn([hall], tmp_path, boxes=False, elevation=89, marked=[marked])
    assert share(boxed, BOX_COLOURS[0]) > 0.001 >= share(picture, BOX_COLOURS[0])
