"""The maps of sources, compared with geometry computed point by point."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from semmap.database.files import schema_folder
from semmap.fields.maps.vocabulary import read_vocabulary
from semmap.fields.sources import (
    Gaze,
    GazeSource,
    ObjectSource,
    People,
    PeopleSource,
    PersonalSpaceSource,
    PersonMotion,
    RobotBodySource,
    RobotState,
    Segmentation,
    Zone,
    Zones,
    ZoneSource,
    installed_sources,
    make_source,
)
from semmap.robot.urdf import load_robot
from tests.robot.robots import real_robot

NOW = datetime(2026, 11, 21, 12, tzinfo=UTC)
VOCABULARY = read_vocabulary([schema_folder() / "ontology" / "fields.ttl"])
SIZE = 0.05


def pose(translation: tuple[float, float, float], seed: int | None = None) -> NDArray[np.float64]:
    m = np.eye(4)
    m[:3, 3] = translation
    if seed is not None:
        m[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    return m


def test_the_vocabulary() -> None:
    seen = VOCABULARY["http://kb.openrobots.org/inFieldOfView"]
    assert seen is VOCABULARY["inFieldOfView"]
    assert (seen.domain, seen.range) == ("field_of_view", "agent")
    assert (seen.subject, seen.object, seen.measure) == ("voxel", "entity", "attention")
    assert VOCABULARY["attention"].object == "number"
    assert (VOCABULARY["on"].subject, VOCABULARY["on"].domain) == ("entity", None)
    assert all(p.measure is None or p.measure in VOCABULARY for p in VOCABULARY.properties)


@pytest.mark.parametrize("graded", [False, True])
@settings(max_examples=5)
@given(seed=st.integers(0, 1000))
def test_gaze(graded: bool, seed: int) -> None:
    """A voxel is seen if its centre is within half the opening angle of the z axis and in reach."""
    at = pose((0.3, -0.2, 1.6), seed)
    source = GazeSource(VOCABULARY, voxel_size=SIZE, reach=2.0, graded=graded)
    seen, other = source(Gaze({"human1": at, "face_2": pose((5, 5, 1))}, NOW))
    assert (seen.about, other.about, seen.time) == ("human1", "face_2", NOW)
    assert seen.rdf_class == "field_of_view"
    low = np.floor((at[:3, 3] - 2.1) / SIZE).astype(int)
    cells = np.stack(np.meshgrid(*(np.arange(a, a + 84) for a in low), indexing="ij"), -1)
    off = (cells.reshape(-1, 3) + 0.5) * SIZE - at[:3, 3]
    along = off @ at[:3, 2]
    angle = np.arccos(np.clip(along / np.linalg.norm(off, axis=1), -1, 1))
    inside = (angle <= 0.25) & (along <= 2.0)
    assert {tuple(v) for v in cells.reshape(-1, 3)[inside]} == {tuple(v) for v in seen.voxels()}
    if graded:
        values = seen.at(off[inside] + at[:3, 3])
        np.testing.assert_allclose(values, 1 - angle[inside] / 0.25, atol=1e-5)
        assert (values > 0).all()


def image(labels: NDArray[Any], names: dict[int, str], **more: Any) -> Segmentation:
    depth = np.full(labels.shape, 1.5, np.float32)
    at = {"intrinsics": (100, 100, 39.5, 29.5), "pose": np.eye(4), "time": NOW, **more}
    return Segmentation(depth=depth, labels=labels, names=names, **at)


def test_objects_by_type() -> None:
    labels = np.zeros((60, 80), np.int32)
    labels[10:20, 10:20], labels[30:40, 30:40], labels[50:55, 60:70] = 1, 2, 3
    percept = image(labels, {1: "wine glass", 2: "DiningTable", 3: "person"})
    (seen,) = ObjectSource(VOCABULARY)(percept)
    assert dict(seen.legend) == {1: "wine_glass", 2: "dining_table"}
    assert (seen.property.name, seen.rdf_class, seen.time) == ("containsObject", "object", NOW)
    for number in (1, 2):
        rows, columns = np.nonzero(labels == number)
        p = np.column_stack([(columns - 39.5) * 0.015, (rows - 29.5) * 0.015, np.full(100, 1.5)])
        want = {tuple(v) for v in np.floor(p / SIZE).astype(int)}
        assert {tuple(v) for v in seen.voxels()[seen.values() == number]} == want
    (people,) = PeopleSource(VOCABULARY)(image((labels == 3) * 7, {7: "human1"}))
    assert (dict(people.legend), set(people.values())) == ({7: "human1"}, {7})
    (none,) = ObjectSource(VOCABULARY)(image(labels * 0, {}))
    assert len(none) == 0


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"names": {1: "cup"}}, r"labels \[2\] have no name"),
        ({"labels": np.ones((3, 4), int)}, "two .H, W. arrays"),
        ({"intrinsics": (0, 100, 1, 1)}, "above 0"),
        ({"pose": np.zeros((4, 4))}, "rigid transform"),
    ],
)
def test_wrong_images_are_refused(changes: dict[str, Any], says: str) -> None:
    given = {"labels": np.full((60, 80), 2), "names": {2: "cup"}, **changes}
    labels, names = given.pop("labels"), given.pop("names")
    percept = image(labels, names, **given)
    if labels.shape != (60, 80):
        percept = Segmentation(
            np.ones((60, 80)), labels, names, percept.intrinsics, percept.pose, NOW
        )
    with pytest.raises(ValueError, match=says):
        ObjectSource(VOCABULARY)(percept)


def test_personal_space() -> None:
    """1 at the person, further ahead than behind, wider the faster."""
    source = PersonalSpaceSource(VOCABULARY, voxel_size=SIZE)
    people = {
        "standing": PersonMotion(0, 0, math.pi / 2),
        "walking": PersonMotion(5, 0, 0, 0, 1.0, z=0.1),
    }
    still, moving = source(People(people, NOW))
    assert (still.about, still.property.measure) == ("standing", "personalSpace")
    ahead, behind, aside = still.at([(0.0, 0.8, 1), (0, -0.8, 1), (0.7, 0, 1)])
    assert ahead == pytest.approx(math.exp(-((0.825 / 0.5) ** 2 + (0.025 / (1 / 3)) ** 2) / 2))
    assert ahead > aside > behind == 0  # below the least
    assert still.at([(0.01, 0.01, 1)])[0] > 0.99
    assert moving.at([(5, 1.5, 1)])[0] > still.at([(0, 1.5, 1)])[0]
    points = still.points()
    assert points[:, 2].min() == pytest.approx(0.025)
    assert points[:, 2].max() == pytest.approx(1.975)
    assert moving.points()[:, 2].min() == pytest.approx(0.125)
    assert (still.values() >= 0.05).all()
    # What is left out disturbs less.
    x, y = np.meshgrid(np.arange(-40, 40), np.arange(-40, 40))
    cells = (np.column_stack([x.ravel(), y.ravel(), np.full(6400, 10)]) + 0.5) * SIZE
    spread = np.where(cells[:, 1] >= 0, 0.5, 0.25)
    value = np.exp(-((cells[:, 1] / spread) ** 2 + (cells[:, 0] / (1 / 3)) ** 2) / 2)
    np.testing.assert_allclose(still.at(cells), np.where(value >= 0.05, value, 0), atol=1e-6)


def test_the_body_of_a_robot() -> None:
    """TIAGo's meshes, sampled, lie in its body; a raised arm is elsewhere."""
    robot = load_robot(real_robot("tiago"))
    at = pose((2, 1, 0))
    at[:2, :2] = [[0, -1], [1, 0]]
    source = RobotBodySource(VOCABULARY, robot=robot, name="tiago1", voxel_size=SIZE)
    (body,) = source(RobotState(at, NOW))
    (raised,) = source(RobotState(at, NOW, {"torso_lift_joint": 0.3}))
    assert (body.about, body.rdf_class) == ("tiago1", "robot")
    for made, joints in ((body, {}), (raised, {"torso_lift_joint": 0.3})):
        for mesh in robot.link_meshes(joints).values():
            points = mesh.vertices[mesh.faces].mean(axis=1) @ at[:3, :3].T + at[:3, 3]
            near = np.zeros(len(points), np.bool_)
            for step in np.stack(np.meshgrid(*[(-SIZE, 0, SIZE)] * 3), -1).reshape(-1, 3):
                near |= made.at(points + step)
            assert near.all()
    assert len(body) != len(raised)
    ends = [m.points()[:, 2].max() for m in (body, raised)]
    assert ends[1] - ends[0] == pytest.approx(0.3, abs=SIZE)


def test_zones() -> None:
    """A room with a pillar and a region, by where their outlines are."""
    hall = shapely.Polygon(
        [(0, 0), (4, 0), (4, 1), (2, 1), (2, 3), (0, 3)],
        [[(0.5, 0.5), (0.5, 0.9), (0.9, 0.9), (0.9, 0.5)]],
    )
    zone = Zone("quiet", "region", shapely.box(1, 0, 3, 1), 0.5, 1.0)
    source = ZoneSource(VOCABULARY, voxel_size=SIZE)
    zones = (Zone("hall", "room", hall, 0.0, 2.5), zone)
    room, region = source(Zones(zones, NOW))
    assert (room.property.name, room.about) == ("inRoom", "hall")
    assert (region.property.name, region.about) == ("inZone", "quiet")
    x, y, z = np.meshgrid(np.arange(-2, 82), np.arange(-2, 62), np.arange(-2, 55), indexing="ij")
    centres = (np.column_stack([x.ravel(), y.ravel(), z.ravel()]) + 0.5) * SIZE
    for made, outline, low, high in ((room, hall, 0, 2.5), (region, zone.outline, 0.5, 1)):
        inside = shapely.contains_xy(outline, centres[:, 0], centres[:, 1])
        inside &= (centres[:, 2] > low) & (centres[:, 2] < high)
        np.testing.assert_array_equal(made.at(centres), inside)
    # What did not change is not made again.
    again, moved = source(Zones((zones[0], Zone("quiet", "region", hall, 0, 1)), NOW))
    assert again is room
    assert moved is not region


def test_installed_sources() -> None:
    assert set(installed_sources()) >= {
        "gaze",
        "objects",
        "people",
        "personal_space",
        "robot_body",
        "zones",
    }
    source = make_source("gaze", VOCABULARY, reach=1.0)
    assert isinstance(source, GazeSource)
    with pytest.raises(LookupError, match=r"there is no source smell; installed sources: .*gaze"):
        make_source("smell", VOCABULARY)
