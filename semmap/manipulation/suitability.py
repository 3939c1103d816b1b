"""Which shapes, functions and grippers suit an action, by the axioms of the ontology.

An action that would contradict `schema/ontology/knowledge/manipulation.ttl` is not proposed.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import NamedTuple

import rdflib
from rdflib import OWL, RDFS

from semmap.ingest.ontology.tbox import ontology_files
from semmap.knowledge.reasoning.engine import TYPE_OF, Facts, Triple, close
from semmap.knowledge.reasoning.rules import (
    AXIOM_CLASSES,
    AXIOM_PROPERTIES,
    CONTRADICTION,
    Compiled,
    compile_rules,
)
from semmap.knowledge.vocabulary import SEMMAP
from semmap.manipulation.solids import FITS
from semmap.query.snapshot import Snapshot

_ACTION, _GRIPPER, _OBJECT = "_:action", "_:gripper", "_:object"


def class_of(name: str, suffix: str = "") -> str:
    """The IRI that a word of the tables has in the ontology: multi-finger, :MultiFinger.

    >>> class_of("multi-finger", "Gripper")
    'urn:semmap:ontology#MultiFingerGripper'
    """
    words = name.replace("_", " ").replace("-", " ").split()
    return f"{SEMMAP}{''.join(word.capitalize() for word in words)}{suffix}"


def unsuitable(
    kind: str,
    form: str,
    shape: str | None = None,
    functions: Iterable[str] = (),
    types: Iterable[str] = (),
) -> list[str]:
    """Why an action of a kind by a gripper of a form does not suit an object; empty where it does.

    `kind` and `form` are those of the tables, `shape` is one of `SIZES`, or None where it is not
    known; `functions` are what the object is used for, such as sitting, and `types` its semantic
    type with those above it.
    """
    told = (tuple(sorted(words)) for words in (functions, types))
    return list(_unsuitable(kind, form, shape, *told))


@cache
def _unsuitable(
    kind: str, form: str, shape: str | None, functions: tuple[str, ...], types: tuple[str, ...]
) -> tuple[str, ...]:
    axioms = _axioms()
    told = [
        (_ACTION, TYPE_OF, class_of(kind)),
        (_ACTION, f"{SEMMAP}actsOn", _OBJECT),
        (_ACTION, f"{SEMMAP}gripper", _GRIPPER),
        (_GRIPPER, TYPE_OF, class_of(form, "Gripper")),
        *((_OBJECT, f"{SEMMAP}hasShape", class_of(each)) for each in (shape,) if each is not None),
        *((_OBJECT, f"{SEMMAP}hasFunction", class_of(use)) for use in functions),
        *((_OBJECT, f"{SEMMAP}modelOf", class_of(each)) for each in types),
    ]
    facts = Facts()
    stated = [*told, *axioms.compiled.stated()]
    for fact in stated:
        facts.add(fact)
    close(facts, axioms.compiled.rules, stated)
    if not any(facts.match(_OBJECT, CONTRADICTION, None)):
        return ()
    found = {str(fact[2]) for fact in facts.match(_OBJECT, TYPE_OF, None)}
    return tuple(
        comment for one, other, comment in axioms.disjoint if one in found and other in found
    )


def reasons_against(
    seen: Snapshot, kind: str, form: str, entities: Iterable[int]
) -> dict[str, str]:
    """Why an action of a kind by a gripper of a form suits none of these entities, by their names.

    Their functions are those of their types and of their models, their shapes those that fit; their
    types are those of the entities; what no reason is against is left out.
    """
    rows = seen.session.execute(OBJECTS, (FITS, list(entities))).fetchall()
    found = {name: unsuitable(kind, form, *told) for name, *told in rows}
    return {
        name: f"{name}: the ontology excludes a {kind} of it by a {form} gripper: {'; '.join(why)}"
        for name, why in found.items()
        if why
    }


OBJECTS = """
SELECT e.name, CASE WHEN o.inliers >= %s THEN o.shape END,
       functions_of(e.type) || coalesce(o.functions, '{}'),
       ARRAY(SELECT c.super FROM type_closure c WHERE c.sub = e.type)
FROM entity e LEFT JOIN entity_object h ON h.entity_id = e.id
LEFT JOIN object_model o ON o.id = h.object_id
WHERE e.id = ANY (%s) ORDER BY e.name
"""


class _Axioms(NamedTuple):
    """The axioms as rules, and the disjoint classes with the comment of the first one."""

    compiled: Compiled
    disjoint: tuple[tuple[str, str, str], ...]


@cache
def _axioms() -> _Axioms:
    path = ontology_files()[0].parent / "knowledge" / "manipulation.ttl"
    graph = rdflib.Graph().parse(path, format="turtle")
    facts: set[Triple] = {
        (str(s), str(p), str(o)) for s, p, o in graph if not isinstance(o, rdflib.Literal)
    }
    axioms = {
        fact
        for fact in facts
        if fact[1] in AXIOM_PROPERTIES or (fact[1] == TYPE_OF and fact[2] in AXIOM_CLASSES)
    }
    disjoint = tuple(
        (str(one), str(other), str(graph.value(one, RDFS.comment)))
        for one, other in sorted(graph.subject_objects(OWL.disjointWith))
    )
    return _Axioms(compile_rules(axioms, same=False), disjoint)
