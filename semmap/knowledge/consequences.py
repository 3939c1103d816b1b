"""What each change of facts leads to: inferences, and a check of the shapes that bind the map."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from semmap.knowledge.map_view import MapView
from semmap.knowledge.reasoning.runs import refresh
from semmap.knowledge.shapes import check_binding


@contextmanager
def with_consequences(view: MapView) -> Iterator[None]:
    """Run a change of facts; at its end, infer what follows, and refuse what shapes forbid.

    BrokenShapeError: the caller's transaction is to be undone.
    """
    row = view.session.execute("SELECT coalesce(max(id), 0) FROM change").fetchone()
    assert row is not None
    yield
    view.chosen = None
    if refresh(view) is not None:
        view.inferred = MapView.of(view.session).inferred
    check_binding(view, row[0])
