"""Learning from the history of a map: what the database then believes, and of whose looks."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

import semmap
from semmap import Map
from semmap.belief.chain import smooth
from semmap.belief.learning import NOTHING, detector_rates, habits, learn, lifted_prior, lifted_rate
from semmap.belief.reader import read_columns
from semmap.belief.store import learning as store
from semmap.belief.store.beliefs import add_observations
from semmap.belief.store.history import ABOUT, read_history
from tests.conftest import MakeDatabase
from tests.oracles.evidence import Fact, where_by_paths
from tests.seen import seen_by

NOW = datetime.now(UTC)
PLACES, SHARES = ("table", "counter", "bench", "fridge"), (0.7, 0.1, 0.1, 0.1)


def use(flat: Map, seed: int, things: tuple[str, ...] = ("coke", "mug"), looks: int = 60) -> None:
    """Ten days in which things are mostly on the table; the robot and people see most of them."""
    random = np.random.default_rng(seed)
    ages = np.sort(random.uniform(60, 864_000, looks))[::-1].tolist()
    rows = []
    for thing in things:
        days = random.choice(PLACES, 11, p=SHARES)
        for age in ages:
            place, at = str(random.choice(PLACES)), NOW - timedelta(seconds=age)
            there = days[int(age / 86_400)] == place
            row = {"object": thing, "place": place, "at": at}
            row["seen"] = bool(random.random() < (0.8 if there else 0.05))
            row["visible"] = float(random.uniform(0.3, 1))
            row["observer"] = "robot" if random.random() < 0.7 else None
            rows.append(row)
    add_observations(flat.connection, rows)
    for age in (700_000, 300_000):
        flat.execute(
            "INSERT INTO placement_history (entity_id, holder_id, pose, relation, during) "
            "VALUES (entity_id('mug'), entity_id('counter'), '{0,0,0.9,0,0,0,1}', 'on', "
            "tstzrange(%s, %s))",
            *(NOW - timedelta(seconds=age), NOW - timedelta(seconds=age - 1000)),
        )


@pytest.fixture
def used(flat: Map) -> Map:
    """The flat after ten days of use."""
    use(flat, 1)
    return flat


def test_the_database_believes_as_the_learner_does(used: Map) -> None:
    """Two implementations, in SQL and in NumPy, of what a history means: before each look."""
    used.learn_belief()
    history = read_history(seen_by(used.connection))
    learned = learn(history.tracks, history.detectors, stated=history.stated, day=store.PARTS)
    for track in history.tracks:
        thing = track.subjects[-1]
        assert lifted_rate(track, learned) != pytest.approx(track.rate)
        rates = detector_rates(track, history.detectors, learned)
        found = smooth(track, *habits(track, learned), *rates, history.stated)
        for number in {0, 1, 17, 40, len(track.at) - 1} & {*range(len(track.at))}:
            at = datetime.fromtimestamp(track.at[number] - 1e-5, UTC)
            rows = used.execute("SELECT * FROM belief_at(%s, %s)", [thing], at)
            by_place = {row[1]: row[3] for row in rows}
            names = [*sorted(one for one in by_place if one is not None), None]
            expected = [by_place[one] for one in names]
            assert found.forecast[number] == pytest.approx(np.array(expected), abs=1e-4)


def test_lifts_say_where_things_are_and_how_often_they_move(used: Map) -> None:
    before = used.where("mug")
    found = used.learn_belief()
    assert found.looks == 120
    rows = {(row["subject"], row["about"], row["word"]): row for row in found.lifts}
    row = rows["mug", "moves", None]
    assert row["lift"] == pytest.approx((row["seen"] + 5) / (row["expected"] + 5))
    assert {about for _, about, _ in rows} == {"moves", *ABOUT}
    prior = {row["place"]: row["prior"] for row in used.where("mug").rows}
    former = {row["place"]: row["prior"] for row in before.rows}
    assert prior["table"] > prior["bench"]
    assert prior != former
    assert sum(prior.values()) == pytest.approx(1)


def test_who_says_how_often_things_move_is_believed(used: Map) -> None:
    """Then what was learned of moves is left out, but not what was learned of places."""
    used.learn_belief()
    at = datetime.now(UTC)
    found = used.where("mug", at, moves=3600.0)
    used.execute("DELETE FROM learned_lift WHERE about = 'moves'")
    assert dict(used.where("mug", at, moves=3600.0)) == pytest.approx(dict(found))
    assert dict(used.where("mug", at, moves=7200.0)) != pytest.approx(dict(found))


def test_what_was_learned_can_be_forgotten(used: Map) -> None:
    at = datetime.now(UTC)
    former = [
        (row["place"], row["prior"], row["probability"]) for row in used.where("mug", at).rows
    ]
    lifts = used.learn_belief().lifts
    assert used.forget_learned() == len(lifts)
    rows = [(row["place"], row["prior"], row["probability"]) for row in used.where("mug", at).rows]
    assert rows == former
    assert used.execute("SELECT count(*) FROM detector_rate") == [(0,)]


def test_learning_again_replaces(used: Map) -> None:
    assert used.learn_belief().lifts == used.learn_belief().lifts


def test_new_looks_have_the_rates_of_their_observer_and_distance(used: Map) -> None:
    used.learn_belief()
    used.execute("DELETE FROM detector_rate")
    used.execute(
        "INSERT INTO detector_rate (map_id, observer_id, within, hit, false_alarm, there, "
        "elsewhere) SELECT current_map(), entity_id(o), w, h, 0.01, 1, 1 FROM (VALUES "
        "('robot', 1.0, 0.9), ('robot', 2.0, 0.8), ('robot', NULL, 0.7), (NULL, NULL, 0.6)) "
        "v (o, w, h)"
    )
    used.add_agent("other", type="robot", size=(0.3, 0.3, 1.0), pose=(7.5, 0.5, 0))
    x, y = used["bench"].pose[:2]
    for distance, observer, hit in (
        (0.6, "robot", 0.9),
        (1.9, "robot", 0.8),
        (2.6, "robot", 0.7),  # none from so far
        (0.6, "other", 0.6),
    ):
        used[observer].move_to(x + distance, y, 0)
        used.observe("coke", "bench", observer=observer)
        assert read_columns(seen_by(used.connection), ["coke"]).observations.hit[-1] == hit
    rows = used.execute("SELECT distance FROM observation ORDER BY id DESC LIMIT 4")
    assert [row[0] for row in rows] == pytest.approx([0.6, 2.6, 1.9, 0.6])
    used.execute("DELETE FROM detector_rate WHERE within = 1")
    used["robot"].move_to(x + 0.6, y, 0)
    used.observe("coke", "bench", observer="robot")  # not as from 2 m
    assert read_columns(seen_by(used.connection), ["coke"]).observations.hit[-1] == 0.7
    used.observe("coke", "bench", observer="robot", hit=0.5, false_alarm=0.2)
    assert read_columns(seen_by(used.connection), ["coke"]).observations.hit[-1] == 0.5
    used.observe("coke", "bench")
    assert np.isnan(read_columns(seen_by(used.connection), ["coke"]).observations.hit[-1])


def test_looks_of_robots_are_believed_by_their_learned_rates(used: Map) -> None:
    """By the sum over all paths, with the rates in the place of the map's."""
    used.execute("DELETE FROM observation")
    used.execute("DELETE FROM placement_history WHERE entity_id = entity_id('coke')")
    at = datetime.now(UTC) - timedelta(seconds=100)
    for seen, place in ((True, "bench"), (False, "table")):
        used.observe("coke", place, observer="robot", seen=seen, at=at)
    used.execute(
        "INSERT INTO detector_rate (map_id, hit, false_alarm, there, elsewhere) "
        "VALUES (current_map(), 0.6, 0.1, 1, 1)"
    )
    now = at + timedelta(seconds=50)
    rows = used.where("coke", now).rows
    prior = {row["place"]: row["prior"] for row in rows}
    facts = [Fact(0.0, ("bench",), 0.6, 0.1), Fact(0.0, ("table",), 0.4, 0.9)]
    expected = where_by_paths(prior, facts, 50.0, 86_400.0, 0.95)
    assert {row["place"]: row["probability"] for row in rows} == pytest.approx(expected, abs=1e-9)


def test_days_held_out_judge_the_others(used: Map) -> None:
    found = used.learn_belief(hold_out=3)
    assert found.before is not None
    assert found.without_hours is not None
    assert found.after is not None
    later = used.execute(
        "SELECT count(*) FROM observation o, (SELECT max(at) AS last FROM observation) m "
        "WHERE o.at >= m.last - interval '3 days'"
    )
    assert [(int(found.after.count.sum()),)] == later
    plain = found.as_json()
    assert plain["after"]["error"] == found.after.error
    assert found.lifts == used.learn_belief().lifts  # all days are kept


def test_days_before_which_nothing_is_known_are_refused(flat: Map) -> None:
    flat["mug"].put_on("table")
    flat["mug"].put_on("bench")
    with pytest.raises(ValueError, match="no looks"):
        flat.learn_belief(hold_out=1)
    use(flat, 2, ("coke",), 5)
    with pytest.raises(ValueError, match="hold out fewer"):
        flat.learn_belief(hold_out=30)
    assert flat.execute("SELECT count(*) FROM learned_lift") == [(0,)]


@pytest.mark.parametrize("days", [-1.0, float("nan")])
def test_a_time_that_is_none_is_refused(flat: Map, days: float) -> None:
    with pytest.raises(ValueError, match="hold_out"):
        flat.learn_belief(hold_out=days)


def test_a_map_without_history_teaches_nothing(make_database: MakeDatabase) -> None:
    url = make_database().render_as_string(hide_password=False)
    with semmap.connect(url) as db:
        empty = db.create_map("empty")
        with pytest.raises(ValueError, match="no history"):
            empty.learn_belief()
        assert empty.forget_learned() == 0


def test_a_thing_of_a_new_type_has_what_its_supertypes_learned(used: Map) -> None:
    used.learn_belief()
    used.add_object("cup", type="cup", size=(0.08, 0.08, 0.1))
    learned = {row["place"]: row["prior"] for row in used.where("cup").rows}
    used.forget_learned()
    plain = {row["place"]: row["prior"] for row in used.where("cup").rows}
    assert learned["table"] / learned["piano"] > plain["table"] / plain["piano"]


def test_tracks_begin_with_the_prior_without_history(used: Map) -> None:
    history = read_history(seen_by(used.connection))
    (mug,) = (t for t in history.tracks if t.subjects[-1] == used["mug"].id)
    former = dict(used.execute("SELECT place_id, prior FROM prior_of(%s)", [used["mug"].id]))
    used.execute("DELETE FROM placement WHERE entity_id = entity_id('mug')")
    used.execute("DELETE FROM placement_history WHERE entity_id = entity_id('mug')")
    rows = dict(used.execute("SELECT place_id, prior FROM prior_of(%s)", [used["mug"].id]))
    assert rows != former
    expected = [rows[one] for one in sorted(p for p in rows if p is not None)]
    assert mug.prior[:-1] == pytest.approx(expected)
    assert lifted_prior(mug, NOTHING) == pytest.approx(mug.prior)


def test_what_the_map_states_after_a_sighting_is_no_news(flat: Map) -> None:
    """A sighting at a point moves the mug, and the map then states what the look said."""
    flat.observe("mug", "table", position=(0, 0, 0.8), observer="robot")
    assert flat["mug"].holder.name == "table"
    history = read_history(seen_by(flat.connection))
    (mug,) = (t for t in history.tracks if t.subjects[-1] == flat["mug"].id)
    assert not mug.told[-1]
    assert mug.seen[-1]


def test_the_distance_of_a_look_is_the_same_whatever_it_shows(flat: Map) -> None:
    for seen, position in ((True, (0.5, 0, 0.8)), (False, None)):
        flat.observe("coke", "table", seen=seen, position=position, observer="robot")
    flat.observe("coke", "kitchen", seen=False, observer="robot")
    rows = flat.execute("SELECT distance FROM observation ORDER BY id DESC LIMIT 3")
    away = float(np.hypot(7 - 1.5, 2 - 1.5))
    assert rows == [(None,), (pytest.approx(away),), (pytest.approx(away),)]


def test_a_thing_that_never_moves_does_not_end_learning(flat: Map) -> None:
    flat["coke"].properties = {"mobility": 0}
    rows = [
        {"object": "coke", "place": place, "seen": True, "at": NOW - timedelta(seconds=200 - n)}
        for n, place in enumerate(["table"] * 70 + ["bench"] * 70)
    ]
    add_observations(flat.connection, rows)
    lifts = flat.learn_belief().lifts
    assert lifts
    assert all(np.isfinite(row["lift"]) and row["lift"] > 0 for row in lifts)


def test_people_have_no_lifts_of_objects(used: Map) -> None:
    used.add_agent("person", type="person", size=(0.5, 0.3, 1.8), pose=(1, 1, 0))
    used.observe("person", "kitchen")
    former = used.where("person", NOW).rows
    used.learn_belief()
    assert used.where("person", NOW).rows == former


def test_a_copy_believes_what_its_original_learned(make_database: MakeDatabase) -> None:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        home = db.create_map("home")
        home.add_room("hall", [(0, 0), (6, 0), (6, 4), (0, 4)], floor=0, ceiling=2.6)
        for name, x in (("a", 1), ("b", 3), ("c", 5)):
            home.add_object(name, type="table", size=(0.8, 0.8, 0.7), pose=(x, 2, 0))
        home.add_object("mug", type="mug")
        home.add_agent("rover", type="robot", size=(0.4, 0.4, 1), pose=(3, 0.5, 0))
        for age in range(1, 20):
            for place in "abc":
                at = NOW - timedelta(hours=10 * age)
                home.observe("mug", place, seen=place == "b", at=at)
        home.observe("mug", "a", seen=False, observer="rover")
        found = home.learn_belief()
        home.execute("SELECT copy_map('home', 'copy')")
        copy = db.map("copy")
        columns = "SELECT lift, by_part FROM learned_lift WHERE map_id = current_map() ORDER BY id"
        assert copy.execute(columns) == home.execute(columns)
        assert len(copy.execute(columns)) == len(found.lifts)
        at = datetime.now(UTC)
        assert copy.where("mug", at) == pytest.approx(home.where("mug", at))
        distances = "SELECT count(distance) FROM observation o JOIN entity e ON e.id = o.entity_id "
        assert copy.execute(distances + "WHERE e.map_id = current_map()") == [(1,)]


def test_a_login_that_may_not_learn_is_told_so(used: Map) -> None:
    used.execute("SET LOCAL ROLE semmap_robot")
    for learn_or_forget in (used.learn_belief, used.forget_learned):
        with pytest.raises(ValueError, match="an admin of the map may learn"):
            learn_or_forget()
