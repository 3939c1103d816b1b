"""The fields of the small house, with and without the service, judged by meshes and by SQL."""

from __future__ import annotations

import json
import queue
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import semmap
from semmap.api.spatial_fields import SpatialFields
from tests.waiting import wait_until

LOOK = {"poses": {"human1": {"from": [6.5, -1.0, 1.6], "to": [7.153, 0.983, 0.85]}}}
FRIDGE = "Refrigerator_01_001"


def mesh_of(small_house: semmap.Map, name: str) -> trimesh.Trimesh:
    """The mesh of an entity in the map's frame, by SQL alone."""
    (row,) = small_house.sql(
        "SELECT ST_XMin(box), ST_YMin(box), ST_ZMin(box), ST_XMax(box), ST_YMax(box), ST_ZMax(box) "
        "FROM world w JOIN entity e ON e.id = w.entity_id WHERE e.name = %s",
        name,
    )
    return trimesh.creation.box(bounds=[row[:3], row[3:]])


def points_of(path: Path) -> Any:
    return trimesh.load(path).vertices  # type: ignore[attr-defined]


@pytest.fixture
def noted(small_house: semmap.Map) -> tuple[SpatialFields, list[str]]:
    """The fields of the small_house, and the notes that they make."""
    notes: list[str] = []
    url = small_house.database.address
    return SpatialFields(url, "house", lambda: small_house, note=notes.append), notes


def test_voxels_lie_in_the_boxes_of_their_entities(small_house: semmap.Map) -> None:
    box = mesh_of(small_house, FRIDGE)
    middle = box.bounds.mean(axis=0)
    found = dict(small_house.fields.at(*middle))
    assert found["kitchen"] == "room"
    top = [*middle[:2], box.bounds[1, 2] - 0.02]
    assert small_house.fields.at(*top)[0] == (FRIDGE, "object")
    assert small_house.fields.at(0, 0, 50) == []
    with pytest.raises(ValueError, match="three finite numbers"):
        small_house.fields.at(float("nan"), 0, 0)


def test_entities_have_a_volume_below_that_of_their_boxes(small_house: semmap.Map) -> None:
    rows = {row.name: row for row in small_house.fields.ls()}
    fridge = rows[FRIDGE]
    assert (fridge.kind, rows["kitchen"].kind) == ("object", "room")
    assert fridge.volume == pytest.approx(fridge.voxels * 0.05**3)
    grown = np.prod(mesh_of(small_house, FRIDGE).extents + 0.1)
    assert 0.1 * grown < fridge.volume < grown
    fine = {row.name: row for row in small_house.fields.with_voxel_size(0.1).ls()}
    assert fine[FRIDGE].voxels < fridge.voxels


def test_answers_are_sequences(noted: tuple[SpatialFields, list[str]]) -> None:
    fields, notes = noted
    count = "SELECT ?o (COUNT(?v) AS ?n) { ?v :inRoom :kitchen ; :occupiedBy ?o } GROUP BY ?o"
    answer = fields.query(count)
    assert answer.names == ("o", "n")
    voxels = {row.name: row.voxels for row in fields.ls()}
    assert all(0 < n <= voxels[name] for name, n in answer)
    assert FRIDGE in dict(answer)
    assert answer.total == len(answer) > 3
    few = fields.query(count, limit=2)
    assert (len(few), few.total) == (2, answer.total)
    assert "<th>o</th>" in few._repr_html_()
    assert "answered from the kept state of the map" in answer.notes[0]
    assert answer.notes[0] in notes
    assert fields.query(f"ASK {{ :{FRIDGE} :in :kitchen }}")
    no = fields.query(f"ASK {{ :kitchen :in :{FRIDGE} }}")
    assert (no.truth, bool(no)) == (False, False)
    ((voxel,), *_) = fields.query("SELECT ?v { ?v :inRoom :kitchen } LIMIT 3")
    assert len(voxel) == 3
    with pytest.raises(ValueError, match=r"line 1, column \d+: no source provides"):
        fields.query("SELECT ?v { ?v :distanceToPerson ?d }")


def test_stored_fields_have_versions_and_files(small_house: semmap.Map, tmp_path: Path) -> None:
    fields = small_house.fields
    cold = f"SELECT ?v {{ ?v :occupiedBy :{FRIDGE} }} STORE :occupiedBy"
    answer = fields.query(cold, keep="cold", output=tmp_path / "cold.vdb")
    assert answer.stored is not None
    assert (answer.stored["kept"], answer.stored["version"]) == ("cold", 1)
    assert (tmp_path / "cold.vdb").read_bytes()[:4] == b" BDV"
    voxels = {row.name: row.voxels for row in fields.ls()}[FRIDGE]
    (kept,) = list(fields)
    assert kept == ("cold", "occupiedBy", FRIDGE, voxels, 1)
    done = fields.export(tmp_path / "out", "cold")
    assert done["voxels"] == voxels == len(points_of(tmp_path / "out/points.ply"))
    with pytest.raises(LookupError, match="no version 2 of the field cold"):
        fields.export(tmp_path / "none", "cold", 2)
    with pytest.raises(ValueError, match="name the field"):
        fields.export(tmp_path / "none", version=2)
    for wrong, says in (
        ({"keep": "a\0"}, "has a NUL"),
        ({"keep": ""}, "needs a name"),
        ({"output": tmp_path / "none" / "a.vdb"}, "there is no folder"),
        ({"limit": -1}, "limit is -1"),
    ):
        with pytest.raises(ValueError, match=says):
            fields.query(cold, **wrong)
    fields.forget("cold")
    with pytest.raises(LookupError, match="there is no field cold in this map; fields: none"):
        fields.forget("cold")
    assert fields.kept() == []
    everything = fields.with_voxel_size(0.1).export(tmp_path / "all")
    sets = json.loads((tmp_path / "all/sets.json").read_text())
    assert len(sets) == everything["sets"]
    points = points_of(tmp_path / "all/points.ply")
    box = mesh_of(small_house, FRIDGE)
    near = np.all((points >= box.bounds[0] - 0.1) & (points <= box.bounds[1] + 0.1), axis=1)
    assert near.sum() > 100
    assert len(points) == everything["voxels"]


def test_an_update_makes_a_region(small_house: semmap.Map) -> None:
    where = f"WHERE {{ ?v :occupiedBy :{FRIDGE} }}"
    changes = small_house.fields.update(f"INSERT {{ _:cold :occupies ?v }} {where}")
    (name,) = changes.changed
    assert changes.new == {"cold": name}
    voxels = {row.name: row.voxels for row in small_house.fields.ls()}
    assert voxels[name] == voxels[FRIDGE]
    small_house[name].delete()


def lifted(small_house: semmap.Map, events: Iterator[dict[str, Any]]) -> set[tuple[str, str]]:
    """Lift the tableware from its table; the relations of it that begin and end."""
    mug = small_house["Tableware_01_001"]
    x, y, z = mug.pose[:3]
    mug.move_to(x, y, z + 1)
    found = set()
    for event in events:
        if event["subject"] == mug.name:
            found.add((event["relation"], event["event"]))
        if ("on", "end") in found:
            break
    mug.move_to(x, y, z)
    return found


def test_relations_are_followed_without_a_service(small_house: semmap.Map) -> None:
    with small_house.fields.watch(seconds=60) as events:
        assert events.count > 10
        assert ("on", "end") in lifted(small_house, iter(events))
    assert list(small_house.fields.watch(seconds=0.1)) == []


@pytest.fixture(scope="module")
def served(small_house: semmap.Map) -> Iterator[semmap.Map]:
    """The small_house while a service of it runs in this process."""
    stop, started = threading.Event(), queue.SimpleQueue[tuple[str, Path, list[str]]]()
    with semmap.connect(small_house.database.address) as opened:
        thread = threading.Thread(
            target=opened.map("house").fields.serve,
            kwargs={
                "sources": ["gaze=socket"],
                "rates": ["gaze=50"],
                "stop": stop,
                "started": lambda *found: started.put(found),
            },
        )
        thread.start()
        name, path, sources = started.get(timeout=60)
        assert (name, sources, path.is_socket()) == ("house", ["gaze"], True)
        yield small_house
        stop.set()
        thread.join(20)
        assert not thread.is_alive()


def test_the_service_answers(served: semmap.Map) -> None:
    fields = served.fields
    heard: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    with fields.watch() as events, fields.watch(heard.put) as also:
        assert events.count == also.count > 10
        fields.send("gaze", [LOOK])
        seen = ("human1", "sees", "Tableware_01_001", "begin")
        for event in events:
            if (*(event[k] for k in ("subject", "relation", "object", "event")),) == seen:
                break
        wait_until(lambda: heard.get(timeout=20)["relation"] == "sees")
    answer = fields.query("ASK { :human1 :sees :Tableware_01_001 }")
    assert answer
    assert answer.notes[0] == "answered by the service of house"
    assert "human1_view" in dict(fields.at(7.153, 0.983, 0.85))
    assert served.sparql("ASK { :human1 semmap:sees :Tableware_01_001 }")
    assert {row.name for row in fields.ls()} >= {"human1_view", FRIDGE}
    with pytest.raises(ValueError, match="a service of house is running: stop it first"):
        fields.serve()


def test_sources_are_started_and_refuse_percepts_of_others(served: semmap.Map) -> None:
    fields = served.fields
    fields.start_source("seen", source="people")
    assert {row["name"] for row in fields.sources()} == {"gaze", "seen"}
    people = {"people": {"human1": {"x": 6, "y": -1}}}
    says = "the source seen takes percepts with depth and labels, not with people"
    with pytest.raises(ValueError, match=says):
        fields.send("seen", people)
    with pytest.raises(ValueError, match="gaze takes percepts with poses, not with people"):
        fields.send("gaze", people)
    with pytest.raises(ValueError, match="no source none takes percepts"):
        fields.send("none", people)
    fields.stop_source("seen")
    assert [row["name"] for row in fields.sources()] == ["gaze"]
    with pytest.raises(ValueError, match="the source seen is not running"):
        fields.stop_source("seen")


def test_relations_are_pushed_into_the_map(served: semmap.Map) -> None:
    served.fields.send("gaze", LOOK)
    pushed: queue.SimpleQueue[list[str]] = queue.SimpleQueue()
    with semmap.connect(served.database.address) as opened:
        pusher = threading.Thread(
            target=opened.map("house").push_fields,
            args=({"sees": "looksAt"},),
            kwargs={"seconds": 3, "started": pushed.put},
        )
        pusher.start()
        assert pushed.get(timeout=20) == ["sees"]
        looks = "ASK { :human1 oro:looksAt :Tableware_01_001 }"
        wait_until(lambda: served.sparql(looks))
        pusher.join(30)
        assert not pusher.is_alive()
    assert not served.sparql(looks)


def test_without_a_service_there_is_none_to_ask(db: semmap.Database) -> None:
    empty = db.create_map("empty")
    for call in (empty.fields.sources, lambda: empty.fields.send("gaze", LOOK)):
        with pytest.raises(LookupError, match="no service is running for this map"):
            call()
    assert empty.fields.ls() == []
    assert list(empty.fields) == []
