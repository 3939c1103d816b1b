from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from planner.search import problem_builder, search_mission
from planner.search.pomdp import Pomdp, write_pomdp
from planner.search.problem_builder import Detector, MapSearch, Viewpoint
from planner.search.receding_horizon import cheapest, decide, tour_seconds
from planner.search.search_mission import NotFoundError, SearchPlanner, explain
from planner.search.search_problem import NOT_SEEN, SearchProblem, as_pomdp
from planner.search.viewpoints import Aim
from semmap.geometry.pose import Pose
from tests.oracles.point_based import solve
from tests.planner.search.brute import best_order, expectimax
from tests.planner.search.pomdp_reader import read_pomdp
from tests.planner.search.problems import random_search


@pytest.mark.parametrize("seed", range(4))
def test_both_solvers_find_the_best_search_for_one_object(seed):
    problem, belief = random_search(seed, hit=1.0, elsewhere=seed % 2 == 1, shut=seed // 2)
    best = best_order(problem, belief, 4)
    assert decide(problem, belief).cost == pytest.approx(best, rel=1e-9)
    pomdp = as_pomdp(problem, belief)
    assert -solve(pomdp).value(pomdp.start) == pytest.approx(best, rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_point_based_value_is_that_of_expectimax(seed):
    problem, belief = random_search(seed, places=2, viewpoints=2, hit=0.8, false_alarm=0.2)
    pomdp = as_pomdp(problem, belief)
    exact = expectimax(pomdp, 9)
    found = solve(pomdp, tolerance=1e-6).value(pomdp.start)
    assert found == pytest.approx(exact, rel=0.02)
    assert found >= exact - 1e-6  # the policy may take more than nine steps


def expected_cost(problem, belief, choose, draws):
    """The mean cost of a policy over random truths and answers, and its standard error."""
    draw = np.random.default_rng(8)
    costs = []
    for _ in range(draws):
        truth = [draw.choice(len(row), p=row) for row in belief]
        now, at, cost = belief, None, 0.0
        for _ in range(100):
            action, viewpoint = choose(now, at)
            if action == "declare":
                said, _ = problem.declared(now)
                wrong = sum(
                    problem.places[problem.place_of[t]] != name
                    for t, name in zip(truth, said, strict=True)
                )
                cost += problem.wrong * wrong
                break
            if action == "go":
                cost += problem.start[viewpoint] if at is None else problem.travel[at, viewpoint]
                at = viewpoint
                continue
            cost += problem.look
            answers = problem.answers(now, at)
            seen = [draw.choice(answers.shape[2], p=answers[i, t]) for i, t in enumerate(truth)]
            now = problem.after(
                now, at, [NOT_SEEN if k == len(problem.places) else k for k in seen]
            )
        else:
            pytest.fail("the search does not end")
        costs.append(cost)
    return np.mean(costs), np.std(costs) / draws**0.5


def test_receding_horizon_agrees_with_point_based_iteration_for_two_objects():
    problem, belief = random_search(2, objects=2, false_alarm=0.05)
    pomdp = as_pomdp(problem, belief)
    best = -solve(pomdp).value(pomdp.start)
    kept = {}

    def choose(now, at):
        key = (now.round(7).tobytes(), at)
        if key not in kept:
            decision = decide(problem, now, at, depth=1)
            kept[key] = decision.action, decision.viewpoint
        return kept[key]

    mean, error = expected_cost(problem, belief, choose, 80)
    assert mean == pytest.approx(best, abs=3 * error)
    assert error < 0.15 * best


def test_a_policy_attains_its_value():
    problem, belief = random_search(1, objects=2, hit=0.7, false_alarm=0.2)
    pomdp = as_pomdp(problem, belief)
    policy = solve(pomdp)
    count = len(problem.viewpoints)

    def choose(now, at):
        state = np.zeros(len(pomdp.states))
        joint = np.outer(*now).ravel()
        modes = count + 1
        state[np.arange(len(joint)) * modes + (count if at is None else at)] = joint
        action, *rest = pomdp.actions[policy.action(state)].split()
        return action, problem.viewpoints.index(rest[0]) if action == "go" else at

    mean, error = expected_cost(problem, belief, choose, 300)
    assert mean < -policy.value(pomdp.start) + 3 * error


def test_an_object_behind_another_one_is_looked_for_from_the_other_side():
    # The box hides the mug from one side; from there, a look says nothing about the mug.
    sides = np.ones((2, 2, 2))
    sides[0, 0, 1] = 0.0
    problem = SearchProblem(
        ("mug", "box"),
        ("table", "elsewhere"),
        ("front", "back"),
        np.arange(2),
        np.array([[1.0, 0], [1, 0]]),
        np.array([[0, 5.0], [5, 0]]),
        np.array([1.0, 6.0]),
        2.0,
        np.array([0.95, 0.95]),
        np.zeros(2),
        100.0,
        np.zeros(2),
        sides,
    )
    belief = np.array([[0.5, 0.5], [1.0, 0.0]])
    after = problem.after(belief, 0, [NOT_SEEN, 0])
    assert after[0] == pytest.approx([0.5, 0.5])
    assert problem.after(belief, 1, [NOT_SEEN, 0])[0, 0] == pytest.approx(0.05 / 1.05)
    decision = decide(problem, after, at=0)
    assert (decision.action, decision.viewpoint) == ("go", 1)
    pomdp = as_pomdp(problem, belief)
    assert pomdp.actions[solve(pomdp).action(pomdp.start)] == "go back"


def test_what_a_viewpoint_cannot_see_is_not_found_by_a_second_look():
    # Two spots of a table; only the second viewpoint shows the one behind the box.
    problem = SearchProblem(
        ("mug",),
        ("table", "shelf"),
        ("front", "back", "shelf"),
        np.array([0, 0, 1]),
        np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]),
        np.array([[0, 4.0, 9], [4, 0, 9], [9, 9, 0]]),
        np.array([1.0, 4.0, 9.0]),
        2.0,
        np.array([0.99]),
        np.zeros(1),
        200.0,
        np.zeros(3),
    )
    belief = problem.spread([{"table": 0.8, "shelf": 0.2}], np.array([0.5, 0.5, 1.0]))
    once = problem.after(belief, 0, [NOT_SEEN])
    twice = problem.after(once, 0, [NOT_SEEN])
    assert once[0, 1] > 0.6
    assert twice[0, 1] > once[0, 1]
    decision = decide(problem, once, at=0)
    assert (decision.action, problem.viewpoints[decision.viewpoint]) == ("go", "back")


def test_a_container_is_opened_once():
    problem, belief = random_search(3, shut=1, wrong=1000.0)
    belief = np.array([[0.9, 0.05, 0.05]])
    first = decide(problem, belief)
    assert (first.action, first.viewpoint) == ("go", 0)
    assert decide(problem, belief, 0).action == "open"
    assert decide(problem, belief, 0, frozenset([0])).action == "look"
    pomdp = as_pomdp(problem, belief)
    assert "open view0" in pomdp.actions
    closed = next(k for k, s in enumerate(pomdp.states) if "place0" in s and "robot@view0" in s)
    look = pomdp.actions.index("look")
    nothing = pomdp.observations.index("no-object0")
    assert pomdp.likelihoods[look, closed, nothing] == 1


def test_the_penalty_decides_between_a_look_and_an_answer():
    problem, _ = random_search(0)
    belief = np.array([[0.96, 0.02, 0.02]])
    careless = SearchProblem(**{**vars_of(problem), "wrong": 20.0})
    careful = SearchProblem(**{**vars_of(problem), "wrong": 2000.0})
    assert decide(careless, belief).action == "declare"
    assert decide(careful, belief).action == "go"


def test_an_object_is_declared_from_a_belief_on_and_else_not_found():
    problem, _ = random_search(0, wrong=100.0)
    problem = SearchProblem(
        **{**vars_of(problem), "missed": 5.0, "places": ("table", "shelf", "elsewhere")}
    )
    assert problem.sure == pytest.approx(0.95)
    assert problem.declared(np.array([[0.95, 0.05, 0.0]])) == (["table"], pytest.approx(5.0))
    assert problem.declared(np.array([[0.97, 0.03, 0.0]])) == (["table"], pytest.approx(3.0))
    for unsure in ([0.94, 0.06, 0.0], [0.0, 0.0, 1.0]):  # elsewhere is never an answer
        assert problem.declared(np.array([unsure])) == ([None], pytest.approx(5.0))
        assert decide(problem, np.array([unsure])).action in ("give up", "go")
    assert decide(problem, np.array([[0.0, 0.0, 1.0]])).action != "declare"


@pytest.mark.parametrize("seed", range(4))
def test_a_search_that_may_end_without_a_find_is_the_best_one(seed):
    """Both solvers agree with all orders of looks, where an object that is not found costs less."""
    problem, belief = random_search(seed, hit=1.0, wrong=600.0, shut=seed // 2)
    problem = SearchProblem(**{**vars_of(problem), "missed": [5.0, 30.0][seed % 2]})
    best = best_order(problem, belief, 4)
    assert decide(problem, belief).cost == pytest.approx(best, rel=1e-9)
    pomdp = as_pomdp(problem, belief)
    assert any("declare no-object0" in action for action in pomdp.actions)
    assert -solve(pomdp).value(pomdp.start) == pytest.approx(best, rel=1e-6)


def vars_of(problem):
    return {f: getattr(problem, f) for f in SearchProblem.__dataclass_fields__}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hit": np.array([1.5])}, "object0: its rate hit is 1.5"),
        ({"false_alarm": np.array([-0.1])}, "object0: its rate false_alarm is -0.1"),
        ({"false_alarm": np.array([0.95])}, "seen no more often where it is"),
        ({"wrong": np.nan}, "wrong: nan"),
        ({"look": 0.0}, "look is 0"),
        ({"visible": np.full((3, 3), 2.0)}, "visible: 2 is not in"),
        ({"place_of": np.array([0, 2, 1])}, "place_of"),
        ({"objects": ("a", "a")}, "object a is there twice"),
        ({"travel": np.zeros((2, 2))}, r"travel: its shape is \(2, 2\)"),
    ],
)
def test_bad_searches_are_refused(change, message):
    problem, _ = random_search(0)
    with pytest.raises(ValueError, match=message):
        SearchProblem(**{**vars_of(problem), **change})


def test_beliefs_that_do_not_sum_to_1_and_impossible_answers_are_refused():
    problem, belief = random_search(0)
    with pytest.raises(ValueError, match=r"object0: its belief sums to 0\.4"):
        problem.spread([{"place0": 0.4}])
    with pytest.raises(ValueError, match=r"object0: .* impossible"):
        problem.after(belief, 0, [1])  # the viewpoint does not show that place


def test_a_search_with_too_many_states_is_refused():
    problem, belief = random_search(0, objects=3, places=6, viewpoints=6)
    with pytest.raises(ValueError, match="1513 states"):
        as_pomdp(problem, belief)


def test_a_pomdp_file_is_read_back_exactly(tmp_path):
    problem, belief = random_search(5, objects=2, hit=0.7, false_alarm=0.2, shut=1)
    pomdp = as_pomdp(problem, belief, most_states=100)
    again = read_pomdp(write_pomdp(pomdp, tmp_path / "search.pomdp"))
    for name in ("transitions", "likelihoods", "rewards", "start"):
        assert np.array_equal(getattr(again, name), getattr(pomdp, name)), name
    assert again.discount == pomdp.discount
    assert len(again.states) == len(pomdp.states)


TIGER = """
# Cassandra's tiger, as others write it
discount: 0.95
values: reward
states: tiger-left tiger-right
actions: listen open-left open-right
observations: tiger-left tiger-right
T:listen
identity
T:open-left
uniform
T:open-right
uniform
O:listen : tiger-left : tiger-left 0.85
O:listen : tiger-left : tiger-right 0.15
O:listen : tiger-right : tiger-left 0.15
O:listen : tiger-right : tiger-right 0.85
O:open-left
uniform
O:open-right
uniform
R:listen : * : * : * -1
R:open-left : tiger-left : * : * -100
R:open-left : tiger-right : * : * 10
R:open-right : tiger-left : * : * 10
R:open-right : tiger-right : * : * -100
"""


def test_the_tiger_of_the_literature_has_its_published_value(tmp_path):
    file = tmp_path / "tiger.pomdp"
    file.write_text(TIGER)
    pomdp = read_pomdp(file)
    policy = solve(pomdp, sweeps=300, tolerance=1e-6)
    assert policy.value(pomdp.start) == pytest.approx(19.3713, abs=0.01)
    assert pomdp.actions[policy.action(pomdp.start)] == "listen"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.85", "0.95", "likelihoods: 0, 0 is not a distribution"),
        ("open-left : tiger-left", "open-it : tiger-left", "line 23: open-it is not among"),
        ("-100", "much", "'much' is not a number"),
        ("discount: 0.95", "", "no line discount"),
    ],
)
def test_bad_pomdp_files_are_refused(tmp_path, old, new, message):
    file = tmp_path / "tiger.pomdp"
    file.write_text(TIGER.replace(old, new, 1))
    with pytest.raises(ValueError, match=message):
        read_pomdp(file)


def test_an_undiscounted_process_without_an_end_is_refused():
    one = np.ones((1, 1, 1))
    endless = Pomdp(("a",), ("wait",), ("o",), one, one, -np.ones((1, 1)), np.ones(1))
    with pytest.raises(ValueError, match="no action ends the process"):
        solve(endless)


def test_a_search_among_many_objects_and_places_takes_a_step():
    problem, belief = random_search(0, objects=20, places=30, viewpoints=40, elsewhere=True)
    decision = decide(problem, belief)
    assert decision.action == "go"
    assert len(set(decision.tour)) > 10
    assert decision.cost < problem.declared(belief)[1]


@pytest.mark.parametrize("seed", range(12))
def test_the_seconds_of_a_tour_are_those_until_the_object_is_found(seed):
    """As brute force adds them up by true spot; what a wrong answer costs is none of them."""
    problem, belief = random_search(seed, wrong=[60.0, 3600.0][seed % 2], shut=seed % 3)
    tour = decide(problem, belief).tour
    expected, spent, unseen, at, opened = 0.0, 0.0, belief[0].copy(), None, set()
    for stop in tour:
        leg = problem.start[stop] if at is None else problem.travel[at, stop]
        spent = leg + problem.look + (stop not in opened) * problem.opening[stop]
        expected += unseen.sum() * spent
        unseen *= 1 - problem.hit[0] * problem.visible[stop]
        at = stop
        opened.add(stop)
    assert tour_seconds(problem, belief, tour) == pytest.approx(expected)


def test_a_look_that_fails_where_the_robot_stands_is_not_planned_for_ever():
    search, state = search_at_tables((0.4, 0.4, 0.2))
    first = decide(search.problem, state.belief, 0).viewpoint
    assert first == 0
    state.planned, state.failures = 0, search_mission.TRIES
    left = search_mission._without_failed(search, state)
    assert decide(left.problem, state.belief, 0).viewpoint not in (0, None)


def test_one_more_look_is_not_better_because_a_tour_is_cut():
    """30 places are likely, as many as a tour has stops; others nearly show nothing."""
    likely, unlikely = 30, 15
    count = likely + unlikely
    chances = np.array([1.0] * likely + [1e-4] * unlikely)
    names = tuple(f"p{k}" for k in range(count))
    problem = SearchProblem(
        ("mug",),
        names,
        tuple(f"v{k}" for k in range(count)),
        np.arange(count),
        np.eye(count),
        np.full((count, count), 5.0) - 5 * np.eye(count),
        np.full(count, 5.0),
        3.0,
        np.array([0.9]),
        np.array([0.0]),
        1e7,
        np.zeros(count),
        missed=5e6,
    )
    decision = decide(problem, (chances / chances.sum())[None])
    assert decision.viewpoint < likely
    assert len(decision.tour) == 30
    assert decision.tour[0] == decision.viewpoint


def test_what_a_missed_object_costs_counts_each_viewpoint_once_behind_a_one_way_door():
    """Nothing leads on from the first two viewpoints, and nothing leads to the last one."""
    problem, belief = random_search(0, places=4, viewpoints=4)
    problem = replace(
        problem,
        start=np.array([1.0, 2.0, 9.0, np.inf]),
        travel=np.where(np.eye(4, dtype=bool), 0.0, np.inf),
        opening=np.array([0.0, 0.0, 8.0, 0.0]),
    )
    seconds = (1 + 2) + (2 + 2) + (9 + 2 + 8)
    chance = belief[0, :3].sum()
    missed = problem_builder._missed(problem, belief)
    assert missed == pytest.approx(seconds / (problem_builder.LEFT * chance))
    problem = replace(problem, missed=missed, wrong=20 * missed)
    assert decide(problem, belief).action == "go"


def search_at_tables(belief, *, missed=50.0, **changes):
    """A search at three places, the last of which is elsewhere; its state has that belief."""
    problem, _ = random_search(0, elsewhere=True)
    names = ("t1", "t2", "elsewhere")
    problem = replace(problem, places=names, missed=missed, wrong=20 * missed, **changes)
    shows = [names[int(row.argmax())] for row in problem.visible]
    viewpoints = tuple(
        Viewpoint(name, "kitchen", Pose.planar(k, 0.0, 0.0, 0.0), Aim(1.2, 0.3), ((place, 1.0),))
        for k, (name, place) in enumerate(zip(problem.viewpoints, shows, strict=True))
    )
    search = MapSearch(problem, np.array([belief]), viewpoints, np.ones(3), None)
    return search, search_mission._State(search, search.belief, 0, np.ones(3), None)


def end(search, state, *, accepted="elsewhere", limit=3600.0):
    """What the planner keeps of the end of a search."""
    planner = SearchPlanner(None, detector=Detector(limit=limit))
    place = search_mission._found_place(search, state, accepted)
    decision = decide(search.problem, state.belief)
    if decision.action == "declare" and place is None:
        decision = search_mission._with_last_look(decision)
    with suppress(NotFoundError):
        planner._end(search, state, "object0", decision, place)
    return planner.answers["object0"]


def test_a_find_at_the_end_of_the_time_says_that_the_time_is_over():
    search, state = search_at_tables([0.96, 0.03, 0.01], missed=10_000.0)
    assert decide(search.problem, state.belief).action == "go"  # a look would still be worth it
    state.seconds = 100.0
    answer = end(search, state, limit=60.0)
    assert (answer.found, answer.place) == (True, "t1")
    assert answer.reason == (
        "object0 is at t1 (96.0%; not seen there, but 95% is sure enough): "
        "the time of the search is over (60 s)"
    )


@pytest.mark.parametrize("over", [False, True])
def test_an_object_that_must_be_seen_is_not_found_where_it_only_probably_is(over):
    search, state = search_at_tables([0.97, 0.02, 0.01], visible=np.zeros((3, 3)))
    state.seconds = 100.0
    limit = 60.0 if over else 3600.0
    answer = end(search, state, accepted="t2", limit=limit)
    assert (answer.found, answer.seen, answer.place) == (False, False, "t1")
    assert "It is probably at t1, but was not seen there" in answer.reason
    assert ("the time of the search is over (60 s)" in answer.reason) == over
    assert "where else" not in answer.reason
    assert "worth its time" not in answer.reason
    assert end(search, state, accepted="t1", limit=limit).found, "the map has it there"
    state.seen_in = frozenset(["t1"])
    assert end(search, state, accepted="t2", limit=limit).found


def test_the_chance_of_a_find_is_that_of_its_place():
    search, _ = search_at_tables([0.4, 0.05, 0.55], missed=5.0)
    search = replace(search, problem=replace(search.problem, wrong=8.0))
    decision = decide(search.problem, search.belief)
    assert decision.action == "declare"
    assert explain(search, search.belief, decision).startswith("object0 is at t1 (40.0%;")


def test_the_cheapest_search_is_that_of_the_object_that_is_probably_found():
    """The other one is nearly always elsewhere; to miss it costs little in its own problem."""
    likely, hopeless = [[0.9, 0.05, 0.05]], [[0.01, 0.01, 0.98]]
    problem, _ = random_search(0, elsewhere=True)
    problem = replace(problem, places=("t1", "t2", "elsewhere"), missed=400.0, wrong=8000.0)
    other = replace(problem, missed=5.0, wrong=100.0)
    searches = [(problem, np.array(likely)), (other, np.array(hopeless))]
    assert decide(*searches[1]).cost < decide(*searches[0]).cost
    assert cheapest(searches) == 0
    assert cheapest(searches[::-1]) == 1


@pytest.mark.parametrize(("share", "said"), [(0.0, "10%"), (1.0, None)])
def test_a_search_says_how_little_its_viewpoints_show(share, said):
    """Where the first viewpoints show nothing, all show what is at the second table."""
    search, _ = search_at_tables([0.85, 0.1, 0.05], missed=10_000.0)
    visible = search.problem.visible * np.array([share, 1.0, 1.0])
    search = replace(search, problem=replace(search.problem, visible=visible))
    reason = explain(search, search.belief, decide(search.problem, search.belief))
    shows = f"All 3 viewpoints show {said} of where it may be"
    assert reason.endswith(shows) if said else "of where it may be" not in reason
