"""Beliefs of objects of a map that hide each other or move."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime, timedelta

import pytest

import semmap as library
from semmap import Map
from semmap.belief.believed_places import belief_with_occlusion
from semmap.belief.error import BeliefError
from semmap.belief.problog_program import problog_program
from semmap.belief.reader import read_columns, read_model
from semmap.belief.store.beliefs import add_observations, read_belief
from tests.command_line import semmap
from tests.conftest import MakeDatabase
from tests.oracles.problog_engine import places_by_problog
from tests.seen import seen_by

NOW = datetime.now(UTC)


def look(name: str, place: str, seen: bool, seconds: float = 0.0) -> dict[str, object]:
    at = NOW - timedelta(seconds=seconds)
    return {"object": name, "place": place, "seen": seen, "at": at}


def test_a_mug_that_the_cereal_box_may_hide_is_not_ruled_out(flat: Map) -> None:
    session = flat.connection
    rows = [look("cereal", "table", True)] * 4 + [look("mug", "table", False)] * 3
    add_observations(session, rows)
    alone = read_belief(seen_by(session), "mug", NOW)
    found = belief_with_occlusion(seen_by(session), ["mug", "cereal"], NOW)
    assert found["mug"]["table"] > 3 * alone["table"]
    assert math.fsum(found["mug"].values()) == pytest.approx(1, abs=1e-12)
    columns, model = (
        read_columns(seen_by(session), ["mug", "cereal"], NOW),
        read_model(seen_by(session)),
    )
    program = problog_program(
        *(columns.prior, columns.observations, columns.mobility),
        *(columns.objects, columns.places, columns.known_volume()),
        model=model,
    )
    for (name, place), probability in places_by_problog(program).items():
        assert probability == pytest.approx(found[name][place], abs=1e-12)


def test_an_object_without_a_volume_is_named(flat: Map) -> None:
    with pytest.raises(BeliefError, match="coke: its volume is unknown: teach it, or give"):
        belief_with_occlusion(seen_by(flat.connection), ["mug", "coke"])


def test_an_old_sighting_fades_into_the_prior_when_objects_move(flat: Map) -> None:
    session = flat.connection
    add_observations(session, [look("coke", "bench", True, 1000.0)] * 5)
    prior = read_belief(seen_by(session), "coke", NOW - timedelta(days=1))["bench"]
    new = prior / (prior + (1 - prior) * (1e-6 / 0.9) ** 5)
    for seconds in (10.0, 1000.0, 1e9):
        keep = math.exp(-1000.0 / seconds)
        found = read_belief(seen_by(session), "coke", NOW, seconds)
        assert found["bench"] == pytest.approx(keep * new + (1 - keep) * prior)


def test_the_commands_show_and_export_beliefs_with_occlusion_and_motion(
    make_database: MakeDatabase,
) -> None:
    url = make_database().render_as_string(hide_password=False)
    with library.connect(url) as db:
        shop = db.create_map("shop")
        shop.add_room("stall", [(0, 0), (6, 0), (6, 4), (0, 4)], floor=0, ceiling=3)
        for number in range(2):
            shop.add_object(
                f"table{number}", type="table", size=(1, 0.6, 0.7), pose=(1.5 + 3 * number, 2, 0)
            )
        shop.add_object("box", type="box", size=(0.3, 0.3, 0.3), on="table0")
        shop.add_object("cup", type="cup", size=(0.08, 0.08, 0.1), on="table0")
    for _ in range(3):
        semmap(url, "observe", "box", "table0")
        semmap(url, "observe", "cup", "table0", "--missed", "--at", str(datetime.now(UTC)))

    def at_table0(*options: str) -> float:
        result = semmap(url, "where", *options, "--json")
        assert result.exit_code == 0, result.output
        cup = next(row for row in json.loads(result.stdout) if row["name"] == "cup")["belief"]
        shares = [row["probability"] for row in cup]
        assert shares == sorted(shares, reverse=True)
        assert math.fsum(shares) == pytest.approx(1, abs=1e-12)
        return next(row["probability"] for row in cup if row["place"] == "table0")

    alone = at_table0("cup")
    beside = at_table0("cup", "box", "--occlusion")
    assert beside > 2 * alone
    assert at_table0("cup", "--moves", "0.001") > 2 * alone
    with pytest.raises(ValueError, match="choose occlusion or moves"):
        semmap(url, "where", "cup", "--occlusion", "--moves", "5")
    exported = semmap(url, "belief", "export", "cup", "box", "--problog", "--occlusion").stdout
    assert places_by_problog(exported)["cup", "table0"] == pytest.approx(beside, rel=0.05)
    seen = semmap(url, "belief", "identify", "cup=4.5,2,0.75", "bottle=1.5,2,0.75", "--json")
    *cup, bottle, _ = json.loads(seen.stdout)
    assert {row["object"] for row in cup} == {"cup", "(new)", "(false alarm)"}
    assert cup[0]["object"] == "cup"
    assert cup[0]["place"] == "table1"
    assert sum(row["probability"] for row in cup) == pytest.approx(1, abs=1e-3)
    assert bottle["object"] == "(new)"
    assert bottle["probability"] == pytest.approx(45 / 46, abs=1e-4)
