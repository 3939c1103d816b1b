"""Learn from a map's history where things are kept, how often they move, and what detectors see.

A thing is at one of its places, a hidden Markov chain as in the beliefs of the database: after
exponentially distributed times it is put anywhere, by its prior. What the map states and what was
looked for say where it was. Expectation maximisation (Baum and Welch) finds the moves, where they
ended, and how often a look saw what was there.

What is learned are lifts: how many times as often as expected something happened to a subject,

    lift = (seen + strength) / (expected + strength),

with what the lifts before it lead to as the expected. Subjects are types, the general ones first,
and then the thing itself, so that a rare type has what its supertypes have; words about places
are the type of the room, the room, the type of the place, and the place. Few counts change
little, many fit (the mean of a gamma distribution after Poisson counts: DuMouchel, "Bayesian data
mining in large frequency tables", 1999). What was taught is in the prior that lifts start from.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

LEAST = 1e-200
"""The least that a look leaves of a place: no number of looks is beyond doubt."""

UNMOVED = 0.99
"""The most that a thing stays before it is seen: what is seen may just have been moved."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Track:
    """What is known of one thing: n statements and looks, oldest first, at P places.

    Parameters
    ----------
    subjects : what it is: types, the general ones first, and itself last
    prior : (P,) before anything is learned; the last place is *elsewhere*
    words : (P - 1, kinds) words about each place, the general kinds first; -1 for none
    rate : moves a second, before anything is learned
    at : (n,) seconds
    hits : (n, P) where it was seen, looked for or put
    told : (n,) whether the map states it; else it is a look
    seen, visible : (n,) of looks
    hit, false_alarm : (n,) rates of the detector of each look, as it states them
    detector : (n,) which detector looked, a row of those of `learn`; -1 for nobody's
    """

    subjects: tuple[Hashable, ...]
    prior: Floats
    words: NDArray[np.intp]
    rate: float
    at: Floats
    hits: NDArray[np.bool_]
    told: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    visible: Floats
    hit: Floats
    false_alarm: Floats
    detector: NDArray[np.intp]

    def until(self, moment: float) -> Track:
        """The part of it before a moment."""
        columns = ("at", "hits", "told", "seen", "visible", "hit", "false_alarm", "detector")
        end = int(np.searchsorted(self.at, moment))
        return replace(self, **{name: getattr(self, name)[:end] for name in columns})


@dataclass(frozen=True)
class MoveLift:
    """How many times as often as `expected` something was `seen`, with smoothing."""

    lift: float
    seen: float
    expected: float


@dataclass(frozen=True, eq=False)
class WordLifts:
    """The same for each word about places: (words,) each; 1 where nothing was expected."""

    lift: Floats
    seen: Floats
    expected: Floats


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


NOTHING = Learned({}, {}, {})


@dataclass(frozen=True, eq=False)
class Smoothed:
    """What a history says of the chain: the result of one pass forward and one back.

    `forecast` (n, P) is the belief just before each entry, by those before it; `there` (n,) how
    probable the thing was at the places of the entry, by all entries. `ends` (P,) counts the moves
    by where they ended, with the first place; `moves` are those expected in `seconds`.
    """

    forecast: Floats
    there: Floats
    ends: Floats
    moves: float
    seconds: float


def smooth(
    track: Track, prior: Floats, rate: float, hit: Floats, false_alarm: Floats, stated: float
) -> Smoothed:
    """Return where a thing was, and when it moved, given all that is known of it.

    `prior` (P,) and `rate` as in `Track`, `hit` and `false_alarm` (n,); what the map states is so
    with the probability `stated`, else as it was before.
    """
    size, places = track.hits.shape
    gap = np.diff(track.at, prepend=track.at[:1])
    real = np.exp(-np.minimum(rate * gap, 60.0))
    surprised = track.seen & ~track.told & (gap > 0) & (rate > 0)
    keep = np.where(surprised, np.minimum(real, UNMOVED), real)
    there = np.where(track.seen, hit, 1 - track.visible * hit)[:, None]
    elsewhere = np.where(track.seen, false_alarm, 1 - track.visible * false_alarm)[:, None]
    likely = np.where(track.hits, there, elsewhere)
    target = np.zeros((size, places))  # where the thing is, if what the map states is so
    told = track.told.copy()

    forecast, before, after = np.empty((3, size, places))
    belief = prior
    for i in range(size):
        forecast[i] = real[i] * belief + (1 - real[i]) * prior
        before[i] = keep[i] * belief + (1 - keep[i]) * prior
        if track.told[i]:
            belief = before[i] * track.hits[i]
            told[i] = belief.any()  # else it is no place of the thing
            target[i] = belief / belief.sum() if told[i] else 0.0
            belief = (1 - stated) * before[i] + stated * target[i] if told[i] else before[i]
        else:
            belief = np.maximum(before[i] * likely[i], np.minimum(before[i], LEAST))
            belief = belief / belief.sum()
        after[i] = belief

    ends, moves = np.zeros(places), 0.0
    was_there = np.empty(size)
    later = np.ones(places)
    for i in reversed(range(size)):
        posterior = after[i] * later
        was_there[i] = posterior[track.hits[i]].sum() / posterior.sum()
        if told[i]:
            arrived = target[i] * later
            put = stated * arrived.sum()
            came = before[i][~track.hits[i]].sum() * put
            came /= (1 - stated) * (before[i] @ later) + put
            ends += came * arrived / arrived.sum()
            moves += came
            later = (1 - stated) * later + put
        elif not track.told[i]:
            later = likely[i] * later
        moved = prior * later
        if keep[i] < 1 and moved.any():
            share = (1 - real[i]) / (1 - keep[i])
            jumped = (1 - keep[i]) * moved.sum() / (before[i] @ later)
            ends += share * jumped * moved / moved.sum()
            moves += jumped * rate * gap[i] / (1 - keep[i])
        later = keep[i] * later + (1 - keep[i]) * moved.sum()
        later = np.maximum(later / later.max(), LEAST)
    ends += prior * later / (prior @ later)
    return Smoothed(forecast, was_there, ends, moves, float(gap.sum()))


def lifted_prior(track: Track, learned: Learned) -> Floats:
    """The prior of a thing (P,) with what was learned; the share of *elsewhere* stays."""
    weight = track.prior[:-1].copy()
    for subject in track.subjects:
        for kind, words in enumerate(track.words.T):
            found = learned.places.get((subject, kind))
            if found is not None:
                known = (words >= 0) & (words < len(found.lift))
                weight[known] *= found.lift[words[known]]
    total = weight.sum()
    share = weight * ((1 - track.prior[-1]) / total) if total > 0 else weight
    return np.append(share, track.prior[-1])


def lifted_rate(track: Track, learned: Learned) -> float:
    """The moves of a thing in a second, with what was learned."""
    lifts = [learned.moves[one].lift for one in track.subjects if one in learned.moves]
    return float(track.rate * np.prod(lifts))


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
    learned = NOTHING
    for _ in range(rounds):
        found = []
        for track in used:
            rates = detector_rates(track, detectors, learned)
            prior, rate = lifted_prior(track, learned), lifted_rate(track, learned)
            found.append((smooth(track, prior, rate, *rates, stated), *rates))
        passes = [one for one, _, _ in found]
        learned = Learned(
            _lifts_of_places(used, [one.ends[:-1] for one in passes], strength, most),
            _lifts_of_moves(used, passes, strength, most),
            _rates_of_detectors(used, found, detectors, strength),
        )
    return learned


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


def _weights(counts: Sequence[float], rows: Sequence[int], most: float, single: bool) -> Floats:
    """How much of the counts of each row a subject takes: a type at most `most` of one thing."""
    total = np.array([counts[row] for row in rows])
    return np.ones(len(rows)) if single else np.minimum(1.0, most / np.maximum(total, most))


def _lifts_of_places(
    tracks: Sequence[Track], ends: Sequence[Floats], strength: float, most: float
) -> dict[tuple[Hashable, int], WordLifts]:
    """Fit the lifts one after the other: each to what those before it lead to."""
    totals = [float(count.sum()) for count in ends]
    share = [track.prior[:-1] / max(track.prior[:-1].sum(), 1e-300) for track in tracks]
    found: dict[tuple[Hashable, int], WordLifts] = {}
    size = 1 + max((int(track.words.max(initial=-1)) for track in tracks), default=-1)
    for subject, rows in _subjects(tracks):
        weights = _weights(totals, rows, most, subject == tracks[rows[0]].subjects[-1])
        for kind in range(tracks[rows[0]].words.shape[1]):
            seen, expected = np.zeros((2, size))
            for row, weight in zip(rows, weights, strict=True):
                words = tracks[row].words[:, kind]
                known = words >= 0
                seen += weight * np.bincount(words[known], ends[row][known], size)
                due = totals[row] * share[row][known]
                expected += weight * np.bincount(words[known], due, size)
            lift = (seen + strength) / (expected + strength)
            found[subject, kind] = WordLifts(lift, seen, expected)
            for row in rows:
                words = tracks[row].words[:, kind]
                share[row] = share[row] * np.where(words >= 0, lift[words], 1.0)
                share[row] /= max(share[row].sum(), 1e-300)
    return found


def _lifts_of_moves(
    tracks: Sequence[Track], passes: Sequence[Smoothed], strength: float, most: float
) -> dict[Hashable, MoveLift]:
    """Fit how often things move, to what their mobility leads to."""
    found: dict[Hashable, MoveLift] = {}
    due = [track.rate * one.seconds for track, one in zip(tracks, passes, strict=True)]
    for subject, rows in _subjects(tracks):
        counts = [one.moves for one in passes]
        weights = _weights(counts, rows, most, subject == tracks[rows[0]].subjects[-1])
        seen = float(weights @ [counts[row] for row in rows])
        expected = float(weights @ [due[row] for row in rows])
        if expected > 0:
            lift = (seen + strength) / (expected + strength)
            found[subject] = MoveLift(lift, seen, expected)
            for row in rows:
                due[row] *= lift
    return found


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
    prior, rate = lifted_prior(track, learned), lifted_rate(track, learned)
    found = smooth(track, prior, rate, hit, false_alarm, stated)
    there = np.where(track.hits, found.forecast, 0.0).sum(axis=1)
    seen = track.visible * (there * hit + (1 - there) * false_alarm)
    return np.where(track.told, np.nan, seen)
