"""What is learned from histories, against lives whose truth is known."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.belief.calibration import calibrate
from semmap.belief.chain import DAY, Track, smooth
from semmap.belief.learning import (
    NOTHING,
    DetectorRates,
    Learned,
    WordLifts,
    habits,
    learn,
    lifted_prior,
    lifted_rate,
    parts_of_day,
    predicted_sightings,
    waves_of_day,
)

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


def live_by_hours(random: np.random.Generator, days: int) -> Track:
    """A thing that is put at one of two places in the morning, and at two others in the evening."""
    turns = (np.arange(days)[:, None] * 24 + random.normal((8, 20), 0.5, (days, 2))).ravel() * 3600
    goals = np.stack([random.choice([0, 1], days), random.choice([2, 3], days)], axis=1).ravel()
    at = np.sort(random.uniform(DAY, days * DAY, 30 * days))
    where = goals[np.searchsorted(turns, at) - 1]
    spots = random.integers(0, 6, len(at))
    hits = np.zeros((len(at), 7), bool)
    hits[np.arange(len(at)), spots] = True
    chance = np.where(spots == where, 0.9, 0.01)
    flags = np.zeros(len(at), bool)
    seen = random.random(len(at)) < chance
    rates = np.full(len(at), 0.9), np.full(len(at), 0.01)
    words = np.arange(6)[:, None]
    prior = np.append(np.full(6, 0.9 / 6), 0.1)
    nobody = np.full(len(at), -1)
    return Track(
        ("mug",), prior, words, 2 / DAY, at, hits, flags, seen, flags + 1.0, *rates, nobody, -3600.0
    )


@pytest.mark.parametrize("day", [parts_of_day(8), parts_of_day(6), waves_of_day(3)])
def test_habits_have_their_hours(day: np.ndarray) -> None:
    """The clock is an hour behind: at 8 h of the track it is seven in the building."""
    track = live_by_hours(np.random.default_rng(8), 30)
    known = [track.until(24 * DAY)]
    learned, steady = learn(known, day=day), learn(known)
    later = track.at >= 24 * DAY
    scores = [
        calibrate(predicted_sightings(track, one)[later], track.seen[later]).log_score
        for one in (learned, steady)
    ]
    assert scores[0] < 0.98 * scores[1]
    prior, rate = habits(track, learned)
    assert len(prior) == len(rate) == len(day)
    morning, night = (int(hour / 24 * len(day)) for hour in (7.5, 19.5))
    assert prior[morning, :2].sum() > 0.45 > 0.35 > prior[night, :2].sum()
    assert rate[morning] > 1.5 * rate[int(14 / 24 * len(day))]
    assert prior.sum(axis=1) == pytest.approx(np.ones(len(day)))
    for one in habits(track, steady):
        assert len(one) == 1


def test_waves_are_those_of_a_spectrum() -> None:
    random = np.random.default_rng(9)
    for waves in (0, 1, 4):
        counts = random.uniform(0, 5, 24)
        spectrum = np.fft.rfft(counts)
        spectrum[waves + 1 :] = 0
        assert waves_of_day(waves) @ counts == pytest.approx(np.fft.irfft(spectrum, 24))
