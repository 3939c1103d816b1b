"""Where a thing was, against sums over all paths, and against a chain in short steps."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from semmap.belief.chain import DAY, UNMOVED, Track, smooth


def random_track(random: np.random.Generator, size: int, places: int) -> Track:
    """Looks and statements without a meaning."""
    hits = np.zeros((size, places), bool)
    hits[np.arange(size), random.integers(0, places, size)] = True
    told = random.random(size) < 0.3
    return Track(
        ("thing",),
        random.dirichlet(np.ones(places)),
        np.arange(places - 1)[:, None],
        1e-5,
        np.sort(random.uniform(0, 3 * DAY, size)),
        hits,
        told,
        ~told & (random.random(size) < 0.5),
        random.uniform(0.2, 1, size),
        random.uniform(0.5, 0.95, size),
        random.uniform(0.01, 0.3, size),
        np.full(size, -1),
    )


@pytest.mark.parametrize("seed", range(6))
def test_smoothing_is_the_sum_over_all_paths(seed: int) -> None:
    """A path has for each entry: moved or not, the place, put or not, and the place then."""
    random = np.random.default_rng(seed)
    size, places, stated, rate = 3, 3, 0.9, 2e-5
    track = random_track(random, size, places)
    prior = track.prior
    track.at[1:] = track.at[0] + np.array([30.0, 2e4])  # in 30 s it stays but for the floor
    found = smooth(track, prior, rate, track.hit, track.false_alarm, stated)

    total, moves, ends, there = 0.0, 0.0, np.zeros(places), np.zeros(size)
    steps = [*itertools.product((False, True), range(places), (False, True), range(places))]
    for first in range(places):
        for path in itertools.product(steps, repeat=size):
            weight, was, counted, ended = float(prior[first]), first, 0.0, [(first, 1.0)]
            for i, (moved, here, put, then) in enumerate(path):
                gap = track.at[i] - track.at[i - 1] if i else 0.0
                real = math.exp(-rate * gap)
                keep = min(real, UNMOVED) if track.seen[i] and gap > 0 else real
                weight *= (1 - keep) * prior[here] if moved else keep * (here == was)
                if moved and keep < 1:
                    counted += rate * gap / (1 - keep)  # with those that nobody can see
                    ended.append((here, (1 - real) / (1 - keep)))
                (spot,) = np.flatnonzero(track.hits[i])
                if track.told[i]:
                    weight *= stated * (then == spot) if put else (1 - stated) * (then == here)
                    if put and here != spot:
                        counted += 1
                        ended.append((then, 1.0))
                else:
                    share = 1 if track.seen[i] else track.visible[i]
                    chance = share * (track.hit if here == spot else track.false_alarm)[i]
                    weight *= (chance if track.seen[i] else 1 - chance) * (then == here) * (not put)
                was = then
            if weight == 0:
                continue
            total += weight
            moves += weight * counted
            for place, share in ended:
                ends[place] += weight * share
            for i, (_, _, _, then) in enumerate(path):
                there[i] += weight * bool(track.hits[i][then])
    assert found.there == pytest.approx(there / total, abs=1e-9)
    assert found.ends[0] == pytest.approx(ends / total, abs=1e-9)
    assert found.moves == pytest.approx([moves / total], abs=1e-9)
    assert found.seconds == pytest.approx([track.at[-1] - track.at[0]])


MINUTE = 60.0


@pytest.mark.parametrize("seed", range(4))
def test_parts_of_the_day_are_those_of_a_chain_in_short_steps(seed: int) -> None:
    """Forward and back over each minute of some days, by matrices."""
    random = np.random.default_rng(seed)
    parts, places, size = int(random.integers(2, 7)), 3, 8
    prior = random.dirichlet(np.ones(places), parts)
    rate = random.uniform(0.1, 4, parts) / DAY
    minutes = np.sort(random.choice(np.arange(10, 4000), size, replace=False))
    minutes += np.arange(size) * 30  # so long that what is seen may have moved
    track = replace(
        random_track(random, size, places),
        at=minutes * MINUTE,
        told=np.zeros(size, bool),
        seen=random.random(size) < 0.6,
        clock=float(random.integers(-20, 20)) * 1800,
    )
    found = smooth(track, prior, rate, track.hit, track.false_alarm, 0.95)

    def part_at(minute: float) -> int:
        seconds = ((minute + 0.5) * MINUTE + float(track.clock)) % DAY
        return int(seconds // (DAY / parts))

    def moving(minute: int) -> float:
        return -math.expm1(-rate[part_at(minute)] * MINUTE)

    def step(minute: int) -> np.ndarray:
        stays = (1 - moving(minute)) * np.eye(places)
        return stays + moving(minute) * prior[part_at(minute)]

    day = np.eye(places)
    for minute in range(minutes[0] - 1440, minutes[0]):
        day = day @ step(minute)
    belief = prior[0] @ np.linalg.matrix_power(day, 200)
    assert found.forecast[0] == pytest.approx(belief, abs=1e-6)
    view = np.where(track.seen, 1.0, track.visible)[:, None]
    chance = view * np.where(track.hits, track.hit[:, None], track.false_alarm[:, None])
    likely = np.where(track.seen[:, None], chance, 1 - chance)

    alphas, entry = [], 0
    for minute in range(minutes[0], minutes[-1] + 1):
        if minute == minutes[entry]:
            assert found.forecast[entry] == pytest.approx(belief, abs=1e-6)
            belief = belief * likely[entry]
            belief, entry = belief / belief.sum(), entry + 1
        alphas.append(belief)
        belief = belief @ step(minute)
    moves, ends, later = np.zeros(parts), np.zeros((parts, places)), np.ones(places)
    alive, target = 1.0, later
    for minute in range(minutes[-1], minutes[0] - 1, -1):
        before, part = alphas[minute - minutes[0]], part_at(minute)
        if minute < minutes[-1]:
            share = before @ step(minute) @ later
            moves[part] += moving(minute) * prior[part] @ later / share
            ends[part] += moving(minute) * prior[part] * alive * target / share
            alive *= 1 - moving(minute)
            later = step(minute) @ later
        if minute in minutes:
            entry = int(np.searchsorted(minutes, minute))
            here = before * later / (before @ later)
            assert found.there[entry] == pytest.approx(here[track.hits[entry]].sum(), abs=1e-6)
            later = later * likely[entry]
            alive, target = 1.0, later
    mix = np.zeros(parts)
    for minute in range(minutes[0] - 1, minutes[0] - 1441, -1):
        mix[part_at(minute)] += alive * moving(minute)
        alive *= 1 - moving(minute)
    first = mix[:, None] * prior * later
    assert found.ends == pytest.approx(ends + first / first.sum(), abs=1e-6)
    assert found.moves == pytest.approx(moves, rel=0.01, abs=1e-3)
    spent = np.bincount([part_at(m) for m in range(minutes[0], minutes[-1])], minlength=parts)
    assert found.seconds == pytest.approx(spent * MINUTE, abs=2 * MINUTE * len(minutes))


def test_days_with_one_habit_are_as_one_without_hours() -> None:
    random = np.random.default_rng(5)
    track = random_track(random, 40, 4)
    args = track.hit, track.false_alarm, 0.95
    one = smooth(track, track.prior, 2 / DAY, *args)
    parts = smooth(track, np.tile(track.prior, (6, 1)), np.full(6, 2 / DAY), *args)
    assert parts.forecast == pytest.approx(one.forecast, abs=1e-9)
    assert parts.there == pytest.approx(one.there, abs=1e-9)
    assert parts.ends.sum(axis=0) == pytest.approx(one.ends[0], abs=1e-9)
    assert parts.moves.sum() == pytest.approx(one.moves[0], abs=1e-9)
    assert parts.seconds.sum() == pytest.approx(one.seconds[0])


def test_a_thing_that_never_moves_has_hours_too() -> None:
    """It was put there some time: by the prior of all hours."""
    random = np.random.default_rng(6)
    track = random_track(random, 5, 3)
    prior = random.dirichlet(np.ones(3), 4)
    found = smooth(track, prior, np.zeros(4), track.hit, track.false_alarm, 0.95)
    assert found.forecast[0] == pytest.approx(prior.mean(axis=0), abs=1e-9)
    assert np.isfinite(found.ends).all()
    assert found.ends.sum() >= 1


def test_a_forecast_knows_nothing_of_its_look() -> None:
    random = np.random.default_rng(7)
    track = random_track(random, 60, 5)
    last = len(track.at) - 1
    other = replace(
        track, seen=track.seen ^ (np.arange(last + 1) == last), told=np.zeros(last + 1, bool)
    )
    track = replace(track, told=other.told)
    args = random.dirichlet(np.ones(5), 3), np.array([1, 2, 3]) / DAY
    rates = track.hit, track.false_alarm, 0.95
    one, two = smooth(track, *args, *rates).forecast, smooth(other, *args, *rates).forecast
    assert one == pytest.approx(two, abs=0)


def test_no_number_of_looks_is_beyond_doubt() -> None:
    """Two places in turn, of a thing that never moves: each likelihood alone would underflow."""
    size = 1000
    hits = np.zeros((size, 3), bool)
    hits[: size // 2, 0] = hits[size // 2 :, 1] = True
    flags, rates = np.ones(size, bool), (np.full(size, 0.9), np.full(size, 1e-6))
    track = Track(
        ("mug",),
        np.array([0.4, 0.4, 0.2]),
        np.array([[0], [1]]),
        0.0,
        np.arange(size) * 1.0,
        hits,
        ~flags,
        flags,
        flags * 1.0,
        *rates,
        np.full(size, -1),
    )
    found = smooth(track, track.prior, 0.0, *rates, 0.95)
    assert found.forecast[-1] == pytest.approx([0, 1, 0], abs=1e-6)
    assert np.isfinite(found.there).all()
    assert found.ends.sum() == pytest.approx(1)


def test_what_the_map_states_is_a_move_at_its_hour() -> None:
    """Put at the second place at one in the afternoon, by a clock that is an hour behind."""
    hits = np.array([[True, False, False], [False, True, False]])
    flags, rates = np.array([False, True]), (np.full(2, 0.9), np.full(2, 0.001))
    at, words = np.array([2.0, 14.0]) * 3600, np.array([[0], [1]])
    prior = np.array([0.4, 0.4, 0.2])
    nobody = np.full(2, -1)
    track = Track(
        ("mug",), prior, words, 0.0, at, hits, flags, ~flags, flags + 1.0, *rates, nobody, -3600.0
    )
    found = smooth(track, np.tile(prior, (4, 1)), np.full(4, 1e-12), *rates, 0.95)
    assert found.moves == pytest.approx([0, 0, 0.95, 0], abs=0.01)
    assert found.ends[2, 1] == pytest.approx(0.95, abs=0.01)
