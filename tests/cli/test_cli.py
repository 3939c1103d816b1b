"""The command line as a user calls it: answers, JSON, errors that say what to do."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import shapely
from sqlalchemy import Engine

import semmap
from tests import command_line
from tests.forked import semmap_process
from tests.ingest.worlds_by_hand import box_world

FIGURE_3 = (Path(__file__).parents[2] / "benchmarks" / "figure3.sql").read_text()


@pytest.fixture(scope="module")
def office(office_world: Engine) -> str:
    """The URL of a database that holds the office."""
    return office_world.url.render_as_string(hide_password=False)


def test_figure_3_verbatim(office: str) -> None:
    done = semmap_process(office, "sql", FIGURE_3, "--json")
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(done.stdout)
    assert list(row) == ["label", "label_2", "box3d"]
    assert (row["label"], row["label_2"]) == ("office4", "desk4")
    assert row["box3d"].startswith("BOX3D(")


def test_ls_and_show(office: str) -> None:
    names = {r["name"] for r in json.loads(semmap_process(office, "ls", "desk", "--json").stdout)}
    assert {"desk1", "desk4"} <= names
    kitchens = json.loads(semmap_process(office, "ls", "--label", "kitchen", "--json").stdout)
    assert [k["name"] for k in kitchens] == ["kitchen"]
    held = {
        r["name"]
        for r in json.loads(semmap_process(office, "ls", "--in", "office4", "--json").stdout)
    }
    assert {"desk4", "muffin1"} <= held
    nearest = json.loads(
        semmap_process(office, "ls", "food", "--near", "desk4", "--within", "1", "--json").stdout
    )
    assert [n["name"] for n in nearest] == ["muffin1"]
    muffin = json.loads(semmap_process(office, "show", "muffin1", "--json").stdout)
    assert (muffin["holder"], muffin["relation"]) == ("desk4", "on")
    assert "food" in muffin["types"]


def test_route_of_figure_4(office: str) -> None:
    done = semmap_process(office, "route", "lab1", "office4", "--json")
    assert done.returncode == 0, done.stderr
    doors = [d["name"] for d in json.loads(done.stdout)["doors"]]
    assert doors == ["door1", "door2", "edoor1", "edoor3", "door5", "door6"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("show", "mufin1"), "did you mean muffin1"),
        (("ls", "dask"), "did you mean"),
        (("ls", "--map", "offic"), "there are: office"),
        (("ls", "--within", "3"), "--near"),
        (("ls", "--box", "1,2,3"), "6 numbers"),
        (("ls", "--where", "blue"), "KEY=VALUE"),
        (("sql", "DELETE FROM entity"), "--write"),
        (("sql", "COMMIT; DELETE FROM entity"), "multiple commands"),
        (("sql", "SELEC 1"), "syntax error"),
        (("route", "lab1", "moon"), "moon"),
        (("import", "nowhere.sdf"), "is not there"),
        (("import", "README.md"), "is not known"),
        (("import", "nowhere.obj", "--scale", "0"), "scale is 0.0: give a finite number above 0"),
        (("import", "nowhere.sdf", "--model-path", "away"), "away is not a folder"),
        (("show", "muffin1", "--at", "noon"), "--at takes an ISO 8601 time"),
        (("serve", "--port", "70000"), "0<=x<=65535"),
        (("serve", "--seconds", "0"), "0.1<=x<=86400"),
    ],
)
def test_errors_name_the_fix(office: str, words: tuple[str, ...], says: str) -> None:
    done = semmap_process(office, *words)
    assert done.returncode == 2, done.stdout
    assert says in done.stderr
    assert "Traceback" not in done.stderr


def test_a_bad_file_and_a_bad_element(office: str, tmp_path: Path) -> None:
    good = box_world(tmp_path, {"a": (0, 0, 0), "b": (0, 0, float("nan"))})
    done = semmap_process(office, "import", good, "--map", "bad", "--strict")
    assert done.returncode == 2
    assert "b" in done.stderr
    done = semmap_process(office, "import", good, "--map", "bad")
    assert done.returncode == 0
    assert "left out: 1" in done.stdout
    good.write_text(good.read_text()[:100])
    done = semmap_process(office, "import", good, "--map", "bad")
    assert done.returncode == 2
    assert good.name in done.stderr


def test_changes_come_with_a_cursor(office: str) -> None:
    first = json.loads(semmap_process(office, "changes", "--json").stdout)
    assert first["changes"]
    moved = semmap_process(
        office,
        "sql",
        "--write",
        "UPDATE placement SET pose[1] = pose[1] + 0.1 WHERE entity_id = entity_id('cup1')",
        "--map",
        "office",
    )
    assert moved.returncode == 0, moved.stderr
    then = json.loads(semmap_process(office, "changes", first["cursor"], "--json").stdout)
    assert {c["what"] for c in then["changes"]} == {"moved"}
    assert (
        json.loads(semmap_process(office, "changes", then["cursor"], "--json").stdout)["changes"]
        == []
    )


def test_negative_numbers_are_numbers_and_unknown_options_errors(database: str) -> None:
    with semmap.connect(database) as db:
        place = db.create_map("kelder")
        for name, x in (("alpha", -5.0), ("beta", 0.2)):
            place.add_room(name, shapely.box(x, -5, x + 4.9, 0), floor=0, ceiling=2.5)
        place.add_door("d", "alpha", "beta", ((0.05, -3), (0.05, -2)))
    for words, says in (
        (("route", "-1,-2", "beta"), "alpha -> beta"),
        (("route", "-1,-2,0", "-.5,-1"), "alpha"),
        (("route", "-1,-2", "beta", "--bogus"), "--bogus"),
    ):
        found = command_line.semmap(database, *words, "--map", "kelder")
        assert says in found.output
        assert (found.exit_code == 0) == ("--bogus" not in words)
