"""Statements as users of KnowledgeCore write them: "human1 looksAt book", "?x rdf:type Book"."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import count
from typing import Any, NamedTuple
from urllib.parse import quote, unquote

import rdflib
from rdflib.paths import Path

from semmap.knowledge.queries import KnowledgeError, plain
from semmap.knowledge.vocabulary import KNOWLEDGE_CORE, SEMMAP, map_namespace, prefixes, short
from semmap.language.error import QueryError
from semmap.language.parser import parse_sparql
from semmap.language.terms import Variable

_BARE = re.compile(r"[^\W\d](?:[\w.%-]*[\w%-])?")
_VARIABLE = re.compile(r"\?[A-Za-z_]\w*", re.ASCII)
_LOCAL = re.compile(r"[A-Za-z_](?:[\w-]|%[0-9A-F]{2})*", re.ASCII)
_ESCAPES = re.compile("(?:%[89A-F][0-9A-F])+")  # of other than ASCII
_NAMELESS = "__"
_COUNT = count()  # variables that ``*`` stands for: each is another one
_LITERALS = frozenset({"true", "false"})
_ABOUT_VOCABULARY = frozenset(
    {
        "rdfs:subClassOf",
        "rdfs:subPropertyOf",
        "rdfs:domain",
        "rdfs:range",
        "owl:equivalentClass",
        "owl:disjointWith",
        "owl:inverseOf",
        "owl:equivalentProperty",
    }
)
"""Properties between classes and properties; bare words are individuals with all others."""


class ClientPattern(NamedTuple):
    """A triple of terms, some of which may be variables; the verb, its property, may be a path."""

    subject: Any
    verb: Any
    object: Any


def parse_pattern(statement: str, map_name: str) -> ClientPattern:
    """Return the terms of a statement; or ValueError.

    A bare word is an individual of the map (`:word`), as property or class a term of KnowledgeCore
    (`oro:word`), and so the property or type of the map with that name. ``*`` is a variable without
    a name.

    >>> [str(term) for term in parse_pattern("human1 looksAt ?book", "lab")]
    ['urn:semmap:map:lab#human1', 'http://kb.openrobots.org#looksAt', 'book']
    """
    if "\0" in statement:
        raise KnowledgeError(f"{statement!r}: has a NUL character: remove it")
    parts = statement.strip().removesuffix(" .").split(None, 2)
    if len(parts) != 3:
        raise KnowledgeError(f"{statement!r}: a statement has a subject, a property and an object")
    subject, verb, object_ = parts
    verb = "rdf:type" if verb == "a" else verb
    both = verb in _ABOUT_VOCABULARY
    of_class = both or verb == "rdf:type"
    of_term = both or (verb == "rdf:type" and object_.startswith("owl:"))
    words = (
        _word(subject, "oro" if of_term else ""),
        _word(verb, "oro"),
        _word(object_, "oro" if of_class else ""),
    )
    known = prefixes(map_name)
    terms = [_name(word, known) for word in words]
    if None not in terms:
        return ClientPattern(*terms)  # many are of names alone, and parsing takes long
    try:
        parsed = parse_sparql(f"SELECT * {{ {' '.join(words)}\n}}", "query", tuple(known.items()))
    except QueryError as error:
        raise KnowledgeError(f"{statement!r}: {error.reason}: write a string in quotes") from error
    if parsed.triple is None:
        raise KnowledgeError(f"{statement!r}: this is more than one statement: give a list of them")
    is_own = (rdflib.Variable, Path)
    return ClientPattern(*(t if isinstance(t, is_own) else plain(t) for t in parsed.triple))


def _word(word: str, prefix: str) -> str:
    if word == "*":
        return f"?{_NAMELESS}{next(_COUNT)}"
    if word in _LITERALS or not _BARE.fullmatch(word):
        return word
    return f"{prefix}:{quote(word, safe='%')}"


def _name(word: str, known: Mapping[str, str]) -> rdflib.URIRef | rdflib.Variable | None:
    """Return the term of a variable, or of a name with a prefix; None where it is to be parsed."""
    if _VARIABLE.fullmatch(word):
        return Variable(word[1:])
    prefix, _, local = word.partition(":")
    if prefix in known and _LOCAL.fullmatch(local):
        return rdflib.URIRef(known[prefix] + local)
    return None


def variables(patterns: Iterable[ClientPattern]) -> list[str]:
    """Return the names of the variables of patterns, in order; without those of ``*``."""
    terms = (term for pattern in patterns for term in pattern)
    names = dict.fromkeys(str(term) for term in terms if isinstance(term, rdflib.Variable))
    return [name for name in names if not name.startswith(_NAMELESS)]


def query_text(
    patterns: Sequence[ClientPattern], names: Sequence[str], graph: rdflib.URIRef | None
) -> str:
    """Return the query for all patterns: SELECT of the names, or ASK where there are none."""
    body = " . ".join(" ".join(term.n3() for term in pattern) for pattern in patterns)
    if graph is not None:
        body = f"GRAPH {graph.n3()} {{ {body} }}"
    form = f"SELECT DISTINCT {' '.join(f'?{name}' for name in names)}" if names else "ASK"
    return f"{form} {{ {body} }}"


def _letters(escapes: re.Match[str]) -> str:
    """Return the letters of escapes, where a bare word may have them."""
    text = unquote(escapes[0])
    return text if re.fullmatch(r"\w+", text) else escapes[0]


def name_of(term: Any, map_name: str) -> Any:
    """Return a term as it is written in a statement; a literal as a value of Python."""
    if isinstance(term, rdflib.Literal):
        return term.toPython()
    if not isinstance(term, rdflib.URIRef):
        return None if term is None else term.n3()
    for space in (map_namespace(map_name), KNOWLEDGE_CORE[0], SEMMAP):
        if term.startswith(space):
            return _ESCAPES.sub(_letters, str(term)[len(space) :])
    return short(str(term), prefixes(map_name))
