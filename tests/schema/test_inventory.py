"""The inventory follows the geometry: each move derives holders again, but keeps stated ones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from psycopg import Connection
from sqlalchemy import Engine, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.ingest.store.holder_store import derive_inventories, find_surfaces
from semmap.ingest.world import Entry, Shape, StoreyDetail, World
from semmap.model import Entity
from tests.consistency import HOLDERS
from tests.oracles.holders import Holding, Item, RoomSpace, SurfacePatch, derive_holders
from tests.query.office_scene import block, drawn, room, store, thing


def flat() -> World:
    """A kitchen with a desk, a balcony beside it, and a room above; nothing has a holder yet."""
    entries = [
        Entry("ground", "storey", detail=StoreyDetail(0, 3)),
        Entry("first", "storey", pose=Pose(z=3), detail=StoreyDetail(3, 3)),
        room("kitchen", drawn(0, 0, 5, 4, 0, 2.6), holder="ground", floor=0, ceiling=2.6),
        room("balcony", drawn(5.1, 0, 9, 4, 0, 2.6), holder="ground", floor=0, ceiling=2.6),
        room("attic", drawn(0, 0, 5, 4, 0, 2.6), holder="first", floor=0, ceiling=2.6),
        thing("desk", block(1.6, 0.8, 0.75), 2, 2, holder=None),
        thing("tray", block(0.4, 0.3, 0.02), 2.2, 2.1, 0.75, holder=None),
        thing("cup", block(0.08, 0.08, 0.1), 2.2, 2.1, 0.77, holder=None),
        thing("ball", block(0.2, 0.2, 0.2), 7, 2, 0, holder=None),
        thing("box", block(0.5, 0.5, 0.4), 4, 3, 0, holder=None),
    ]
    return World("flat", None, entries)  # type: ignore[arg-type]


def driver(connection: Any) -> Connection[Any]:
    return connection.connection.driver_connection  # type: ignore[no-any-return]


@pytest.fixture
def ids(engine: Engine) -> dict[str, int]:
    made = store(engine, "flat", flat())
    with engine.begin() as connection:
        of_map = connection.execute(text("SELECT id FROM map")).scalar_one()
        derive_inventories(driver(connection), of_map)
    return made


def holders(engine: Engine) -> dict[str, str | None]:
    with engine.connect() as connection:
        rows = connection.execute(
            text(
                "SELECT e.name, p.relation || ' ' || h.name FROM placement p "
                "JOIN entity e ON e.id = p.entity_id LEFT JOIN entity h ON h.id = p.holder_id "
                "WHERE e.kind IN ('object', 'agent')"
            )
        )
        return {row[0]: row[1] for row in rows}


def no_contradictions(engine: Engine) -> bool:
    with engine.connect() as connection:
        found = connection.execute(text(HOLDERS)).all()
    assert not found, found
    return True


def run(engine: Engine, statement: str, **values: Any) -> Any:
    with engine.begin() as connection:
        result = connection.execute(text(statement), values)
        return result.all() if result.returns_rows else None


def by_function(engine: Engine, of: int, x: float, y: float, z: float) -> None:
    run(engine, "SELECT move_to(:of, :x, :y, :z)", of=of, x=x, y=y, z=z)


def by_update(engine: Engine, of: int, x: float, y: float, z: float) -> None:
    run(
        engine,
        "UPDATE placement p SET pose = CASE WHEN h.pose IS NULL THEN t.pose "
        "ELSE pose_compose(pose_inverse(h.pose), t.pose) END "
        "FROM (SELECT planar_pose(:x, :y, 0, :z)) t (pose), "
        "placement q LEFT JOIN world h ON h.entity_id = q.holder_id "
        "WHERE p.entity_id = :of AND q.entity_id = :of",
        of=of,
        x=x,
        y=y,
        z=z,
    )


def by_session(engine: Engine, of: int, x: float, y: float, z: float) -> None:
    with Session(engine) as session:
        moved = session.get_one(Entity, of)
        assert moved.placement is not None
        moved.placement.holder = None
        moved.placement.pose = Pose.planar(x, y, 0, z)
        session.commit()


def by_map_editor(engine: Engine, of: int, x: float, y: float, z: float) -> None:
    """As QGIS does it: the footprint is dragged (at its height)."""
    run(
        engine,
        "UPDATE gis_object SET geom = ST_Translate(geom, :x - ST_X(ST_Centroid(geom)), "
        ":y - ST_Y(ST_Centroid(geom))) WHERE fid = :of",
        of=of,
        x=x,
        y=y,
    )
    by_function(engine, of, x, y, z)


HELD_IN_PLACE = """
UPDATE placement SET holder_id = :holder,
    pose = (SELECT pose_compose(pose_inverse(r.pose), w.pose) FROM world r, world w
            WHERE r.entity_id = :holder AND w.entity_id = :ball)
WHERE entity_id = :ball
"""

MOVERS = [by_function, by_update, by_session, by_map_editor]
Mover = Callable[[Engine, int, float, float, float], None]


def test_import_derives_holders(engine: Engine, ids: dict[str, int]) -> None:
    assert holders(engine) == {
        "desk": "in kitchen",
        "tray": "on desk",
        "cup": "on tray",
        "ball": "in balcony",
        "box": "in kitchen",
    }
    assert no_contradictions(engine)


@pytest.mark.parametrize("move", MOVERS)
@pytest.mark.parametrize(
    ("name", "to", "holder"),
    [
        ("ball", (4.2, 0.9, 0), "in kitchen"),
        ("ball", (4, 3, 0.4), "on box"),
        ("ball", (2, 1, 3), "in attic"),
        ("cup", (2.2, 2.1, 1.9), "in kitchen"),
        ("cup", (1.5, 2, 0.75), "on desk"),
        ("tray", (7, 3, 0), "in balcony"),
        ("desk", (7, 1, 0), "in balcony"),
        ("ball", (40, 40, 0), "in ground"),
    ],
)
def test_moved_object_gets_the_holder_that_the_geometry_shows(
    engine: Engine,
    ids: dict[str, int],
    move: Mover,
    name: str,
    to: tuple[float, float, float],
    holder: str,
) -> None:
    move(engine, ids[name], *to)
    now = holders(engine)
    assert now[name] == holder
    if name != "cup":
        assert now["cup"] == "on tray", "what stands on a moved object moves along"
    assert no_contradictions(engine)


def test_object_stays_where_it_is_when_its_holder_changes(
    engine: Engine, ids: dict[str, int]
) -> None:
    by_function(engine, ids["ball"], 4, 3, 0.4)
    pose = run(engine, "SELECT pose FROM world WHERE entity_id = :id", id=ids["ball"])[0][0]
    assert list(pose[:3]) == pytest.approx([4, 3, 0.4])
    by_function(engine, ids["box"], 6, 1, 0)  # takes the ball along
    pose = run(engine, "SELECT pose FROM world WHERE entity_id = :id", id=ids["ball"])[0][0]
    assert list(pose[:3]) == pytest.approx([6, 1, 0.4])


def test_stated_holder_stays_until_the_geometry_contradicts_it(
    engine: Engine, ids: dict[str, int]
) -> None:
    by_function(engine, ids["ball"], 4, 3, 0.41)  # 1 cm above the box
    run(
        engine,
        "UPDATE placement SET holder_id = :b, confidence = NULL, relation = 'in' "
        "WHERE entity_id = :a",
        a=ids["ball"],
        b=ids["box"],
    )
    by_function(engine, ids["ball"], 4.1, 3, 0.41)
    assert holders(engine)["ball"] == "in box"
    by_function(engine, ids["ball"], 4.1, 3, 1.5)
    assert holders(engine)["ball"] == "in kitchen"
    reason = run(
        engine,
        "SELECT reason FROM placement_history WHERE entity_id = :a AND reason IS NOT NULL "
        "ORDER BY upper(during) DESC LIMIT 1",
        a=ids["ball"],
    )[0][0]
    assert reason == "the geometry contradicted the stated holder"


def test_setting_a_holder_states_it(engine: Engine, ids: dict[str, int]) -> None:
    by_function(engine, ids["ball"], 4, 3, 0.4)
    run(
        engine,
        HELD_IN_PLACE,
        ball=ids["ball"],
        holder=ids["kitchen"],
    )
    confidence = run(engine, "SELECT confidence FROM placement WHERE entity_id = :i", i=ids["ball"])
    assert confidence == [(None,)]


def test_holder_elsewhere_is_refused(engine: Engine, ids: dict[str, int]) -> None:
    before = holders(engine)
    with pytest.raises(DBAPIError, match=r"ball is not in or on desk: they are 4\.\d+ m apart"):
        run(
            engine,
            HELD_IN_PLACE,
            ball=ids["ball"],
            holder=ids["desk"],
        )
    assert holders(engine) == before


def test_contents_of_a_tilted_table_fall_to_the_room(engine: Engine, ids: dict[str, int]) -> None:
    run(
        engine,
        "UPDATE placement SET pose = pose_compose(pose, ARRAY[0, 0, 0, sin(0.3), 0, 0, cos(0.3)]) "
        "WHERE entity_id = :i",
        i=ids["desk"],
    )
    assert holders(engine)["tray"] != "on desk"
    assert no_contradictions(engine)


def test_contents_of_a_deleted_table_are_derived_again(engine: Engine, ids: dict[str, int]) -> None:
    run(engine, "DELETE FROM entity WHERE id = :i", i=ids["desk"])
    assert holders(engine)["tray"] == "in kitchen"
    assert holders(engine)["cup"] == "on tray"
    assert no_contradictions(engine)


def test_a_table_pushed_under_an_object_becomes_its_holder(
    engine: Engine, ids: dict[str, int]
) -> None:
    by_function(engine, ids["ball"], 7, 2, 0.4)
    assert holders(engine)["ball"] == "in balcony"
    by_function(engine, ids["box"], 7, 2, 0)
    assert holders(engine)["ball"] == "on box"
    by_function(engine, ids["ball"], 7, 2, 0.6)
    by_function(engine, ids["box"], 4, 3, 0)
    assert holders(engine)["ball"] == "in balcony"
    assert no_contradictions(engine)


def test_two_objects_that_change_places_in_one_statement_change_holders(
    engine: Engine,
) -> None:
    crates = World("crates", None, [])  # type: ignore[arg-type]
    crates.entries = [
        thing("red", block(1, 1, 0.5), 0, 0, 0, holder=None),
        thing("blue", block(1, 1, 0.5), 0, 0, 0.5, holder=None),
    ]
    ids = store(engine, "crates", crates)
    assert holders(engine) == {"red": None, "blue": "on red"}
    run(
        engine,
        "UPDATE placement p SET holder_id = NULL, pose = planar_pose(0, 0, 0, t.z) "
        "FROM (VALUES (:red, 0.5), (:blue, 0)) t (id, z) WHERE p.entity_id = t.id",
        red=ids["red"],
        blue=ids["blue"],
    )
    assert holders(engine) == {"red": "on blue", "blue": None}
    assert no_contradictions(engine)


def test_of_two_objects_in_and_on_each_other_one_is_the_holder(
    engine: Engine, ids: dict[str, int]
) -> None:
    """The larger one begins 2 cm above the other's bottom, encloses it, and is on its base."""
    world = World("pair", None, [])  # type: ignore[arg-type]
    world.entries = [
        thing("case", block(1, 1, 0.9), 20, 20, 0.02, holder=None),
        thing("core", block(0.96, 0.96, 0.93), 20, 20, 0, holder=None),
    ]
    store(engine, "pair", world)
    assert no_contradictions(engine)


def test_shape_given_to_a_holder_ends_what_was_stated(engine: Engine, ids: dict[str, int]) -> None:
    """A lamp is stated to be on a shelf without a shape; the shape turns out to be far below."""
    by_function(engine, ids["ball"], 2, 2, 2)
    run(
        engine,
        "WITH made AS (INSERT INTO entity (map_id, kind, name) "
        "SELECT map_id, 'object', 'shelf' FROM entity WHERE id = :ball RETURNING id) "
        "INSERT INTO placement (entity_id, pose) SELECT id, planar_pose(2, 2, 0, 1) FROM made",
        ball=ids["ball"],
    )
    run(engine, "SELECT put(:ball, (SELECT id FROM entity WHERE name = 'shelf'))", ball=ids["ball"])
    assert holders(engine)["ball"] == "in shelf"
    run(
        engine,
        "INSERT INTO entity_model SELECT s.id, em.model_id FROM entity s, entity_model em "
        "WHERE s.name = 'shelf' AND em.entity_id = :tray",
        tray=ids["tray"],
    )
    assert holders(engine)["ball"] == "in kitchen"
    assert no_contradictions(engine)


def test_a_room_drawn_later_becomes_the_holder_of_its_contents(
    engine: Engine, ids: dict[str, int]
) -> None:
    by_function(engine, ids["ball"], 12, 2, 0)
    assert holders(engine)["ball"] == "in ground"
    run(
        engine,
        "INSERT INTO gis_room (map, storey, name, floor, ceiling, geom) VALUES "
        "('flat', 'ground', 'shed', 0, 2.5, ST_Multi(ST_MakeEnvelope(10, 0, 14, 4, 0)))",
    )
    assert holders(engine)["ball"] == "in shed"
    assert no_contradictions(engine)


# --- the rules, against an independent implementation in Python


def box(id_: int, low: tuple[float, ...], size: tuple[float, ...]) -> Item:
    (x, y, z), (w, d, h) = low, size
    return Item(id_, np.array([[x, y, z], [x + w, y + d, z + h]]), shapely.box(x, y, x + w, y + d))


def derived(engine: Engine, name: str, things: list[Item], rooms: list[RoomSpace]) -> list[Holding]:
    """What the database derives for boxes in world coordinates; holders by their index."""
    entries = [
        room(
            f"room{r.id}",
            drawn(*r.outline.bounds, 0, r.high - r.low),  # type: ignore[call-arg]
            holder=None,
            floor=r.low,
            ceiling=r.high,
        )
        for r in rooms
    ]
    for t in things:
        low, high = t.box
        shape = Shape("mesh", box_mesh((0, 0, 0), tuple(high - low)))
        entries.append(Entry(f"thing{t.id}", "object", pose=Pose(*low), shapes=[shape]))
    made = store(engine, name, World(name, None, entries))  # type: ignore[arg-type]
    numbers = {made[e.name]: int(e.name.lstrip("thingrom")) for e in entries}
    with engine.begin() as connection:
        of_map = connection.execute(text("SELECT id FROM map WHERE name = :n"), {"n": name})
        find_surfaces(driver(connection), of_map.scalar_one())
        rows = connection.execute(
            text("SELECT * FROM derived_holders(:ids)"),
            {"ids": [made[f"thing{t.id}"] for t in things]},
        )
        found = {
            numbers[r.entity_id]: Holding(numbers.get(r.holder_id), r.confidence, r.relation)
            for r in rows
        }
    return [found[t.id] for t in things]


ROOMS = [
    RoomSpace(100, shapely.box(0, 0, 5, 4), 0.0, 2.5),
    RoomSpace(101, shapely.box(5.1, 0, 9, 4), 0.0, 2.5),
]
TABLE = box(1, (1, 1, 0), (1.2, 0.6, 0.75))
TRAY = box(2, (1.1, 1.1, 0.75), (0.4, 0.3, 0.04))
STOOL = box(4, (4.1, 2.1, 0), (0.2, 0.2, 0.4))


@pytest.mark.parametrize(
    ("low", "size", "expected"),
    [
        ((1.2, 1.2, 0.75), (0.1, 0.1, 0.1), (1, 1, "on")),
        ((1.2, 1.2, 0.79), (0.05, 0.05, 0.1), (2, 1, "on")),
        ((1.2, 1.2, 1.5), (0.1, 0.1, 0.1), (100, 1, "in")),
        ((20, 20, 0), (0.1, 0.1, 0.1), (None, 1, "in")),
        ((-0.3, 1.0, 0), (0.5, 0.5, 0.1), (None, 1, "in")),
        ((2.14, 1.2, 0.75), (0.1, 0.1, 0.1), (1, 0.6, "on")),  # 60 % on the table
        ((1.7, 1.2, 0.77), (0.1, 0.1, 0.1), (1, 0.667, "on")),  # 2 cm above it
        ((4.7, 2, 0), (0.5, 0.5, 0.5), (100, 0.6, "in")),  # 60 % in the room
        ((3.9, 1.9, 0.4), (0.6, 0.6, 0.3), (4, 0.5, "on")),  # wider than its stool
        ((4.1, 2.1, 0.4), (0.6, 0.6, 0.3), (100, 1, "in")),  # its middle is beside the stool
        ((3.9, 1.9, 0.42), (0.6, 0.6, 0.3), (100, 1, "in")),  # 2 cm above it
    ],
    ids=[
        *("table", "tray", "hanging", "outside", "mostly-outside", "edge", "above", "sill"),
        *("on-stool", "beside-stool", "over-stool"),
    ],
)
def test_rules(
    module_engine: Engine,
    request: pytest.FixtureRequest,
    low: tuple[float, ...],
    size: tuple[float, ...],
    expected: tuple[int | None, float, str],
) -> None:
    things = [TABLE, TRAY, box(3, low, size), STOOL]
    found = derived(module_engine, request.node.name, things, ROOMS)[2]
    assert (found.holder, found.relation) == (expected[0], expected[2])
    assert found.confidence == pytest.approx(expected[1], abs=1e-3)


angles = st.floats(-3, 3)


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(roll=angles, pitch=angles, yaw=angles, turn=angles)
def test_of_two_of_one_size_neither_holds_the_other(
    module_engine: Engine, roll: float, pitch: float, yaw: float, turn: float
) -> None:
    """Two boxes about one middle, one turned: rounding does not make either the larger."""
    pose = Pose.from_rpy(1, 2, 3, roll, pitch, yaw)
    turned = Pose.from_rpy(1, 2, 3, roll, pitch, yaw + turn)
    block = box_mesh((-0.5, -0.5, -0.4), (0.5, 0.5, 0.4))
    entries = [
        Entry(f"box{i}", "object", pose=p, shapes=[Shape("mesh", block)])
        for i, p in enumerate((pose, turned))
    ]
    name = f"twins{run(module_engine, 'SELECT count(*) FROM map')[0][0]}"
    made = store(module_engine, name, World(name, None, entries))  # type: ignore[arg-type]
    held = "SELECT count(holder_id) FROM placement WHERE entity_id = ANY(:made)"
    assert run(module_engine, held, made=list(made.values())) == [(0,)]
    assert no_contradictions(module_engine)


lengths = st.integers(1, 5)
boxes = st.tuples(
    st.integers(0, 6), st.integers(0, 6), st.integers(0, 4), lengths, st.integers(1, 4)
)


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(lattice=st.lists(boxes, min_size=1, max_size=8))
def test_random_piles_against_python(
    module_engine: Engine, lattice: list[tuple[int, int, int, int, int]]
) -> None:
    """Boxes on a lattice of decimetres: the SQL and the Python of the same rules agree.

    Pairs where one encloses another are left out: the oracle knows no "in an object".
    """
    things = [
        box(i, (x / 10, y / 10, z / 10), (w / 10, w / 10, h / 10))
        for i, (x, y, z, w, h) in enumerate(lattice)
    ]
    tops = [SurfacePatch(t.id, t.box[0, 2], t.box[1, 2], t.footprint) for t in things]
    expected = derive_holders(things, tops, ROOMS)
    name = f"pile{run(module_engine, 'SELECT count(*) FROM map')[0][0]}"
    for t, found in zip(things, derived(module_engine, name, things, ROOMS), strict=True):
        wanted = expected[t.id]
        if found.relation == "in" and found.holder is not None and found.holder < 100:
            outer = things[found.holder]
            assert (outer.box[0] <= t.box.mean(axis=0)).all()
            assert (outer.box[1] >= t.box.mean(axis=0)).all()
            continue
        assert found.relation == wanted.relation
        assert found.confidence == pytest.approx(wanted.confidence, abs=1e-3)
        if found.holder != wanted.holder:  # two bear it equally
            assert wanted.relation == "on"
            shares = [
                tops[h].outline.intersection(t.footprint).area  # type: ignore[index]
                for h in (found.holder, wanted.holder)
            ]
            assert shares[0] == pytest.approx(shares[1])


def test_a_board_lies_on_the_trestles_around_its_middle(
    module_engine: Engine, request: pytest.FixtureRequest
) -> None:
    """Each bears less than half; with the second one away, the board would tip."""
    trestles = [box(i, (x, 2, 0), (w, 0.5, 0.7)) for i, x, w in ((1, 1.0, 0.2), (2, 2.7, 0.3))]
    board = box(3, (1.0, 2, 0.7), (2.0, 0.5, 0.03))
    for held_by, there in ((2, trestles), (100, trestles[:1])):
        name = f"{request.node.name}{held_by}"
        found = derived(module_engine, name, [*there, board], ROOMS)[-1]
        assert found.holder == held_by
