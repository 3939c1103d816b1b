"""What an endpoint of SPARQL says of itself: SPARQL 1.1 Service Description, and VoID of the map.

See www.w3.org/TR/sparql11-service-description and www.w3.org/TR/void.
"""

from __future__ import annotations

import rdflib
from rdflib.namespace import RDF, VOID, Namespace

from semmap.knowledge.map_view import MapView
from semmap.knowledge.sparql.kept_queries import Session
from semmap.knowledge.vocabulary import graph_iri, prefixes
from semmap.knowledge.whole_graph import with_prefixes

SD = Namespace("http://www.w3.org/ns/sparql-service-description#")
FORMAT = Namespace("http://www.w3.org/ns/formats/")

RESULTS = ("SPARQL_Results_JSON", "SPARQL_Results_XML", "SPARQL_Results_CSV", "SPARQL_Results_TSV")
GRAPHS = ("Turtle", "N-Triples", "JSON-LD", "RDF_XML")

_NAMED = """
SELECT g.text, count(*) FROM triple t JOIN term g ON g.id = t.graph
WHERE t.map_id = %s AND (t.until IS NULL OR t.until > statement_timestamp()) GROUP BY g.text
"""


def service_description(session: Session, url: str) -> rdflib.Graph:
    """Return the description of the endpoint of a map, whose address ends in ``/sparql``."""
    view = MapView.of(session)
    found = with_prefixes(rdflib.Graph(), view.name)
    for prefix, space in {"sd": SD, "void": VOID, "formats": FORMAT}.items():
        found.bind(prefix, space)
    reads, writes, data = rdflib.URIRef(url), rdflib.BNode(), rdflib.BNode()
    update = rdflib.URIRef(url.removesuffix("sparql") + "update")
    for service, address, language in (
        (reads, reads, SD.SPARQL11Query),
        (writes, update, SD.SPARQL11Update),
    ):
        found.add((service, RDF.type, SD.Service))
        found.add((service, SD.endpoint, address))
        found.add((service, SD.supportedLanguage, language))
        found.add((service, SD.defaultDataset, data))
    for name in (*RESULTS, *GRAPHS):
        found.add((reads, SD.resultFormat, FORMAT[name]))
    for kind in (SD.Dataset, VOID.Dataset):
        found.add((data, RDF.type, kind))
    found.add((data, VOID.sparqlEndpoint, reads))
    found.add((data, VOID.uriSpace, rdflib.Literal(view.namespace)))
    for space in prefixes(view.name).values():
        if space != view.namespace:
            found.add((data, VOID.vocabulary, rdflib.URIRef(space)))
    default = rdflib.BNode()
    found.add((data, SD.defaultGraph, default))
    found.add((default, RDF.type, SD.Graph))
    for name, number in session.execute(_NAMED, (view.number,)):
        named, graph = rdflib.BNode(), rdflib.BNode()
        found.add((data, SD.namedGraph, named))
        found.add((named, RDF.type, SD.NamedGraph))
        found.add((named, SD.name, rdflib.URIRef(graph_iri(name))))
        found.add((named, SD.graph, graph))
        found.add((graph, RDF.type, SD.Graph))
        found.add((graph, VOID.triples, rdflib.Literal(number)))
    return found
