"""SPARQL on a map of 1,000,000 objects, beside SQL that is written by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import psycopg

from benchmarks.database import million
from benchmarks.timing import Row, medians_in_turn, print_rows
from semmap.knowledge import query
from semmap.knowledge.map_view import MapView
from semmap.knowledge.queries import limited
from semmap.knowledge.vocabulary import prefixes
from semmap.language.parser import parse_sparql

__all__ = ["main"]

QUESTIONS = (
    (
        "where the ten muffins are",
        "SELECT ?x ?t ?r { ?x a <urn:semmap:type#muffin> ; semmap:heldBy ?t . "
        "?t semmap:heldBy ?r }",
        "SELECT e.name, h.name, r.name FROM object_type o JOIN entity e ON e.id = o.id "
        "JOIN placement p ON p.entity_id = o.id JOIN entity h ON h.id = p.holder_id "
        "JOIN placement q ON q.entity_id = p.holder_id JOIN entity r ON r.id = q.holder_id "
        "WHERE o.type = 'muffin' AND o.map_id = (SELECT current_map())",
        10,
    ),
    (
        "what one table holds, with types",
        "SELECT ?x ?t { ?x semmap:heldBy :object101 ; semmap:directType ?t }",
        "SELECT e.name, e.type FROM placement p JOIN entity e ON e.id = p.entity_id "
        "WHERE p.holder_id = entity_id('object101')",
        None,
    ),
    (
        "rooms with more than 3 tables, of three rooms",
        "SELECT ?r (COUNT(?x) AS ?n) { ?r semmap:name ?m . ?r a semmap:Room . "
        "?x semmap:heldBy ?r ; "
        'a <urn:semmap:ontology#Table> FILTER(?m IN ("room1", "room2", "room3")) } '
        "GROUP BY ?r HAVING(COUNT(?x) > 3)",
        "SELECT r.name, count(*) FROM entity r JOIN placement p ON p.holder_id = r.id "
        "JOIN object_type o ON o.id = p.entity_id AND o.type = 'table' "
        "WHERE r.map_id = (SELECT current_map()) AND r.name IN ('room1', 'room2', 'room3') "
        "AND r.kind = 'room' GROUP BY r.id, r.name HAVING count(*) > 3",
        None,
    ),
    (
        "tables within 3 m of a point",
        "SELECT ?x { ?x a semmap:Table ; geo:hasDefaultGeometry/geo:asWKT ?w FILTER(geof:distance("
        '?w, "POINT(505 505)"^^geo:wktLiteral, uom:metre) < 3) }',
        "SELECT e.name FROM world w JOIN entity e ON e.id = w.entity_id "
        "JOIN object_type o ON o.id = w.entity_id AND o.type = 'table' "
        "WHERE w.map_id = (SELECT current_map()) AND w.footprint IS NOT NULL AND "
        "ST_DWithin(w.footprint, 'POINT(505 505)'::geometry, 3)",
        None,
    ),
)
"""Each question in SPARQL and SQL, with the number of rows where it is known."""


def compared(session: psycopg.Connection[Any], question: tuple[str, str, str, int | None]) -> Row:
    """One question: the statement that SPARQL becomes, and the whole answer, beside SQL."""
    name, sparql, sql, rows = question
    with limited(session, None):
        view = MapView.of(session)
        parsed = parse_sparql(sparql, "query", tuple(prefixes(view.name).items()))
        statement = view.statement(parsed.algebra.p, [str(n) for n in parsed.names])

        def by_hand() -> list[Any]:
            return session.execute(sql, prepare=False).fetchall()

        def translated() -> list[Any]:
            return session.execute(
                statement.sql.encode(), statement.parameters, prepare=False
            ).fetchall()

        found = len(by_hand())
        assert found == len(translated()), name
        assert rows is None or rows == found, (name, found)
        answered: Callable[[], object] = lambda: query(session, sparql)  # noqa: E731
        hand, ours, whole = medians_in_turn(by_hand, translated, answered, times=31, warm_up=5)
    return Row(
        f"{name} ({found} rows)",
        f"{1e3 * ours:.2f} ms in the server; {1e3 * whole:.1f} ms with parsing and terms",
        f"SQL by hand: {1e3 * hand:.2f} ms",
        "within 2x in the server",
        ours <= 2 * hand,
    )


def main() -> None:
    """Print the table."""
    with million() as engine, engine.connect() as connection:
        session = connection.connection.driver_connection
        assert isinstance(session, psycopg.Connection)
        session.execute("SELECT set_config('semmap.map', 'million', false)")
        session.commit()
        print_rows("SPARQL on 1,000,000 objects", [compared(session, each) for each in QUESTIONS])


if __name__ == "__main__":
    main()
