"""What people see is pushed as facts and into their models: a cup that moves while nobody looks."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from queue import SimpleQueue
from typing import Any

import pytest
from sqlalchemy import Engine

import semmap
from semmap import Map
from semmap.knowledge import KnowledgeClient
from semmap.knowledge.fields.push import FieldPush, read_pushed
from semmap.knowledge.queries import query
from semmap.query.map_handle import MapHandle
from tests.waiting import wait_until

PUSHED = read_pushed(["sees=looksAt"], "house")
SALLY_SEES_CUP = ("sees", "sally", "cup")


@pytest.fixture(scope="module")
def house(module_engine: Engine) -> Iterator[Map]:
    url = module_engine.url.render_as_string(hide_password=False)
    with semmap.connect(url) as database:
        house = database.create_map("house")
        house.add_room("kitchen", [(0, 0), (5, 0), (5, 5), (0, 5)], floor=0, ceiling=3)
        house.add_object("table", type="table", size=(1, 1, 0.7), pose=(1, 1, 0))
        house.add_object("shelf", type="table", size=(1, 1, 0.5), pose=(4, 4, 0))
        house.add_object("cup", type="cup", size=(0.1, 0.1, 0.1), on="table", label="Tasse")
        for name in ("sally", "anne"):
            house.add_agent(name, type="person", size=(0.5, 0.5, 1.7), pose=(3, 1, 0))
        yield house


def places(kb: KnowledgeClient, model: str | None) -> Any:
    return kb.find("where", "cup isOn ?where", model=model)


def test_an_agent_keeps_what_it_saw_last(house: Map) -> None:
    engine = house.database.engine
    push = FieldPush(engine, "house", PUSHED, perspectives=True)
    with KnowledgeClient(MapHandle(engine, "house")) as kb:
        kb.subscribe("?who looksAt cup")
        push.begin([SALLY_SEES_CUP, ("sees", "anne", "cup"), ("near", "cup", "table")])
        assert {e.bindings["who"] for e in (next(kb.events(5)), next(kb.events(5)))} == {
            "sally",
            "anne",
        }
        assert places(kb, "sally") == places(kb, "anne") == {"table"}
        assert kb.has(["cup rdf:type Cup", "cup rdf:type Drinkware"], model="sally")
        assert kb.has('cup rdfs:label "Tasse"', model="sally")
        assert not kb.has("table rdf:type *", model="sally"), "nobody saw the table"
        push.end([SALLY_SEES_CUP])
        event = next(kb.events(5))
        assert (event.what, event.bindings) == ("disappeared", {"who": "sally"})
        house.execute("SELECT put(entity_id('cup'), NULL)")
        house.execute(
            "UPDATE placement SET holder_id = entity_id('shelf'), relation = 'on', "
            "pose = '{0,0,0.5,0,0,0,1}' WHERE entity_id = entity_id('cup')"
        )
        push.catch_up()
        assert places(kb, None) == places(kb, "anne") == {"shelf"}
        assert places(kb, "sally") == {"table"}, "Sally did not see it move"
        push.begin([SALLY_SEES_CUP])
        assert places(kb, "sally") == {"shelf"}
        rows = house.execute("SELECT predicate FROM statement WHERE predicate LIKE '%near'")
        assert not rows, "what is not named is not pushed"


def test_messages_of_the_service_are_followed_until_it_ends(house: Map) -> None:
    messages: SimpleQueue[dict[str, Any] | None] = SimpleQueue()
    fact = {"relation": "sees", "subject": "anne", "object": "table"}
    messages.put(fact | {"held": True, "event": "begin"})
    messages.put({"held": False})
    push = FieldPush(house.database.engine, "house", PUSHED)
    thread = threading.Thread(
        target=push.follow, args=(iter(messages.get, None), threading.Event())
    )
    thread.start()
    with KnowledgeClient(house) as kb:
        for truth, message in (
            (True, None),
            (False, fact | {"event": "end"}),
            (True, fact | {"event": "begin"}),
        ):
            if message:
                messages.put(message)
            wait_until(lambda truth=truth: kb.has("anne looksAt table") is truth)
        messages.put({"over": True})
        thread.join(10)
        assert not kb.has("anne looksAt table"), "what was pushed ends with the program"
        assert not kb.has("table * *", model="anne"), "perspectives were not switched on"


def test_a_pushed_fact_ends_where_its_program_is_killed(house: Map) -> None:
    push = FieldPush(house.database.engine, "house", PUSHED)
    push.begin([("sees", "anne", "shelf")])
    (row,) = house.connection.execute(
        "SELECT until - clock_timestamp() > interval '20 s' FROM statement "
        "WHERE object_id = entity_id('shelf') AND until < clock_timestamp() + interval '31 s'"
    ).fetchall()
    assert row == (True,)
    assert query(house.connection, "ASK { :anne oro:looksAt :shelf }").truth


@pytest.mark.parametrize(
    "line", ["sees", "=looksAt", "sees=", "sees=?x", "sees=a b", "sees=isOn", "sees=semmap:sees"]
)
def test_a_wrong_line_of_configuration_is_an_error(line: str) -> None:
    with pytest.raises(ValueError, match=r"sees|looksAt"):
        read_pushed([line], "house")
