"""A processor by others makes the facts of the map from its mapping as R2RML."""

from __future__ import annotations

from pathlib import Path

import pyoxigraph

from semmap import Map
from semmap.knowledge.whole_graph import serialized
from tests.oracles.r2rml import materialized, needs_processor


def facts_of(made: Map, *, inferences: bool = False) -> set[pyoxigraph.Quad]:
    """Return what `semmap rdf export` writes."""
    text = serialized(made.graph(inferences=inferences), "nquads")
    return set(pyoxigraph.parse(text.encode(), format=pyoxigraph.RdfFormat.N_QUADS))


@needs_processor
def test_the_document_makes_the_facts_of_the_map(loft_map: Map, tmp_path: Path) -> None:
    document = tmp_path / "loft.ttl"
    loft_map.export_r2rml(document)
    expected = facts_of(loft_map)
    assert len({quad.graph_name for quad in expected}) == 3
    assert materialized(document, loft_map.engine.url) == expected
