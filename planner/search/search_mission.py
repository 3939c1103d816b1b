"""Plans the steps of a mission that searches for objects, and says why (O'Neill, section 4.4.2).

A mission's runner plans again after each look, on what the map has learnt from it. So the plan of a
search is its next look alone, and a mission continues where it was after its process has ended.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from planner.live_topology import LiveTopology
from planner.mission.store.observations import read_missing, read_robot
from planner.plan import Action, Plan
from planner.route_search import find_route
from planner.routing_graph import Endpoint, RoutingGraph
from planner.search.opened_furniture import OPENING
from planner.search.problem_builder import Detector, MapSearch, build_search
from planner.search.reader import (
    Circumstances,
    read_believed_object,
    read_circumstances,
    read_looks,
    read_opened,
    read_sight,
)
from planner.search.receding_horizon import Decision, decide
from planner.search.search_problem import ELSEWHERE, NOT_SEEN
from planner.search.viewpoints import Sight
from semmap.arrays import Floats
from semmap.error import Error
from semmap.query.snapshot import Snapshot

MOST_NAMES = 4  # places that an explanation or a command names

LEAST_CHANCE = 0.02
"""Chance to see the object below which a look is not worth it, whatever an answer costs."""

TRIES = 2  # how often a viewpoint may fail until the search does without it


class NotFoundError(Error, ValueError):
    """An object was not found; the message says where the robot looked, and why it ended."""


@dataclass(frozen=True)
class SearchResult:
    """The end of a search: the object is found at a place, or it is not found.

    It is found where the belief is `sure` or more. If the goal needs the object itself, such as
    ``on(mug, desk1)``, it must also have been seen there in this search, unless the map has it
    there. Else `place` is only the most probable one.
    """

    found: bool
    place: str
    probability: float
    sure: float  # from which on a place is taken for that of the object
    seen: bool  # there, during this search
    looks: int  # how many
    looked_at: tuple[str, ...]  # the places that they showed, in their order
    covered: float  # how much of the belief they showed since it began, or before, at least
    reason: str  # why the search ended, as a sentence


@dataclass(eq=False)
class _State:
    """What a planner knows of the search for one object."""

    search: MapSearch
    belief: Floats
    newest: int
    hidden: Floats  # (S,) how much of each spot no look has shown
    known: Circumstances
    looked_at: tuple[str, ...] = ()
    seen_in: frozenset[str] = frozenset()
    looks: int = 0
    seconds: float = 0.0  # of the steps planned so far
    planned: int | None = None
    at: int | None = None  # the viewpoint of the last look
    failures: int = 0
    failed: frozenset[int] = frozenset()  # viewpoints that the robot did not reach
    covered: float = 0.0  # how much of the belief looks showed before it began again


class SearchPlanner:
    """Plans searches for a class of robots on a map that changes; says why it goes where it goes.

    `answers` are those of the searches that ended, by object.
    """

    def __init__(
        self,
        live: LiveTopology,
        sight: Sight | None = None,
        detector: Detector | None = None,
        say: Callable[[str], object] | None = None,
    ) -> None:
        self.live = live
        self.sight = sight  # by default that of the robot's class
        self.assumed_camera: str | None = None
        self.detector = detector or Detector()
        self._say = say or (lambda text: None)
        self._states: dict[str, _State] = {}
        self.answers: dict[str, SearchResult] = {}
        self._ended_without: dict[str, frozenset[str]] = {}

    def camera(self, seen: Snapshot) -> Sight:
        """How the robot can hold its camera; `assumed_camera` says so if it is not known."""
        if self.sight is None:
            self.sight, self.assumed_camera = read_sight(seen, self.live.graph.robot.name)
        return self.sight

    def begin(
        self,
        seen: Snapshot,
        name: str,
        start: Endpoint,
        progress: Callable[[str, int, int], None] | None = None,
    ) -> MapSearch:
        """The search for an object from where the robot is.

        Raises LookupError if the map has no such entity, ValueError if the robot can see no place
        at which it may be.
        """
        known = read_believed_object(seen, name)
        return build_search(
            name,
            known.belief,
            known.places,
            known.occluders,
            self.live.graph,
            start,
            height=known.height,
            sight=self.camera(seen),
            detector=self.detector,
            shut=known.shut,
            progress=progress,
        )

    def not_found(self, without: frozenset[str]) -> set[str]:
        """The objects that were not found by plans without these connectors, or without fewer."""
        return {
            name
            for name, answer in self.answers.items()
            if not answer.found and self._ended_without[name] <= without
        }

    def next_steps(
        self,
        seen: Snapshot,
        robot: str,
        name: str,
        goal: str,
        *,
        without: frozenset[str] = frozenset(),
        accepted: str | None = ELSEWHERE,
    ) -> Plan:
        """The way to the next look and the look; no action if the search is over.

        At the place `accepted` the object need not be seen; by default it need not be seen at all.
        Raises NotFoundError: no place is sure enough, and no look is worth its time any more or the
        time is over.
        """
        graph = self.live.graph.without(without)
        where = read_robot(seen, robot)
        if where is None:
            raise LookupError(f"no room holds {robot}: give its start by start=")
        start = graph.endpoint(*where)
        state = self._state(seen, robot, name, start)
        done = read_opened(seen, robot)
        opened = frozenset(k for k, v in enumerate(state.search.viewpoints) if v.opens in done)
        at = state.search.nearest(*where, state.at)
        search = state.search
        if at is None or graph is not search.graph:
            search = search.from_here(start, graph, at)
        search = _without_failed(search, state)
        decision = decide(search.problem, state.belief, at, opened)
        place = _found_place(search, state, accepted)
        if decision.action == "declare" and place is None:
            decision = _with_last_look(decision)
        self.answers.pop(name, None)
        if decision.viewpoint is None or state.seconds >= self.detector.limit:
            self._ended_without[name] = without
            self._end(search, state, name, decision, place)
            return Plan(goal, (), 0.0, 0.0)
        self._say(explain(search, state.belief, decision, opened))
        state.failures = state.failures + 1 if state.planned == decision.viewpoint else 0
        state.planned = decision.viewpoint
        plan = _plan(goal, name, search, graph, start, decision, at, opened)
        state.seconds += plan.seconds
        return plan

    def _state(self, seen: Snapshot, robot: str, name: str, start: Endpoint) -> _State:
        """The belief after what the robot has seen since the last call."""
        state = self._states.get(name)
        if state is None:
            return self._begun(seen, robot, name, start)
        problem = state.search.problem
        rows, state.newest = read_looks(seen, name, robot, state.newest)
        where = next((row.place for row in rows if row.seen), None)
        planned = state.planned
        if rows:
            state.looks += 1
            state.planned = None
            state.seen_in |= {where} if where is not None else frozenset()
            state.looked_at = (*dict.fromkeys([*state.looked_at, *(row.place for row in rows)]),)
        if read_missing(seen.connection, {name, *problem.places} - {ELSEWHERE}):
            return self._begun(seen, robot, name, start)  # again, without a removed place
        before, state.known = state.known, read_circumstances(seen, name, robot)
        if before.differ(state.known, own_sighting=any(row.seen for row in rows)):
            return self._begun(seen, robot, name, start)  # others know more, or furniture moved
        at = None
        if start.pose is not None:
            at = state.at = state.search.nearest(start.place, start.pose, planned)
        if rows and at is not None:
            answer = NOT_SEEN if where not in problem.places else problem.places.index(where)
            state.hidden = state.hidden * (1 - problem.visible[at])
            try:
                state.belief = problem.after(state.belief, at, [answer])
            except ValueError:  # it is where no look from here should show it: begin again
                return self._begun(seen, robot, name, start)
        return state

    def _begun(self, seen: Snapshot, robot: str, name: str, start: Endpoint) -> _State:
        """A state of the present belief; its looks and its time go on from an earlier one.

        Its viewpoints are those of the whole graph, as what is left out may be free again.
        """
        search = self.begin(seen, name, self.live.graph.endpoint(start.place, start.pose))
        _, newest = read_looks(seen, name, robot, 0)
        known = read_circumstances(seen, name, robot)
        begun = _State(search, search.belief, newest, np.ones(len(search.share)), known)
        earlier = self._states.get(name)
        if earlier is not None:
            kept = ("looked_at", "seen_in", "looks", "seconds")
            begun = replace(begun, **{field: getattr(earlier, field) for field in kept})
            begun.covered = _covered(earlier)
            begun.failed = _again(earlier, search)
        self._states[name] = begun
        return begun

    def _end(
        self, search: MapSearch, state: _State, name: str, decision: Decision, place: str | None
    ) -> None:
        """Keep how the search ended; NotFoundError where the object has no place."""
        over = self.detector.limit if state.seconds >= self.detector.limit else None
        self.answers[name] = result = _result(search, state, decision, place, over)
        if not result.found:
            raise NotFoundError(result.reason)
        self._say(result.reason)


def _result(
    search: MapSearch, state: _State, decision: Decision, place: str | None, over: float | None
) -> SearchResult:
    """The end of a search that has found the object at a place, or has not; and why it ended.

    `over` is the limit, seconds, if the search ends because its time is over.
    """
    problem, belief = search.problem, state.belief
    chances = problem.by_place(belief)[0]
    best = int(chances.argmax()) if place is None else problem.places.index(place)
    likeliest, chance = problem.places[best], float(chances[best])
    covered = _covered(state)
    time = None if over is None else f"the time of the search is over ({over:.0f} s)"
    if place is not None:
        reason = _declared(search, belief, place, place in state.seen_in, time, decision)
    else:
        why = _why_no_look(search, decision) if time is None else time.capitalize()
        (declared,), _ = problem.declared(belief)
        if declared is not None:
            why = f"It is probably at {declared}, but was not seen there" + (
                f": {time}" if time is not None else _no_look_at(search, decision)
            )
        reason = (
            f"{problem.objects[0]} was not found in {_looked_at(state, covered)}; most probable "
            f"are {_likeliest(search, belief)}. {why}{_unseen(search, belief)}"
        )
    return SearchResult(
        place is not None,
        likeliest,
        chance,
        problem.sure,
        likeliest in state.seen_in,
        state.looks,
        state.looked_at,
        covered,
        reason,
    )


def _again(earlier: _State, search: MapSearch) -> frozenset[int]:
    """The viewpoints at which looks failed, in a search that has begun again."""
    viewpoints = earlier.search.viewpoints
    failed = {(viewpoints[k].pose, viewpoints[k].aim) for k in earlier.failed}
    return frozenset(k for k, v in enumerate(search.viewpoints) if (v.pose, v.aim) in failed)


def _covered(state: _State) -> float:
    return max(state.covered, float((state.search.belief[0] * (1 - state.hidden)).sum()))


def _found_place(search: MapSearch, state: _State, accepted: str | None) -> str | None:
    """The place at which the object is found; None if none is sure, or it must be seen there."""
    (place,), _ = search.problem.declared(state.belief)
    enough = accepted in (ELSEWHERE, place) or place in state.seen_in
    return place if enough else None


def _looked_at(state: _State, covered: float) -> str:
    """How many looks there were, where, and how much of the belief they showed."""
    looks = "1 look" if state.looks == 1 else f"{state.looks} looks"
    if not state.looked_at:
        return looks
    shown = ", ".join(state.looked_at[:MOST_NAMES])
    more = len(state.looked_at) - MOST_NAMES
    shown += f" and {more} more places" if more > 0 else ""
    return f"{looks} at {shown}, which showed {covered:.0%} of where it might be"


def _with_last_look(decision: Decision) -> Decision:
    """The best look, if there is one that may show the object; else to give up."""
    looks = [o for o in decision.options if o.viewpoint is not None and o.chance > LEAST_CHANCE]
    if not looks:
        return replace(decision, action="give up")
    return Decision("go", looks[0].viewpoint, (looks[0], *decision.options))


def _why_no_look(search: MapSearch, decision: Decision) -> str:
    """Why no look is worth its time."""
    looks = [option for option in decision.options if option.viewpoint is not None]
    if not looks:
        return "No pose that the robot reaches shows where else it may be"
    best = looks[0]
    name = search.viewpoints[best.viewpoint or 0].name
    return (
        f"No look is worth its time: the best, from {name}, takes {best.seconds:.0f} s and shows "
        f"it with {best.chance:.1%}"
    )


def _no_look_at(search: MapSearch, decision: Decision) -> str:
    """Why an object that is probably at a place is not looked for there any more."""
    chance = max((o.chance for o in decision.options if o.viewpoint is not None), default=None)
    if chance is None:
        return ": no pose that the robot reaches shows it"
    return f": no look shows it with more than {chance:.1%}"


def _without_failed(search: MapSearch, state: _State) -> MapSearch:
    """The search without the viewpoints at which looks failed."""
    if state.planned is not None and state.failures >= TRIES:
        state.failed |= {state.planned}
    failed = [*state.failed]
    if not failed:
        return search
    start, travel = search.problem.start.copy(), search.problem.travel.copy()
    start[failed] = travel[:, failed] = np.inf
    return replace(search, problem=replace(search.problem, start=start, travel=travel))


def _plan(
    goal: str,
    name: str,
    search: MapSearch,
    graph: RoutingGraph,
    start: Endpoint,
    decision: Decision,
    at: int | None,
    opened: frozenset[int],
) -> Plan:
    """The actions until the next look ends."""
    number = decision.viewpoint
    assert number is not None
    viewpoint = search.viewpoints[number]
    actions = []
    if at is None or search.viewpoints[at].pose != viewpoint.pose:
        route = find_route(graph, start, graph.endpoint(viewpoint.room, viewpoint.pose))
        for step in route.steps:
            subject = step.connector.name if step.connector is not None else step.from_place
            actions.append(Action(step.behaviour, (subject,), step.seconds, (step,)))
    if viewpoint.opens is not None and number not in opened:
        arguments = (viewpoint.opens,)
        actions.append(Action("open_container", arguments, OPENING, at=viewpoint.pose))
    shown = [place for place, _ in viewpoint.shows[:MOST_NAMES]]
    chosen = next(o for o in decision.options if o.viewpoint == number)
    look = max(search.problem.look, chosen.seconds - sum(action.seconds for action in actions))
    camera = search.sight.pose(viewpoint.pose, viewpoint.aim)
    actions.append(Action("look", (name, *shown), look, at=viewpoint.pose, camera=camera))
    seconds = sum(action.seconds for action in actions)
    return Plan(goal, tuple(actions), seconds, seconds)


def explain(
    search: MapSearch,
    belief: Floats,
    decision: Decision,
    opened: frozenset[int] = frozenset(),
    *,
    seen: bool = False,
) -> str:
    """Why a search goes on as it does, in one sentence or two.

    `opened` are viewpoints; `seen` is whether it was seen where it is declared.
    """
    problem = search.problem
    name = problem.objects[0]
    if decision.action == "give up":
        return f"{name}: {_likeliest(search, belief)}. {_why_no_look(search, decision)}"
    if decision.action == "declare":
        (place,), _ = problem.declared(belief)
        assert place is not None  # else the search gives up
        return _declared(search, belief, place, seen, None, decision)
    assert decision.viewpoint is not None
    viewpoint = search.viewpoints[decision.viewpoint]
    chosen = decision.options[0]
    text = f"{name}: {_likeliest(search, belief)}. To {viewpoint.name}"
    if viewpoint.opens is not None and decision.viewpoint not in opened:
        text += f", to open {viewpoint.opens}"
    shows = ", ".join(f"{p} ({s:.0%} of it)" for p, s in viewpoint.shows[:MOST_NAMES])
    text += (
        f": {chosen.seconds:.0f} s until a look shows {shows}, and {name} with {chosen.chance:.1%}"
    )
    others = [o for o in decision.options if o.viewpoint not in (None, decision.viewpoint)]
    if others:
        next_ = others[0]
        text += (
            f". From {search.viewpoints[next_.viewpoint or 0].name} first ({next_.seconds:.0f} s, "
            f"{next_.chance:.1%})"
        )
    return text + _unseen(search, belief)


def _declared(
    search: MapSearch,
    belief: Floats,
    place: str,
    seen: bool,
    why: str | None,
    decision: Decision,
) -> str:
    """Where an object is found, and why the search ends: by default, no look is worth its time."""
    problem = search.problem
    chance = float(problem.by_place(belief)[0, problem.places.index(place)])
    how = "seen there" if seen else f"not seen there, but {problem.sure:.0%} is sure enough"
    looks = [o for o in decision.options if o.viewpoint is not None]
    if why is None and looks:
        best = search.viewpoints[looks[0].viewpoint or 0].name
        why = f"another look, from {best} ({looks[0].seconds:.0f} s), is not worth its time"
    why = why or "no viewpoint shows where else it may be"
    return (
        f"{problem.objects[0]} is at {place} ({chance:.1%}; {how}): {why}{_unseen(search, belief)}"
    )


WORTH_SAYING = 0.05
"""The chance of a place from which it is said that no look shows it."""


LITTLE = 0.5
"""The share of the belief below which it is said how much of it all viewpoints show."""


def _unseen(search: MapSearch, belief: Floats) -> str:
    """The likely places that no look shows, and how little all looks show; empty without such."""
    chances = dict(zip(search.problem.places, search.problem.by_place(belief)[0], strict=True))
    likely = [p for p in search.unseen if chances[p] >= WORTH_SAYING]
    text = ""
    if likely:
        named = ", ".join(f"{place} ({chances[place]:.0%})" for place in likely[:MOST_NAMES])
        text = f". No pose that the robot reaches shows {named}"
        if closed := [place for place in likely if place in search.closed]:
            text += f"; this robot does not open {', '.join(closed[:MOST_NAMES])}"
    if search.in_view < LITTLE:
        count = len(search.viewpoints)
        text += f". All {count} viewpoints show {search.in_view:.0%} of where it may be"
    return text


def _likeliest(search: MapSearch, belief: Floats) -> str:
    chances = search.problem.by_place(belief)[0]
    order = np.argsort(-chances, kind="stable")[:3]
    return ", ".join(f"{search.problem.places[k]} {chances[k]:.0%}" for k in order)
