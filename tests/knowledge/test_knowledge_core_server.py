"""KnowledgeCore's protocol on a lab: its client pykb, and requests as text by a plain socket."""

from __future__ import annotations

import json
import queue
import re
import signal
import socket
import struct
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import ModuleType
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import Engine

import semmap
from semmap.error import InvalidArgumentError
from semmap.knowledge.client import KnowledgeClient
from semmap.knowledge.knowledge_core_server import (
    METHODS,
    MOST_CONNECTIONS,
    Scan,
    listening,
    serving,
    subscribe,
)


@pytest.fixture(scope="module")
def lab(module_engine: Engine) -> Iterator[semmap.Map]:
    url = module_engine.url.render_as_string(hide_password=False)
    with semmap.connect(url) as database:
        made = database.create_map("lab")
        made.add_room("kitchen", [(0, 0), (5, 0), (5, 5), (0, 5)], floor=0, ceiling=3)
        made.add_object("mug", type="mug", size=(0.1, 0.1, 0.1), pose=(1, 1, 0), label="Becher")
        yield made


@pytest.fixture(scope="module")
def port(lab: semmap.Map, tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    folder = tmp_path_factory.mktemp("files")
    (folder / "wizards.ttl").write_text(
        "@prefix : <http://kb.openrobots.org#> . :Wizard a <http://www.w3.org/2002/07/owl#Class> ."
    )
    (folder.parent / "secret.ttl").write_text("<a:b> <a:c> <a:d> .")
    with serving(lab, port=0, files=folder) as chosen:
        yield chosen


class Raw:
    """A client that sends text."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=10)
        self._read = b""
        self._events: list[list[str]] = []

    def send(self, text: str) -> None:
        self.socket.sendall(text.encode())

    def receive(self) -> list[str]:
        """The lines of the next message; none where the server ended the connection."""
        while b"#end#" not in self._read:
            piece = self.socket.recv(65536)
            if not piece:
                return []
            self._read += piece
        message, _, self._read = self._read.partition(b"#end#")
        return message.decode().strip().split("\n")

    def call(self, method: str, *arguments: Any, **named: Any) -> Any:
        lines = [method, *map(json.dumps, [*arguments, *([{"kwargs": named}] if named else [])])]
        self.send("\n".join([*lines, "#end#"]))
        while (message := self.receive())[0] == "event":
            self._events.append(message)
        status, *rest = message
        if status == "error":
            raise ValueError(rest[1])
        return json.loads(rest[0]) if rest else None

    def event(self) -> list[str]:
        """The next event, which may have come before an answer."""
        return self._events.pop(0) if self._events else self.receive()


@contextmanager
def raw(port: int) -> Iterator[Raw]:
    client = Raw(port)
    with client.socket:
        yield client


@pytest.fixture
def client(port: int) -> Iterator[Raw]:
    with raw(port) as client:
        client.call("clear")
        yield client
        client.call("clear")


def unordered(rows: list[Any]) -> list[Any]:
    return sorted(rows, key=str)


def eventually(holds: Callable[[], bool]) -> None:
    end = time.monotonic() + 10
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)


# --- the text of the protocol


def test_an_answer_as_text(client: Raw) -> None:
    client.send("hello\n#end#")
    assert client.receive() == ["ok", f'"semmap {semmap.__version__}"']
    client.send('update\n["alfred isIn garage"]\n#end#exist\n["alfred isIn garage"]\n#end#')
    assert client.receive() == ["ok"]
    assert client.receive() == ["ok", "true"]
    client.send('find\n["?x isIn garage"]\n{"kwargs": {"vars": ["?x"]}}\n#end#')
    assert client.receive() == ["ok", '[{"x": "alfred"}]']


def test_the_methods_and_their_arguments(client: Raw) -> None:
    methods = client.call("methods")
    names = {each.split("(")[0] for each in methods}
    assert names == {
        *("about", "add", "classesof", "clear", "close", "details", "exist", "find", "hello"),
        *("label", "labels", "load", "lookup", "methods", "remove", "retract", "revise", "sparql"),
        *("stats", "subscribe", "update", "version"),
    }
    (find,) = (each for each in methods if each.startswith("find("))
    assert find.startswith("find(patterns")


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        ("__init__", "no method"),
        ("_unsubscribe", "no method"),
        ("events", "no method"),
        ("nonsense", "methods: .*find"),
        ("find", "missing a required argument: 'patterns'"),
        ('find\n["a b c"]\n[]\n[]\n[]', "too many"),
        ('find\n["a b c"]\n{"kwargs": {"secret": 1}}', "secret"),
        ("find\n5", "."),
        ('find\n["?a b c"]\n[]\n5', "."),
        ('update\n["a b', "is not JSON"),
        ("update\n" + "[" * 100_000, "is not JSON"),
        ("update\n5", "."),
        ('update\n"a b c"', "list"),
        ("update\n[5]", "."),
        ('update\n["s p o"]\n["m1", 5]', "."),
        ('update\n["s p o"]\n["m1"]\n"long"', "."),
        ('update\n["s p o", "toto titi"]', "toto titi"),
        ('update\n["s p o", "robert says \'test\'"]', "double quotes"),
        ('revise\n["s p o"]\n{"method": "replace"}', "replace"),
        ('revise\n["s p o"]\n[]', "dictionary"),
        ('sparql\n"SELECT WHERE"', "."),
    ],
)
def test_a_wrong_request_is_an_error_and_changes_nothing(
    client: Raw, request_: str, reason: str
) -> None:
    client.send(f"{request_}\n#end#")
    status, kind, text = client.receive()
    assert (status, kind) == ("error", "kberror")
    assert re.search(reason, text), text
    assert client.call("find", ["?s p ?o"], models="all") == []


def test_a_page_of_the_web_sends_no_request(client: Raw, port: int) -> None:
    client.call("update", ["alfred likes tea"])
    with raw(port) as page:
        page.send("POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n\n#end#clear\n#end#")
        assert page.receive()[0] == "error"
        assert page.receive() == []
    assert client.call("exist", ["alfred likes tea"])


def test_the_end_of_messages_within_strings(client: Raw) -> None:
    said = 'he said: "#end#" \\'
    client.call("update", [f"robert says {json.dumps(said)}"])
    assert client.call("find", ["robert says ?what"]) == [{"what": said}]
    with pytest.raises(ValueError, match="# end#"):
        client.call("update", ["#end#"])


def test_a_message_comes_in_pieces(client: Raw) -> None:
    text = 'update\n["robert says \\"a #end# b\\"", "é likes café"]\n#end#'
    for each in text.encode():
        client.socket.sendall(bytes([each]))
    assert client.receive() == ["ok"]
    assert client.call("find", ["?who likes ?what"]) == [{"who": "é", "what": "café"}]


def test_a_message_beyond_the_limit(client: Raw, port: int, monkeypatch: Any) -> None:
    monkeypatch.setenv("SEMMAP_MAX_MESSAGE_BYTES", "100000")
    with raw(port) as large:
        large.send('update\n["a b c"]\n' + " " * 100_001)
        assert "SEMMAP_MAX_MESSAGE_BYTES" in large.receive()[2]
        assert large.receive() == []
    assert client.call("exist", ["a b c"]) is False
    client.call("update", [f"a b {json.dumps(f'{i}' * 10_000)}" for i in range(9)])
    assert len(client.call("find", ["a b ?c"])) == 9


def test_a_message_without_an_end(
    port: int, lab: semmap.Map, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SEMMAP_MAX_MESSAGE_SECONDS", "0.3")
    with serving(lab, port=0) as chosen, raw(chosen) as late, raw(chosen) as silent:
        late.call("hello")
        time.sleep(0.5)
        late.call("hello")
        late.send("hel")
        began = time.monotonic()
        assert late.receive() == silent.receive() == []
        assert time.monotonic() - began < 5


def test_connections_beyond_the_limit(lab: semmap.Map) -> None:
    with serving(lab, port=0) as chosen:
        clients = [Raw(chosen) for _ in range(MOST_CONNECTIONS)]
        assert all(each.call("hello") for each in clients)
        with raw(chosen) as more:
            assert "too many connections" in more.receive()[2]
        clients.pop().socket.close()

        def answers() -> bool:
            with raw(chosen) as more:
                more.send("hello\n#end#")
                return more.receive()[0] == "ok"

        eventually(answers)
        for each in clients:
            each.socket.close()


# --- the methods


def test_literals_with_datatypes(client: Raw) -> None:
    literals = {
        '"test"': "test",
        '"test"@fr': "test",
        '"foo"^^<http://example.org/my/datatype>': "foo",
        '"10"^^xsd:decimal': 10,
        "-5": -5,
        "1.25": 1.25,
        "-12.5e10": -12.5e10,
        "true": True,
        '"false"^^xsd:boolean': False,
        '"2026-05-17"^^xsd:date': "2026-05-17",
    }
    for number, (literal, value) in enumerate(literals.items()):
        client.call("update", [f"robert says{number} {literal}"])
        (row,) = client.call("find", [f"robert says{number} ?what"])
        assert (row["what"], type(row["what"])) == (value, type(value)), literal
        assert client.call("lookup", f"says{number}") == [[f"says{number}", "datatype_property"]]
        assert client.call("exist", [f"robert says{number} {literal}"])


def test_each_method(client: Raw) -> None:
    client.call("add", ["johnny rdf:type Wizard", 'johnny rdfs:label "Jojo"@fr'])
    client.call("revise", ["johnny likes tea"], policy={"method": "add", "models": ["human1"]})
    assert client.call("stats")["models"] == ["default", "human1"]
    assert client.call("version") == semmap.__version__
    assert client.call("label", "johnny") == {"default": "johnny", "fr": "Jojo"}
    assert client.call("classesof", "johnny", direct=True) == ["Wizard"]
    assert client.call("details", resource="johnny")["type"] == "instance"
    assert client.call("lookup", resource="Wizard") == [["Wizard", "class"]]
    assert client.call("about", "Wizard") == [["johnny", "rdf:type", "Wizard"]]
    query = "SELECT ?who { ?who oro:likes :tea }"
    assert client.call("sparql", query)["results"]["bindings"] == []
    (row,) = client.call("sparql", query, model="human1")["results"]["bindings"]
    assert row["who"]["value"].endswith("#johnny")
    client.call("retract", ["johnny rdf:type *"])
    client.call("remove", ["johnny likes tea"], models=["human1"])
    assert client.call("find", ["johnny ?is ?what"], models="all") == [
        {"is": "rdfs:label", "what": "Jojo"}
    ]


def test_files_are_those_of_the_folder(client: Raw, lab: semmap.Map) -> None:
    client.call("load", "wizards.ttl", models=["human1"])
    assert client.call("lookup", "Wizard", ["human1"]) == [["Wizard", "class"]]
    for name in ("../secret.ttl", "/etc/hostname"):
        with pytest.raises(ValueError, match="is not in the folder"):
            client.call("load", name)
    with pytest.raises(ValueError, match=r"missing\.ttl"):
        client.call("load", "missing.ttl")
    with (
        serving(lab, port=0) as chosen,
        raw(chosen) as other,
        pytest.raises(ValueError, match="--files"),
    ):
        other.call("load", "wizards.ttl")


def test_an_event_comes_after_the_number_of_its_subscription(
    client: Raw, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def subscribe_slowly(kb: Any, patterns: Any) -> str:
        number = subscribe(kb, patterns)
        time.sleep(1)
        return number

    monkeypatch.setitem(METHODS, "subscribe", subscribe_slowly)
    with raw(port) as subscriber:
        subscriber.send('subscribe\n["?o isIn room"]\n#end#')
        for visitor in range(8):
            client.call("update", [f"visitor{visitor} isIn room"])
            time.sleep(0.1)
        status, number = subscriber.receive()
        assert status == "ok"
        status, of, bindings = subscriber.receive()
        assert (status, of) == ("event", json.loads(number))
        assert json.loads(bindings)[0]["o"].startswith("visitor")


def test_a_client_that_vanishes_leaves_no_subscription(lab: semmap.Map) -> None:
    with KnowledgeClient(lab) as shared, listening(shared) as chosen:
        clients = [Raw(chosen) for _ in range(3)]
        for each in clients:
            each.call("subscribe", ["?o isNear room"])
        standing = shared._subscriptions._subscribers
        assert len(standing) == 3
        clients[0].socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        clients[0].socket.close()  # a reset, as where a process is killed
        clients[1].call("close")
        assert clients[1].receive() == []
        eventually(lambda: len(standing) == 1)
        clients[1].socket.close()
        clients[2].call("update", ["alfred isNear room"])
        assert clients[2].event()[0] == "event"
        clients[2].call("clear")
    assert clients[2].receive() == []
    clients[2].socket.close()
    eventually(lambda: not standing)


def test_a_client_that_does_not_read_is_let_go(
    lab: semmap.Map, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SEMMAP_MAX_MESSAGE_SECONDS", "1")
    with serving(lab, port=0) as chosen, raw(chosen) as deaf:
        deaf.call("clear")
        deaf.call("update", [f"robert says{n} {json.dumps('x' * 10_000)}" for n in range(100)])
        request = b'find\n["robert ?says ?what"]\n#end#' * 10_000
        deaf.socket.sendall(request)

        def is_let_go() -> bool:
            with suppress(OSError):
                deaf.socket.sendall(b" ")
                return False
            return True

        eventually(is_let_go)
        with raw(chosen) as other:
            other.call("clear")


# --- the command


def test_the_command_ends_by_a_signal(lab: semmap.Map) -> None:
    url = lab.engine.url.render_as_string(hide_password=False)
    words = ["--db", url, "knowledge", "serve", "--port", "0"]
    main = "from semmap.cli import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", main, *words], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("serving lab on 127.0.0.1:"), line
        with raw(int(line.split(":")[1].split(";")[0])) as client:
            assert client.call("stats")["map"] == "lab"
            process.send_signal(signal.SIGTERM)
            assert process.wait(timeout=30) == 0
            assert client.receive() == []


def test_an_address_that_cannot_be_used(lab: semmap.Map, port: int) -> None:
    with pytest.raises(InvalidArgumentError, match=f"127.0.0.1:{port} cannot be used"):
        lab.serve_knowledge(port=port)
    with pytest.raises(InvalidArgumentError, match="70000 cannot be used"):
        lab.serve_knowledge(port=70_000)
    lab.serve_knowledge(port=0, seconds=0.1)


def test_clients_have_the_rights_of_the_server(lab: semmap.Map) -> None:
    reader = lab.engine.url.update_query_dict({"options": "-crole=semmap_reader"})
    with (
        semmap.connect(reader.render_as_string(hide_password=False)) as database,
        serving(database.map("lab"), port=0) as chosen,
        raw(chosen) as client,
    ):
        assert client.call("lookup", "Becher") == [["mug", "instance"]]
        for method, *arguments in (("update", ["alfred likes tea"]), ("clear",)):
            with pytest.raises(ValueError, match="permission denied"):
                client.call(method, *arguments)
        number = client.call("subscribe", ["?who likes tea"])
        lab.update("INSERT DATA { :ann oro:likes :tea }")
        assert client.event() == ["event", number, '[{"who": "ann"}]']
        lab.update("DELETE DATA { :ann oro:likes :tea }")


# --- pykb


@pytest.fixture(scope="module")
def pykb() -> ModuleType:
    """The module of KnowledgeCore's client."""
    if sys.version_info >= (3, 12):
        pytest.skip("pykb 2.5 needs asyncore, which Python 3.12 lacks")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of asyncore
        import kb
    return kb


@pytest.fixture
def kb(pykb: ModuleType, client: Raw, port: int) -> Iterator[Any]:
    with pykb.KB(port=port) as kb:
        yield kb


def test_pykb_changes_and_queries_statements(kb: Any) -> None:
    assert kb.hello() == f"semmap {semmap.__version__}"
    kb += ["alfred isIn garage", "alfred rdf:type Wizard", 'alfred rdfs:label "Alf red"']
    kb += "batman isIn garage"
    assert unordered(kb["* isIn garage"]) == [{"var1": "alfred"}, {"var1": "batman"}]
    assert kb["?who isIn *", "?who rdf:type Wizard"] == [{"who": "alfred"}]
    assert {"who": "mug"} in kb["?who isIn *"]
    assert kb["alfred isIn garage"] is True
    assert kb["Alf red"] == ["alfred"]
    assert kb.lookup("Wizard") == [["Wizard", "class"]]
    for present in ("alfred", "alfred isIn garage", "alfred isIn *", "?x rdf:type Wizard"):
        assert present in kb
    for absent in ("joker", "alfred isIn", "alfred isIn kitchen", "* likes *"):
        assert absent not in kb
    kb -= "batman isIn garage"
    kb -= ["joker isIn garage"]
    kb += ["alfred likes tea"]
    assert kb.find(["?who likes ?what"], vars=["?who"]) == [{"who": "alfred"}]
    assert kb.find(["?who likes ?what"], ["?what", "?who"]) == [{"what": "tea", "who": "alfred"}]
    assert kb.find(["?who likes ?what", "?who rdf:type ?kind"], None, []) == [
        {"who": "alfred", "what": "tea", "kind": "Wizard"}
    ]


def test_pykb_lists_all_statements_without_the_tbox(kb: Any) -> None:
    before = kb["* * *"]
    assert {row["var1"] for row in before} >= {"mug", "kitchen"}
    assert not {row["var1"] for row in before} & {"Mug", "Kitchen", "Entity"}
    assert "owl:Class" not in {row["var2"] for row in kb["* rdf:type *"]}
    kb += ["alfred isIn garage", "alfred age 18"]
    added = [row for row in kb["* * *"] if row not in before]
    assert unordered(added) == [
        {"var1": "alfred", "var2": "age", "var3": 18},
        {"var1": "alfred", "var2": "isIn", "var3": "garage"},
    ]
    kb.update(["s p o", "s2 p2 o2"], ["human1"])
    assert unordered(kb["* * *", ["human1"]]) == [
        {"var1": "s", "var2": "p", "var3": "o"},
        {"var1": "s2", "var2": "p2", "var3": "o2"},
    ]


def test_pykb_has_models(kb: Any) -> None:
    kb.update(["alfred likes tea"], models=["human1", "human2"])
    kb.remove(["alfred likes tea"], ["human1"])
    assert kb["alfred likes tea"] is False
    assert kb["alfred likes tea", ["human1"]] is False
    assert kb["* likes ?what", "?who likes *", ["human2"]] == [{"what": "tea", "who": "alfred"}]
    assert kb.exist(["alfred likes tea"], models=["human2"])
    assert kb.find(["?who likes tea"], models="all") == [{"who": "alfred"}]


def test_pykb_raises_errors(kb: Any, pykb: ModuleType) -> None:
    for wrong in ("toto", "toto titi", "toto titi tutu tata"):
        with pytest.raises(pykb.KbError, match="toto"):
            kb += wrong
        with pytest.raises(pykb.KbError, match="kberror"):
            kb.update([wrong])
    with pytest.raises(pykb.KbError, match="replace"):
        kb.revise(["a b c"], {"method": "replace"})
    with pytest.raises(pykb.KbError, match="secret"):
        kb.find(["a b ?c"], secret=1)
    assert kb["a b ?c"] == []


def test_pykb_ends_statements_after_their_lifespan(kb: Any) -> None:
    kb.update(["alfred likes tea"], lifespan=0.5)
    assert "alfred likes tea" in kb
    eventually(lambda: "alfred likes tea" not in kb)


def test_pykb_gets_events(kb: Any, pykb: ModuleType, port: int) -> None:
    called: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def on_event(bindings: Any) -> None:
        called.put(bindings)

    kb += ["alfred isIn garage"]
    first = kb.subscribe(["?o isIn room"], on_event)
    polled = kb.subscribe("?o isIn garage")
    assert first != polled
    with pykb.KB(port=port) as other:
        other += ["alfred isIn room", "alfred isIn garage"]
        assert called.get(timeout=10) == [{"o": "alfred"}]
        other += ["batman isIn garage"]
        assert kb.events.get(timeout=10) == (polled, [{"o": "batman"}])
        other -= ["alfred isIn room"]
        other += ["alfred isIn room"]
        assert called.get(timeout=10) == [{"o": "alfred"}]
        assert other.events.empty()


def test_pykb_gets_one_event_of_a_subscription_for_once(kb: Any) -> None:
    for name in ("joe", "jim"):
        number = kb.subscribe(["?who rdf:type Wizard"], one_shot=True)
        kb += [f"{name} rdf:type Wizard", f"{name}2 likes tea"]
        assert kb.events.get(timeout=10) == (number, [{"who": name}])
        kb += [f"{name}3 rdf:type Wizard"]
        with pytest.raises(queue.Empty):
            kb.events.get(timeout=0.5)


WHOLE = re.compile(rb'"(?:[^"\\\n]|\\.)*"?|(#end#)')


@settings(max_examples=300, deadline=None)
@given(st.lists(st.sampled_from([b'"', b"\\", b"\n", b"#end#", b"#en", b"d#", b"a"]), max_size=30))
def test_the_end_is_found_in_pieces_as_in_the_whole(pieces: list[bytes]) -> None:
    scan, buffer, found = Scan(), bytearray(), None
    for piece in pieces:
        buffer += piece
        found = scan.end_in(buffer)
        if found is not None:
            break
    whole = next((each for each in WHOLE.finditer(buffer) if each[1]), None)
    assert found == (None if whole is None else whole.start())
