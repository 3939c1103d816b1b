"""Learn from a map's history where things are kept, how often they move, and what detectors see.

A thing is at one of its places, a hidden Markov chain (`semmap.belief.chain`). What the map states
and what was looked for say where it was. Expectation maximisation finds the moves, where they
ended, and how often a look saw what was there.

What is learned are lifts: how many times as often as expected something happened to a subject,

    lift = (seen + strength) / (expected + strength),

with what the lifts before it lead to as the expected. Subjects are types, the general ones first,
and then the thing itself, so that a rare type has what its supertypes have; words about places
are the type of the room, the room, the type of the place, and the place. Few counts change
little, many fit (the mean of a gamma distribution after Poisson counts: DuMouchel, "Bayesian data
mining in large frequency tables", 1999). What was taught is in the prior that lifts start from.

Habits follow the clock. The day has parts of equal length, in each of which things move at a rate
and to places of its own: lifts by part, fitted after those of the whole day. The parts are apart
(a piecewise constant hazard), or what they count is smoothed to a few waves of the day (a spectrum:
Krajnik et al., "FreMEn", IEEE Transactions on Robotics 33, 2017).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.belief.chain import Smoothed, Track, smooth

Floats = NDArray[np.float64]

HOURLY = 2.0
"""How many times as many counts the whole day is worth for a part of it."""


@dataclass(frozen=True)
class MoveLift:
    """How many times as often as `expected` something was `seen`, with smoothing.

    `by_part` (W,) are those of each part of the day, to the whole day; None for none.
    """

    lift: float
    seen: float
    expected: float
    by_part: Floats | None = None


@dataclass(frozen=True, eq=False)
class WordLifts:
    """The same for each word about places: (words,) each; 1 where nothing was expected.

    `by_part` is (W, words).
    """

    lift: Floats
    seen: Floats
    expected: Floats
    by_part: Floats | None = None


@dataclass(frozen=True)
class DetectorRates:
    """P(seen | there) and P(seen | not there), from so many looks at where things were, and not."""

    hit: float
    false_alarm: float
    there: float
    elsewhere: float


@dataclass(frozen=True)
class Learned:
    """Lifts of places by subject and kind of word; of moves by subject; rates by detector.

    A detector is a tuple of names, the general one first; () are all.
    """

    places: Mapping[tuple[Hashable, int], WordLifts]
    moves: Mapping[Hashable, MoveLift]
    detectors: Mapping[tuple[Hashable, ...], DetectorRates]
    parts: int = 1
    """Of the day: W."""


NOTHING = Learned({}, {}, {})


def lifted_prior(track: Track, learned: Learned) -> Floats:
    """The prior of a thing (P,) with what was learned; the share of *elsewhere* stays."""
    return _share(track, _lift_of_places(track, learned))


def lifted_rate(track: Track, learned: Learned) -> float:
    """The moves of a thing in a second, with what was learned."""
    lifts = [learned.moves[one].lift for one in track.subjects if one in learned.moves]
    return float(track.rate * np.prod(lifts))


def habits(track: Track, learned: Learned) -> tuple[Floats, Floats]:
    """The priors (W, P) and moves in a second (W,) of a thing in each part of the day."""
    lift = _lift_of_places(track, learned)
    by_part = np.ones((learned.parts, len(lift)))
    rates = np.full(learned.parts, lifted_rate(track, learned))
    for subject in track.subjects:
        moves = learned.moves.get(subject)
        if moves is not None and moves.by_part is not None:
            rates *= moves.by_part
        for kind, words in enumerate(track.words.T):
            found = learned.places.get((subject, kind))
            if found is not None and found.by_part is not None:
                known = (words >= 0) & (words < len(found.lift))
                by_part[:, known] *= found.by_part[:, words[known]]
    return np.array([_share(track, lift * one) for one in by_part]), rates


def _lift_of_places(track: Track, learned: Learned) -> Floats:
    lift = np.ones(len(track.prior) - 1)
    for subject in track.subjects:
        for kind, words in enumerate(track.words.T):
            found = learned.places.get((subject, kind))
            if found is not None:
                known = (words >= 0) & (words < len(found.lift))
                lift[known] *= found.lift[words[known]]
    return lift


def _share(track: Track, lift: Floats) -> Floats:
    weight = track.prior[:-1] * lift
    total = weight.sum()
    share = weight * ((1 - track.prior[-1]) / total) if total > 0 else weight
    return np.append(share, track.prior[-1])


def detector_rates(
    track: Track, detectors: Sequence[tuple[Hashable, ...]], learned: Learned
) -> tuple[Floats, Floats]:
    """The rates of each look (n,), (n,): those learned of its detector, else those stated."""
    hit, false_alarm = track.hit.copy(), track.false_alarm.copy()
    for number in np.unique(track.detector[track.detector >= 0]):
        names = detectors[number]
        known = (learned.detectors.get(names[:end]) for end in range(len(names), -1, -1))
        found = next((one for one in known if one is not None), None)
        if found is not None:
            own = track.detector == number
            hit[own], false_alarm[own] = found.hit, found.false_alarm
    return hit, false_alarm


def learn(
    tracks: Sequence[Track],
    detectors: Sequence[tuple[Hashable, ...]] = (),
    *,
    stated: float = 0.95,
    strength: float = 5.0,
    most: float = 20.0,
    rounds: int = 15,
    day: Floats | None = None,
) -> Learned:
    """Learn from the tracks of a map's things.

    Parameters
    ----------
    tracks : of all things
    detectors : names of each detector, the general one first: (robot, distance)
    stated : the probability of what the map states
    strength : how many counts the expected is worth
    most : counts of one thing that its types learn from
    rounds : of expectation and maximisation
    day : (W, W) how counts of the parts of the day are smoothed, as `parts_of_day` or
        `waves_of_day` say; None for habits that have no hours

    Examples
    --------
    >>> look = np.ones(9, bool)
    >>> seen = Track(("mug",), np.array([0.4, 0.4, 0.2]), np.array([[0], [1]]), 1e-5,
    ...              np.arange(9) * 36000.0, np.tile([False, True, False], (9, 1)), ~look, look,
    ...              np.ones(9), np.full(9, 0.9), np.full(9, 0.001), np.full(9, -1))
    >>> lifted_prior(seen, learn([seen])).round(2)
    array([0.33, 0.47, 0.2 ])
    """
    used = [track for track in tracks if len(track.at)]
    day = parts_of_day(1) if day is None else day
    learned = replace(NOTHING, parts=len(day))
    for _ in range(rounds if used else 0):
        found = []
        for track in used:
            rates = detector_rates(track, detectors, learned)
            found.append((smooth(track, *habits(track, learned), *rates, stated), *rates))
        passes = [one for one, _, _ in found]
        places, moves = _lifts(used, passes, strength, most, day)
        rates_of = _rates_of_detectors(used, found, detectors, strength)
        learned = Learned(places, moves, rates_of, len(day))
    return learned


def parts_of_day(parts: int) -> Floats:
    """Parts of equal length that are apart: each has what it counts. (parts, parts)."""
    return np.eye(parts)


def waves_of_day(waves: int, parts: int = 24) -> Floats:
    """Counts of parts as sums of waves: of a day, of half a day, and so on. (parts, parts).

    >>> waves_of_day(0, 4)[0]
    array([0.25, 0.25, 0.25, 0.25])
    """
    turn = 2 * np.pi * np.arange(parts) / parts
    lag = turn[:, None] - turn
    found = np.full((parts, parts), 1 / parts)
    for wave in range(1, waves + 1):
        found += 2 / parts * np.cos(wave * lag)
    return found


def _subjects(tracks: Sequence[Track]) -> list[tuple[Hashable, list[int]]]:
    """The subjects with the rows of their tracks, those of many things first.

    A type of exactly the things of a more general one says nothing new; a thing does.
    """
    of: dict[Hashable, list[int]] = defaultdict(list)
    depth: dict[Hashable, int] = {}
    for row, track in enumerate(tracks):
        for number, subject in enumerate(track.subjects):
            of[subject].append(row)
            depth[subject] = max(depth.get(subject, 0), number)
    own = {track.subjects[-1] for track in tracks}
    kept: dict[tuple[int, ...], Hashable] = {}
    for subject in sorted(of, key=lambda one: (depth[one], str(one))):
        if subject not in own:
            kept.setdefault(tuple(of[subject]), subject)
    types = sorted(kept.values(), key=lambda one: (-len(of[one]), depth[one], str(one)))
    return [(one, of[one]) for one in [*types, *(track.subjects[-1] for track in tracks)]]


@dataclass(frozen=True, eq=False)
class _Fit:
    """How lifts are fitted, one after the other: each to what those before it lead to."""

    tracks: Sequence[Track]
    strength: float
    most: float

    def places(
        self, ends: Sequence[Floats], shares: list[Floats], day: Floats
    ) -> dict[tuple[Hashable, int], tuple[Floats, Floats, Floats]]:
        """The lift, seen and expected (W, words) of words, by moves that ended (W, P) at places.

        `shares` (W, P) are what they are compared with, and then what they lead to.
        """
        totals = [count.sum(axis=1, keepdims=True) for count in ends]
        size = 1 + max(int(track.words.max(initial=-1)) for track in self.tracks)
        found = {}
        for subject, rows, weights in self._subjects([float(one.sum()) for one in totals]):
            for kind in range(self.tracks[rows[0]].words.shape[1]):
                seen, expected = np.zeros((2, len(day), size))
                for row, weight in zip(rows, weights, strict=True):
                    words = self.tracks[row].words[:, kind]
                    known = words >= 0
                    due = totals[row] * shares[row]
                    np.add.at(seen.T, words[known], weight * ends[row][:, known].T)
                    np.add.at(expected.T, words[known], weight * due[:, known].T)
                lift = self._lift(seen, expected, day)
                found[subject, kind] = lift, seen, expected
                for row in rows:
                    words = self.tracks[row].words[:, kind]
                    shares[row] = shares[row] * np.where(words >= 0, lift[:, words], 1.0)
                    shares[row] /= np.maximum(shares[row].sum(axis=1, keepdims=True), 1e-300)
        return found

    def moves(
        self, counts: Sequence[Floats], due: list[Floats], day: Floats
    ) -> dict[Hashable, tuple[Floats, Floats, Floats]]:
        """The lift, seen and expected (W,) of moves, that are compared with those that are due."""
        found: dict[Hashable, tuple[Floats, Floats, Floats]] = {}
        for subject, rows, weights in self._subjects([float(one.sum()) for one in counts]):
            seen, expected = (
                weights @ np.array([many[row] for row in rows]) for many in (counts, due)
            )
            if expected.sum() > 0:
                lift = self._lift(seen, expected, day)
                found[subject] = lift, seen, expected
                for row in rows:
                    due[row] = due[row] * lift
        return found

    def _subjects(self, counts: Sequence[float]) -> Iterator[tuple[Hashable, list[int], Floats]]:
        """The subjects in their order, with the rows of their tracks, and how much each counts.

        A type takes at most `most` of one thing.
        """
        for subject, rows in _subjects(self.tracks):
            weights = np.ones(len(rows))
            if subject != self.tracks[rows[0]].subjects[-1]:
                own = np.array([counts[row] for row in rows])
                weights = np.minimum(1.0, self.most / np.maximum(own, self.most))
            yield subject, rows, weights

    def _lift(self, seen: Floats, expected: Floats, day: Floats) -> Floats:
        """The lift of each part of the day, by counts (W, ...) that are smoothed along the day."""
        worth = self.strength * float(np.trace(day)) / len(day)
        seen, expected = (np.maximum(day @ counts, 0.0) for counts in (seen, expected))
        lift: Floats = (seen + worth) / (expected + worth)
        return lift


def _lifts(
    tracks: Sequence[Track],
    passes: Sequence[Smoothed],
    strength: float,
    most: float,
    day: Floats,
) -> tuple[dict[tuple[Hashable, int], WordLifts], dict[Hashable, MoveLift]]:
    """Fit the lifts of the whole day, and then what each part of the day is to it."""
    fit, whole, parts = _Fit(tracks, strength, most), parts_of_day(1), len(day)
    ends = [one.ends[:, :-1] for one in passes]
    shares = [track.prior[None, :-1] / max(track.prior[:-1].sum(), 1e-300) for track in tracks]
    places = fit.places([one.sum(axis=0, keepdims=True) for one in ends], shares, whole)
    seconds = [one.seconds for one in passes]
    due = [np.array([track.rate * s.sum()]) for track, s in zip(tracks, seconds, strict=True)]
    moves = fit.moves([one.moves.sum(keepdims=True) for one in passes], due, whole)
    by_part: dict[Any, Any] = {}
    if parts > 1:
        fit = replace(fit, strength=HOURLY * strength)
        by_part |= fit.places(ends, [np.repeat(one, parts, axis=0) for one in shares], day)
        rates = [d / max(s.sum(), 1e-300) for d, s in zip(due, seconds, strict=True)]
        due = [rate * s for rate, s in zip(rates, seconds, strict=True)]
        by_part |= fit.moves([one.moves for one in passes], due, day)
    hours = {key: lift for key, (lift, _, _) in by_part.items()}
    return (
        {
            key: WordLifts(lift[0], seen[0], expected[0], hours.get(key))
            for key, (lift, seen, expected) in places.items()
        },
        {
            key: MoveLift(float(lift[0]), float(seen[0]), float(expected[0]), hours.get(key))
            for key, (lift, seen, expected) in moves.items()
        },
    )


def _rates_of_detectors(
    tracks: Sequence[Track],
    passes: Sequence[tuple[Smoothed, Floats, Floats]],
    detectors: Sequence[tuple[Hashable, ...]],
    strength: float,
) -> dict[tuple[Hashable, ...], DetectorRates]:
    """Count the looks that saw what was there, and what was not; each with those of all as prior.

    Of a look in vain with a share of the place in view, the share counts that was in view.
    """
    counts = np.zeros((len(detectors), 4))  # seen and looked at, where it was, and where not
    first = np.zeros((2, 2))  # the rates that are stated, and how many
    for track, (one, hit, false_alarm) in zip(tracks, passes, strict=True):
        looks = track.detector >= 0
        rows, seen, view = track.detector[looks], track.seen[looks], track.visible[looks]
        for column, share, rate in (
            (0, one.there[looks], hit[looks]),
            (2, 1 - one.there[looks], false_alarm[looks]),
        ):
            tried = np.where(seen, 1.0, view * (1 - rate) / (1 - view * rate))
            np.add.at(counts[:, column], rows, share * seen)
            np.add.at(counts[:, column + 1], rows, share * tried)
        first[0] += track.hit[looks].sum(), looks.sum()
        first[1] += track.false_alarm[looks].sum(), looks.sum()
    if not first[0, 1]:
        return {}
    hit, false_alarm = first[:, 0] / first[:, 1]
    found: dict[tuple[Hashable, ...], DetectorRates] = {}
    longest = max(len(names) for names in detectors)
    for end in range(longest + 1):
        for names in dict.fromkeys(one[:end] for one in detectors if len(one) >= end):
            own = sum(counts[row] for row, one in enumerate(detectors) if one[:end] == names)
            parent = found[names[:-1]] if names else DetectorRates(hit, false_alarm, 0, 0)
            high = (own[0] + strength * parent.hit) / (own[1] + strength)
            low = (own[2] + strength * parent.false_alarm) / (own[3] + strength)
            found[names] = DetectorRates(
                float(min(high, 0.999)), float(min(low, high / 2)), float(own[1]), float(own[3])
            )
    return found


def predicted_sightings(
    track: Track,
    learned: Learned,
    detectors: Sequence[tuple[Hashable, ...]] = (),
    stated: float = 0.95,
) -> Floats:
    """How probable it was before each entry (n,) that a look would see the thing; NaN if told.

    By the entries before it alone, so that looks after those that were learned from are a test.
    """
    hit, false_alarm = detector_rates(track, detectors, learned)
    found = smooth(track, *habits(track, learned), hit, false_alarm, stated)
    there = np.where(track.hits, found.forecast, 0.0).sum(axis=1)
    seen = track.visible * (there * hit + (1 - there) * false_alarm)
    return np.where(track.told, np.nan, seen)
