"""Parts on joints at any position of theirs: how far they move by default, and what is refused."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import psycopg
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import semmap
from semmap.geometry.pose import Pose
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.moving_part import MovingPart
from semmap.query.snapshot import Snapshot
from tests.conftest import MakeDatabase


@pytest.fixture(scope="module")
def session(make_database: MakeDatabase) -> Iterator[psycopg.Connection[Any]]:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        db.create_map("hall")
        yield db.session


def flap(at: float, low: float | None, high: float | None, kind: str = "revolute") -> MovingPart:
    """A flap at a position of its joint, about or along an axis at a slant through (1, 2, 3)."""
    axis, point = np.array((1.0, 2, 2)) / 3, np.array((1.0, 2, 3))
    moved = np.eye(4)
    if kind == "prismatic":
        moved[:3, 3] = at * axis
    else:
        moved[:3, :3] = Rotation.from_rotvec(at * axis).as_matrix()
        moved[:3, 3] = point - moved[:3, :3] @ point
    closed = Pose(0.3, -1, 0.5, 0, 0, math.sin(0.4), math.cos(0.4))
    joint = {"type": kind, "axis": (1, 2, 2), "point": (1, 2, 3), "lower": low, "upper": high}
    placed = Pose.from_matrix(closed.matrix @ moved)
    mesh = trimesh.creation.box((0.1, 0.2, 0.3))
    return MovingPart("flap", mesh, placed, (), None, joint | {"closed": [*closed]}, placed)


@pytest.mark.parametrize(
    ("at", "low", "high", "opens", "turns"),
    [
        (0, 0, 1.4, 1.4, 1.4),
        (0.6, 0, 1.4, 0.8, -0.6),
        (3.8, 0, 4.5, 0.7, -3.8),  # by its pose alone, at 3.8 - 2 pi
        (-3.8, -4.5, 0, -0.7, 3.8),
        (-3, -3.5, 3.5, 6.5, 3),
        (0.7, 0.2, 1.4, 0.7, -0.5),  # its stop is at 0.2
        (-0.7, -1.4, -0.2, -0.7, 0.5),
        (0.2, 0.2, 1.4, 1.2, 1.2),
        (0, 0.2, 1.4, 1.4, 1.4),  # as files put it
        (-0.01, 0, 1.4, 1.41, 1.41),  # a little beside its stop
    ],
)
def test_a_part_moves_to_its_limits(
    session: psycopg.Connection[Any],
    at: float,
    low: float,
    high: float,
    opens: float,
    turns: float,
) -> None:
    seen = Snapshot(session, "hall")
    for kind in ("revolute", "prismatic"):
        part = flap(at, low, high, kind)
        for aim, expected in (("open", opens), ("turn", turns)):
            motion = part.known_motion(seen, aim, None)
            assert motion is not None
            assert motion.amount == pytest.approx(expected, abs=1e-6), (kind, aim)
            assert motion.is_hinge == (kind == "revolute")


@pytest.mark.parametrize(
    ("at", "low", "high", "kind", "message"),
    [
        (-1, 0, 4.5, "revolute", "goes from 0 to 4.5 and is at -1: put it where its joint allows"),
        (1.39, 0, 1.4, "revolute", "is open already"),
        (1.39, 0.2, 1.4, "prismatic", "is open already"),
        (0, 0, 0, "revolute", "is open already"),
        (0, None, None, "continuous", "has no limits: give travel"),
        (0, 0, 1, "fixed", "its joint is fixed, so it is still: give hinge="),
        (0, 0, 1, "several", "its joint is several, and such joints are not handled: give hinge="),
        (0, 0, 1, "planar", "its joint is planar, and such joints are not handled"),
    ],
)
def test_a_part_that_does_not_open_tells_why(
    session: psycopg.Connection[Any],
    at: float,
    low: float | None,
    high: float | None,
    kind: str,
    message: str,
) -> None:
    part = flap(at, low, high, kind)
    with pytest.raises(ManipulationError, match=message):
        part.known_motion(Snapshot(session, "hall"), "open", None)
