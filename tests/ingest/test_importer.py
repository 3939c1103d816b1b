"""A file into the map: what comes in, what a repeat does, what a bad file leaves."""

from __future__ import annotations

import json
import shutil
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import Engine, text

from semmap.ingest.importer import import_file
from semmap.ingest.world import WorldError
from tests.command_line import semmap
from tests.ingest.worlds_by_hand import box_world, room_features
from tests.waiting import wait_until

COUNTS = (
    "SELECT (SELECT count(*) FROM entity), (SELECT count(*) FROM placement), "
    "(SELECT count(*) FROM model), (SELECT count(*) FROM chunk), (SELECT count(*) FROM change), "
    "(SELECT count(*) FROM placement_history), (SELECT count(*) FROM import), "
    "(SELECT count(*) FROM map)"
)


def counts(engine: Engine) -> tuple[Any, ...]:
    with engine.connect() as connection:
        return tuple(connection.execute(text(COUNTS)).one())


def poses(engine: Engine, map_name: str) -> dict[str, list[float]]:
    with engine.connect() as connection:
        rows = connection.execute(
            text(
                "SELECT e.name, w.pose FROM entity e JOIN world w ON w.entity_id = e.id "
                "JOIN map m ON m.id = e.map_id WHERE m.name = :map"
            ),
            {"map": map_name},
        )
        return {row[0]: row[1] for row in rows}


def holders(engine: Engine, map_name: str) -> dict[str, str | None]:
    with engine.connect() as connection:
        rows = connection.execute(
            text(
                "SELECT e.name, h.name FROM entity e JOIN placement p ON p.entity_id = e.id "
                "LEFT JOIN entity h ON h.id = p.holder_id "
                "JOIN map m ON m.id = e.map_id WHERE m.name = :map"
            ),
            {"map": map_name},
        )
        return {row[0]: row[1] for row in rows}


def test_a_repeated_import_changes_nothing(engine: Engine, tmp_path: Path) -> None:
    path = box_world(tmp_path, {"table": (0, 0, 0.4), "mug": (0.1, 0, 0.9)})
    first = import_file(engine, path, map_name="repeat")
    assert (first.added, first.changed, first.removed) == (2, 0, 0)
    before = counts(engine)
    again = import_file(engine, path, map_name="repeat")
    assert (again.added, again.changed, again.removed, again.unchanged) == (0, 0, 0, 2)
    assert again.holders == 0
    assert counts(engine) == before


def test_a_changed_file_updates_the_changed_entities(engine: Engine, tmp_path: Path) -> None:
    path = box_world(tmp_path, {"a": (0, 0, 0), "b": (3, 0, 0), "c": (6, 0, 0)})
    import_file(engine, path, map_name="changed")
    box_world(tmp_path, {"a": (0, 0, 0), "b": (3, 1, 0), "d": (9, 0, 0)})
    summary = import_file(engine, path, map_name="changed")
    assert (summary.added, summary.changed, summary.removed, summary.unchanged) == (1, 1, 1, 1)
    now = poses(engine, "changed")
    assert set(now) == {"a", "b", "d"}
    assert now["b"][:2] == [3.0, 1.0]


def test_meshes_are_shared_by_their_instances(engine: Engine, tmp_path: Path) -> None:
    before = counts(engine)
    path = box_world(tmp_path, {f"crate{i}": (2.0 * i, 40, 0) for i in range(6)}, size=0.777)
    summary = import_file(engine, path, map_name="shared")
    assert summary.added == 6
    assert counts(engine)[2] == before[2] + 1


@pytest.mark.parametrize("stage", ["entities", "placements"])
@pytest.mark.parametrize("map_name", ["gone", "other"])
def test_a_map_is_dropped_after_an_import_that_has_begun(
    engine: Engine, tmp_path: Path, map_name: str, stage: str
) -> None:
    import_file(engine, box_world(tmp_path, {"a": (0, 0, 0), "b": (3, 0, 0)}), map_name="gone")
    path = box_world(tmp_path, {"a": (0, 0, 0), "c": (6, 0, 0)})
    begun: list[Future[None]] = []

    def drop() -> None:
        with engine.begin() as connection:
            connection.execute(text("SELECT drop_map('gone')"))

    def is_waiting() -> bool:
        with engine.connect() as connection:
            statement = "SELECT count(*) FROM pg_stat_activity WHERE wait_event_type = 'Lock'"
            return bool(connection.scalar(text(f"{statement} AND query ~ '^SELECT drop_map'")))

    def drop_at_stage(at: str, done: int, _: int) -> None:
        if at == stage and not begun:
            begun.append(pool.submit(drop))
            wait_until(is_waiting)

    with ThreadPoolExecutor() as pool:
        import_file(engine, path, map_name=map_name, progress=drop_at_stage)
        begun[0].result()
    assert set(poses(engine, map_name)) == ({"a", "c"} if map_name == "other" else set())


def test_moves_by_a_robot_survive_an_import(engine: Engine, tmp_path: Path) -> None:
    path = box_world(tmp_path, {"mug": (0, 0, 0)})
    import_file(engine, path, map_name="moved")
    with engine.begin() as connection:
        connection.execute(
            text(
                "SELECT move_to(e.id, 5, 5, 0) FROM entity e JOIN map m ON m.id = e.map_id "
                "WHERE m.name = 'moved' AND e.name = 'mug'"
            )
        )
    import_file(engine, path, map_name="moved")
    assert poses(engine, "moved")["mug"][:2] == [5.0, 5.0]


@pytest.mark.parametrize("rooms_first", [True, False])
def test_inventories_follow_in_whatever_order_files_come(
    engine: Engine, tmp_path: Path, rooms_first: bool
) -> None:
    name = f"order{rooms_first}"
    world = box_world(tmp_path, {"table": (1, 1, 0.4), "mug": (1.1, 1, 0.9), "far": (50, 50, 0.4)})
    rooms = tmp_path / "rooms.geojson"
    rooms.write_text(json.dumps(room_features({"kitchen1": (0, 0, 4, 3)})))
    for path in (rooms, world) if rooms_first else (world, rooms):
        import_file(engine, path, map_name=name)
    held = holders(engine, name)
    assert held["table"] == "kitchen1"
    assert held["mug"] == "table"
    assert held["far"] is None


def test_names_that_another_file_has_get_a_suffix(engine: Engine, tmp_path: Path) -> None:
    one = box_world(tmp_path / "one", {"a": (0, 0, 0)})
    two = box_world(tmp_path / "two", {"a": (5, 0, 0)})
    import_file(engine, one, map_name="names")
    summary = import_file(engine, two, map_name="names")
    assert any("a_2" in note for note in summary.notes)
    assert set(poses(engine, "names")) == {"a", "a_2"}
    again = import_file(engine, two, map_name="names")
    assert (again.added, again.unchanged) == (0, 1)


def test_a_world_imported_twice_under_two_names_stands_beside_itself(engine: Engine) -> None:
    office = Path(__file__).parents[2] / "examples" / "office" / "office.sdf"
    first = import_file(engine, office, map_name="twins", source="one")
    second = import_file(engine, office, map_name="twins", source="two")
    assert first.kinds["object"] == second.added == 220


def test_a_type_missing_from_the_t_box_is_left_out_or_defined(
    engine: Engine, tmp_path: Path
) -> None:
    path = tmp_path / "odd.geojson"
    features = room_features({"room1": (0, 0, 4, 3), "room2": (4, 0, 8, 3), "room3": (8, 0, 12, 3)})
    for feature, type_ in zip(
        features["features"], ("orangery", "kitchn", "meeting room"), strict=True
    ):
        feature["properties"]["type"] = type_
    path.write_text(json.dumps(features))
    import_file(engine, box_world(tmp_path, {"a": (0, 0, 0)}), map_name="a")  # with the T-Box
    before = types(engine)
    summary = import_file(engine, path, map_name="odd")
    assert types(engine) - before == set()
    assert poses(engine, "odd").keys() == {"room3"}
    orangery, kitchen = summary.skipped
    assert "'orangery'" in orangery.problem
    assert "--define" in orangery.fix
    assert "kitchen" in kitchen.fix
    with pytest.raises(WorldError, match="orangery"):
        import_file(engine, path, map_name="strict odd", strict=True)
    summary = import_file(engine, path, map_name="odd", define=True)
    assert summary.skipped == []
    assert any("orangery" in note for note in summary.notes)
    assert types(engine) - before == {("orangery", "room"), ("kitchn", "room")}
    assert import_file(engine, path, map_name="odd").unchanged == 3  # the map has them now


def types(engine: Engine) -> set[tuple[str, str]]:
    """All types with their parents."""
    with engine.connect() as connection:
        rows = connection.execute(text("SELECT type, parent FROM type_parent"))
        return {(row[0], row[1]) for row in rows}


def test_strict_takes_nothing_where_something_is_left_out(engine: Engine, tmp_path: Path) -> None:
    path = box_world(tmp_path, {"a": (0, 0, 0), "b": (0, 0, float("nan"))})
    before = counts(engine)
    with pytest.raises(WorldError, match="b"):
        import_file(engine, path, map_name="strict", strict=True)
    assert counts(engine) == before
    summary = import_file(engine, path, map_name="strict")
    assert summary.added == 1
    assert len(summary.skipped) == 1


@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_random_damage_leaves_the_map_as_it_was_or_says_what_it_left_out(
    engine: Engine, tmp_path: Path, data: st.DataObject
) -> None:
    """A file damaged as a whole changes nothing; a damaged element is left out and named."""
    shutil.rmtree(tmp_path / "d", ignore_errors=True)
    path = box_world(tmp_path / "d", {"a": (0, 0, 0), "b": (3, 0, 0), "c": (6, 0, 0)})
    whole = data.draw(st.booleans())
    content = path.read_text()
    if whole:
        kind = data.draw(st.sampled_from(["cut", "bomb", "root", "binary"]))
        if kind == "cut":
            path.write_text(content[: data.draw(st.integers(1, len(content) - 12))])
        elif kind == "bomb":
            bomb = '<!DOCTYPE b [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>'
            path.write_text(bomb + content.replace("<sdf", "<sdf x='&b;'", 1))
        elif kind == "root":
            path.write_text("<html><body/></html>")
        else:
            path.write_bytes(data.draw(st.binary(min_size=1, max_size=200)))
        before = counts(engine)
        with pytest.raises(WorldError) as refused:
            import_file(engine, path, map_name="damaged")
        assert path.name in str(refused.value)
        assert counts(engine) == before
    else:
        name = data.draw(st.sampled_from(["a", "b", "c"]))
        bad = data.draw(st.sampled_from(["nan", "inf", "343582000"]))
        model = content.index(f"<model name='{name}'>")
        pose = content.index("<pose>", model) + len("<pose>")
        path.write_text(content[:pose] + bad + content[content.index(" ", pose) :])
        summary = import_file(engine, path, map_name="damaged")
        assert [s.element for s in summary.skipped if name in s.element]
        assert set(poses(engine, "damaged")) == {"a", "b", "c"} - {name}


EMPTY = {
    "w.sdf": ("<sdf version='1.9'><world name='w'><light name='sun'/></world></sdf>", "nothing"),
    "p.sdf": (
        "<sdf version='1.9'><world name='w'><population name='crowd'/></world></sdf>",
        "population crowd: its geometry exists only when the simulator runs, so nothing of",
    ),
    "f.geojson": ('{"type": "FeatureCollection", "features": []}', "nothing"),
}


@pytest.mark.parametrize("name", EMPTY)
def test_an_import_that_brings_nothing_is_an_error_and_leaves_no_map(
    engine: Engine, tmp_path: Path, name: str
) -> None:
    path = tmp_path / name
    content, says = EMPTY[name]
    path.write_text(content)
    before = counts(engine)
    with pytest.raises(WorldError, match=says):
        import_file(engine, path)
    assert counts(engine) == before


PUMP = (
    "<sdf version='1.9'><model name='{}'><link name='l'><visual name='v'><geometry><box>"
    "<size>0.4 0.5 0.6</size></box></geometry></visual></link></model></sdf>"
)


@pytest.fixture
def ward(tmp_path: Path) -> Path:
    """A world whose models lie in another folder, as strangers keep theirs; one mesh is missing."""
    for model in ("floor_2_pump", "floor_1"):
        (tmp_path / "library" / model).mkdir(parents=True)
        (tmp_path / "library" / model / "model.sdf").write_text(PUMP.format(model))
    broken = PUMP.format("Bed_01").replace(
        "<box><size>0.4 0.5 0.6</size></box>", "<mesh><uri>no.dae</uri></mesh>"
    )
    (tmp_path / "library" / "Bed_01").mkdir()
    (tmp_path / "library" / "Bed_01" / "model.sdf").write_text(broken)
    path = tmp_path / "ward" / "ward.world"
    path.parent.mkdir()
    includes = "".join(
        f"<include><uri>model://{model}</uri><pose>{x} 2 0 0 0 0</pose></include>"
        for x, model in enumerate(("floor_2_pump", "floor_1", "Bed_01"), 1)
    )
    path.write_text(f"<sdf version='1.9'><world name='ward'>{includes}</world></sdf>")
    return path


def test_model_path_and_the_list_of_guesses(database: str, ward: Path, tmp_path: Path) -> None:
    words = ("import", ward, "--json")
    (without,) = json.loads(semmap(database, *words).stdout)
    assert len(without["skipped"]) == 3
    assert "--model-path" in without["skipped"][0]["fix"]
    (done,) = json.loads(semmap(database, *words, "--model-path", tmp_path / "library").stdout)
    assert [s["element"] for s in done["skipped"]] == [
        "Bed_01/model.sdf: model Bed_01: link l: visual v"
    ]
    guess = {"name": "Bed_01", "type": "bed", "confidence": 0.9}
    assert done["guessed"] == [guess]
    listed = json.loads(semmap(database, "ls", "--guessed", "--json").stdout)
    assert listed == [guess | {"model": "Bed_01"}]
    found = {row["name"]: row for row in json.loads(semmap(database, "ls", "--json").stdout)}
    assert found["floor_1"]["type"] is None  # 0.6 m high: not flat
    assert found["floor_2_pump"]["type"] is None
    assert [found["Bed_01"][axis] for axis in "xyz"] == [3, 2, 0]  # its mesh is missing
    correct = "UPDATE gis_object SET type = 'sofa' WHERE name = 'Bed_01'"
    assert semmap(database, "sql", "--write", correct).exit_code == 0
    assert json.loads(semmap(database, "ls", "--guessed", "--json").stdout) == []


def test_scale_is_metres_per_unit_of_a_mesh_file(database: str, tmp_path: Path) -> None:
    part = tmp_path / "part.obj"
    part.write_text(
        "v 0 0 0\nv 1000 0 0\nv 0 2000 0\nv 0 0 3000\nf 1 3 2\nf 1 4 3\nf 1 2 4\nf 2 3 4\n"
    )
    notes = json.loads(semmap(database, "import", part, "--json").stdout)[0]["notes"]
    assert any("--scale 0.001" in note for note in notes)
    semmap(database, "import", part, "--scale", "0.001", "--map", "scaled")
    high = "SELECT ST_ZMax(box) AS high FROM world WHERE entity_id = entity_id('part')"
    rows = json.loads(semmap(database, "sql", high, "--map", "scaled", "--json").stdout)
    assert rows == [{"high": pytest.approx(3)}]
    with pytest.raises(WorldError, match="scale"):
        semmap(database, "import", box_world(tmp_path, {"a": (0, 0, 0)}), "--scale", "2")


def test_define_adds_the_types_of_drawn_features(database: str, tmp_path: Path) -> None:
    path = tmp_path / "odd.geojson"
    features = room_features({"room1": (0, 0, 4, 3), "room2": (4, 0, 8, 3)})
    features["features"][0]["properties"]["type"] = "kitchn"
    path.write_text(json.dumps(features))
    said = " ".join(semmap(database, "import", path).stdout.split())
    assert "its type 'kitchn' is none that the map has" in said
    assert "kitchen" in said
    assert "left out: 1" not in semmap(database, "import", path, "--define").stdout


def square_building(path: Path, west: float, storey: dict[str, Any]) -> Path:
    """An Open-RMF building of one room of 10 x 10 m with two chairs, a place and a lane."""
    corners = [(west, 0), (west + 10, 0), (west + 10, 10), (west, 10)]
    places = [(west + 5, 7, 0, "hub"), (west + 2, 7, 0, "dock")]
    level = {
        "elevation": 0,
        "vertices": [*([x, y, 0, ""] for x, y in corners), *map(list, places)],
        "walls": [[a, (a + 1) % 4, {}] for a in range(4)],
        "floors": [{"parameters": {}, "vertices": [0, 1, 2, 3]}],
        "lanes": [[4, 5, {}]],
        "models": [
            {"model_name": "Chair", "name": f"chair{n}", "x": west + n, "y": 1} for n in (1, 2)
        ],
    }
    building = {"name": path.stem, "coordinate_system": "cartesian_meters", "lifts": {}}
    path.write_text(yaml.safe_dump(building | {"levels": {"L1": level | storey}}))
    return path


@pytest.mark.parametrize("storey", [{}, {"floors": []}, {"elevation": 1.5}])
def test_two_buildings_of_equal_names_are_both_in_the_map(
    engine: Engine, tmp_path: Path, storey: dict[str, Any]
) -> None:
    """Furniture without a shape and places, too, each where its own file has it."""
    files = {
        west: square_building(tmp_path / f"site{west}.building.yaml", west, storey if west else {})
        for west in (0, 50)
    }
    summaries = [import_file(engine, path, map_name="both") for path in files.values()]
    at = poses(engine, "both")
    for name, x, y in (("chair1", 1, 1), ("chair2", 2, 1), ("hub", 5, 7), ("dock", 2, 7)):
        for west, suffix in zip(files, ("", "_2"), strict=True):
            expected = (west + x, y, storey.get("elevation", 0) if west else 0)
            assert at[name + suffix][:3] == pytest.approx(expected)
    note = "chair1: the map has one already; this one is chair1_2"
    assert note in summaries[1].notes
    assert summaries[0].added == summaries[1].added + ("floors" in storey)
    held = holders(engine, "both")
    theirs = "L1" if "floors" in storey else "L1_2"
    assert (held["walls-L1"], held["walls-L1_2"]) == ("L1", theirs)
    again = [import_file(engine, path, map_name="both") for path in files.values()]
    assert [(s.added, s.changed, s.removed, s.holders) for s in again] == [(0, 0, 0, 0)] * 2
    with engine.connect() as connection:
        lanes = connection.execute(
            text(
                "SELECT a.name, b.name FROM link JOIN entity a ON a.id = from_id "
                "JOIN entity b ON b.id = to_id JOIN map m ON m.id = a.map_id WHERE m.name = 'both'"
            )
        )
        assert {(*lane,) for lane in lanes} == {("hub", "dock"), ("hub_2", "dock_2")}


def test_a_door_far_from_its_rooms_is_an_error_and_strict_refuses_it(
    engine: Engine, tmp_path: Path
) -> None:
    def feature(name: str, kind: str, geometry: dict[str, Any], **more: Any) -> dict[str, Any]:
        properties = {"kind": kind, "name": name, **more}
        return {"type": "Feature", "properties": properties, "geometry": geometry}

    def room(name: str, x: float) -> dict[str, Any]:
        ring = [[x, 0], [x + 4, 0], [x + 4, 3], [x, 3], [x, 0]]
        return feature(name, "room", {"type": "Polygon", "coordinates": [ring]})

    line = {"type": "LineString", "coordinates": [[130, 1], [130, 2]]}
    door = feature("way", "connector", line, joins="west,east")
    path = tmp_path / "flat.geojson"
    features = [room("west", 0), room("east", 4), door]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with pytest.raises(WorldError, match=r"way ends 126\.00 m beside west"):
        import_file(engine, path, map_name="flat", strict=True)
    assert counts(engine)[-1] == 0
    notes = import_file(engine, path, map_name="flat").notes
    assert [note.partition(" m beside")[0] for note in notes] == ["error: way ends 126.00"]
    line["coordinates"] = [[4, 1], [4, 2]]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    assert import_file(engine, path, map_name="flat", strict=True).notes == []
