"""Habits that follow the hours of the day, in the database: against steps from part to part."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from semmap import Map
from semmap.belief.chain import DAY
from semmap.belief.store.history import read_history
from semmap.belief.store.learning import PARTS
from tests.seen import seen_by


def put_by_steps(
    rates: list[float], by_part: np.ndarray, clock: float, seconds: float
) -> tuple[np.ndarray, float]:
    """Where a thing is that moved, going forward from one part of the day to the next."""
    length = DAY / len(rates)
    put, moved, now, end = np.zeros(by_part.shape[1]), 0.0, clock - seconds, clock
    while now < end:
        cell = math.floor(now / length + 1e-9)
        stop = min((cell + 1) * length, end)
        part = cell % len(rates)
        gone = -math.expm1(-rates[part] * (stop - now))
        put = (1 - gone) * put + gone * by_part[part]
        moved = (1 - gone) * moved + gone
        now = stop
    return put, moved


@settings(max_examples=80, deadline=None, suppress_health_check=[*HealthCheck])
@given(
    st.integers(1, 8),
    st.integers(0, 1000),
    st.floats(0, 5 * DAY),
    st.one_of(st.floats(1, DAY), st.floats(DAY, 40 * DAY), st.sampled_from([0.0, DAY, 3 * DAY])),
)
def test_put_is_by_the_part_of_the_last_move(
    flat: Map, parts: int, seed: int, clock: float, seconds: float
) -> None:
    random = np.random.default_rng(seed)
    rates = (random.uniform(0.01, 6, parts) / DAY).tolist()
    by_part = random.dirichlet(np.ones(4), parts)
    ((found,),) = flat.execute(
        "SELECT put_until(%s, %s, %s, %s)", rates, by_part.ravel().tolist(), clock, seconds
    )
    put, moved = put_by_steps(rates, by_part, clock, seconds)
    assert found[-1] == pytest.approx(1 - moved, abs=1e-9)
    if moved > 1e-6:
        assert np.array(found[:-1]) == pytest.approx(put / moved, abs=1e-6)


def live_by_hours(flat: Map, zone: str, days: int = 20) -> None:
    """The mug is on the table from six to noon and on the bench else, by the clock of a zone."""
    today = datetime.now(ZoneInfo(zone)).replace(hour=0, minute=0, second=0, microsecond=0)
    for day in range(1, days):
        for hour in (1, 4, 7, 8, 10, 11, 13, 16, 19, 22):
            at = (today - timedelta(days=day)).replace(hour=hour, minute=30)
            place = "table" if 6 <= hour < 12 else "bench"
            other = "bench" if place == "table" else "table"
            flat.observe("mug", place, at=at)
            flat.observe("mug", other, seen=False, at=at)


@pytest.mark.parametrize("zone", ["UTC", "Asia/Tokyo", "America/New_York"])
def test_where_it_is_at_eight_in_the_morning_is_by_the_clock_of_the_building(
    flat: Map, zone: str
) -> None:
    live_by_hours(flat, zone)
    flat.learn_belief(time_zone=zone)
    tomorrow = datetime.now(ZoneInfo(zone)) + timedelta(days=2)
    places = {
        hour: flat.where("mug", tomorrow.replace(hour=hour, minute=30)).best for hour in (8, 20)
    }
    assert places == {8: "table", 20: "bench"}
    flat.forget_learned()
    plain = [flat.where("mug", tomorrow.replace(hour=hour), moves=3600.0) for hour in (8, 20)]
    assert plain[0]["table"] == pytest.approx(plain[1]["table"], abs=1e-6)


def test_rows_have_as_many_numbers_as_the_day_has_parts(flat: Map) -> None:
    live_by_hours(flat, "UTC", 4)
    rows = flat.learn_belief().lifts
    assert {len(row["by_part"]) for row in rows} == {len(PARTS)}
    (moves,) = (r["by_part"] for r in rows if (r["subject"], r["about"]) == ("mug", "moves"))
    assert max(moves) > 1.1 * min(moves)


def test_summer_time_moves_the_clock_and_not_the_time_that_passed(flat: Map) -> None:
    """The night of 2026-03-29 in Berlin has 23 hours."""
    for hour in (0, 3):
        at = datetime(2026, 3, 29, hour, 30, tzinfo=UTC)
        flat.observe("mug", "table", at=at)
    flat.execute(
        "INSERT INTO belief_model (map_id, time_zone) VALUES (current_map(), 'Europe/Berlin')"
    )
    history = read_history(seen_by(flat.connection))
    (mug,) = (track for track in history.tracks if track.subjects[-1] == flat["mug"].id)
    looks = ~mug.told
    assert np.diff(mug.at[looks]) == pytest.approx([3 * 3600])
    assert np.broadcast_to(mug.clock, mug.at.shape)[looks].tolist() == [3600, 7200]


def test_a_time_zone_that_nobody_has_is_refused(flat: Map) -> None:
    flat.observe("mug", "table")
    with pytest.raises(ValueError, match="Mars/Olympus"):
        flat.learn_belief(time_zone="Mars/Olympus")
    assert flat.execute("SELECT count(*) FROM learned_lift") == [(0,)]
    with pytest.raises(ValueError, match='time zone "x" not recognized'):
        flat.execute("INSERT INTO belief_model (map_id, time_zone) VALUES (current_map(), 'x')")


def test_a_zone_that_postgresql_reads_the_other_way_round_is_refused(flat: Map) -> None:
    flat.observe("mug", "table")
    with pytest.raises(ValueError, match="there is no time zone UTC"):
        flat.learn_belief(time_zone="UTC+2")
    with pytest.raises(ValueError, match="time zone is known"):
        flat.execute("INSERT INTO belief_model (map_id, time_zone) VALUES (current_map(), 'UTC+2')")


def test_what_never_moves_stays_and_has_been_put_by_all_hours(flat: Map) -> None:
    by_part = [0.9, 0.1, 0.5, 0.5]
    for seconds in (DAY, 400 * DAY):
        ((found,),) = flat.execute("SELECT put_until('{0,0}', %s, 3600, %s)", by_part, seconds)
        assert found[2] == 1
        assert found[:2] == pytest.approx([0.7, 0.3], abs=1e-5)
        assert sum(found[:2]) == pytest.approx(1, abs=1e-12)


def test_several_things_are_believed_as_each_of_them_alone(flat: Map) -> None:
    live_by_hours(flat, "Asia/Tokyo", 6)
    for hours in (3, 9):
        flat.observe("coke", "counter", at=datetime.now(UTC) - timedelta(hours=hours))
    flat.learn_belief(time_zone="Asia/Tokyo")
    ids = [flat[name].id for name in ("mug", "coke")]
    at = datetime.now(UTC) + timedelta(hours=7)
    columns = "SELECT entity_id, place_id, probability FROM belief_at(%s, %s) ORDER BY 1, 2"
    together = flat.execute(columns, ids, at)
    alone = [row for one in sorted(ids) for row in flat.execute(columns, [one], at)]
    assert [row[:2] for row in together] == [row[:2] for row in alone]
    assert [row[2] for row in together] == pytest.approx([row[2] for row in alone], abs=1e-12)
