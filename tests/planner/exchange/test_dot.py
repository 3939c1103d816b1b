"""DOT that says what the topology says, whatever the names: read by a small strict reader."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings

from planner.exchange.dot import dot
from planner.topology import OUTSIDE, Topology
from tests.planner.exchange.buildings import buildings, figure_4

TOKEN = re.compile(r'\s*("(?:[^"\\\n]|\\["\\n])*"|--|[\w.]+|[{}\[\]=,;])')


class Dot:
    """Nodes with their cluster, edges with their attributes: the DOT grammar as far as used."""

    def __init__(self, text: str) -> None:
        self.tokens: list[str] = []
        at = 0
        while text[at:].strip():
            match = TOKEN.match(text, at)
            assert match, f"no token at {text[at : at + 40]!r}"
            self.tokens.append(match[1])
            at = match.end()
        self.nodes: dict[str, str | None] = {}
        self.labels: dict[str, str] = {}
        self.edges: list[tuple[str, str, dict[str, str]]] = []
        assert self.take() == "graph"
        self.take()
        self.block(None)
        assert not self.tokens

    def take(self) -> str:
        return self.tokens.pop(0)

    def name(self) -> str:
        token = self.take()
        if token.startswith('"'):
            return re.sub(r'\\(["\\n])', lambda m: {"n": "\n"}.get(m[1], m[1]), token[1:-1])
        return token

    def block(self, cluster: str | None) -> None:
        assert self.take() == "{"
        while self.tokens[0] != "}":
            if self.tokens[0] == "subgraph":
                self.take(), self.take()
                assert self.tokens[1] == "label"
                self.block(self.label_of_next())
                continue
            first = self.name()
            if self.tokens[0] == "=":
                self.take(), self.take()
            elif self.tokens[0] == "--":
                self.take()
                second = self.name()
                self.edges.append((first, second, self.attributes()))
            else:
                said = self.attributes()
                if first not in ("graph", "node", "edge"):
                    assert first not in self.nodes
                    self.nodes[first], self.labels[first] = cluster, said["label"]
            assert self.take() == ";"
        self.take()

    def label_of_next(self) -> str:
        before = list(self.tokens)
        assert (self.take(), self.take(), self.take()) == ("{", "label", "=")
        label = self.name()
        self.tokens = before
        return label

    def attributes(self) -> dict[str, str]:
        found: dict[str, str] = {}
        assert self.take() == "["
        while True:
            key = self.name()
            assert self.take() == "="
            found[key] = self.name()
            if self.take() == "]":
                return found


@settings(max_examples=50)
@given(building=buildings())
def test_what_is_read_back_is_the_topology(building: Topology) -> None:
    read = Dot(dot(building))
    assert read.nodes == {p.name: p.storey for p in building.places.values()}
    rides = [e for e in read.edges if e[2].get("style") == "dashed"]
    connectors = [e for e in read.edges if "color" in e[2]]
    assert len(rides) == max(0, len(building.cabins().get("lift", [])) - 1)
    assert len(rides) + len(connectors) == len(read.edges)
    said = {
        (
            a,
            b,
            e["label"].rsplit("\n", 1)[0]
            if e["label"].endswith(("closed", "locked"))
            else e["label"],
        )
        for a, b, e in connectors
    }
    assert said == {(*c.places, c.name) for c in building.connectors.values()}
    for c, (_, _, e) in zip(building.connectors.values(), connectors, strict=True):
        assert e.get("dir") == {"both": None, "forward": "forward", "backward": "back"}[c.direction]


def test_one_storey_with_what_it_leads_to() -> None:
    read = Dot(dot(figure_4(), storey="floor-1st"))
    assert set(read.nodes) == {"lab1", "corridor1", "foyer-1st", "elevator-1st", OUTSIDE}
    assert read.nodes[OUTSIDE] is None
    with pytest.raises(LookupError, match="no storey attic; there are"):
        dot(figure_4(), storey="attic")
