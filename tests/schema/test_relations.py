"""Spatial relations: truth tables of a small building, and distances against SciPy."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from sqlalchemy import ColumnElement, Engine, Select, Text, any_, func, literal, select, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from semmap.geometry.mesh import Mesh, box_mesh
from semmap.geometry.pose import Pose
from semmap.model import Entity, Object, PoseColumn, Room
from tests.query.office_scene import block, bodies, office, store, thing

MAPS = itertools.count()

FRAMES = {
    "as drawn": Pose(),
    "shifted": Pose(-31.7, 12.3, 4.21),
    "turned": Pose.planar(3.3, -8.1, 0.7, -2),
    "turned about": Pose.planar(120.4, 77.7, -2.6, 0.05),
}


@dataclass(frozen=True)
class Relation:
    """A relation, its SQL function, and those that list its first and its second entities."""

    name: str
    function: str
    parameters: tuple[str, ...]
    members: str | None = None
    converse: str | None = None


RELATIONS = (
    Relation("in", "is_in", ("a", "b", "tolerance"), "things_in", "containers_of"),
    Relation("on", "is_on", ("a", "b", "tolerance"), "things_on", "supports_of"),
    Relation("under", "is_under", ("a", "b", "tolerance"), "things_under", "things_above"),
    Relation("above", "is_above", ("a", "b", "tolerance"), "things_above", "things_under"),
    Relation(
        "touching", "is_touching", ("a", "b", "tolerance"), "things_touching", "things_touching"
    ),
    Relation("near", "is_near", ("a", "b", "distance"), "things_near", "things_near"),
    Relation("left_of", "is_left_of", ("a", "b", "frame")),
    Relation("right_of", "is_right_of", ("a", "b", "frame")),
    Relation("in_front_of", "is_in_front_of", ("a", "b", "frame")),
    Relation("behind", "is_behind", ("a", "b", "frame")),
    Relation("between", "is_between", ("a", "b", "c", "tolerance")),
    Relation("reachable_from", "is_reachable", ("place_a", "place_b")),
)


def among(column: Any, function: str, *parameters: Any) -> ColumnElement[bool]:
    """That a column is among the ids which a function lists, put so that its index is seen."""
    ids = select(getattr(func.semmap, function)(*parameters).column_valued()).scalar_subquery()
    listed: ColumnElement[bool] = column == any_(func.array(ids))
    return listed


def seen(side: str, b: int, frame: Any) -> ColumnElement[bool]:
    """That an entity is on a side of another, in a frame or as an observer sees it."""
    if isinstance(frame, str | Pose):
        frame = literal(frame, Text if isinstance(frame, str) else PoseColumn)
    beside: ColumnElement[bool] = getattr(func.semmap, named(side).function)(Entity.id, b, frame)
    return beside


@dataclass
class Building:
    engine: Engine
    ids: dict[str, int]
    frame: Pose

    def names(self, condition: ColumnElement[bool], of: Any = Entity) -> set[str]:
        with Session(self.engine) as session:
            mine = of.id.in_(self.ids.values())
            return set(session.scalars(select(of.name).where(mine, condition)))

    def holds(self, relation: str, *parameters: Any) -> bool:
        """The SQL function itself; names stand for ids."""
        with self.engine.connect() as connection:
            function = getattr(func.semmap, named(relation).function)
            given = [self.ids.get(p, p) for p in parameters]
            answer = connection.execute(select(function(*given))).scalar_one()
            assert answer is not None
            return bool(answer)


def named(name: str) -> Relation:
    return next(relation for relation in RELATIONS if relation.name == name)


@pytest.fixture(scope="module", params=list(FRAMES.values()), ids=list(FRAMES))
def building(request: pytest.FixtureRequest, module_engine: Engine) -> Building:
    frame = request.param
    return Building(
        module_engine, store(module_engine, f"office{next(MAPS)}", office(frame)), frame
    )


DOORS = "door1 door2 door3 door4 door5 door6 door7"
ROOMS = "office corridor store vault cabin1"
STANDING = "rug chest1 chest2 crate robot home shelf stone"

# For each entity b of a relation, all a for which it holds; for those not named, none.
TRUTH: dict[str, dict[str, str]] = {
    "in": {
        "first": f"{ROOMS} {DOORS} {STANDING} table tray muffin paper sheet ball lamp book vase "
        "mug plate pin stool",
        "second": "cabin2 attic desk",
        "office": f"{STANDING} store table tray muffin paper sheet ball lamp book vase mug plate "
        "pin",
        "corridor": "stool",
        "attic": "desk",
        "crate": "mug",
        "shelf": "book",
        "home": "robot",
    },
    "on": {
        "office": STANDING,
        "corridor": "stool",
        "attic": "desk",
        "rug": "table ball",
        "table": "tray paper sheet",
        "tray": "muffin",
        "shelf": "book vase",
        "crate": "mug",
        "chest1": "plate",
        "home": "robot",
    },
    "above": {
        "rug": "table tray muffin paper sheet ball lamp",
        "ball": "table paper",
        "table": "tray muffin paper sheet lamp",
        "tray": "muffin lamp",
        "muffin": "lamp",
        "shelf": "vase",
        "chest1": "plate",
    },
    "under": {
        "table": "ball rug",
        "paper": "ball table rug",
        "sheet": "table rug",
        "tray": "table rug",
        "muffin": "tray table rug",
        "lamp": "muffin tray table rug",
        "ball": "rug",
        "vase": "shelf",
        "plate": "chest1",
    },
    "touching": {
        "office": STANDING,
        "corridor": "stool",
        "attic": "desk",
        "rug": "office ball table",
        "table": "rug shelf tray paper sheet",
        "tray": "table muffin",
        "muffin": "tray",
        "paper": "table sheet",
        "sheet": "table paper",
        "ball": "rug",
        "shelf": "office table book vase",
        "book": "shelf",
        "vase": "shelf",
        "crate": "office mug",
        "mug": "crate",
        "chest1": "office chest2 plate",
        "chest2": "office chest1 plate",
        "plate": "chest1 chest2",
        "robot": "office home",
        "home": "office robot",
        "stone": "office",
        "stool": "corridor",
        "desk": "attic",
    },
}


@pytest.mark.parametrize("relation", TRUTH)
def test_a_relation_is_true_for_exactly_these_pairs(building: Building, relation: str) -> None:
    pairs = text(
        f"SELECT b.name, a.name FROM entity a, entity b WHERE a.id = ANY(:ids) AND b.id = ANY(:ids)"
        f" AND {named(relation).function}(a.id, b.id)"
    )
    with building.engine.connect() as connection:
        rows = connection.execute(pairs, {"ids": list(building.ids.values())}).all()
    got = {(row[0], row[1]) for row in rows}
    assert got == {(b, a) for b, every in TRUTH[relation].items() for a in every.split()}


@pytest.mark.parametrize("relation", [r for r in RELATIONS if r.members], ids=lambda r: r.name)
def test_what_is_listed_by_index_from_either_side_is_the_same(
    building: Building, relation: Relation
) -> None:
    function = getattr(func.semmap, relation.function)
    measure = literal(0.6 if relation.name == "near" else 0.01)
    for name in ("table", "office", "second", "shelf", "muffin", "ball", "pin", "lift"):
        of = building.ids[name]
        assert building.names(among(Entity.id, relation.members, of, measure)) == building.names(
            function(Entity.id, of, measure)
        )
        assert building.names(among(Entity.id, relation.converse, of, measure)) == building.names(
            function(of, Entity.id, measure)
        )


@pytest.mark.parametrize(
    ("a", "b", "distance", "expected"),
    [
        ("chest1", "shelf", 1.15, True),  # 3.59 to 4.25, 0.6 aside
        ("stone", "robot", 1.905, True),
        ("stone", "robot", 1.895, False),
        ("lamp", "table", 0.84, True),
        ("lamp", "table", 0.82, False),
        ("ball", "table", 0.53, True),
        ("ball", "table", 0.4, False),
        ("mug", "crate", 0.005, True),
        ("lamp", "office", 0.1, True),
        ("desk", "lamp", 0.5, False),
        ("pin", "crate", 1.5, True),
        ("pin", "crate", 1.4, False),
        ("stool", "office", 0.8, False),
        ("first", "office", 100.0, False),
        ("idea", "office", 100.0, False),
    ],
)
def test_near_is_the_distance_of_surfaces(
    building: Building, a: str, b: str, distance: float, expected: bool
) -> None:
    assert building.holds("near", a, b, distance) is expected
    assert building.holds("near", b, a, distance) is expected
    with building.engine.connect() as connection:
        pair = {"a": building.ids[a], "b": building.ids[b]}
        metres = connection.execute(text("SELECT surface_distance(:a, :b)"), pair).scalar()
    assert (metres is not None and metres <= distance) is expected


SIDES = ("left_of", "right_of", "in_front_of", "behind")


@pytest.mark.parametrize(
    ("a", "b", "frame", "side"),
    [
        ("shelf", "table", "object", "in_front_of"),
        ("robot", "table", "object", "right_of"),
        ("crate", "table", "object", "in_front_of"),
        ("chest1", "shelf", "object", "in_front_of"),
        ("table", "shelf", "object", "behind"),
        ("stone", "crate", "object", "behind"),
        ("chest2", "crate", "object", "left_of"),
        ("tray", "table", "object", None),
        ("desk", "shelf", "object", None),
        ("table", "idea", "object", None),
        # chest1 is turned by a quarter, the robot's front is.
        ("chest2", "chest1", "object", "right_of"),
        ("table", "robot", "object", "in_front_of"),
        ("crate", "robot", "object", "right_of"),
        ("pin", "robot", "object", "right_of"),
        # From the middle of the wall at y = 0, looking at the table.
        ("shelf", "table", (2, 0), "right_of"),
        ("robot", "table", (2, 0), "in_front_of"),
        ("crate", "table", (2, 0), "right_of"),
        ("lamp", "table", (2, 0), None),
        # The same from the other side of the table.
        ("shelf", "table", (2, 4), "left_of"),
        ("robot", "table", (2, 4), "behind"),
        ("crate", "table", (2, 4), "left_of"),
        ("shelf", "table", (2, 2), None),
        # Seen by the chest, and by one in no place.
        ("stone", "crate", "chest2", "right_of"),
        ("stone", "crate", "idea", None),
    ],
)
def test_sides(
    building: Building, a: str, b: str, frame: str | tuple[float, float], side: str | None
) -> None:
    observer: Any = frame
    if isinstance(frame, tuple):
        observer = building.frame @ Pose(*frame)
    elif frame in building.ids:
        observer = building.ids[frame]
    got = [
        s
        for s in SIDES
        if building.ids[a] in building_ids(building, seen(s, building.ids[b], observer))
    ]
    assert got == ([side] if side else [])


def building_ids(building: Building, condition: ColumnElement[bool]) -> set[int]:
    return {building.ids[name] for name in building.names(condition)}


def test_sides_in_the_frame_of_the_map_do_not_turn_with_the_object(module_engine: Engine) -> None:
    for yaw in (0.0, 1.0, 2.5):
        world = bodies("sides", [box_mesh((-0.2, -0.2, 0), (0.2, 0.2, 1))] * 5)
        places = [(0, 0), (2, 0.5), (-0.5, 2), (-2, -1), (0.1, -2)]
        for entry, (x, y) in zip(world.entries, places, strict=True):
            entry.pose = Pose.planar(x, y, yaw)
        ids = store(module_engine, f"sides{next(MAPS)}", world)
        there = Building(module_engine, ids, Pose())
        got = {s: there.names(seen(s, ids["body0"], "map")) for s in SIDES}
        assert got == {
            "in_front_of": {"body1"},
            "left_of": {"body2"},
            "behind": {"body3"},
            "right_of": {"body4"},
        }


@pytest.mark.parametrize(
    ("a", "b", "c", "expected"),
    [
        ("stone", "robot", "crate", True),
        ("stone", "table", "crate", False),
        ("table", "robot", "crate", False),
        ("muffin", "tray", "lamp", True),
        ("table", "rug", "tray", True),
        ("lamp", "tray", "muffin", False),
        ("pin", "table", "crate", False),
        ("stone", "robot", "desk", False),
        ("robot", "robot", "crate", False),
        ("idea", "robot", "crate", False),
    ],
)
def test_between(building: Building, a: str, b: str, c: str, expected: bool) -> None:
    assert building.holds("between", a, b, c) is expected
    assert building.holds("between", a, c, b) is expected
    of_b, of_c = building.ids[b], building.ids[c]
    assert (a in building.names(func.semmap.is_between(Entity.id, of_b, of_c))) is expected


@pytest.mark.parametrize(
    ("start", "expected"),
    {
        "office": "office corridor store cabin1 cabin2 attic",
        "stool": "office corridor store cabin1 cabin2 attic",
        "store": "store",
        "vault": "vault",
        "cabin2": "office corridor store cabin1 cabin2 attic",
        "attic": "attic",
    }.items(),
)
def test_reachable(building: Building, start: str, expected: str) -> None:
    place = func.semmap.place_of(building.ids[start])
    assert building.names(among(Room.id, "reachable_from", place), Room) == set(expected.split())
    for goal in ROOMS.split():
        assert building.holds("reachable_from", start, goal) is (goal in expected.split())
    assert building.holds("reachable_from", start, "stool") is ("corridor" in expected.split())


def analyse(engine: Engine) -> None:
    """Let the planner know how many things there are, as autovacuum does in time."""
    with engine.connect() as connection:
        connection.execution_options(isolation_level="AUTOCOMMIT").exec_driver_sql("ANALYZE")


ON_EACH = (
    "SELECT a.name AS thing, b.name AS holder FROM entity b "
    "CROSS JOIN LATERAL things_on(b.id) AS t (id) JOIN entity a ON a.id = t.id "
    "WHERE a.kind = 'object' AND b.kind = 'object' AND "
)


def test_relations_between_two_sets(building: Building) -> None:
    analyse(building.engine)
    with Session(building.engine) as session:
        pairs = session.execute(
            text(ON_EACH + "b.id = ANY (:ids)"), {"ids": [*building.ids.values()]}
        ).all()
        things = {b: a for b, a in TRUTH["on"].items() if b not in ("office", "corridor", "attic")}
        agents_and_regions = ("robot", "home")
        assert {(row[0], row[1]) for row in pairs} == {
            (a, b)
            for b, every in things.items()
            for a in every.split()
            if a not in agents_and_regions and b not in agents_and_regions
        }


def test_relations_are_within_one_map_only(module_engine: Engine) -> None:
    first = store(module_engine, f"one{next(MAPS)}", office(Pose()))
    second = store(module_engine, f"two{next(MAPS)}", office(Pose()))
    crossed = Building(
        module_engine,
        {"muffin": first["muffin"], "office": second["office"], "tray": second["tray"]},
        Pose(),
    )
    for relation in ("in", "on", "above", "under", "touching", *SIDES):
        for b in ("office", "tray"):
            assert not crossed.holds(relation, "muffin", b)
    assert not crossed.holds("near", "muffin", "tray", 10)


@pytest.mark.parametrize("gap", [-0.008, 0.008])
def test_contact_within_the_tolerance(module_engine: Engine, gap: float) -> None:
    world = bodies("contact", [])
    world.entries = [
        thing("table", block(1, 1, 0.7), 0, 0, holder=""),
        thing("tray", block(0.3, 0.2, 0.02), 0, 0, 0.7 + gap, holder=""),
    ]
    for entry in world.entries:
        entry.holder = None
    there = Building(module_engine, store(module_engine, f"contact{next(MAPS)}", world), Pose())
    assert there.holds("on", "tray", "table")
    assert not there.holds("on", "tray", "table", 0.004)
    assert not there.holds("in", "tray", "table")
    assert there.holds("touching", "tray", "table")
    assert there.holds("touching", "tray", "table", 0.004) is (gap < 0)


@pytest.mark.parametrize("lift", [-0.004, 0, 0.003])
def test_of_two_thin_objects_one_is_on_the_other(module_engine: Engine, lift: float) -> None:
    sheets = [box_mesh((-1, -1, 0), (1, 1, 0.001)), box_mesh((-0.5, -0.5, 0), (0.5, 0.5, 0.006))]
    world = bodies("thin", sheets)
    world.entries[1].pose = Pose(z=lift)
    there = Building(module_engine, store(module_engine, f"thin{next(MAPS)}", world), Pose())
    for relation in ("on", "above"):
        assert there.holds(relation, "body1", "body0")
        assert not there.holds(relation, "body0", "body1")


box_poses = st.builds(
    Pose.from_rpy,
    *(st.floats(-1.5, 1.5) for _ in range(3)),
    *(st.floats(-3.2, 3.2) for _ in range(3)),
)
half_sizes = st.tuples(*(st.floats(0.02, 0.8) for _ in range(3)))


def box_distance(a: Pose, half_a: np.ndarray, b: Pose, half_b: np.ndarray) -> float:
    """Metres between two solid boxes: least squares over a point of each, bounded by its faces."""
    matrix = np.hstack([a.rotation_matrix, -b.rotation_matrix])
    bound = np.concatenate([half_a, half_b])
    best = lsq_linear(
        matrix, b.translation - a.translation, (-bound, bound), method="bvls", tol=1e-14
    )
    return float(np.sqrt(2 * best.cost))


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(poses=st.tuples(box_poses, box_poses), halves=st.tuples(half_sizes, half_sizes))
def test_touching_and_near_agree_with_least_squares(
    module_engine: Engine, poses: tuple[Pose, Pose], halves: tuple[Any, Any]
) -> None:
    half = [np.array(h) for h in halves]
    world = bodies("boxes", [box_mesh(tuple(-h), tuple(h)) for h in half])
    for entry, pose in zip(world.entries, poses, strict=True):
        entry.pose = pose
    there = Building(module_engine, store(module_engine, f"boxes{next(MAPS)}", world), Pose())
    distance = box_distance(poses[0], half[0], poses[1], half[1])
    if distance > 1e-6:
        assert there.holds("near", "body0", "body1", distance * 1.0001 + 1e-6)
        assert not there.holds("near", "body1", "body0", distance * 0.9999 - 1e-7)
        assert there.holds("touching", "body0", "body1") is (distance <= 0.01)
    else:
        # Solids that meet: so do their surfaces, unless one lies inside the other.
        inner = [
            bool((abs(p.inverse().apply(q.apply(corners(h)))) < g).all())
            for p, q, h, g in (
                (poses[0], poses[1], half[1], half[0]),
                (poses[1], poses[0], half[0], half[1]),
            )
        ]
        if not any(inner):
            assert there.holds("near", "body0", "body1", 1e-6)


def corners(half: np.ndarray) -> np.ndarray:
    return np.array(list(itertools.product(*((-h, h) for h in half))))


def test_large_meshes_are_distinguished_by_their_surfaces(module_engine: Engine) -> None:
    """A ball in the hole of a ring: their boxes overlap, their surfaces are 0.5 m apart."""
    ring = trimesh.creation.torus(1, 0.2, major_sections=200, minor_sections=60)
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=0.3)
    meshes = [Mesh(np.asarray(m.vertices), m.faces.astype(np.int32)) for m in (ring, sphere)]
    assert min(len(m.faces) for m in meshes) > 20_000
    ids = store(module_engine, f"ring{next(MAPS)}", bodies("ring", meshes))
    there = Building(module_engine, ids, Pose())
    assert not there.holds("touching", "body0", "body1")
    assert not there.holds("near", "body0", "body1", 0.4)
    assert there.holds("near", "body0", "body1", 0.502)
    assert not there.holds("on", "body1", "body0")
    assert not there.holds("above", "body1", "body0")


@pytest.fixture(scope="module")
def crowd(module_engine: Engine) -> Building:
    """A table with a tray on it among 4,000 other things."""
    ids = store(module_engine, f"crowd{next(MAPS)}", office(Pose.planar(500, 500, 1)))
    with module_engine.begin() as connection:
        of_map = connection.execute(
            text("SELECT map_id FROM entity WHERE id = :id"), {"id": ids["table"]}
        ).scalar_one()
        connection.execute(
            text(
                "WITH e AS (INSERT INTO entity (map_id, kind, name) "
                "SELECT :map, 'object', 'o' || i FROM generate_series(1, 4000) i RETURNING id) "
                "INSERT INTO placement (entity_id, pose) "
                "SELECT id, planar_pose(id % 200, (id / 200) % 200, 0, 0.5) FROM e"
            ),
            {"map": of_map},
        )
    analyse(module_engine)
    return Building(module_engine, ids, Pose())


def explained(engine: Engine, statement: Select[Any]) -> str:
    sql = statement.compile(engine, compile_kwargs={"literal_binds": True})
    with engine.connect() as connection:
        return "\n".join(connection.execute(text(f"EXPLAIN {sql}".replace(":", "\\:"))).scalars())


@pytest.mark.parametrize(
    "condition",
    [
        lambda ids: among(Object.id, "things_on", ids["table"]),
        lambda ids: among(Object.id, "supports_of", ids["muffin"]),
        lambda ids: among(Object.id, "things_in", ids["crate"]),
        lambda ids: among(Object.id, "things_near", ids["tray"], 0.3),
        lambda ids: among(Object.id, "things_touching", ids["table"]),
    ],
)
def test_lists_ask_the_spatial_index_and_scan_nothing(crowd: Building, condition: Any) -> None:
    statement = select(Object.name).where(condition(crowd.ids))
    plan = explained(crowd.engine, statement)
    assert "Seq Scan" not in plan, plan
    assert "world_box" in plan or "world_flat" in plan, plan


def test_two_sets_ask_the_index_once_a_row_of_the_second(crowd: Building) -> None:
    statement = text(f"{ON_EACH} b.id = {crowd.ids['table']}")
    with crowd.engine.connect() as connection:
        plan = "\n".join(connection.execute(text(f"EXPLAIN {statement}")).scalars())
        names = set(connection.execute(statement).scalars())
    assert "Seq Scan" not in plan, plan
    assert names == {"tray", "paper", "sheet"}


def test_every_relation_is_a_function(module_engine: Engine) -> None:
    with module_engine.connect() as connection:
        rows = connection.execute(
            text(
                "SELECT proname, proargnames, provolatile::text, proparallel::text FROM pg_proc "
                "WHERE pronamespace = 'semmap'::regnamespace"
            )
        ).all()
    signatures = {(row[0], tuple(row[1] or ())): row[2:] for row in rows}
    names = {row[0] for row in rows}
    for relation in RELATIONS:
        assert signatures[relation.function, relation.parameters] == ("s", "s")
        assert {relation.members, relation.converse} - {None} <= names


def test_an_unknown_frame_is_refused(module_engine: Engine) -> None:
    with module_engine.connect() as connection, pytest.raises(DBAPIError, match="no frame 'world'"):
        connection.execute(text("SELECT is_left_of(1, 2, 'world')"))
