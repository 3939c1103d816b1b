"""A kitchen with two cups of one model, a gripper, and candidates to store."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import psycopg
import pytest
import trimesh

import semmap
from semmap import Map
from semmap.geometry.pose import Pose
from semmap.manipulation.action_record import pose_of
from semmap.manipulation.store.devices import add_gripper
from tests.conftest import MakeDatabase


def candidate(x: float = 0.0, yaw: float = 0.0, **values: Any) -> SimpleNamespace:
    """A grasp as the generator gives it: poses (4, 4) in the model's frame."""
    pose = Pose.planar(x, 0.0, yaw, z=0.05).matrix
    back = Pose.planar(x - 0.1, 0.0, yaw, z=0.05).matrix
    given: dict[str, Any] = {
        "pose": pose,
        "pre_grasp": back,
        "width": 0.06,
        "approach": "side",
        "family": "side 0",
        "quality": 0.5,
        "posture": {"finger": 0.03},
        "pre_posture": {"finger": 0.045},
    }
    return SimpleNamespace(**(given | values))


def primitive(kind: str, *size: float, pose: Any = None) -> SimpleNamespace:
    """A shape as the shape detector gives it."""
    return SimpleNamespace(
        kind=kind,
        size=size,
        pose=np.eye(4) if pose is None else pose,
        inliers=1.0,
        deviation=tuple(0.001 for _ in size),
    )


def path_between(
    here: psycopg.Connection[Any], automaton: str, start: Any, goal: Any, link: str = ""
) -> list[Pose] | None:
    """The stored path between two poses, (4, 4) or seven numbers, if nothing is in its way."""
    row = here.execute(
        "SELECT poses FROM path WHERE id = path_between(%s, %s::float8[], %s::float8[], %s)",
        (automaton, pose_of(start, "start").row, pose_of(goal, "goal").row, link),
    ).fetchone()
    return None if row is None else [Pose(*pose) for pose in row[0]]


@pytest.fixture(scope="module")
def cup_map(make_database: MakeDatabase) -> Iterator[Map]:
    url = make_database().render_as_string(hide_password=False)
    with semmap.connect(url) as db:
        cups = db.create_map("kitchen")
        cups.add_room("kitchen", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.7)
        cups.add_object("table", type="table", size=(1.6, 0.8, 0.75), pose=(1.5, 1.5, 0))
        cup = trimesh.creation.cylinder(0.035, 0.09, sections=24)
        cup.apply_translation((0, 0, 0.045))
        cups.add_object("cup1", type="cup", mesh=cup, pose=(1.2, 1.4, 0.75))
        cups.add_object("cup2", type="cup", mesh=cup, pose=(1.9, 1.5, 0.75, 1.2))
        cups.add_object("bottle", type="bottle", size=(0.07, 0.07, 0.25), pose=(1.5, 1.6, 0.75))
        cups.add_object("book", type="book", size=(0.2, 0.15, 0.03), pose=(1.0, 1.7, 0.75))
        cups.add_object("note", type="notepad")
        cups.add_agent("robot", type="robot", size=(0.5, 0.5, 1.2), pose=(3.4, 2, 0))
        add_gripper(db.session, "two_fingers", form="parallel", opening=0.09, depth=0.05)
        add_gripper(db.session, "wide", form="parallel", opening=0.2, depth=0.08)
        yield cups


@pytest.fixture
def cups(cup_map: Map) -> Iterator[Map]:
    """The cups, for one test: what the test changes is undone."""
    with cup_map.transaction() as transaction:
        yield cup_map
        raise psycopg.Rollback(transaction)
