"""Missions whose goal names an object that must be found first, such as ``found(mug)``."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

from planner.plan import Action, Plan
from planner.readers.entity_lookup import find_entities
from planner.search.reader import DOUBTED, read_doubtful, read_holder, read_kind, read_seen_by
from planner.search.receding_horizon import decide, tour_seconds
from planner.search.search_mission import MOST_NAMES, NotFoundError, SearchPlanner, explain
from planner.search.search_problem import ELSEWHERE
from planner.task_planner import TaskPlanner
from planner.tasks.goal import Atom, Goal, parse_goal
from planner.tasks.problem import NoPlanError
from planner.tasks.reader import read_state
from semmap.belief.store.beliefs import read_belief
from semmap.geometry.pose import Pose
from semmap.query.geometry_notes import listed
from semmap.query.snapshot import Snapshot

FOUND = "found"  # the relation of a goal that is reached when the robot knows where an object is


class SearchingPlanner:
    """Plans missions that search for objects first (`planner.mission.runner.Planner`).

    `relations` are those of a domain file, with their numbers of arguments.
    """

    def __init__(
        self,
        tasks: TaskPlanner,
        search: SearchPlanner,
        relations: Iterable[tuple[str, int]] = (),
    ) -> None:
        self._tasks, self._search = tasks, search
        self._relations = tuple(relations)

    def __call__(
        self,
        seen: Snapshot,
        robot: str,
        goal: str,
        *,
        without: frozenset[str] = frozenset(),
        tried: frozenset[tuple[str, Pose]] = frozenset(),
    ) -> Plan:
        """The next look of a search, or the plan of the rest of the goal."""
        self._search.live.catch_up()
        parsed = parse_goal(goal, ((FOUND, 1), *self._relations))
        wanted = {w.text for atom in parsed.atoms if atom.relation == FOUND for w in atom.words}
        found = {name for name, answer in self._search.answers.items() if answer.found}
        missed = self._search.not_found(without)
        names, doubted = objects_to_find(seen, parsed, missed)
        for name in names:
            if name in found:
                continue
            if read_kind(seen, name) is None:
                raise LookupError(f"the map has no {name} any more: nothing is left to search for")
            holder = read_holder(seen, name)
            if name not in wanted and (holder == robot or read_seen_by(seen, name, robot)):
                continue
            accepted = ELSEWHERE if name in wanted else holder
            try:
                plan = self._search.next_steps(
                    seen, robot, name, goal, without=without, accepted=accepted
                )
            except NotFoundError:
                if name in objects_to_find(seen, parsed, {*missed, name})[0]:
                    raise
                return self(seen, robot, goal, without=without, tried=tried)  # another will do
            if plan.actions:
                return plan
        rest = [atom for atom in parsed.atoms if atom.relation != FOUND]
        if not rest:
            return Plan(goal, (), 0.0, 0.0)
        text = goal if len(rest) == len(parsed.atoms) else " and ".join(map(_text, rest))
        plan = self._tasks(seen, robot, text, without=without | doubted, tried=tried)
        return replace(plan, goal=goal)


def objects_to_find(
    seen: Snapshot, goal: Goal, given_up: Collection[str] = ()
) -> tuple[list[str], frozenset[str]]:
    """The objects of a goal whose place is only believed, in order, and those to leave out.

    They are those in ``found(...)``, those that looks have made doubtful, and those that nothing
    holds. Of a type or label, those are left out where others are known; else the one that most
    probably is somewhere is to be found, of those that are not `given_up`. What else the map has
    is where the map has it.
    """
    found: list[str] = []
    doubted: set[str] = set()
    for atom in goal.atoms:
        for name in dict.fromkeys(word.text for word in atom.words):
            if atom.relation == FOUND:
                found.append(name)
                continue
            names = [e.name for e in find_entities(seen, name) if e.kind == "object"]
            doubtful = read_doubtful(seen, names)
            if names == [name] or not doubtful:
                found += doubtful
                continue
            doubted |= doubtful.keys()
            if len(doubtful) == len(names):
                likely = [each for each in doubtful if each not in given_up] or [*doubtful]
                found.append(max(likely, key=lambda each: doubtful[each]))
    return [*dict.fromkeys(found)], frozenset(doubted.difference(found))


def plan_with_search(
    seen: Snapshot,
    tasks: TaskPlanner,
    search: SearchPlanner,
    goal: str,
    start: str | None,
    *,
    agent: str | None = None,
    relations: Iterable[tuple[str, int]] = (),
    patience: float,
) -> tuple[Plan, list[str]] | None:
    """The plan of a goal with objects whose place is only believed, and why; None without such.

    It begins with an action ``search`` for each such object. What follows is planned for the place
    where the object most probably is, or for the next one if no plan leads on from there. A mission
    plans again after each look. Raises NotFoundError: no look for an object of ``found(...)`` is
    worth its time.
    """
    parsed = parse_goal(goal, ((FOUND, 1), *relations))
    wanted = {w.text for atom in parsed.atoms if atom.relation == FOUND for w in atom.words}
    names, doubted = objects_to_find(seen, parsed)
    if not names and not doubted:
        return None
    graph = search.live.graph
    actions: list[Action] = []
    reasons: list[str] = []
    state = read_state(seen, graph.topology, start)
    begin = graph.endpoint(state.place, state.pose)
    for name in names:
        found = search.begin(seen, name, begin)
        decision = decide(found.problem, found.belief)
        reasons.append(explain(found, found.belief, decision) + DOUBTED)
        if decision.action == "give up" and name in wanted:
            raise NotFoundError(reasons[-1])
        if decision.viewpoint is None:
            continue
        rooms = [found.viewpoints[k].name for k in decision.tour]
        seconds = tour_seconds(found.problem, found.belief, decision.tour)
        actions.append(Action("search", (name, *rooms[:MOST_NAMES]), seconds))
    rest = [atom for atom in parsed.atoms if atom.relation != FOUND]
    bound = 0.0
    if rest:
        text = " and ".join(map(_text, rest))
        plan, believed = _plan_rest(seen, tasks, text, start, agent, names, doubted, patience)
        reasons += [f"What follows is for {name} at {at}" for name, at in believed.items()]
        actions += plan.actions
        bound = plan.bound
    if doubted:
        reasons.append(f"Left out, as their places are in doubt: {listed(sorted(doubted))}")
    return Plan(goal, tuple(actions), sum(a.seconds for a in actions), bound), reasons


def _plan_rest(
    seen: Snapshot,
    tasks: TaskPlanner,
    goal: str,
    start: str | None,
    agent: str | None,
    names: Sequence[str],
    doubted: frozenset[str],
    patience: float,
) -> tuple[Plan, dict[str, str]]:
    """The plan of a goal once some objects are found, and the places for which it is.

    Raises NoPlanError: none leads on from the places where they probably are.
    """
    places = {name: [p for p in read_belief(seen, name) if p != ELSEWHERE] for name in names}
    why: NoPlanError | None = None
    for number in range(MOST_NAMES):
        believed = {name: of[number] for name, of in places.items() if number < len(of)}
        if number > 0 and not believed:
            break
        task = tasks.task(seen, goal, start, agent=agent, without=doubted, believed=believed)
        try:
            plan = task.plan(patience)
        except NoPlanError as error:
            why = why or error
            continue
        if why is None or plan.actions:  # to find it where it should go explains no refusal
            return plan, believed
    assert why is not None
    raise why


def _text(atom: Atom) -> str:
    """The text of a condition, which `parse_goal` reads again."""
    words = [str(w) if w.number else f'"{w.text}"' for w in atom.words]
    return f"{atom.relation}({', '.join(words)})"
