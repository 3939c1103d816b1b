"""Which object was where, by what was known then and since, against sums over all paths."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from semmap import Map
from semmap.belief.chain import DAY
from semmap.belief.learning import detector_rates, habits, learn
from semmap.belief.store import learning as store
from semmap.belief.store.history import read_history
from tests.belief.conftest import THESIS
from tests.seen import seen_by

NOW = datetime.now(UTC)


def hours_ago(hours: float) -> datetime:
    return NOW - timedelta(hours=hours)


@pytest.fixture
def mugs(flat: Map) -> Map:
    """Two mugs: one was seen on the bench before and after, the other one on the table."""
    flat.add_object("cup", type="mug", size=(0.08, 0.08, 0.1))
    for hours in (30, 20, 2):
        flat.observe("cup", "bench", at=hours_ago(hours))
        flat.observe("cup", "table", seen=False, at=hours_ago(hours))
        flat.observe("mug", "table", at=hours_ago(hours))
    return flat


def test_the_mug_that_was_here_yesterday(mugs: Map) -> None:
    found = mugs.which("drinkware", "bench", hours_ago(25))
    assert [*found] == ["cup", "mug"]
    assert found["cup"] > 0.7 > 0.2 > found["mug"]
    assert [*mugs.which("drinkware", "table", hours_ago(25))] == ["mug", "cup"]


def test_a_place_that_holds_places_is_their_sum(mugs: Map) -> None:
    """Of the future, where nothing is seen since: the belief in each of the places."""
    at = NOW + timedelta(hours=3)
    places = ("kitchen", "table", "counter", "fridge")
    room = mugs.which("drinkware", "kitchen", at)
    assert {*room} == {"mug", "cup"}
    for name, share in room.items():
        expected = sum(mugs.where(name, at)[place] for place in places)
        assert share == pytest.approx(expected, abs=1e-6)


def test_now_it_is_the_belief(mugs: Map) -> None:
    """What nothing was seen of since: the pass back says nothing new."""
    for learned in (False, True):
        if learned:
            mugs.learn_belief()
        at = datetime.now(UTC) + timedelta(hours=5)
        for place in ("bench", "table", "fridge"):
            found = mugs.which("drinkware", place, at)
            for name in ("mug", "cup"):
                assert found[name] == pytest.approx(mugs.where(name, at)[place], abs=1e-6)


def test_a_look_since_then_counts_by_bayes(flat: Map) -> None:
    """P(there an hour before it was seen there): by two places and one look."""
    flat.execute("DELETE FROM placement WHERE entity_id = entity_id('coke')")
    flat.execute("DELETE FROM placement_history WHERE entity_id = entity_id('coke')")
    at = hours_ago(2)
    flat.observe("coke", "bench", at=at + timedelta(hours=1), hit=0.8, false_alarm=0.1)
    prior = {row["place"]: row["prior"] for row in flat.where("coke").rows}["bench"]
    stays = min(np.exp(-3600 / DAY), 0.99)
    there = stays * 0.8 + (1 - stays) * (prior * 0.8 + (1 - prior) * 0.1)
    away = stays * 0.1 + (1 - stays) * (prior * 0.8 + (1 - prior) * 0.1)
    expected = prior * there / (prior * there + (1 - prior) * away)
    flat.execute("DELETE FROM placement WHERE entity_id = entity_id('coke')")
    flat.execute("DELETE FROM placement_history WHERE entity_id = entity_id('coke')")
    assert flat.which("coke", "bench", at)["coke"] == pytest.approx(expected, abs=1e-6)


def test_what_was_learned_is_read_as_it_was_kept(mugs: Map) -> None:
    mugs.learn_belief()
    history = read_history(seen_by(mugs.connection))
    kept = store.read_learned(mugs.connection, history)
    learned = learn(history.tracks, history.detectors, stated=history.stated, day=store.PARTS)
    for track in history.tracks:
        for one, other in zip(habits(track, kept), habits(track, learned), strict=True):
            assert one == pytest.approx(other)
        rates = [detector_rates(track, history.detectors, known) for known in (kept, learned)]
        assert np.array(rates[0]) == pytest.approx(np.array(rates[1]))


def test_unknown_names_and_agents_are_refused(flat: Map) -> None:
    with pytest.raises(LookupError, match="nowhere"):
        flat.which("mug", "nowhere")
    with pytest.raises(LookupError, match="unicorn"):
        flat.which("unicorn", "table")
    with pytest.raises(ValueError, match="robot is an agent"):
        flat.which("robot", "kitchen")


def test_a_place_that_the_map_states_again_later_was_its_place_before(flat: Map) -> None:
    """It was put on the bench five days ago and now; it is known from both."""
    flat.execute("DELETE FROM placement_history WHERE entity_id = entity_id('mug')")
    flat.execute(
        "INSERT INTO placement_history (entity_id, holder_id, pose, relation, during) "
        "VALUES (entity_id('mug'), entity_id('bench'), '{0,0,0.5,0,0,0,1}', 'on', "
        "tstzrange(now() - interval '5 days', now() - interval '3 days'))"
    )
    found = flat.which("mug", "bench", hours_ago(5 * 24 - 1))
    assert found["mug"] > 0.9


def test_a_statement_after_a_wide_look_counts(flat: Map) -> None:
    """It was seen somewhere in the kitchen; a day later it was put on the table."""
    flat.observe("coke", "kitchen", at=hours_ago(30))
    flat.execute(
        "INSERT INTO placement (entity_id, holder_id, pose, relation) VALUES "
        "(entity_id('coke'), entity_id('table'), '{0,0,0.75,0,0,0,1}', 'on')"
    )
    at = datetime.now(UTC)
    expected = flat.where("coke", at)["table"]
    assert expected > 0.9
    assert flat.which("coke", "table", at)["coke"] == pytest.approx(expected, abs=1e-6)
    ((since,),) = flat.execute("SELECT since FROM placement WHERE entity_id = entity_id('coke')")
    assert flat.which("coke", "table", since)["coke"] > 0.9


def test_old_looks_of_the_thesis_say_less(flat: Map) -> None:
    flat.execute("DELETE FROM placement WHERE entity_id = entity_id('coke')")
    flat.execute(THESIS)
    flat.observe("coke", "counter", at=hours_ago(1))
    at = datetime.now(UTC)
    found = flat.which("coke", "counter", at)["coke"]
    assert found == pytest.approx(flat.where("coke", at)["counter"], abs=1e-6)


def test_what_is_no_place_of_it_is_refused(flat: Map) -> None:
    for place in ("cereal", "robot"):
        with pytest.raises(ValueError, match=f"{place} is no place of mug"):
            flat.which("mug", place)
    assert flat.which("mug", "bench")["mug"] > 0.9  # now, by the clock of the database
