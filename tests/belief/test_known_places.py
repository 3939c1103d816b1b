"""What the map knows of a place agrees with the belief, and what was seen with what is there."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import shapely
import trimesh

import semmap
from semmap.belief.identify import Detection
from semmap.error import UnknownNameError


@pytest.fixture
def db(database: str) -> Iterator[semmap.Database]:
    with semmap.connect(database) as found:
        yield found


def two_tables(db: semmap.Database, *, drawn: bool = True) -> semmap.Map:
    here = db.create_map("piso")
    here.add_storey("bajo", elevation=0, height=3)
    if drawn:
        here.add_room("sala", shapely.box(0, 0, 6, 6), floor=0, ceiling=2.7)
        here.add_room("cocina", shapely.box(6.1, 0, 12, 6), floor=0, ceiling=2.7)
        here.add_door("puerta", "sala", "cocina", ((6.05, 2), (6.05, 3)))
    for name, x in (("mesa1", 3), ("mesa2", 9)):
        here.add_object(name, type="table", size=(1.4, 0.8, 0.75), pose=(x, 4, 0, 0))
    return here


@pytest.mark.parametrize(("drawn", "x"), [(False, 6), (True, -2)])
def test_what_has_a_pose_beside_all_places_is_at_none_of_them(
    db: semmap.Database, drawn: bool, x: float
) -> None:
    """A storey holds the ball, and it is not on its tables."""
    here = two_tables(db, drawn=drawn)
    here.add_object("pelota", type="ball", size=(0.2, 0.2, 0.2), pose=(x, 1, 0, 0))
    assert here["pelota"].holder == here["bajo"]
    assert here.where("pelota")["elsewhere"] > 0.9


def test_a_person_who_was_seen_in_bed_is_there(db: semmap.Database) -> None:
    here = two_tables(db)
    here.add_object("cama", type="bed", size=(2, 1.6, 0.5), pose=(1.2, 1, 0, 0))
    here.add_agent("ana", type="person", size=(0.5, 0.4, 1.7), pose=(4, 1, 0, 0))
    assert here.where("ana")["sala"] > 0.9
    here.observe_point("ana", (1.2, 1, 0.6))
    assert here.where("ana")["cama"] > 0.9
    here["ana"].move_to(4, 1, 0)
    assert here.where("ana")["sala"] > 0.9


@pytest.mark.parametrize("yaw", [0.0, 0.7])
@pytest.mark.parametrize(("dx", "dy"), [(0.72, 0), (1.1, 0), (0.75, -0.5), (0, 0.6), (0.2, 0.1)])
def test_what_is_seen_beside_the_edge_of_a_table_stands_on_it(
    db: semmap.Database, dx: float, dy: float, yaw: float
) -> None:
    """Oracle: the nearest point of the table, less half a mug, by Shapely."""
    here = two_tables(db)
    here.add_object("taza", type="mug", size=(0.08, 0.08, 0.1), on="mesa2")
    here["mesa1"].move_to(3, 4, 0, yaw)
    here.observe("taza", "mesa1", position=(dx, dy, 0.75))
    assert here["taza"].holder == here["mesa1"]
    assert here.where("taza")["mesa1"] > 0.9
    top = shapely.box(-0.7, -0.4, 0.7, 0.4)
    at = shapely.Point(dx, dy)
    if not top.covers(at):
        at = shapely.shortest_line(top.buffer(-0.04), at).interpolate(0)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    pose = here["taza"].pose
    assert pose is not None
    assert pose[:3] == pytest.approx([*(np.array((3, 4)) + turn @ (at.x, at.y)), 0.75], abs=1e-6)
    assert [finding for finding in here.check() if "taza" in finding.entities] == []


@pytest.mark.parametrize(
    ("seen", "point", "sides", "known"),
    [
        ("desk", (9, 4, 0.375), (1.4, 0.8, 0.75), "mesa2"),
        ("desk", (9, 4, 0.375), None, "mesa2"),
        ("cup", (9, 4, 0.8), (0.08, 0.08, 0.1), "taza"),
        ("stool", (9, 4, 0.375), (1.4, 0.8, 0.75), "mesa2"),
    ],
)
def test_no_second_solid_where_one_is(
    db: semmap.Database,
    seen: str,
    point: tuple[float, float, float],
    sides: tuple[float, float, float] | None,
    known: str,
) -> None:
    """A detector may call a thing by another name than the map."""
    here = two_tables(db)
    here.add_object("taza", type="mug", size=(0.08, 0.08, 0.1), on="mesa2")
    before = len(here.objects)
    (said,) = here.observe_objects([Detection(seen, point, sides)])
    assert (said["object"], said["new"]) == (known, False)
    assert len(here.objects) == before


def test_what_is_smaller_and_in_another_is_new(db: semmap.Database) -> None:
    here = two_tables(db)
    here.add_object("caja", type="box", size=(0.4, 0.4, 0.4), pose=(1, 1, 0, 0))
    (said,) = here.observe_objects([Detection("ball", (1, 1, 0.2), (0.1, 0.1, 0.1))])
    assert said["object"] != "caja"


def test_a_misspelt_class_is_no_new_one(db: semmap.Database) -> None:
    here = two_tables(db)
    with pytest.raises(UnknownNameError, match="no class tabel; did you mean table"):
        here.teach({"objects": [{"name": "x", "class": "tabel"}]})
    assert "x" not in here
    here.teach({"objects": [{"name": "x", "class": "mesita"}]})
    assert here["x"].type == "mesita"


def test_what_is_put_in_a_cabinet_stands_on_a_board(db: semmap.Database) -> None:
    here = two_tables(db)
    boards = [trimesh.creation.box((0.8, 0.4, 0.02)) for _ in range(4)]
    for board, z in zip(boards, (0.01, 0.5, 1.0, 1.49), strict=True):
        board.apply_translation((0, 0, z))
    sides = [trimesh.creation.box((0.02, 0.4, 1.5)) for _ in range(2)]
    for side, x in zip(sides, (-0.4, 0.4), strict=True):
        side.apply_translation((x, 0, 0.75))
    mesh = trimesh.util.concatenate([*boards, *sides])
    here.add_object("vitrina", type="cabinet", mesh=mesh, pose=(5, 5, 0, 0))
    here.add_object("lata", type="can", size=(0.066, 0.066, 0.12), in_="vitrina")
    pose = here["lata"].pose
    assert pose is not None
    assert pose.z == pytest.approx(1.01)
    assert [finding for finding in here.check() if "lata" in finding.entities] == []


def test_what_was_looked_for_in_vain_is_searched_for(db: semmap.Database) -> None:
    """Its grasps are stored, and it has no pose in which a gripper could be judged."""
    here = two_tables(db)
    here.add_object("taza", type="mug", size=(0.08, 0.08, 0.1), on="mesa2")
    assert here.grasps("taza").rows
    for _ in range(5):
        here.observe("taza", "mesa2", seen=False)
    assert here["taza"].pose is None
    plan = here.plan("carries(robot, taza)", start="sala")
    assert plan.actions[0].name == "search"


@pytest.mark.parametrize("gap", [0.02, 0.035, 0.045])
def test_what_is_too_high_for_its_holder_floats(db: semmap.Database, gap: float) -> None:
    here = two_tables(db)
    here.add_object("taza", type="mug", size=(0.08, 0.08, 0.1), pose=(3, 4, 0.75 + gap, 0))
    held = here["taza"].holder == here["mesa1"]
    assert held == (not here.check()) == (gap < 0.03)


@pytest.mark.parametrize(("x", "z"), [(1, 0.8), (3, 1.4), (3, 0.8), (3.3, 0.8)])
def test_voxels_and_geometry_are_one_truth(db: semmap.Database, x: float, z: float) -> None:
    """Oracle: how far a ball of 0.1 m reaches from the box of the mug."""
    here = two_tables(db)
    here.add_object("taza", type="mug", size=(0.08, 0.08, 0.1), pose=(3, 4, 0.75, 0))
    here.fields.update(f'INSERT DATA {{ :taza :occupies "SPHERE({x} 4 {z} 0.1)"^^:region }}')
    nearest = np.clip((x, 4, z), (2.96, 3.96, 0.75), (3.04, 4.04, 0.85))
    away = np.linalg.norm(nearest - (x, 4, z)) + 0.1
    assert abs(away - 0.5) > 0.05
    kinds = {finding.kind: finding.entities for finding in here.check()}
    assert kinds == ({"voxels apart": ("taza",)} if away > 0.5 else {})
