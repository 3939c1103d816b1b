"""The map as RDF: SPARQL and GeoSPARQL over the tables, without a copy of them."""

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from semmap.knowledge.answer import Answer as Answer
    from semmap.knowledge.client import KnowledgeClient as KnowledgeClient
    from semmap.knowledge.knowledge_core import KB as KB
    from semmap.knowledge.knowledge_core import KbError as KbError
    from semmap.knowledge.queries import KnowledgeError as KnowledgeError

__getattr__, __all__ = load_on_use(__name__)
