"""Teachings into the map, all or nothing; contradictions to the map are refused with the reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import psycopg
from psycopg import errors, sql
from psycopg.types.json import Jsonb

from semmap.belief.error import BeliefError
from semmap.belief.grammar import HOURS, spoken
from semmap.belief.sentences import understand
from semmap.belief.store.beliefs import add_observations, refusal
from semmap.belief.store.taught_facts import noted, restate
from semmap.belief.teaching import (
    KnownAction,
    KnownRelation,
    TaughtObject,
    Teaching,
    action_chain,
    is_a,
)
from semmap.ingest.ontology.tbox import KINDS
from semmap.query.refusal import denied
from semmap.query.snapshot import Snapshot
from semmap.snake_case import snake_case
from semmap.suggestions import misspelt, suggestion

Row = dict[str, Any]

PLACED = ("in", "on", "is_in", "is_on")
"""Relations that say where an object is: they are sightings."""

PLACES = """
SELECT e.name FROM entity e LEFT JOIN world w ON w.entity_id = e.id
WHERE e.map_id = current_map() AND (
    e.kind IN ('room', 'storey', 'region')
    OR e.kind = 'object' AND ST_Area(w.footprint) >= 0.02 AND e.type IN (
        SELECT sub FROM type_closure
        WHERE super IN ('furniture', 'fixture', 'appliance', 'container'))
    OR e.id IN (SELECT place_id FROM belief))
ORDER BY 1
"""
"""Rooms, and what `places_for` offers to objects; also before there is a belief about one."""

FOUND_IN = "found_in"
"""The relation of a thing or a class to where it is usually found: a part of the prior."""

FIT = 1.05
"""How much larger than its geometry an object may be taught to be."""


def teach(session: psycopg.Connection[Any], teaching: Teaching, name: str) -> dict[str, int]:
    """Store a teaching, in one transaction; return how many of each part were stored.

    `name` is that of the teaching in `taught_facts.list_teachings`.

    Classes become types of the T-Box, ``isA`` their subsumption or the type of an entity; an object
    that the map does not have becomes an entity without a placement; occurrences become
    observations. A relation ``in`` or ``on`` of two entities is an occurrence at this moment.
    Relations of two entities are links. `BeliefError` or LookupError for a name that neither the
    map nor the teaching has, or a statement that contradicts the map.
    """
    try:
        with session.transaction(), noted(session, name):
            return _Lesson(session).store(_with_relations(session, teaching))
    except errors.CheckViolation as error:
        raise refusal(error) from error
    except errors.DataError as error:
        reason = error.diag.message_primary or str(error)
        raise BeliefError(f"a value cannot be stored: {reason}") from error
    except errors.InsufficientPrivilege as error:
        raise BeliefError(
            f"this login may not teach that ({error.diag.message_primary or error}): robots teach "
            "objects, relations, actions and occurrences; classes are taught by an admin"
        ) from error


def how_to(seen: Snapshot, goal: str, given: Sequence[str] = ()) -> list[KnownAction]:
    """Return the shortest chain of taught actions that brings about a goal; as `action_chain`."""
    session = seen.session
    actions = session.execute(
        "SELECT action, cause, effect FROM taught_action WHERE map_id = current_map() ORDER BY 1, 2"
    ).fetchall()
    lesson = _Lesson(session)
    return action_chain(
        [KnownAction(*row) for row in actions], lesson.resolved(goal), lesson.subsumes, given
    )


def vocabulary(seen: Snapshot) -> dict[str, list[str]]:
    """Return the names of `semmap.belief.grammar.write_grammar`."""
    return _vocabulary(seen.session)


def _vocabulary(session: psycopg.Connection[Any]) -> dict[str, list[str]]:
    queries = {
        "things": "SELECT name FROM entity WHERE map_id = current_map() "
        "AND kind IN ('object', 'agent') ORDER BY 1",
        "places": PLACES,
        "types": "SELECT name FROM semantic_type ORDER BY 1",
        "actions": "SELECT DISTINCT action FROM taught_action WHERE map_id = current_map() "
        "ORDER BY 1",
        "groups": "SELECT DISTINCT s.super FROM entity e JOIN type_closure s ON s.sub = e.type "
        "WHERE e.map_id = current_map() AND e.kind = 'object' "
        "AND e.type <> ALL (subtypes('building_element')) "
        "AND s.super NOT IN ('object', 'entity') ORDER BY 1",
        "kinds": "SELECT DISTINCT s.super FROM entity e JOIN type_closure s ON s.sub = e.type "
        "WHERE e.map_id = current_map() AND e.kind IN ('object', 'agent') "
        "AND s.super NOT IN ('object', 'entity', 'agent') ORDER BY 1",
    }
    names = {
        key: [row[0] for row in session.execute(query).fetchall()] for key, query in queries.items()
    }
    things = set(map(spoken, names["things"]))  # a name stands for its thing, not for a type
    names["kinds"] = [kind for kind in names["kinds"] if spoken(kind) not in things]
    return names | {"hours": [*HOURS]}


def _with_relations(session: psycopg.Connection[Any], teaching: Teaching) -> Teaching:
    """The teaching with the relations that its sentences state."""
    if not teaching.sentences:
        return teaching
    names = _vocabulary(session)
    stated = tuple(understand(text, names).stated for text in teaching.sentences)
    return replace(teaching, relations=teaching.relations + stated)


class _Lesson:
    """The names of a map while a teaching is stored: kinds and types of entities, types `known`."""

    def __init__(self, session: psycopg.Connection[Any]) -> None:
        self.session = session
        ((self.map,),) = session.execute("SELECT current_map()").fetchall()
        rows = session.execute(
            "SELECT name, id, kind, type FROM entity WHERE map_id = current_map()"
        ).fetchall()
        self.ids: dict[str, int] = {name: id for name, id, _, _ in rows}
        self.kinds: dict[str, str] = {name: kind for name, _, kind, _ in rows}
        self.types: dict[str, str | None] = {name: type_ for name, _, _, type_ in rows}
        self._read_types()

    def _read_types(self) -> None:
        rows = self.session.execute("SELECT sub, super FROM type_closure").fetchall()
        self.closure: set[tuple[str, str]] = set(rows)
        self.known = {sub for sub, _ in self.closure}

    def resolved(self, name: str) -> str:
        """The name of an entity or of a type, as the map writes it."""
        if name in self.kinds:
            return name
        if snake_case(name) in self.known:
            return snake_case(name)
        hint = suggestion(name, [*self.kinds, *self.known], "teach it as knowledge first")
        raise LookupError(f"neither the map nor the teaching has {name}{hint}")

    def subsumes(self, name: str, other: str) -> bool:
        """Whether an entity or type is another one, or a kind of it."""
        own = self.types.get(name) if name in self.kinds else name
        return name == other or (own, other) in self.closure

    def store(self, teaching: Teaching) -> dict[str, int]:
        """Store the parts, those first on which others stand."""
        counts = {"types": self._add_types(teaching)}
        self._describe(teaching)
        for taught in teaching.objects:
            self._add_object(taught)
        sightings: list[dict[str, Any]] = []
        self._subsume([r for r in teaching.relations if is_a(r.relation)])
        for taught in teaching.objects:
            if taught.type is not None:
                self._set_type(taught.name, self._type(taught.type, taught.name))
        for relation in teaching.relations:
            if not is_a(relation.relation):
                sightings += self._relate(relation)
        counts["relations"] = len(teaching.relations)
        counts["actions"] = len(teaching.actions)
        self._add_actions(teaching.actions)
        counts["objects"] = len(teaching.objects)
        if teaching.model:
            self._judge(teaching.model)
        for taught in teaching.objects:
            sightings += [self._sighting(taught.name, row) for row in taught.occurrences]
        sightings += [self._sighting(row.get("object"), row) for row in teaching.observations]
        self.session.execute("SELECT refresh_beliefs()")
        self.session.execute(
            "SELECT refresh_belief(ARRAY(SELECT id FROM entity "
            "WHERE map_id = current_map() AND name = ANY (%s)))",
            ([taught.name for taught in teaching.objects],),
        )
        counts["observations"] = len(add_observations(self.session, sightings))
        return counts

    def _add_types(self, teaching: Teaching) -> int:
        """Concepts that are taught, and classes that relations or objects name."""
        names = [concept.name for concept in teaching.knowledge]
        for relation in teaching.relations:
            if is_a(relation.relation):
                names += [relation.subject, relation.object]
        self._refuse_misspelt(teaching, names)
        names += [taught.type for taught in teaching.objects if taught.type]
        others = self.kinds.keys() | {taught.name for taught in teaching.objects}
        new = {snake_case(name): name for name in names if name not in others}
        if "" in new:
            raise BeliefError(f"{new['']} is not a name: give letters or digits")
        for name in new.keys() & self.known:
            restate(self.session, "semantic_type", {"name": name})
        new = {name: label for name, label in new.items() if name not in self.known}
        if new:
            self.session.execute(
                "INSERT INTO semantic_type (name, label) "
                "SELECT * FROM unnest(%s::text[], %s::text[])",
                (list(new), list(new.values())),
            )
            self._read_types()
        return len(new)

    def _refuse_misspelt(self, teaching: Teaching, taught: Sequence[str]) -> None:
        """LookupError for a class of an object that is none, and like one that is."""
        others = {snake_case(name) for name in taught} | self.known
        for each in teaching.objects:
            if each.type and each.type not in self.kinds and snake_case(each.type) not in others:
                meant = misspelt(snake_case(each.type), others)
                if meant is not None:
                    raise LookupError(
                        f"{each.name}: there is no class {each.type}; did you mean {meant}? Teach "
                        "it as knowledge, too, if it is a new one"
                    )

    def _describe(self, teaching: Teaching) -> None:
        for concept in teaching.knowledge:
            if not concept.properties:
                continue
            name = self.resolved(concept.name)
            if name in self.kinds:
                self._set_properties("entity", {"id": self.ids[name]}, concept.properties)
            else:
                self._set_properties("semantic_type", {"name": name}, concept.properties)

    def _set_properties(self, table: str, key: Row, properties: Row) -> None:
        ((column, value),) = key.items()
        for name in properties:
            restate(self.session, table, key, f"properties.{name}")
        statement = sql.SQL("UPDATE {} SET properties = properties || %s WHERE {} = %s").format(
            sql.Identifier(table), sql.Identifier(column)
        )
        if not self.session.execute(statement, (Jsonb(properties), value)).rowcount:
            raise denied()

    def _add_object(self, taught: TaughtObject) -> None:
        kind = self.kinds.get(taught.name)
        if kind is None:
            row = self.session.execute(
                "INSERT INTO entity (map_id, kind, name) VALUES (current_map(), 'object', %s) "
                "RETURNING id",
                (taught.name,),
            ).fetchone()
            assert row is not None
            self.kinds[taught.name], self.types[taught.name] = "object", None
            self.ids[taught.name] = row[0]
        elif kind not in ("object", "agent"):
            raise BeliefError(f"{taught.name} is a {kind} of the map: teach objects and agents")
        else:
            restate(self.session, "entity", {"id": self.ids[taught.name]})
        if taught.properties:
            self._check_size(taught)
            self._set_properties("entity", {"id": self.ids[taught.name]}, taught.properties)

    def _check_size(self, taught: TaughtObject) -> None:
        row = self.session.execute(
            "SELECT s.sides[1] * s.sides[2], s.sides[1] * s.sides[2] * s.height FROM entity e "
            "JOIN world w ON w.entity_id = e.id AND w.footprint IS NOT NULL, "
            "LATERAL size_of(e.id) s WHERE e.map_id = current_map() AND e.name = %s",
            (taught.name,),
        ).fetchone()
        for key, most, unit in zip(("base_area", "volume"), row or (), ("m2", "m3"), strict=False):
            given = float(taught.properties.get(key, 0))
            if given > most * FIT:
                raise BeliefError(
                    f"{taught.name}: {key} is {given:g} {unit}, but its geometry in the map has at "
                    f"most {most:.3g} {unit}: correct one of them"
                )

    def _subsume(self, relations: Sequence[KnownRelation]) -> None:
        """Subsumption of types, then the types of entities."""
        pairs = []
        for relation in relations:
            above = self._type(relation.object, relation)
            if self._is_of_entity(relation):
                continue
            sub = snake_case(relation.subject)
            if (above, sub) in self.closure and above != sub:
                raise BeliefError(
                    f"{relation}: contradicts the map, where {above} is a kind of {sub}"
                )
            if (sub, above) not in self.closure:
                pairs.append((sub, above))
            restate(self.session, "type_parent", {"type": sub, "parent": above})
        if pairs:
            self.session.execute(
                "INSERT INTO type_parent (type, parent) SELECT * FROM "
                "unnest(%s::text[], %s::text[]) ON CONFLICT DO NOTHING",
                ([sub for sub, _ in pairs], [above for _, above in pairs]),
            )
            self._read_types()
            self._check_kinds({sub for sub, _ in pairs})
        for relation in relations:
            if self._is_of_entity(relation):
                self._set_type(relation.subject, snake_case(relation.object))

    def _is_of_entity(self, relation: KnownRelation) -> bool:
        """Whether the subject is an entity, and not a class; LookupError if it is neither."""
        return not relation.of_classes and self.resolved(relation.subject) in self.kinds

    def _check_kinds(self, names: set[str]) -> None:
        """A type is for entities of one kind, as are its subtypes and the entities of it."""
        below = {sub for sub, above in self.closure if above in names}
        for name in sorted(below):
            kinds = sorted(above for sub, above in self.closure if sub == name and above in KINDS)
            if len(kinds) > 1:
                raise BeliefError(
                    f"{name} would be {' and '.join(kinds)}: an entity is of one kind"
                )
        wrong = self.session.execute(
            "SELECT name, kind, type FROM entity "
            "WHERE type = ANY (%s) AND NOT fits_kind(type, kind)",
            (sorted(below),),
        ).fetchone()
        if wrong:
            raise BeliefError(
                "{} is an entity of the kind {}, which {} would not be".format(*wrong)
            )

    def _type(self, name: str, where: object) -> str:
        if name in self.kinds and snake_case(name) not in self.known:
            raise BeliefError(f"{where}: {name} is an entity of the map, not a class")
        if snake_case(name) not in self.known:
            hint = suggestion(name, self.known, "teach it as knowledge first")
            raise LookupError(f"{where}: there is no class {name}{hint}")
        return snake_case(name)

    def _set_type(self, name: str, wanted: str) -> None:
        """Refine the type of an entity; a type that was guessed from its name gives way."""
        now, kind = self.types[name], self.kinds[name]
        if now == wanted or (now, wanted) in self.closure:
            restate(self.session, "entity", {"id": self.ids[name]}, "type")
            return
        if now is not None and now != kind and (wanted, now) not in self.closure:
            guessed = self.session.execute(
                "SELECT properties -> 'type_guess' ->> 'type' = type FROM entity "
                "WHERE map_id = current_map() AND name = %s",
                (name,),
            ).fetchone()
            if not (guessed and guessed[0]):
                raise BeliefError(
                    f"{name} isA {wanted}: contradicts the map, where it is a {now}, which is not "
                    f"a kind of {wanted}. Teach {now} isA {wanted}, or correct its type"
                )
        fits = self.session.execute("SELECT fits_kind(%s, %s)", (wanted, kind)).fetchone()
        if not (fits and fits[0]):
            raise BeliefError(
                f"{name} isA {wanted}: contradicts the map, where {name} is of the kind {kind}"
            )
        changed = self.session.execute(
            "UPDATE entity SET type = %s WHERE id = %s", (wanted, self.ids[name])
        )
        if not changed.rowcount:
            raise denied()
        self.types[name] = wanted

    def _relate(self, relation: KnownRelation) -> list[dict[str, Any]]:
        """Store a relation; return the sighting that it is, if it says where something is."""
        subject, other = self.resolved(relation.subject), self.resolved(relation.object)
        both = subject in self.kinds and other in self.kinds
        name = snake_case(relation.relation)
        if both and name in PLACED:
            return [self._sighting(subject, {"place": other, "seen": True})]
        if both and name != FOUND_IN:
            ends = {"from_id": self.ids[subject], "to_id": self.ids[other]}
            self._add("link", ends | {"relation": relation.relation})
        else:
            name = FOUND_IN if name == FOUND_IN else relation.relation
            row = {"map_id": self.map, "subject": subject, "relation": name, "object": other}
            self._add("taught_relation", row)
        return []

    def _add(self, table: str, key: Row) -> None:
        """Insert a row that is its key, unless it is there."""
        restate(self.session, table, key)
        self.session.execute(
            sql.SQL("INSERT INTO {} ({}) VALUES ({}) ON CONFLICT DO NOTHING").format(
                sql.Identifier(table),
                sql.SQL(", ").join(map(sql.Identifier, key)),
                sql.SQL(", ").join([sql.Placeholder()] * len(key)),
            ),
            [*key.values()],
        )

    def _add_actions(self, actions: Sequence[KnownAction]) -> None:
        for action in actions:
            states = {"cause": action.cause, "effect": action.effect}
            for role, state in states.items():
                try:
                    states[role] = self.resolved(state)
                except LookupError:
                    hint = suggestion(state, [*self.kinds, *self.known])
                    raise LookupError(
                        f"action {action.name}: neither the map nor the teaching has {state}, its "
                        f'{role}: teach it as knowledge, {{"name": "{state}"}}{hint}'
                    ) from None
            self._add("taught_action", {"map_id": self.map, "action": action.name} | states)

    def _judge(self, model: dict[str, float]) -> None:
        self._add("belief_model", {"map_id": self.map})
        for name in model:
            restate(self.session, "belief_model", {"map_id": self.map}, name)
        changes = [sql.SQL("{} = {}").format(sql.Identifier(k), sql.Placeholder(k)) for k in model]
        self.session.execute(
            sql.SQL("UPDATE belief_model SET {} WHERE map_id = current_map()").format(
                sql.SQL(", ").join(changes)
            ),
            model,
        )

    def _sighting(self, name: Any, row: dict[str, Any]) -> dict[str, Any]:
        """An observation; in a room or storey, a person means anywhere in it."""
        wide = self.kinds.get(str(row.get("place"))) in ("room", "storey", "region")
        return {"inside": wide and row.get("position") is None} | row | {"object": name}
