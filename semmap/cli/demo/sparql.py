"""The question of Figure 3 in SPARQL, on any world."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from semmap import cli
from semmap.api.map import Map
from semmap.cli.demo.choices import DemoChoices
from semmap.knowledge.results import shown
from semmap.knowledge.vocabulary import TYPE, encode, prefixes, short

FIGURE_3 = """SELECT DISTINCT ?room ?table (geof:minX(?box) AS ?from_x) (geof:maxX(?box) AS ?to_x)
    (geof:maxZ(?box) AS ?top) {{
    ?object a {object} ; semmap:heldBy ?table .
    ?table a {table} ; semmap:heldBy ?room ; geo:hasBoundingBox/geo:asWKT ?box .
    ?room a semmap:Room
}}"""
"""Tables that hold an object, their rooms and boxes (Deeken et al., Figure 3)."""

DOORS = """SELECT ?room (COUNT(?door) AS ?doors) {
    ?room a semmap:Room
    OPTIONAL { ?door a semmap:Connector ; semmap:connects ?room }
} GROUP BY ?room ORDER BY DESC(?doors) ?room LIMIT 5"""
"""What is asked where no small object stands on a piece of furniture."""


def figure_3_in_sparql(house: Map, choices: DemoChoices) -> str:
    """Return the query of Figure 3 for the chosen types, or one on doors where there are none."""
    if choices.type is None:
        return DOORS
    types = (choices.table_type, choices.type)
    found = dict(
        house.execute("SELECT name, iri FROM semantic_type WHERE name IN (%s, %s)", *types)
    )
    known = prefixes("")
    table, object_ = (short(found.get(t) or f"{TYPE}{encode(t)}", known) for t in types)
    return FIGURE_3.format(table=table, object=object_)


def ask_in_sparql(house: Map, choices: DemoChoices, say: Callable[..., Any]) -> None:
    """Ask the map in SPARQL, and print question and answer."""
    text = figure_3_in_sparql(house, choices)
    say("   The same in SPARQL:" if choices.type else "   How many doors has each room? In SPARQL:")
    for line in text.splitlines():
        say(f"   {line}")
    answer = house.sparql(text)
    known = prefixes(house.name)
    rows = [tuple(shown(term, known) for term in row) for row in answer.rows]
    cli.show_rows(list(answer.names), rows, False)
