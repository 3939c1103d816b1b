"""Stored fields are loaded bit by bit: each version, after any history and after restarts."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from sqlalchemy import Engine, text
from sqlalchemy.exc import DBAPIError

from semmap.database import Cluster, open_engine
from semmap.database.maps import see_map
from semmap.fields import Box, Sphere
from semmap.fields.maps.grids import GRIDS, Grid, ValueType
from semmap.fields.store import field_store
from semmap_vdb import BoolGrid, FloatGrid, Int32Grid
from tests.database.test_crash import kill_server
from tests.seen import seen_by

IRI = "urn:semmap:ontology#personalSpace"
VALUES: dict[ValueType, list[Any]] = {
    "bool": [True, False],
    "int32": [0, 7, -1, 2**31 - 1, -(2**31)],
    "float32": [0.0, -0.0, 1.5, math.inf, -math.inf, math.nan, 1e-45],
}
LOW, SIDE = -48, 96
EDGES = (8, 16, 32, 64, 128)


def bits(values: NDArray[Any]) -> NDArray[Any]:
    return values.view(np.uint8 if values.dtype == np.bool_ else np.uint32)


def same(one: Grid, other: Grid) -> bool:
    """Whether two grids have equal values and states in all voxels of a box, and outside."""
    if type(one) is not type(other) or one.placement != other.placement:
        return False
    background = [np.float64(g.background).tobytes() for g in (one, other)]
    if one.voxel_size != other.voxel_size or background[0] != background[1]:
        return False
    a, b = (bits(g.read_box((LOW,) * 3, (SIDE,) * 3)) for g in (one, other))
    rows = []
    for grid in (one, other):
        voxels, values = grid.read()
        order = np.lexsort(voxels.T)
        rows.append((voxels[order], bits(values)[order]))
    return np.array_equal(a, b) and all(
        np.array_equal(mine, yours) for mine, yours in zip(*rows, strict=True)
    )


places = st.tuples(*(st.integers(-40, 40),) * 3)
changes = st.lists(
    st.one_of(
        st.tuples(st.just("set"), places, st.integers(0, 6), st.integers(1, 40)),
        st.tuples(st.just("fill"), places, st.integers(0, 6), st.sampled_from([1, 3, 8, 16, 40])),
        st.tuples(st.just("clear"), places, st.just(0), st.sampled_from([2, 8, 30])),
        st.tuples(st.just("prune"), st.just((0, 0, 0)), st.just(0), st.just(0)),
    ),
    max_size=6,
)


def apply(grid: Grid, change: tuple[str, tuple[int, int, int], int, int]) -> None:
    """One change, on voxels of 1 m."""
    what, at, which, size = change
    kind = next(name for name, each in GRIDS.items() if isinstance(grid, each))
    value = VALUES[kind][which % len(VALUES[kind])]
    box = Box(np.array(at) // 8 * 8 + size / 2, (size, size, size))
    if what == "set":
        random = np.random.default_rng(size)
        voxels = np.clip(at + random.integers(-9, 9, (size, 3)), LOW, LOW + SIDE - 1)
        dtype = {"bool": np.bool_, "int32": np.int32, "float32": np.float32}[kind]
        grid.set(voxels.astype(np.int32), np.full(size, value, dtype))
    elif what == "fill":
        grid.fill((box if which % 2 else Sphere(at, size / 2)).shape, value)
    elif what == "clear":
        grid.clear(box.shape)
    else:
        grid.prune()


def again(grid: Grid, edge: int) -> Grid:
    back = type(grid)(grid.voxel_size, grid.background)  # type: ignore[arg-type]
    back.place(grid.placement)
    back.put_blocks(grid.blocks(edge), edge)
    return back


@pytest.mark.parametrize("kind", GRIDS)
@settings(max_examples=12)
@given(steps=changes, which=st.integers(0, 6), edge=st.sampled_from(EDGES))
@example(steps=[("fill", (-40, 0, 0), 1, 40)], which=1, edge=8)
def test_cubes_are_the_grid(kind: ValueType, steps: list[Any], which: int, edge: int) -> None:
    """Cubes restore a grid, and equal fields have equal cubes, whatever their history."""
    grid = GRIDS[kind](1.0, VALUES[kind][which % len(VALUES[kind])])
    for step in steps:
        apply(grid, step)
    cubes = grid.blocks(edge)
    assert same(again(grid, edge), grid)
    assert again(grid, edge).blocks(edge) == cubes
    # another history: other voxels come and go, these come one by one
    other = type(grid)(1.0, grid.background)  # type: ignore[arg-type]
    other.fill(Sphere((5, 5, 5), 20).shape, VALUES[kind][0])
    other.clear(Box((0, 0, 0), (400, 400, 400)).shape)
    voxels, values = grid.read()
    order = np.random.default_rng(len(voxels)).permutation(len(voxels))
    other.set(voxels[order], values[order])  # type: ignore[arg-type]
    assert other.blocks(edge) == cubes


def test_large_tiles_cost_little() -> None:
    """A room full of air is some bytes a cube."""
    grid = BoolGrid(0.05, False)
    grid.fill(Box((0, 0, 0), (25.6, 25.6, 25.6)).shape, True)
    grid.prune()
    for edge in EDGES:
        cubes = grid.blocks(edge)
        assert len(cubes) == (512 // edge) ** 3
        assert {len(b) for b in cubes.values()} == {7}
        if edge > 16:
            assert len(again(grid, edge)) == 512**3


@pytest.mark.parametrize(
    "spoil",
    [
        lambda b: b[:-1],
        lambda b: b + b"\0",
        lambda b: b"\2" + b[1:],
        lambda b: b"",
        lambda b: b[:1] + b"\7" + b[2:],
        lambda b: b[:2] + b"\xff\xff" + b[4:],
        lambda b: b + b[1:],
    ],
)
def test_wrong_bytes_are_refused(spoil: Any) -> None:
    grid = Int32Grid(1.0, 0)
    grid.set(np.array([[1, 2, 3]], np.int32), np.array([5], np.int32))
    ((at, data),) = grid.blocks(32).items()
    fresh = Int32Grid(1.0, 0)
    with pytest.raises(ValueError, match="not a cube of a grid"):
        fresh.put_blocks({at: spoil(data)}, 32)
    with pytest.raises(ValueError, match="not a cube of a grid"):
        Int32Grid(1.0, 0).put_blocks({(8, 0, 0): data}, 32)
    with pytest.raises(ValueError, match="an edge of 8, 16, 32, 64 or 128"):
        grid.blocks(24)


@pytest.fixture(scope="module")
def kept(module_engine: Engine) -> Engine:
    """A database with a map."""
    with module_engine.begin() as connection:
        connection.execute(text("INSERT INTO map (name) VALUES ('office')"))
    return module_engine


@pytest.mark.parametrize("kind", GRIDS)
@settings(max_examples=6)
@given(saves=st.lists(changes, min_size=1, max_size=4), which=st.integers(0, 6))
def test_each_version_is_loaded_unchanged(
    kept: Engine, kind: ValueType, saves: list[Any], which: int
) -> None:
    grid = GRIDS[kind](1.0, VALUES[kind][which % len(VALUES[kind])])
    was: list[tuple[Grid, dict[Any, bytes]]] = []
    with kept.begin() as connection:
        field_store.forget(connection, kind)
        for number, steps in enumerate(saves, 1):
            for step in steps:
                apply(grid, step)
            turn = number / 10
            c, s = math.cos(turn), math.sin(turn)
            grid.place([[c, -s, 0, turn], [s, c, 0, -1 / 3], [0, 0, 1, 1e-9]])
            legend = {number: "mug", -1: "cup"} if kind == "int32" else None
            assert number == field_store.save(
                connection, kind, grid, property=IRI, legend=legend, state={"at": turn}
            )
            was.append((again(grid, 8), grid.blocks(field_store.EDGE)))
        for number, (before, _) in enumerate(was, 1):
            found = field_store.load(seen_by(connection), kind, number)
            assert same(found.grid, before)
            assert found.version == number
            assert found.legend == ({number: "mug", -1: "cup"} if kind == "int32" else None)
            assert found.state == {"at": number / 10}
        assert same(field_store.load(seen_by(connection), kind).grid, grid)
        # only what changed was written
        past: dict[Any, bytes] = {}
        for (_, cubes), version in zip(
            was, field_store.versions(seen_by(connection), kind), strict=True
        ):
            fresh = [b for at, b in cubes.items() if past.get(at) != b]
            assert (version.blocks, version.bytes) == (len(fresh), sum(map(len, fresh)))
            past = cubes
        # what is pruned is gone, what is not is as it was
        assert field_store.prune(connection, kind, 2) == max(len(saves) - 2, 0)
        for number, (before, _) in list(enumerate(was, 1))[-2:]:
            assert same(field_store.load(seen_by(connection), kind, number).grid, before)
        rows = connection.execute(text("SELECT count(*) FROM field_block")).scalar_one()
        held = {(at, b) for _, cubes in was[-2:] for at, b in cubes.items()}
        assert rows >= len(held)
        assert rows <= sum(len(cubes) for _, cubes in was[-2:])
        field_store.forget(connection, kind)
        assert connection.execute(text("SELECT count(*) FROM field_block")).scalar_one() == 0


def test_the_attributes_of_a_field(kept: Engine) -> None:
    grid = Int32Grid(0.05, -1)
    grid.fill(Sphere((0, 0, 1), 0.3).shape, 41)
    with kept.begin() as connection:
        field_store.save(
            connection,
            "seen by gerda",
            grid,
            property="urn:semmap:ontology#containsObject",
            about="gerda",
            legend={41: "mug"},
        )
    with kept.begin() as connection:
        assert field_store.names(seen_by(connection)) == ["seen by gerda"]
        found = field_store.load(seen_by(connection), "seen by gerda")
        assert found.property == "urn:semmap:ontology#containsObject"
        assert (found.about, found.legend, found.state) == ("gerda", {41: "mug"}, None)
        assert found.at.tzinfo is not None
        assert same(found.grid, grid)
        row = connection.execute(text("SELECT * FROM field")).one()
        assert (row.value_type, row.voxel_size, row.version) == ("int32", 0.05, 1)
        field_store.forget(connection, "seen by gerda")
        field_store.forget(connection, "seen by gerda")


def test_fields_belong_to_their_map(engine: Engine) -> None:
    with engine.begin() as connection:
        for name in ("a", "b"):
            connection.execute(text("INSERT INTO map (name) VALUES (:name)"), {"name": name})
            see_map(connection, name)
            field_store.save(connection, f"of {name}", FloatGrid(0.1, 0.0), property=IRI)
        assert field_store.names(seen_by(connection)) == ["of b"]
        see_map(connection, "a")
        assert field_store.names(seen_by(connection)) == ["of a"]
        connection.execute(text("SELECT drop_map('a')"))
        assert connection.execute(text("SELECT count(*) FROM field_version")).scalar_one() == 1


def refused(kept: Engine, says: str, act: Any, error: type[Exception] = ValueError) -> None:
    with kept.begin() as connection:
        before = field_store.versions(seen_by(connection), "space")
        with pytest.raises(error, match=says):
            act(connection)
        assert field_store.versions(seen_by(connection), "space") == before
        assert field_store.names(seen_by(connection)) == ["space"]


def test_wrong_fields_are_refused(kept: Engine) -> None:
    grid, bools = FloatGrid(0.1, 0.0), BoolGrid(0.1, False)
    with kept.begin() as connection:
        field_store.save(connection, "space", grid, property=IRI)
    other = FloatGrid(0.2, 0.0)

    def saved(grid: Grid, name: str = "space", **what: Any) -> Any:
        return lambda c: field_store.save(c, name, grid, **{"property": IRI, **what})

    refused(kept, "voxels of 0.1 m, but this one is .* 0.2 m", saved(other))
    refused(kept, "is stored as float32 values of .*, but this one is bool", saved(bools))
    refused(kept, "but this one is .* about gerda", saved(grid, about="gerda"))
    refused(kept, "this one is float32 values of urn:x", saved(grid, property="urn:x"))
    refused(kept, "needs a name and a property", saved(grid, property=""))
    refused(kept, "needs a name and a property", saved(grid, name=""))
    refused(kept, "cannot have a legend", saved(grid, legend={1: "mug"}))
    refused(kept, "keep is 0: give at least 1", lambda c: field_store.prune(c, "space", 0))
    unknown = "there is no field spice in this map; fields: space"
    refused(kept, unknown, lambda c: field_store.load(seen_by(c), "spice"), LookupError)
    refused(kept, unknown, lambda c: field_store.versions(seen_by(c), "spice"), LookupError)
    refused(
        kept,
        "there is no version 7 of the field space; versions: 1",
        lambda c: field_store.load(seen_by(c), "space", 7),
        LookupError,
    )
    with kept.begin() as connection:
        field_store.forget(connection, "space")


def test_no_map(engine: Engine) -> None:
    with (
        engine.begin() as connection,
        pytest.raises(LookupError, match="there is no map to store a field"),
    ):
        field_store.save(connection, "space", FloatGrid(0.1, 0.0), property=IRI)


def test_an_uncommitted_field_is_not_stored(kept: Engine) -> None:
    with kept.connect() as connection:
        field_store.save(connection, "space", FloatGrid(0.1, 0.0), property=IRI)
        connection.rollback()
        assert field_store.names(seen_by(connection)) == []


def test_a_robot_may_store_fields_and_a_reader_may_load_them(kept: Engine) -> None:
    grid = FloatGrid(0.1, 0.0)
    grid.fill(Sphere((0, 0, 0), 1).shape, 0.5)
    with kept.begin() as connection:
        connection.execute(text("SET LOCAL ROLE semmap_robot"))
        for _ in range(3):
            field_store.save(connection, "space", grid, property=IRI)
        field_store.prune(connection, "space", 1)
        connection.execute(text("SET LOCAL ROLE semmap_reader"))
        assert same(field_store.load(seen_by(connection), "space").grid, grid)
        with pytest.raises(DBAPIError, match="permission denied"), connection.begin_nested():
            field_store.save(connection, "space", grid, property=IRI)
        connection.execute(text("SET LOCAL ROLE semmap_robot"))
        field_store.forget(connection, "space")


def test_concurrent_saves_wait_for_each_other(kept: Engine) -> None:
    """Two processes that save one field give two versions."""

    def put(value: float) -> None:
        grid = FloatGrid(0.1, 0.0)
        grid.fill(Sphere((value, 0, 0), 1).shape, value)
        with kept.begin() as connection:
            field_store.save(connection, "space", grid, property=IRI)

    threads = [threading.Thread(target=put, args=(float(k + 1),)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    with kept.begin() as connection:
        assert [v.version for v in field_store.versions(seen_by(connection), "space")] == [
            1,
            2,
            3,
            4,
            5,
            6,
        ]
        seen = {
            float(field_store.load(seen_by(connection), "space", n).grid.read()[1][0])
            for n in range(1, 7)
        }
        assert seen == {1.0, 2.0, 3.0, 4.0, 5.0, 6.0}
        field_store.forget(connection, "space")


def test_fields_survive_a_crash_of_the_server(own: Cluster) -> None:
    grids: list[Grid] = []
    for kind, each in GRIDS.items():
        grid = each(1.0, VALUES[kind][0])
        for step in (("fill", (-8, 16, 0), 1, 40), ("set", (-20, 3, 9), 3, 30)):
            apply(grid, step)
        grids.append(grid)
    engine = open_engine(own.ensure())
    with engine.begin() as connection:
        connection.execute(text("INSERT INTO map (name) VALUES ('lasting')"))
        for kind, grid in zip(GRIDS, grids, strict=True):
            field_store.save(connection, kind, grid, property=IRI)
    lost = engine.connect()
    field_store.save(lost, "lost", grids[0], property=IRI)
    kill_server(own)
    lost.invalidate()
    engine.dispose()
    for end in (kill_server, Cluster.stop):
        engine = open_engine(own.ensure())
        with engine.connect() as connection:
            assert field_store.names(seen_by(connection)) == sorted(GRIDS)
            for kind, grid in zip(GRIDS, grids, strict=True):
                assert same(field_store.load(seen_by(connection), kind).grid, grid)
        engine.dispose()
        end(own)
    engine = open_engine(own.ensure())
    with engine.begin() as connection:
        connection.execute(text("SELECT drop_map('lasting')"))
    engine.dispose()
