"""Inferences in the database: by update, by retraction, in queries."""

from __future__ import annotations

import psycopg

from semmap.knowledge import query, update
from semmap.knowledge.reasoning import contradictions, reason, why

EX = "PREFIX ex: <http://example.org/> "
AXIOMS = """INSERT DATA {
    semmap:Drinkware rdfs:subClassOf ex:Breakable . ex:Breakable rdfs:subClassOf ex:Delicate .
    ex:Breakable owl:disjointWith ex:Unbreakable .
    rel:beside a owl:SymmetricProperty . ex:partOf a owl:TransitiveProperty .
    ex:owner a owl:FunctionalProperty . ex:owns owl:inverseOf ex:owner .
}"""


def truth(session: psycopg.Connection, pattern: str, *, inferred: bool = True) -> bool:
    return query(session, f"{EX} ASK {{ {pattern} }}", inferred=inferred).truth


def test_inferences_follow_updates(changing: psycopg.Connection) -> None:
    update(changing, EX + AXIOMS)
    assert not truth(changing, ":cup%201 a ex:Delicate")
    done = reason(changing)
    assert done.complete
    assert truth(changing, ":cup%201 a ex:Delicate")
    assert not truth(changing, ":cup%201 a ex:Delicate", inferred=False)
    assert not truth(changing, ":table a ex:Delicate")
    update(changing, EX + "INSERT DATA { :mug a semmap:Mug . :table ex:owner :ann }")
    assert truth(changing, ":mug a ex:Delicate")
    assert truth(changing, ":ann ex:owns :table")
    update(changing, EX + "DELETE DATA { :table ex:owner :ann }")
    assert not truth(changing, ":ann ex:owns :table")
