"""`semmap fields` as a user calls it, on the office."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from sqlalchemy import Engine, text

from semmap.fields.store.event_channel import EventListener
from tests.command_line import semmap


@pytest.fixture(scope="module")
def office(office_world: Engine) -> str:
    """The URL of a database that holds the office."""
    return office_world.url.render_as_string(hide_password=False)


def run(office: str, *words: object) -> Any:
    done = semmap(office, "fields", *words, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_at_lists_the_entities_of_a_voxel(office: str) -> None:
    found = run(office, "at", "9.2,0.45,7.73")
    assert {(r["name"], r["kind"]) for r in found} == {("desk4", "object"), ("office4", "room")}
    assert {r["name"] for r in run(office, "at", "9.2,2.5,8.5")} == {"office4"}
    assert run(office, "at", "-5,-2.5,8.5") == []


def test_ls_lists_volumes(office: str) -> None:
    rows = {r["name"]: r for r in run(office, "ls", "--voxel-size", "0.02")}
    assert {"desk4", "muffin1", "walls-3rd"} <= set(rows)
    desk = 0.8 * 1.6 * 0.03 + 4 * 0.05**2 * 0.71 + 0.02 * 1.4 * 0.3
    assert rows["desk4"]["volume"] == pytest.approx(desk, rel=0.35)
    assert rows["muffin1"]["voxels"] > 10


def test_export(office: str, tmp_path: Path) -> None:
    result = run(office, "export", "-o", tmp_path, "--voxel-size", "0.1")
    cloud = trimesh.load(tmp_path / "points.ply")
    assert len(cloud.vertices) == result["voxels"]  # type: ignore[attr-defined]
    sets = json.loads((tmp_path / "sets.json").read_text())
    assert len(sets) == result["sets"]
    assert ["desk4", "office4"] in sets.values()
    assert (tmp_path / "sets.vdb").stat().st_size > 1000
    low, high = np.asarray(cloud.bounds)
    assert low[2] < 0.1
    assert high[2] > 9


PREFIX = "PREFIX : <urn:semmap:ontology#> "


def test_query(office: str, tmp_path: Path) -> None:
    counted = (
        "SELECT ?entity (COUNT(?v) AS ?n) WHERE { ?v :inRoom :office4 . ?v :occupiedBy ?entity }"
    )
    result = run(
        office,
        "query",
        "--voxel-size",
        "0.1",
        f"{PREFIX}{counted} GROUP BY ?entity ORDER BY DESC(?n)",
    )
    rows = dict(result["rows"])
    assert result["variables"] == ["entity", "n"]
    assert next(iter(rows)) == "sofa3"
    assert rows["desk4"] > 50
    # What is free and what is occupied make the room.
    count = "SELECT (COUNT(DISTINCT ?v) AS ?n) WHERE { ?v :inRoom :office4 "
    [[whole]] = run(office, "query", "--voxel-size", "0.1", f"{PREFIX}{count} }}")["rows"]
    [[free]] = run(
        office, "query", "--voxel-size", "0.1", f"{PREFIX}{count} . ?v :freeIn :office4 }}"
    )["rows"]
    [[full]] = run(
        office, "query", "--voxel-size", "0.1", f"{PREFIX}{count} . ?v :occupiedBy ?t }}"
    )["rows"]
    assert free + full == whole
    on = "SELECT ?entity WHERE { ?entity :on :desk4 } ORDER BY ?entity"
    found = [row for [row] in run(office, "query", f"{PREFIX}{on}")["rows"]]
    assert {"muffin1", "monitor5"} <= set(found)
    assert not {"desk4", "sofa3", "office_chair5"} & set(found)
    file = tmp_path / "ask.rq"
    file.write_text(PREFIX + "ASK { ?v :occupiedBy 'muffin' }")
    assert run(office, "query", "--voxel-size", "0.1", "-f", file) is True
    stored = run(
        office,
        "query",
        "--voxel-size",
        "0.1",
        PREFIX + "SELECT ?v WHERE { ?v :occupiedBy 'muffin' } STORE :occupiedBy",
        "-o",
        tmp_path / "muffin.vdb",
    )
    assert stored["property"] == "occupiedBy"
    assert stored["voxels"] > 0
    assert (tmp_path / "muffin.vdb").stat().st_size > 100


def test_stored_maps(office: str) -> None:
    """A stored map can be queried, and each change makes a version."""
    size = ("--voxel-size", "0.1")
    text = PREFIX + "SELECT ?v WHERE { ?v :occupiedBy 'muffin' } STORE :occupiedBy"
    first = run(office, "query", text, *size, "--keep", "sweet")
    assert (first["kept"], first["version"]) == ("sweet", 1)
    text = PREFIX + "SELECT ?v ?o WHERE { ?v :inRoom ?o FILTER(:z(?v) < 0.1) } STORE :inZone"
    with pytest.raises(ValueError, match="not of the type region"):
        run(office, "query", text, *size, "--keep", "low")
    text = PREFIX + "SELECT ?v WHERE { ?v :inZone :home FILTER(:z(?v) < 0.2) } STORE :inZone"
    low = run(office, "query", text, *size, "--keep", "low")
    assert run(office, "query", text, *size, "--keep", "low")["version"] == 2
    rows = {row["name"]: row for row in run(office, "kept")}
    assert rows["low"]["versions"] == 2
    assert rows["low"]["voxels"] == low["voxels"]
    assert rows["sweet"]["about"] == "muffin1"
    forgot = semmap(office, "fields", "forget", "low")
    assert forgot.exit_code == 0
    assert [row["name"] for row in run(office, "kept")] == ["sweet"]
    with pytest.raises(LookupError, match="fields: sweet"):
        semmap(office, "fields", "forget", "low")


def test_export_of_a_stored_map(office: str, tmp_path: Path) -> None:
    text = PREFIX + "SELECT ?v WHERE { ?v :occupiedBy 'muffin' } STORE :occupiedBy"
    stored = run(office, "query", text, "--voxel-size", "0.1", "--keep", "baked")
    result = run(office, "export", "-o", tmp_path, "--kept", "baked")
    assert (result["version"], result["voxels"]) == (1, stored["voxels"])
    assert len(trimesh.load(tmp_path / "points.ply").vertices) == stored["voxels"]  # type: ignore[attr-defined]
    assert (tmp_path / "field.vdb").read_bytes()[:4] == b" BDV"
    for words, says in (
        (("--kept", "bread"), "there is no field bread"),
        (("--kept", "baked", "--version", "2"), "no version 2 of the field baked"),
        (("--version", "2"), "name the field by --kept"),
    ):
        with pytest.raises((ValueError, LookupError), match=says):
            run(office, "export", "-o", tmp_path / "none", *words)
    assert not (tmp_path / "none").exists()
    semmap(office, "fields", "forget", "baked")


def test_tables_are_limited(office: str) -> None:
    text = PREFIX + "SELECT ?v WHERE { ?v :occupiedBy :muffin1 } ORDER BY :z(?v)"
    done = semmap(office, "fields", "query", text, "--limit", 3, "--voxel-size", 0.03)
    assert done.exit_code == 0
    assert "more rows" in done.stdout


def test_watch(office: str, office_world: Engine) -> None:
    """The muffin is lifted and put down: the command and the channel report it."""
    printed: list[Any] = []

    def watch() -> None:
        words = ["fields", "watch", "--seconds", "5", "--voxel-size", "0.05", "--json"]
        done = semmap(office, *words)
        printed.extend(json.loads(line) for line in done.stdout.splitlines())

    with EventListener(office_world) as listener:
        watching = threading.Thread(target=watch)
        watching.start()
        received: set[tuple[str, str, str]] = set()
        rise = 0.6
        while (
            watching.is_alive() and ("on", "muffin1", "desk4") not in received
        ):  # it is not known when watching begins
            with office_world.begin() as connection:
                connection.execute(
                    text(
                        "UPDATE placement SET pose[3] = pose[3] + :rise "
                        "WHERE entity_id = entity_id('muffin1')"
                    ),
                    {"rise": rise},
                )
            rise = -rise
            heard = [e for e in listener.events(timeout=0.5) if not e.began]
            received |= {(e.relation, e.subject, e.object) for e in heard}
        watching.join()
    ended = {(e["subject"], e["relation"], e["object"]) for e in printed if e["event"] == "end"}
    assert ("muffin1", "on", "desk4") in ended
    assert ("on", "muffin1", "desk4") in received


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("at", "1,2"), "give X,Y,Z"),
        (("at", "a,b,c"), "give X,Y,Z"),
        (("ls", "--voxel-size", "0"), "give metres above 0"),
    ],
)
def test_wrong_arguments_are_refused(office: str, words: tuple[str, ...], message: str) -> None:
    with pytest.raises((ValueError, LookupError), match=message):
        run(office, *words)
