"""Sentences of a map's grammar: questions, commands and statements, and their answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

from semmap.api.checked import EntityName
from semmap.api.map_beliefs import MapBeliefs
from semmap.api.map_observations import MapObservations
from semmap.api.map_tasks import MapTasks

if TYPE_CHECKING:
    from semmap.api.map_results import MapRoute


@dataclass(frozen=True)
class SentenceAnswer:
    """The answer to a sentence.

    Attributes
    ----------
    sentence : with the names as the map writes them
    text : the answer in words
    result : of "where is", the `BelievedPlaces`; of "which", the probabilities by name; of "find",
        the `ObjectSearch`; of "bring", the `MapPlan`; of "go to", the `MapRoute`; of an action, the
        list of `KnownAction` that ends with it; whether something "is a" type, a bool; that
        something is in or on a place, its probability
    """

    sentence: str
    text: str
    result: Any = field(repr=False)

    def as_json(self) -> dict[str, Any]:
        """The answer as plain values."""
        found = self.result
        if hasattr(found, "as_json"):
            found = found.as_json()
        elif isinstance(found, list):
            found = [{"action": a.name, "cause": a.cause, "effect": a.effect} for a in found]
        return {"sentence": self.sentence, "text": self.text, "result": found}


class MapSentences(MapTasks, MapBeliefs, MapObservations):
    """The part of `Map` that answers sentences of its grammar."""

    def ask(
        self, sentence: str, *, start: EntityName | None = None, robot: str | None = None
    ) -> SentenceAnswer:
        """Answer a sentence of the grammar: a question, a command or a statement. Nothing changes.

        Parameters
        ----------
        sentence : one that `grammar` generates, such as "where is the mug"
        start, robot : as for `plan`, of sentences that find, bring or go

        Raises
        ------
        LookupError, ValueError
            The grammar has no such sentence (the message has the nearest one), or the method that
            answers it raises this.
        """
        from semmap.belief.grammar import SENTENCES
        from semmap.belief.sentences import understand
        from semmap.belief.store.teaching import vocabulary

        with self.snapshot() as seen:
            said = understand(sentence, vocabulary(seen))
        options = {"start": start, "robot": robot}
        answer = dict(zip(SENTENCES, ANSWERS, strict=True))[said.form]
        text, result = answer(self, said.names, options)
        return SentenceAnswer(str(said), text, result)


Names = tuple[str, ...]
Options = Mapping[str, Any]
Answered = tuple[str, Any]


def _where(house: MapSentences, names: Names, options: Options) -> Answered:
    found = house.where(names[0])
    return f"{names[0]}: {_most(found)}", found


_NEXT_HOUR = """
SELECT (d.at + CASE WHEN d.at > n.now THEN interval '0' ELSE interval '1 day' END)
       AT TIME ZONE m.time_zone
FROM belief_model_of(current_map()) m, LATERAL (SELECT now() AT TIME ZONE m.time_zone) n (now),
     LATERAL (SELECT date_trunc('day', n.now) + make_interval(hours => %s)) d (at)
"""


def _where_at(house: MapSentences, names: Names, options: Options) -> Answered:
    """At the next such hour, by the clock of the building."""
    from semmap.belief.grammar import HOURS

    ((at,),) = house.execute(_NEXT_HOUR, HOURS.index(names[1]))
    found = house.where(names[0], at)
    return f"{names[0]}: {_most(found)}", found


def _which(house: MapSentences, names: Names, options: Options) -> Answered:
    """At this time yesterday."""
    kind, place = names
    found = house.which(kind, place, datetime.now(UTC) - timedelta(days=1))
    return _most(found), found


def _most(found: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {share:.2f}" for name, share in [*found.items()][:3])


def _find(house: MapSentences, names: Names, options: Options) -> Answered:
    found = house.search(names[0], **options)
    return found.reason, found


def _bring(house: MapSentences, names: Names, options: Options) -> Answered:
    item, place = names
    relation = "on" if house[place].kind == "object" else "in"  # an item may be a type, too
    found = house.plan(f'{relation}("{item}", "{place}")', **options)
    actions = "; ".join(map(str, found.actions)) or "nothing to do"
    return f"{actions}: {found.seconds:.1f} s ({found.proof})", found


def _go(house: MapSentences, names: Names, options: Options) -> Answered:
    found = _route(house, names[0], **options)
    return f"{', '.join(found.places)}: {found.seconds:.1f} s, {found.metres:.1f} m", found


def _route(house: MapSentences, goal: str, start: str | None, robot: str | None) -> MapRoute:
    """The route from where plans begin."""
    from planner.tasks.reader import read_state

    live = house.live_topology(robot)
    with live.snapshot() as seen:
        state = read_state(seen, live.topology, start)
    here = state.place if state.pose is None else (state.pose.x, state.pose.y, state.pose.z)
    return house.route(here, goal, robot=robot)


def _is_placed(house: MapSentences, names: Names, options: Options) -> Answered:
    """How probable all places are that the place is or holds."""
    item, place = names
    found = house.where(item)
    held = house.execute(
        "SELECT name FROM entity WHERE map_id = current_map() AND name = ANY (%s) "
        "AND (name = %s OR is_held_by(id, entity_id(%s)))",
        [*found],
        place,
        place,
    )
    share = sum(found[name] for (name,) in held)
    return f"{share:.2f}", share


def _is_a(house: MapSentences, names: Names, options: Options) -> Answered:
    return _yes(house[names[0]].is_a(names[1]))


def _subsumed(house: MapSentences, names: Names, options: Options) -> Answered:
    known = "SELECT EXISTS (SELECT FROM type_closure WHERE sub = %s AND super = %s)"
    return _yes(house.execute(known, *names)[0][0])


def _yes(found: bool) -> Answered:
    return "yes" if found else "no", found


def _action(house: MapSentences, names: Names, options: Options) -> Answered:
    """The shortest chain that ends with the action: those before it bring about its cause."""
    from semmap.belief.error import BeliefError
    from semmap.belief.teaching import KnownAction

    rows = house.execute(
        "SELECT cause, effect FROM taught_action "
        "WHERE map_id = current_map() AND action = %s ORDER BY 1, 2",
        names[0],
    )
    chains = []
    for cause, effect in rows:
        try:
            before = house.how_to(cause)
        except BeliefError:
            before = []
        chains.append([*before, KnownAction(names[0], cause, effect)])
    found = min(chains, key=len)
    return ", ".join(action.name for action in found), found


ANSWERS: tuple[Callable[[MapSentences, Names, Options], Answered], ...] = (
    _where,
    _find,
    _bring,
    _go,
    _is_placed,
    _is_a,
    _subsumed,
    _action,
    _where,
    _find,
    _bring,
    _where_at,
    _where_at,
    _which,
)
"""What answers each of `semmap.belief.grammar.SENTENCES`: the text and the result."""
