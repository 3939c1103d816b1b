"""Parts of meshes by hand and against trimesh."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from semmap.geometry.mesh import Mesh, box_mesh, join
from semmap.geometry.parts import closed_parts

BOX = box_mesh((0, 0, 0), (1, 1, 1))
FAR = box_mesh((3, 0, 0), (4, 1, 1))
LID_OFF = Mesh(FAR.vertices, FAR.faces[1:])


def test_parts_and_which_are_closed() -> None:
    part, closed = closed_parts(join([BOX, LID_OFF]))
    assert part.tolist() == [0] * 12 + [1] * 11
    assert closed.tolist() == [True, False]


def test_doubled_corners_do_not_part() -> None:
    soup = Mesh(BOX.triangles.reshape(-1, 3), np.arange(36, dtype=np.int32).reshape(-1, 3))
    part, closed = closed_parts(soup)
    assert (part.max(), closed.tolist()) == (0, [True])


def test_boxes_that_touch_are_one_closed_part() -> None:
    part, closed = closed_parts(join([BOX, box_mesh((1, 0, 0), (2, 1, 1))]))
    assert (part.max(), closed.tolist()) == (0, [True])


def test_none() -> None:
    part, closed = closed_parts(Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32)))
    assert len(part) == len(closed) == 0


@pytest.mark.parametrize("drop", [0, 7])
def test_a_ball_as_trimesh_sees_it(drop: int) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    faces = np.asarray(ball.faces[drop:], np.int32)
    _, closed = closed_parts(Mesh(np.asarray(ball.vertices, float), faces))
    assert closed.tolist() == [trimesh.Trimesh(ball.vertices, faces).is_watertight]
