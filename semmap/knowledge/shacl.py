"""SHACL: what a map must conform to, on request and, at what was changed, at each update."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import rdflib
from rdflib import OWL, RDF, RDFS, SH
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.database.files import schema_folder
from semmap.error import Error
from semmap.ingest.text_file import read_text
from semmap.ingest.world import WorldError
from semmap.knowledge.map_view import MapView
from semmap.knowledge.queries import limited_view
from semmap.knowledge.results import shown
from semmap.knowledge.sparql.kept_queries import Session
from semmap.knowledge.timed_patterns import TimedPatterns
from semmap.knowledge.timed_shapes import checked_apart
from semmap.knowledge.vocabulary import prefixes
from semmap.knowledge.whole_graph import without_warnings
from semmap.limits import QUERY_SECONDS, REGEX_SECONDS

MANY = 2_000  # from so many nodes on, the whole map is validated
_ENDS = (SH.targetSubjectsOf, SH.targetObjectsOf, SH.equals, SH.disjoint, SH.lessThan)
_OF_CLASSES = {RDF.type, RDFS.subClassOf}
_REPEATED = (SH.zeroOrMorePath, SH.oneOrMorePath)


@dataclass(frozen=True)
class Violation:
    """A node of the map that does not conform to a shape."""

    name: str  # the node, with a prefix
    message: str
    path: str  # the property; "" where the node itself is wrong
    value: str  # that is wrong, "" where one is missing
    severity: str  # "violation", "warning" or "info"

    def shown(self) -> str:
        """Return it as a line."""
        where = f" ({self.path}{f' {self.value}' if self.value else ''})" if self.path else ""
        return f"{self.name}: {self.message}{where}"


@dataclass(frozen=True)
class Shapes:
    """A graph of shapes."""

    name: str  # of the file
    turtle: str  # its text
    graph: rdflib.Graph  # the shapes

    @cached_property
    def inverse(self) -> frozenset[rdflib.URIRef]:
        """The properties that paths follow against their direction."""
        return frozenset(
            o for o in self.graph.objects(None, SH.inversePath) if isinstance(o, rdflib.URIRef)
        )

    @cached_property
    def properties(self) -> frozenset[rdflib.URIRef] | None:
        """The properties that the shapes are about; None for all."""
        if self.needs_everything:
            return None
        found = {*_OF_CLASSES, *self.inverse}
        for end in (SH.path, SH.alternativePath, SH.zeroOrOnePath, *_REPEATED, *_ENDS):
            for node in self.graph.objects(None, end):
                found |= {p for p in self._members(node) if isinstance(p, rdflib.URIRef)}
        return frozenset(found)

    def _members(self, node: Any) -> list[Any]:
        is_list = (node, RDF.first, None) in self.graph
        if not is_list:
            return [node]
        items = rdflib.collection.Collection(self.graph, node)
        return [each for item in items for each in self._members(item)]

    @property
    def needs_everything(self) -> bool:
        """Whether the shapes may look at all facts: by SPARQL, or because they are closed."""
        return self.has_sparql or any((None, p, None) in self.graph for p in (SH.closed, SH.js))

    @property
    def has_sparql(self) -> bool:
        """Whether rdflib evaluates queries of the shapes."""
        return any((None, p, None) in self.graph for p in (SH.sparql, SH.select, SH.ask))

    @cached_property
    def reach(self) -> int | None:
        """How many facts away from its node a shape looks at most; None without a limit."""
        if self.needs_everything or any((None, p, None) in self.graph for p in _REPEATED):
            return None
        steps = [1]
        for path in self.graph.objects(None, SH.path):
            steps.append(len(self._members(path)))
        nested = len(set(self.graph.objects(None, SH.node)))
        nested += len(set(self.graph.objects(None, SH.qualifiedValueShape)))
        return max(steps) * (1 + nested) + 1


def domain_shapes() -> Shapes:
    """Return the shapes of `schema/shapes/domain.ttl`: what a robot's map must have."""
    return read_shapes(schema_folder() / "shapes" / "domain.ttl")


def read_shapes(path: Path, *, seconds: float | None = None) -> Shapes:
    """Return the shapes of a Turtle file; or WorldError.

    Their SPARQL is stopped after some seconds, by default after those of a query.
    """
    shapes = _parsed(path.stem, read_text(path), path)
    most = QUERY_SECONDS.value if seconds is None else seconds
    _conforms(shapes, rdflib.Graph(), path, None, most, check=True)
    return shapes


def _parsed(name: str, text: str, path: Path) -> Shapes:
    try:
        graph = rdflib.Graph().parse(data=text, format="turtle")
    except Exception as error:  # rdflib's parsers raise anything on broken text
        raise WorldError(
            path, "file", f"is not Turtle: {str(error)[:300]}", "Fix its syntax."
        ) from error
    if (None, OWL.imports, None) in graph:
        raise WorldError(
            path, "owl:imports", "names another file", "Write all shapes into one file."
        )
    if (None, SH.js, None) in graph or (None, SH.jsLibrary, None) in graph:
        raise WorldError(path, "sh:js", "is code, which is not run", "State it as a shape.")
    has_shapes = any(
        (None, RDF.type, kind) in graph for kind in (SH.NodeShape, SH.PropertyShape)
    ) or any((None, p, None) in graph for p in (SH.targetClass, SH.targetNode, *_ENDS[:2]))
    if not has_shapes:
        raise WorldError(
            path, "file", "has no SHACL shape", "State one: :S a sh:NodeShape ; sh:targetClass ..."
        )
    for pattern in graph.objects(None, SH.pattern):
        try:
            re.compile(str(pattern))
        except re.error as error:
            raise WorldError(
                path, f"sh:pattern {str(pattern)!r}", f"is malformed: {error}", "Correct it."
            ) from error
    return Shapes(name, text, graph)


_kept = lru_cache(maxsize=8)(_parsed)


def validate(
    session: Session, shapes: Iterable[Shapes], *, seconds: float | None = None
) -> list[Violation]:
    """Return what breaks shapes in the map that a session sees; inferences are facts, too."""
    with limited_view(session, seconds) as view:
        return [found for each in shapes for found in _violations(view, each)]


def bind_shapes(session: Session, shapes: Shapes) -> None:
    """Let shapes bind the map that a session sees: an update that breaks them is refused."""
    with limited_view(session, None) as view:
        _refuse(_violations(view, shapes), "the map does not conform to the shapes")
        session.execute(
            "INSERT INTO binding_shapes (map_id, name, turtle) VALUES (%s, %s, %s) "
            "ON CONFLICT (map_id, name) DO UPDATE SET turtle = excluded.turtle, "
            "at = clock_timestamp()",
            (view.number, shapes.name, shapes.turtle),
        )


def unbind_shapes(session: Session, name: str) -> None:
    """Let shapes bind the map no more."""
    with session.transaction():
        view = MapView.of(session)
        gone = session.execute(
            "DELETE FROM binding_shapes WHERE map_id = %s AND name = %s", (view.number, name)
        )
        if not gone.rowcount:
            known = ", ".join(each.name for each in binding_shapes(view)) or "none"
            raise LookupError(f"no shapes {name} bind the map {view.name}; those that do: {known}")


def binding_shapes(view: MapView) -> list[Shapes]:
    """Return the shapes that bind a map."""
    rows = view.session.execute(
        "SELECT name, turtle FROM binding_shapes WHERE map_id = %s ORDER BY name", (view.number,)
    )
    return [_kept(name, turtle, Path(name)) for name, turtle in rows.fetchall()]


class BrokenShapeError(Error, ValueError):
    """A change after which the map does not conform to the shapes that bind it."""


def check_binding(view: MapView, since: int) -> None:
    """Refuse a change after which what it changed does not conform to the binding shapes.

    That is `MapView.touched`, and what the table `change` has after the row `since`. After
    BrokenShapeError, the caller undoes the change.
    """
    shapes = binding_shapes(view)
    if not shapes:
        return
    rows = view.session.execute(
        "SELECT DISTINCT entity_iri(u) FROM change c, unnest(c.entities) u WHERE c.id > %s "
        "AND c.xid = pg_current_xact_id()::text::bigint AND c.map_id = %s",
        (since, view.number),
    ).fetchall()
    nodes = {rdflib.URIRef(iri) for (iri,) in rows if iri is not None}
    nodes |= {node for node in view.touched if isinstance(node, rdflib.URIRef)}
    for each in shapes:
        what = f"it breaks the shapes {each.name}, which bind the map {view.name}"
        _refuse(_violations(view, each, nodes), what)


def _refuse(found: list[Violation], what: str) -> None:
    wrong = [each.shown() for each in found if each.severity == "violation"]
    if wrong:
        more = f"; and {len(wrong) - 5} more" if len(wrong) > 5 else ""
        raise BrokenShapeError(f"{what}: {'; '.join(wrong[:5])}{more}")


def _violations(
    view: MapView, shapes: Shapes, nodes: set[rdflib.URIRef] | None = None
) -> list[Violation]:
    """Return what does not conform; of some nodes and what leads to them, or of all."""
    focus: set[rdflib.URIRef] | None = None
    if nodes is not None and shapes.reach is not None:
        focus = _leading_to(view, shapes, nodes)
    if focus is None:
        data = _whole(view, shapes.properties)
    elif not focus:
        return []
    else:
        data = _around(view, shapes, focus)
    return sorted(
        _report(view, _conforms(shapes, data, Path(shapes.name), focus, _seconds_left(view))),
        key=lambda v: (v.severity, v.name, v.message),
    )


def _seconds_left(view: MapView) -> float:
    if view.deadline == math.inf:
        return QUERY_SECONDS.value
    return max(0.01, view.deadline - time.monotonic())


def _conforms(
    shapes: Shapes,
    data: rdflib.Graph,
    path: Path,
    focus: set[rdflib.URIRef] | None,
    seconds: float,
    *,
    check: bool = False,
) -> rdflib.Graph:
    """Return the report of SHACL; check the shapes by those of SHACL itself."""
    if shapes.has_sparql:
        return checked_apart(_checked, seconds, path, shapes.graph, data, path, focus, check)
    return _checked(shapes.graph, data, path, focus, check)


def _checked(
    shapes: rdflib.Graph,
    data: rdflib.Graph,
    path: Path,
    focus: set[rdflib.URIRef] | None,
    check: bool,
) -> rdflib.Graph:
    try:
        import pyshacl
        from pyshacl.constraints.core import string_based_constraints
    except ModuleNotFoundError as error:
        raise ValueError(
            f"{error.name} is not installed: pip install 'semmap[knowledge]'"
        ) from None
    vars(string_based_constraints)["re"] = TimedPatterns
    try:
        with without_warnings():
            _, report, text = pyshacl.validate(
                data,
                shacl_graph=shapes,
                inplace=True,
                advanced=False,
                do_owl_imports=False,
                meta_shacl=check,
                focus_nodes=None if focus is None else list(focus),
            )
    except TimeoutError as error:
        problem = f"takes longer than {REGEX_SECONDS.value:g} s for one value"
        fix = f"Do not nest repetitions. {REGEX_SECONDS.variable} raises the limit."
        raise WorldError(path, "sh:pattern", problem, fix) from error
    except MemoryError:
        raise
    except Exception as error:  # pyshacl raises anything on malformed shapes
        raise WorldError(
            path, "shape", f"is malformed: {str(error).strip()[:300]}", "See the SHACL standard."
        ) from error
    if not isinstance(report, rdflib.Graph):
        raise WorldError(path, "shape", f"cannot be checked: {str(text)[:300]}", "Simplify it.")
    return report


def _report(view: MapView, report: rdflib.Graph) -> Iterable[Violation]:
    known = prefixes(view.name)

    for result in report.subjects(RDF.type, SH.ValidationResult):
        path = report.value(result, SH.resultPath)
        if isinstance(path, rdflib.BNode):
            path = report.value(path, SH.inversePath)
        severity = str(report.value(result, SH.resultSeverity)).rsplit("#", 1)[-1].lower()
        messages = sorted(map(str, report.objects(result, SH.resultMessage)))
        value = report.value(result, SH.value)
        node = report.value(result, SH.focusNode)
        yield Violation(
            shown(node, known) or "",
            messages[0] if messages else "does not conform",
            shown(path, known) or "",
            "" if value == node else shown(value, known) or "",
            severity,
        )


def _whole(view: MapView, properties: frozenset[rdflib.URIRef] | None) -> rdflib.Graph:
    graph = rdflib.Graph()
    for verb in properties or [None]:
        graph += view.triples((None, verb, None))
    return graph


def _around(view: MapView, shapes: Shapes, nodes: set[rdflib.URIRef]) -> rdflib.Graph:
    """Return the facts that shapes of some nodes look at."""
    graph = rdflib.Graph()
    done: set[Any] = set()
    new: set[Any] = set(nodes)
    for _ in range(shapes.reach or 0):
        done |= new
        found = _facts(view, new, shapes.properties or (), "s")
        found += _facts(view, new, shapes.inverse, "o")
        graph += found
        new = {t for s, p, o in found if p not in _OF_CLASSES for t in (s, o)}
        new = {t for t in new - done if isinstance(t, rdflib.URIRef)}
        if not new:
            break
    # The classes of the nodes, for targets.
    graph += view.triples((None, RDFS.subClassOf, None))
    return graph


def _leading_to(
    view: MapView, shapes: Shapes, nodes: set[rdflib.URIRef]
) -> set[rdflib.URIRef] | None:
    """Return some nodes, and those whose shapes look at them; None where there are too many."""
    followed = (shapes.properties or frozenset()) - _OF_CLASSES
    found, new = set(nodes), set(nodes)
    for _ in range((shapes.reach or 0) - 1):
        there = {s for s, _, _ in _facts(view, new, followed, "o")}
        there |= {o for _, _, o in _facts(view, new, shapes.inverse, "s")}
        new = {t for t in there - found if isinstance(t, rdflib.URIRef)}
        found |= new
        if len(found) > MANY:
            return None
        if not new:
            break
    return found


def _facts(
    view: MapView, nodes: Iterable[Any], properties: Iterable[rdflib.URIRef], known: str
) -> list[tuple[Any, Any, Any]]:
    side = rdflib.Variable(known)
    rows = [{side: node} for node in nodes]
    found: list[tuple[Any, Any, Any]] = []
    if not rows:
        return found
    for verb in properties:
        pattern = CompValue("BGP", triples=[(rdflib.Variable("s"), verb, rdflib.Variable("o"))])
        values = CompValue("ToMultiSet", p=CompValue("values", res=rows))
        tree = CompValue("Join", p1=values, p2=pattern)
        for s, o in view.run(view.statement(tree, ("s", "o"))):
            found.append((s, verb, o))
    return found
