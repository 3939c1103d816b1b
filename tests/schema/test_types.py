"""Subsumption: a desk is a table as soon as the T-Box says so, and no longer than that."""

from __future__ import annotations

import networkx as nx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import Engine, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from semmap.model import Object, SemanticType
from tests.model.test_placement import new_map

TYPES = [f"t{i}" for i in range(7)]


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    first=st.sets(st.tuples(st.integers(0, 6), st.integers(0, 6)), max_size=10),
    second=st.sets(st.tuples(st.integers(0, 6), st.integers(0, 6)), max_size=10),
)
def test_supertypes_of_entities_are_the_ancestors_in_the_graph(
    engine: Engine, first: set[tuple[int, int]], second: set[tuple[int, int]]
) -> None:
    with Session(engine) as session:
        of = new_map(session)
        session.add_all(SemanticType(name=t) for t in TYPES)
        session.flush()
        things = {t: Object(map=of, name=t, type=t) for t in TYPES}
        session.add_all(things.values())
        session.flush()
        for edges in (first, second):
            graph = nx.DiGraph([(TYPES[a], TYPES[b]) for a, b in edges if a < b])
            graph.add_nodes_from(TYPES)
            session.execute(text("DELETE FROM type_parent WHERE type = ANY(:t)"), {"t": TYPES})
            for edge in graph.edges:
                session.execute(
                    text("INSERT INTO type_parent VALUES (:a, :b)"), {"a": edge[0], "b": edge[1]}
                )
            for name, thing in things.items():
                got = set(
                    session.execute(
                        text("SELECT type FROM object_type WHERE id = :id"), {"id": thing.id}
                    ).scalars()
                )
                assert got == nx.descendants(graph, name) | {name, "object", "entity"}
        session.rollback()


def test_types_that_subsume_each_other_are_refused(engine: Engine) -> None:
    with Session(engine) as session:
        session.add_all([SemanticType(name="cup_a"), SemanticType(name="cup_b")])
        session.flush()
        with pytest.raises(DBAPIError, match="subsume each other"):
            session.execute(
                text("INSERT INTO type_parent VALUES ('cup_a', 'cup_b'), ('cup_b', 'cup_a')")
            )


def test_renaming_an_entity_renames_it_in_figure_3(engine: Engine) -> None:
    with Session(engine) as session:
        of = new_map(session)
        one = Object(map=of, name="old")
        session.add(one)
        session.flush()
        one.name = "new"
        session.flush()
        labels = session.execute(
            text("SELECT DISTINCT label FROM object_type WHERE id = :id"), {"id": one.id}
        ).scalars()
        assert list(labels) == ["new"]
