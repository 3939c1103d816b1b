"""The interface of KnowledgeCore, name by name, for programs that speak to one."""

from __future__ import annotations

import inspect
import json
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from hashlib import md5
from importlib.metadata import version
from itertools import count, product
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import psycopg
import rdflib
from sqlalchemy.exc import DBAPIError

from semmap.database import open_engine
from semmap.error import Error
from semmap.ingest.world import WorldError
from semmap.knowledge.client import KnowledgeClient
from semmap.knowledge.facts import refusal_text
from semmap.knowledge.map_view import MapView
from semmap.knowledge.patterns import name_of
from semmap.knowledge.rdf_file import read_facts, store_facts
from semmap.knowledge.results import sparql_json
from semmap.knowledge.sparql.stored_terms import Term
from semmap.knowledge.standing.subscriptions import Event
from semmap.knowledge.vocabulary import SEMMAP
from semmap.query.map_handle import MapHandle, MapSource

Models = str | Sequence[str] | None

_FORMATS = {".ttl": "turtle", ".owl": "xml", ".rdf": "xml", ".n3": "n3", ".nt": "nt"}
_METHODS = ("add", "update", "safe_add", "safe_update", "revision", "retract", "remove")


class KbError(Error):
    """A request that was refused; `value` is the reason."""

    def __init__(self, value: str) -> None:
        super().__init__(value)
        self.value = value


class KB(AbstractContextManager["KB"]):
    """A map as KnowledgeCore's class `KB` has it; by default the chosen or only map.

    Models are the names of one or several; none, or "default", is the map itself, "all" is the map
    and each model. Names of statements are those of `KnowledgeClient`.

    Examples
    --------
    >>> with KB() as kb:  # doctest: +SKIP
    ...     kb += ["alfred rdf:type Human", "alfred likes icecream"]
    ...     kb["* likes icecream"]
    [{'var1': 'alfred'}]
    """

    def __init__(self, source: MapSource | KnowledgeClient | None = None) -> None:
        """See a map, by a client that several of these may share, else by one of its own."""
        self._shared = isinstance(source, KnowledgeClient)
        if source is None:
            source = MapHandle(open_engine())
        if not isinstance(source, KnowledgeClient):
            source = KnowledgeClient(source)
        self._client = source
        self.events: SimpleQueue[tuple[str, list[dict[str, Any]]]] = SimpleQueue()
        self._subscribed: dict[tuple[str, Any], list[int]] = {}

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all subscriptions."""
        self._unsubscribe()
        if not self._shared:
            self._client.close()

    def _unsubscribe(self) -> None:
        while self._subscribed:
            _, numbers = self._subscribed.popitem()
            self._end(numbers)

    def _end(self, numbers: Iterable[int]) -> None:
        for number in numbers:
            self._client.unsubscribe(number)

    def hello(self) -> str:
        """Return the name and version of what answers."""
        return f"semmap {self.version()}"

    def version(self) -> str:
        """Return the version of what answers."""
        return version("semmap")

    def stats(self) -> dict[str, Any]:
        """Return the name of the knowledge base, its map and its models."""
        models = ["default", *self._client.models()]
        return {"name": self.hello(), "map": self._client.map_name, "models": models}

    def methods(self) -> list[str]:
        """Return the methods with their arguments."""
        return [
            f"{name}{inspect.signature(method)}"
            for name, method in inspect.getmembers(self, inspect.ismethod)
            if not name.startswith("_")
        ]

    def clear(self) -> None:
        """Remove all statements of the map and its models; entities and their tables stay."""
        with _errors(), self._client.view() as view:
            view.session.execute("DELETE FROM triple WHERE map_id = %s", (view.number,))
        self._unsubscribe()

    def load(self, filename: str | Path, models: Models = None) -> None:
        """Add the statements of an RDF file: RDF/XML, Turtle, N3 or N-Triples."""
        path = Path(filename)
        with _errors():
            facts = list(read_facts(path, _FORMATS.get(path.suffix, "turtle")))
            with self._client.view() as view:
                for model in self._models(models):
                    graph = self._client.graph_of(model)
                    placed = [fact._replace(graph=graph) for fact in facts]
                    store_facts(view.session, placed, path)

    def revise(self, stmts: Sequence[str], policy: dict[str, Any]) -> None:
        """Change statements by a policy: "method", and maybe "models" and "lifespan" (seconds)."""
        if not isinstance(policy, dict) or "method" not in policy:
            raise KbError("a policy is a dictionary with the key method, such as {'method': 'add'}")
        unknown = policy.keys() - {"method", "models", "lifespan"}
        if unknown or policy["method"] not in _METHODS:
            wrong = f"{min(unknown)} in a policy" if unknown else f"method {policy['method']!r}"
            raise KbError(
                f"{wrong} is unknown; keys: method, models, lifespan; methods: "
                + ", ".join(_METHODS)
            )
        if isinstance(stmts, str) or not all(isinstance(each, str) for each in stmts):
            raise KbError(f"{stmts!r}: a list of statements is expected")
        for each in stmts:
            if each.split(None, 2)[2:] and each.split(None, 2)[2].startswith("'"):
                raise KbError(f"{each!r}: write a string in double quotes")
        retracts = policy["method"] in ("retract", "remove")
        with _errors():
            self._client.revise_models(
                self._models(policy.get("models")),
                stmts,
                "retract" if retracts else "update",
                lifespan=0 if retracts else policy.get("lifespan") or 0,
                unknown=True,
            )
        self._client.catch_up()

    def update(self, stmts: Sequence[str], models: Models = None, lifespan: float = 0) -> None:
        """Add statements; those with a functional property replace former ones."""
        self.revise(stmts, {"method": "update", "models": models, "lifespan": lifespan})

    add = update

    def remove(self, stmts: Sequence[str], models: Models = None) -> None:
        """Remove statements; those that are not there are left out."""
        self.revise(stmts, {"method": "retract", "models": models})

    retract = remove

    def __iadd__(self, stmts: str | Sequence[str]) -> KB:
        self.update([stmts] if isinstance(stmts, str) else stmts)
        return self

    def __isub__(self, stmts: str | Sequence[str]) -> KB:
        self.remove([stmts] if isinstance(stmts, str) else stmts)
        return self

    def find(
        self, patterns: Sequence[str], vars: Sequence[str] | None = None, models: Models = None
    ) -> list[dict[str, Any]] | bool:
        """Return the terms of variables where all patterns match, for each model; or a yes or no.

        `vars`, such as "?agent", are by default all of the patterns. Given first, as in former
        versions, they are known by having no spaces. Where all are ``*`` or begin with ``?__``,
        they are var1, var2 ...
        """
        patterns, wanted = _listed(patterns), _listed(vars or [])
        if wanted and all(_is_name(each) for each in patterns):
            patterns, wanted = wanted, patterns
        with _errors():
            patterns, starred = _with_stars(patterns)
            parsed = self._client.parsed(patterns)
            known = dict.fromkeys(
                f"?{term}" for p in parsed for term in p if isinstance(term, rdflib.Variable)
            )
            if not known:
                return self.exist(patterns, models)
            names = wanted or list(known)
            named = [name for name in names if name not in starred and not name.startswith("?__")]
            names = named or names
            shown = [n.removeprefix("?") for n in named] or [
                f"var{i + 1}" for i in range(len(names))
            ]
            found: dict[tuple[Any, ...], None] = {}
            for model in self._models(models):
                rows = self._client.rows(patterns, names, model=model, tbox=False)
                found |= dict.fromkeys(rows)
        return [dict(zip(shown, row, strict=True)) for row in found]

    def exist(self, stmts: Sequence[str], models: Models = None) -> bool:
        """Return whether all statements or patterns match together, in each of the models."""
        with _errors():
            patterns = _listed(stmts)
            return all(
                self._client.has(patterns, model=m, tbox=False) for m in self._models(models)
            )

    def __getitem__(self, given: Any) -> Any:
        args = [given] if isinstance(given, str) else list(given)
        models = args.pop() if len(args) > 1 and isinstance(args[-1], (list, tuple)) else None
        if len(args) == 1 and isinstance(args[0], (list, tuple)):
            args = list(args[0])
        if len(args) == 1 and not _is_statement(args[0]):
            return [concept for concept, _ in self.lookup(args[0], models)]
        return self.find(args, models=models)

    def __contains__(self, pattern: str) -> bool:
        if _is_statement(pattern):
            return self.exist([pattern])
        return bool(self.lookup(pattern))

    def about(self, term: str, models: Models = None) -> list[list[Any]]:
        """Return the statements with a term as subject, property or object, or in a label."""
        with _errors(), self._client.view() as view:
            found: dict[tuple[Any, ...], None] = {}
            for model in self._models(models):
                for place, each in self._senses(term):
                    found |= dict.fromkeys(self._triples(view, model, _at(place, each)))
                found |= dict.fromkeys(self._labelled(view, term, model))
        return [[self._name(part) for part in triple] for triple in found]

    def lookup(self, query: str, models: Models = None) -> list[list[str]]:
        """Return terms by name or label with their types; partial matches of labels are last."""
        found: dict[str, None] = {}
        partly: dict[str, None] = {}
        with _errors(), self._client.view() as view:
            patterns = [_at(place, each) for place, each in self._senses(query)]
            if any(True for each in patterns for _ in self._triples(view, models, each)):
                found[query] = None
            for subject, _, label in self._labelled(view, query, models):
                (found if str(label) == query else partly)[str(self._name(subject))] = None
            return [[name, self._type(view, name, models)] for name in {**found, **partly}]

    def label(self, term: str, lang: str | None = None, models: Models = None) -> str:
        """Return the label of a term in a language, else the default one, else the term."""
        labels = self.labels(term, models)
        return labels.get(lang or "default", labels["default"])

    def labels(self, term: str, models: Models = None) -> dict[str, str]:
        """Return the labels of a term by language; "default" is one without, in English, or it."""
        labels: dict[str, str] = {}
        with _errors(), self._client.view() as view:
            resource = self._client.resource(view, term)
            for triple in self._triples(view, models, (resource, rdflib.RDFS.label, None)):
                labels[getattr(triple[2], "language", None) or "default"] = str(triple[2])
        return {"default": labels.get("en", term)} | labels

    def details(self, term: str, models: Models = None) -> dict[str, Any]:
        """Return name, labels, id, type, equivalents, and the classes or relatives of a term."""
        with _errors(), self._client.view() as view:
            kind = self._type(view, term, models)
            resource = self._client.resource(view, term)

            def values(*verbs: Any, inverse: bool = False) -> list[str]:
                found = (
                    self._name(triple[0 if inverse else 2])
                    for verb in verbs
                    for triple in self._triples(
                        view, models, (None, verb, resource) if inverse else (resource, verb, None)
                    )
                )
                return sorted(set(map(str, found)))

            is_a, sub = rdflib.RDF.type, rdflib.RDFS.subClassOf
            direct = rdflib.URIRef(f"{SEMMAP}directType")
            attributes: list[tuple[str, str, Any]] = []
            if kind == "class":
                instances = values(direct, inverse=True) or values(is_a, inverse=True)
                attributes = [
                    ("Parents", "superClasses", values(sub)),
                    ("Children", "subClasses", values(sub, inverse=True)),
                    ("Instances", "instances", instances),
                ]
            elif kind == "instance":
                attributes = [("Classes", "classes", values(direct) or values(is_a))]
            same = values(rdflib.OWL.sameAs, rdflib.OWL.equivalentClass)
        labels = self.labels(term, models)
        return {
            "name": labels["default"],
            "label": labels,
            "id": term,
            "type": kind,
            "sameAs": same,
            "attributes": [{"name": n, "id": i, "values": v} for n, i, v in attributes],
        }

    def classesof(self, term: str, direct: bool = False, models: Models = None) -> list[str]:
        """Return the classes of a term; only those that are stated if `direct`."""
        found: dict[str, None] = {}
        with _errors():
            for verb in ("semmap:directType", "rdf:type") if direct else ("rdf:type",):
                for model in self._models(models):
                    rows = self._client.rows([f"{term} {verb} ?class"], ["?class"], model=model)
                    found |= dict.fromkeys(str(name) for (name,) in rows)
                if found:
                    break
        return list(found)

    def sparql(self, query: str, models: Models = None) -> dict[str, Any]:
        """Return the answer of a query on one model as SPARQL's JSON."""
        with _errors():
            names = self._models(models)
            if len(names) != 1:
                raise KbError("a query reads one model: others are read by GRAPH :model { ... }")
            found = self._client.sparql(query, model=names[0])
            answer: dict[str, Any] = json.loads(sparql_json(found))
        return {**answer, "query": query}

    def subscribe(
        self,
        patterns: str | Sequence[str],
        callback: Callable[[list[dict[str, Any]]], Any] | None = None,
        one_shot: bool = False,
        models: Models = None,
        gone: Callable[[list[dict[str, Any]]], Any] | None = None,
    ) -> str:
        """Return the number of a subscription to what all patterns match in the models.

        A callback gets each match, `gone` those that are true no more, which KnowledgeCore lacks.
        """
        listed = _listed(patterns)
        with _errors():
            names = self._models(models)
            key = json.dumps([sorted(listed), one_shot, [name or "" for name in names]])
            number = f"evt_{md5(key.encode(), usedforsecurity=False).hexdigest()}"
            if (number, callback) in self._subscribed:
                return number
            numbers: list[int] = []
            self._subscribed[number, callback] = numbers

            def report(event: Event) -> None:
                if self._subscribed.get((number, callback)) is not numbers:
                    return  # it has ended
                if one_shot:
                    self._end(self._subscribed.pop((number, callback), ()))
                bindings = [dict(event.bindings)]
                if event.what == "disappeared":
                    if gone is not None:
                        gone(bindings)
                elif callback is not None:
                    callback(bindings)
                else:
                    self.events.put((number, bindings))

            try:
                for name in names:
                    each = self._client.subscribe(listed, report, one_shot=one_shot, model=name)
                    numbers.append(each)
            except Exception:
                del self._subscribed[number, callback]
                self._end(numbers)
                raise
            if self._subscribed.get((number, callback)) is not numbers:
                self._end(numbers)  # it was reported before the last model was followed
        return number

    def _models(self, models: Models) -> list[str | None]:
        """Return the names of models; None for the map itself."""
        given = [models] if isinstance(models, str) else list(models or [])
        if "all" in given:
            return [None, *self._client.models()]
        names = [None if name in ("", "default") else name for name in given]
        return list(dict.fromkeys(names)) or [None]

    def _name(self, term: Any) -> Any:
        return name_of(term, self._client.map_name)

    def _senses(self, name: str) -> Iterator[tuple[int, Term]]:
        """Yield places in a triple with what a name stands for there."""
        try:
            (as_subject,) = self._client.parsed(f"{name} rdf:type *")
            (as_class,) = self._client.parsed(f"* rdf:type {name}")
            (as_verb,) = self._client.parsed(f"* {name} *")
        except ValueError:
            return  # a text with spaces: only labels have it
        for place, term in (
            (0, as_subject.subject),
            (0, as_class.object),
            (1, as_verb.verb),
            (2, as_subject.subject),
            (2, as_class.object),
        ):
            if isinstance(term, rdflib.URIRef):
                yield place, term

    def _triples(
        self, view: MapView, models: Models, pattern: tuple[Any, Any, Any]
    ) -> Iterator[tuple[Any, Any, Any]]:
        for model in self._models(models):
            yield from view.triples(pattern, self._client.graph_of(model))

    def _labelled(self, view: MapView, text: str, models: Models) -> Iterator[tuple[Any, Any, Any]]:
        """Yield the labels that have a text, as whole words."""
        words = re.compile(rf"(?<!\w){re.escape(text)}(?!\w)")
        triples = self._triples(view, models, (None, rdflib.RDFS.label, None))
        return (triple for triple in triples if words.search(str(triple[2])))

    def _type(self, view: MapView, name: str, models: Models) -> str:
        verbs = {"rdf:type": "object_property", "rdfs:label": "datatype_property"}
        if name in verbs:
            return verbs[name]
        senses = list(dict.fromkeys(self._senses(name)))
        is_a, sub = rdflib.RDF.type, rdflib.RDFS.subClassOf
        classes = {
            triple[2]
            for place, term in senses
            if place == 0
            for triple in self._triples(view, models, (term, is_a, None))
        }
        for kind, class_ in (
            ("object_property", rdflib.OWL.ObjectProperty),
            ("datatype_property", rdflib.OWL.DatatypeProperty),
            ("class", rdflib.OWL.Class),
        ):
            if class_ in classes:
                return kind
        if classes:
            return "instance"
        for model, (place, term) in product(self._models(models), senses):
            if place == 1:
                for triple in self._triples(view, model, (None, term, None)):
                    literal = isinstance(triple[2], rdflib.Literal)
                    return "datatype_property" if literal else "object_property"
            if place == 2:
                patterns = ((None, is_a, term), (None, sub, term), (term, sub, None))
                if any(True for each in patterns for _ in self._triples(view, model, each)):
                    return "class"
        return "undecided"


def _at(place: int, term: Term) -> tuple[Any, Any, Any]:
    """Return the pattern of triples that have a term at a place."""
    subject, verb, node = (term if i == place else None for i in range(3))
    return subject, verb, node


def _listed(given: Any) -> list[str]:
    return [given] if isinstance(given, str) else [str(each) for each in given]


def _is_name(word: str) -> bool:
    return word.startswith("?") and len(word.split()) == 1


def _is_statement(text: str) -> bool:
    try:
        return len(shlex.split(text)) == 3
    except ValueError:  # a quotation mark without another one
        return len(text.split(None, 2)) == 3


def _with_stars(patterns: Sequence[str]) -> tuple[list[str], set[str]]:
    """Return patterns with a variable for each ``*``, and these variables."""
    numbers, starred, found = count(), set(), []
    for pattern in patterns:
        words = pattern.split(None, 2)
        for place, word in enumerate(words):
            if word == "*":
                words[place] = f"?__{next(numbers)}"
                starred.add(words[place])
        found.append(" ".join(words))
    return found, starred


@contextmanager
def _errors() -> Iterator[None]:
    """Report what is refused as KnowledgeCore does."""
    try:
        yield
    except (ValueError, LookupError, WorldError) as error:
        raise KbError(str(error)) from error
    except psycopg.Error as error:
        raise KbError(refusal_text(error)) from error
    except DBAPIError as error:
        raise KbError(str(error.orig)) from error
