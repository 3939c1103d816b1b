"""Runs of the reasoner, and the state that they leave in the table `reasoning`."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from semmap.knowledge.map_view import MapView
from semmap.knowledge.queries import limited
from semmap.knowledge.reasoning.axioms import OntologyAxioms
from semmap.knowledge.reasoning.changes import Changed, consider
from semmap.knowledge.reasoning.first_run import first_run
from semmap.knowledge.reasoning.store import Stored
from semmap.knowledge.sparql.kept_queries import Session


@dataclass(frozen=True)
class Reasoned:
    """What a run of the reasoner changed."""

    added: int
    removed: int
    inferences: int  # how many there are now
    contradictions: int
    complete: bool  # all facts were read
    seconds: float


def reason(session: Session, *, complete: bool = False, seconds: float | None = None) -> Reasoned:
    """Reason about the map that a session sees, from now on after each update, too."""
    with limited(session, seconds) as deadline:
        view = MapView.of(session)
        view.deadline = deadline
        session.execute(
            "INSERT INTO reasoning (map_id, axioms, cursor) VALUES (%s, '', change_cursor()) "
            "ON CONFLICT DO NOTHING",
            (view.number,),
        )
        done = refresh(view, complete=complete)
        assert done is not None
        return done


def forget(session: Session) -> None:
    """Remove the inferences of a map, and reason about it no more."""
    with session.transaction():
        session.execute("DELETE FROM reasoning WHERE map_id = %s", (MapView.of(session).number,))


def is_reasoned(view: MapView) -> bool:
    """Return whether a map is reasoned about."""
    row = view.session.execute("SELECT FROM reasoning WHERE map_id = %s", (view.number,))
    return row.fetchone() is not None


def refresh(view: MapView, *, complete: bool = False) -> Reasoned | None:
    """Bring the inferences of a map up to date; None where it is not reasoned about."""
    start = time.perf_counter()
    row = view.session.execute(
        "SELECT axioms, cursor, at FROM reasoning WHERE map_id = %s FOR UPDATE", (view.number,)
    ).fetchone()
    if row is None:
        return None
    state, cursor, at = row
    # Before the changes are read: what is committed after this is read by the next run.
    news = view.session.execute("SELECT change_cursor(), statement_timestamp()").fetchone()
    assert news is not None
    ontology = OntologyAxioms.read(view, state)
    changed = None
    if ontology.is_of(state) and not complete:
        changed = Changed.since(view, cursor, at)
    done = None if changed is None else consider(view, ontology, changed)
    if done is None:
        ontology, done = first_run(view, ontology)
    counts = _note(view, ontology, news, done)
    return Reasoned(
        done.added.total(),
        done.removed,
        *counts,
        done.complete,
        time.perf_counter() - start,
    )


def _note(
    view: MapView, ontology: OntologyAxioms, news: tuple[Any, Any], done: Stored
) -> tuple[int, int]:
    """Write the state of the reasoner; return the numbers of inferences and contradictions."""
    properties = sorted({p for p, _ in done.added})
    classes = sorted({c for _, c in done.added if c is not None})
    merged = "ARRAY(SELECT DISTINCT unnest({0} || %({0})s::text[]) ORDER BY 1)"
    kept = "%({0})s::text[]" if done.complete else merged
    start = "0" if done.complete else "{}"
    row = view.session.execute(
        f"UPDATE reasoning SET axioms = %(axioms)s, cursor = %(cursor)s, at = %(at)s, "
        f"properties = {kept.format('properties')}, classes = {kept.format('classes')}, "
        f"inferences = {start.format('inferences')} + %(more)s, "
        f"contradictions = {start.format('contradictions')} + %(clashes)s "
        "WHERE map_id = %(map)s "
        "RETURNING inferences, contradictions".encode(),
        {
            "axioms": ontology.state,
            "cursor": news[0],
            "at": news[1],
            "properties": properties,
            "classes": classes,
            "more": done.added.total() - done.removed,
            "clashes": done.clashes,
            "map": view.number,
        },
    ).fetchone()
    assert row is not None
    return row[0], row[1]
