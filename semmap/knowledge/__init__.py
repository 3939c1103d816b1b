"""The map as RDF: SPARQL and GeoSPARQL over the tables, without a copy of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from semmap.knowledge.answer import Answer
    from semmap.knowledge.client import KnowledgeClient
    from semmap.knowledge.knowledge_core import KB, KbError
    from semmap.knowledge.queries import KnowledgeError

__all__ = [
    "KB",
    "Answer",
    "KbError",
    "KnowledgeClient",
    "KnowledgeError",
]

_HOMES = {
    "KB": "semmap.knowledge.knowledge_core",
    "KbError": "semmap.knowledge.knowledge_core",
    "Answer": "semmap.knowledge.answer",
    "KnowledgeClient": "semmap.knowledge.client",
    "KnowledgeError": "semmap.knowledge.queries",
}

__getattr__ = load_on_use(__name__, _HOMES)
