"""What is learned from histories, against sums over all paths and lives whose truth is known."""

from __future__ import annotations

import itertools
import math
from collections.abc import Hashable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.belief.calibration import calibrate
from semmap.belief.learning import (
    NOTHING,
    UNMOVED,
    DetectorRates,
    Learned,
    Track,
    WordLifts,
    learn,
    lifted_prior,
    lifted_rate,
    predicted_sightings,
    smooth,
)

DAY = 86_400.0


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
    assert found.ends == pytest.approx(ends / total, abs=1e-9)
    assert found.moves == pytest.approx(moves / total, abs=1e-9)
    assert found.seconds == pytest.approx(track.at[-1] - track.at[0])


KINDS = ("mug", "book")
ROOMS = np.repeat([0, 1, 2], 4)
WORDS = np.stack([ROOMS, 3 + np.arange(12) % 4, 7 + np.arange(12)], axis=1)
DETECTORS: list[tuple[Hashable, ...]] = [("robot", 2.0), ("robot",)]
HITS, FALSE_ALARM = np.array([0.85, 0.5]), 0.01
RATES = {"mug": 6 / DAY, "book": 1 / DAY}
EVEN = np.append(np.full(12, 0.9 / 12), 0.1)


class Life:
    """Days of some things: their true habits and places, and what a robot saw of them."""

    def __init__(self, seed: int, things: int = 6, days: int = 28, looks: int = 60) -> None:
        random = np.random.default_rng(seed)
        habits = {kind: random.dirichlet(np.full(12, 0.4)) for kind in KINDS}
        self.habits, self.tracks, self.truth = habits, [], []
        for thing in range(things):
            kind = KINDS[thing % 2]
            goals = np.append(0.9 * habits[kind], 0.1)
            moves = np.sort(random.uniform(0, days * DAY, random.poisson(RATES[kind] * days * DAY)))
            stays = random.choice(13, len(moves) + 1, p=goals)
            at = np.sort(random.uniform(0, days * DAY, looks * days))
            spots, detector = random.integers(0, 12, len(at)), random.integers(0, 2, len(at))
            where = stays[np.searchsorted(moves, at)]
            visible = random.uniform(0.5, 1, len(at))
            chance = visible * np.where(spots == where, HITS[detector], FALSE_ALARM)
            hits = np.zeros((len(at), 13), bool)
            hits[np.arange(len(at)), spots] = True
            self.truth.append(where)
            self.tracks.append(
                Track(
                    ("object", kind, thing),
                    EVEN,
                    WORDS,
                    1 / DAY,
                    at,
                    hits,
                    np.zeros(len(at), bool),
                    random.random(len(at)) < chance,
                    visible,
                    np.full(len(at), 0.9),
                    np.full(len(at), 0.02),
                    detector,
                )
            )


@pytest.fixture(scope="module")
def life() -> Life:
    """Four weeks of three mugs and three books."""
    return Life(1)


@pytest.fixture(scope="module")
def learned(life: Life) -> Learned:
    """What the first three weeks teach."""
    return learn([track.until(21 * DAY) for track in life.tracks], DETECTORS)


def test_habits_and_moves_are_near_those_of_the_life(life: Life, learned: Learned) -> None:
    """A book is moved about 21 times in the three weeks: that is what its habits are seen by."""
    left = []
    for track in life.tracks:
        kind = str(track.subjects[1])
        goals = np.append(0.9 * life.habits[kind], 0.1)
        off = np.abs(lifted_prior(track, learned) - goals).sum()
        left.append(off / np.abs(track.prior - goals).sum())
        assert 0.4 < lifted_rate(track, learned) / RATES[kind] < 1.6
    assert max(left) < 0.9
    assert np.mean(left) < 0.6


def test_rates_of_detectors_are_near_those_of_the_life(learned: Learned) -> None:
    for names, hit in zip(DETECTORS, HITS, strict=True):
        if len(names) > 1:  # the other one has no distance: its rates are of both
            assert learned.detectors[names].hit == pytest.approx(hit, abs=0.1)
    assert learned.detectors[()].hit == pytest.approx(HITS.mean(), abs=0.1)
    assert learned.detectors[()].false_alarm == pytest.approx(FALSE_ALARM, abs=0.006)


def test_later_days_are_calibrated_by_the_truth(life: Life, learned: Learned) -> None:
    """Each place at the time of each look, and whether the thing was there in truth."""
    judged = {}
    for name, known in (("before", NOTHING), ("after", learned)):
        chance, true = [], []
        for track, where in zip(life.tracks, life.truth, strict=True):
            later = track.at >= 21 * DAY
            prior, rate = lifted_prior(track, known), lifted_rate(track, known)
            hit = np.where(track.detector == 0, *HITS)
            forecast = smooth(track, prior, rate, hit, np.full(len(hit), 0.01), 0.95).forecast
            chance.append(forecast[later].ravel())
            true.append((where[later][:, None] == np.arange(13)).ravel())
        chances = np.concatenate(chance)
        rows = (chances > 0.05) & (chances < 0.95)  # the others are nearly all sure to be 0
        judged[name] = calibrate(chances[rows], np.concatenate(true)[rows])
    assert judged["after"].error < 0.06
    assert judged["after"].log_score < 0.9 * judged["before"].log_score


def test_sightings_of_later_days_are_foretold(life: Life, learned: Learned) -> None:
    scores = {}
    for name, known in (("before", NOTHING), ("after", learned)):
        later = [track.at >= 21 * DAY for track in life.tracks]
        chance = [
            predicted_sightings(track, known, DETECTORS)[rows]
            for track, rows in zip(life.tracks, later, strict=True)
        ]
        seen = [track.seen[rows] for track, rows in zip(life.tracks, later, strict=True)]
        scores[name] = calibrate(np.concatenate(chance), np.concatenate(seen))
    assert scores["after"].error < 0.02
    assert scores["after"].log_score < scores["before"].log_score


def test_a_forecast_knows_nothing_of_its_look(life: Life) -> None:
    track = life.tracks[0].until(2 * DAY)
    last = len(track.at) - 1
    other = replace(track, seen=track.seen ^ (np.arange(last + 1) == last))
    args = track.prior, 1e-4, track.hit, track.false_alarm, 0.95
    one, two = smooth(track, *args).forecast, smooth(other, *args).forecast
    assert one == pytest.approx(two, abs=0)


def test_what_nobody_has_seen_has_the_habits_of_its_type(life: Life, learned: Learned) -> None:
    for kind in KINDS:
        fresh = replace(life.tracks[0], subjects=("object", kind, "new"))
        goals = np.append(0.9 * life.habits[kind], 0.1)
        off = np.abs(lifted_prior(fresh, learned) - goals).sum()
        assert off < 0.6 * np.abs(EVEN - goals).sum()
    unknown = replace(life.tracks[0], subjects=("object", "umbrella", "new"))
    every = replace(life.tracks[0], subjects=("object",))
    assert lifted_prior(unknown, learned) == pytest.approx(lifted_prior(every, learned))


def test_a_place_that_is_new_has_the_lifts_of_its_room_and_type(learned: Learned) -> None:
    """It is as likely as by its room and its type, which no look at it can have said."""
    lifts = learned.places["mug", 0].lift
    room = int(np.argmax(lifts[:3]))
    other = (room + 1) % 3
    words = np.array([[room, 99, 100], [other, 99, 101]])
    fresh = Track(("mug",), np.array([0.5, 0.5, 0.0]), words, 1.0, *[np.empty(0)] * 8)  # type: ignore[arg-type]
    due = lifts[[room, other]]
    assert lifted_prior(fresh, learned)[:2] == pytest.approx(due / due.sum())
    assert due[0] > 1


def test_one_thing_with_many_moves_is_not_its_type() -> None:
    """A mug that was seen a hundred times at one place, and three that are at another."""
    look = np.ones(1, bool)

    def seen_at(name: str, place: int, times: int) -> Track:
        hits = np.zeros((times, 3), bool)
        hits[:, place] = True
        at = np.arange(times) * 100 * DAY
        flags = np.repeat(look, times)
        rates = np.full(times, 0.9), np.full(times, 0.001)
        words, nobody = np.array([[0], [1]]), np.full(times, -1)
        prior = np.array([0.45, 0.45, 0.1])
        subjects = ("object", name[:3], name)
        return Track(
            subjects, prior, words, 1 / DAY, at, hits, ~flags, flags, flags * 1.0, *rates, nobody
        )

    tracks = [seen_at("mug1", 0, 1000), *(seen_at(f"mug{n}", 1, 20) for n in (2, 3, 4))]
    found = learn([*tracks, seen_at("book", 0, 20)])
    fresh = replace(tracks[0], subjects=("object", "mug", "new"))
    assert lifted_prior(fresh, found)[1] > 0.5
    assert lifted_prior(tracks[0], found)[0] > 0.8


@given(
    st.lists(st.floats(0.01, 1), min_size=2, max_size=6),
    st.lists(st.floats(0.01, 100), min_size=5, max_size=5),
)
def test_a_lifted_prior_is_a_distribution(shares: list[float], lifts: list[float]) -> None:
    prior = np.array(shares) / sum(shares)
    words = np.arange(len(prior) - 1)[:, None] % 5
    track = Track(("a", "b"), prior, words, 1.0, *[np.empty(0)] * 8)  # type: ignore[arg-type]
    known = {("b", 0): WordLifts(np.array(lifts), np.ones(5), np.ones(5))}
    found = lifted_prior(track, Learned(known, {}, {}))
    assert found.sum() == pytest.approx(1)
    assert found[-1] == pytest.approx(prior[-1])
    ratio = found[:-1] / prior[:-1]
    expected = np.array(lifts)[words[:, 0]]
    assert ratio / ratio[0] == pytest.approx(expected / expected[0])


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


def test_rates_of_a_detector_fall_back_to_the_general_ones(life: Life) -> None:
    known = Learned({}, {}, {(): DetectorRates(0.4, 0.01, 1, 1)})
    track = life.tracks[0].until(DAY)
    chance = predicted_sightings(track, known, DETECTORS)
    stated = replace(
        track, hit=np.full(len(track.at), 0.4), false_alarm=np.full(len(track.at), 0.01)
    )
    assert chance == pytest.approx(predicted_sightings(stated, NOTHING, DETECTORS))


@given(st.lists(st.tuples(st.integers(0, 20), st.booleans()), min_size=1, max_size=60))
def test_calibration_is_the_mean_of_groups(rows: list[tuple[int, bool]]) -> None:
    chance, true = np.array(rows, float).T
    chance = chance / 20
    found = calibrate(chance, true, groups=4)
    assert found.count.sum() == len(rows)
    assert (np.diff(found.predicted) > 0).all()
    end = np.cumsum(found.count)
    order = np.argsort(chance, kind="stable")
    for group, (first, last) in enumerate(zip([0, *end[:-1]], end, strict=True)):
        own = order[first:last]
        assert found.predicted[group] == pytest.approx(chance[own].mean())
        assert found.observed[group] == pytest.approx(true[own].mean())
        assert last == len(rows) or chance[order[last]] > chance[order[last - 1]]
    gaps = np.abs(found.predicted - found.observed)
    assert found.error == pytest.approx((gaps * found.count).sum() / len(rows))
    assert found.brier_score == pytest.approx(np.mean((chance - true) ** 2))
