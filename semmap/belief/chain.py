"""Where a thing was, by what was stated and seen of it: a hidden Markov chain over its places.

It stays for exponentially distributed times, and is put anywhere then, by its prior. Each part of
the day has a prior and a rate of moves. `smooth` goes through what is known once forward and once
back (Baum and Welch); the beliefs of the database are its forward pass.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

LEAST = 1e-200
"""The least that a look leaves of a place: no number of looks is beyond doubt."""

DAY = 86_400.0

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
    clock : seconds that the clock of the building is ahead of `at`, of all or (n,); both count from
        a midnight
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
    clock: Floats | float = 0.0

    def until(self, moment: float) -> Track:
        """The part of it before a moment."""
        columns = ("at", "hits", "told", "seen", "visible", "hit", "false_alarm", "detector")
        end = int(np.searchsorted(self.at, moment))
        clock = np.broadcast_to(self.clock, self.at.shape)[:end]
        kept = {name: getattr(self, name)[:end] for name in columns}
        return replace(self, **kept, clock=clock)


@dataclass(frozen=True, eq=False)
class Smoothed:
    """What a history says of the chain: the result of one pass forward and one back.

    `forecast` (n, P) is the belief just before each entry, by those before it; `there` (n,) how
    probable the thing was at the places of the entry, by all entries. `ends` (W, P) counts the
    moves by the part of the day and where they ended, with the first place; `moves` (W,) are those
    expected in `seconds` (W,).
    """

    forecast: Floats
    there: Floats
    ends: Floats
    moves: Floats
    seconds: Floats


def smooth(
    track: Track,
    prior: Floats,
    rate: Floats | float,
    hit: Floats,
    false_alarm: Floats,
    stated: float,
) -> Smoothed:
    """Return where a thing was, and when it moved, given all that is known of it.

    `prior` (W, P) and `rate` (W,) in each part of the day, or (P,) and one for all of it; `hit` and
    `false_alarm` (n,); what the map states is so with the probability `stated`, else as it was
    before.
    """
    size, places = track.hits.shape
    prior, rate = np.atleast_2d(prior), np.atleast_1d(rate)
    gap = np.diff(track.at, prepend=track.at[:1])
    pieces = _Pieces(track, rate)
    real, mix = pieces.stays, pieces.mix
    put_at = mix @ prior  # where a thing is that moved before an entry
    surprised = track.seen & ~track.told & (gap > 0) & (rate > 0).any()
    keep = np.where(surprised, np.minimum(real, UNMOVED), real)
    there = np.where(track.seen, hit, 1 - track.visible * hit)[:, None]
    elsewhere = np.where(track.seen, false_alarm, 1 - track.visible * false_alarm)[:, None]
    likely = np.where(track.hits, there, elsewhere)
    target = np.zeros((size, places))  # where the thing is, if what the map states is so
    told = track.told.copy()

    forecast, before, after = np.empty((3, size, places))
    belief = put_at[0]
    for i in range(size):
        forecast[i] = real[i] * belief + (1 - real[i]) * put_at[i]
        before[i] = keep[i] * belief + (1 - keep[i]) * put_at[i]
        if track.told[i]:
            belief = before[i] * track.hits[i]
            told[i] = belief.any()  # else it is no place of the thing
            target[i] = belief / belief.sum() if told[i] else 0.0
            belief = (1 - stated) * before[i] + stated * target[i] if told[i] else before[i]
        else:
            belief = np.maximum(before[i] * likely[i], np.minimum(before[i], LEAST))
            belief = belief / belief.sum()
        after[i] = belief

    ends = np.zeros_like(prior)
    told_moves = np.zeros(len(rate))
    moved = np.zeros((size, len(rate)))  # whether it moved before an entry, by the part of the last
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
            ends[pieces.part[i]] += came * arrived / arrived.sum()
            told_moves[pieces.part[i]] += came
            later = (1 - stated) * later + put
        elif not track.told[i]:
            later = likely[i] * later
        ended = mix[i][:, None] * prior * later
        if real[i] < 1:
            ended *= (1 - real[i]) / (before[i] @ later)
            ends += ended
            moved[i] = ended.sum(axis=1)
        later = keep[i] * later + (1 - keep[i]) * (put_at[i] @ later)
        later = np.maximum(later / later.max(), LEAST)
    first = mix[0][:, None] * prior * later
    ends += first / first.sum()
    return Smoothed(forecast, was_there, ends, told_moves + pieces.moves(moved), pieces.seconds)


class _Pieces:
    """The times before the entries of a track, cut where a part of the day begins.

    Attributes
    ----------
    stays : (n,) how probable a thing does not move before an entry
    mix : (n, W) how the last moves before it are shared by the parts, if there are any; before the
        first entry, those of all days before
    part : (n,) in which part of the day the entry is
    seconds : (W,) how long the track is, by parts of the day
    """

    def __init__(self, track: Track, rate: Floats) -> None:
        size, parts = len(track.at), len(rate)
        end = (track.at + track.clock) * (parts / DAY)
        length = np.diff(track.at, prepend=track.at[0] - DAY) * (parts / DAY)
        first = np.floor(end - length).astype(np.intp)
        count = np.floor(end).astype(np.intp) - first + 1
        self._of = np.repeat(np.arange(size), count)
        number = np.arange(len(self._of)) - np.repeat(np.cumsum(count) - count, count)
        cell = first[self._of] + number
        begun = np.maximum(cell, (end - length)[self._of])
        seconds = np.clip(np.minimum(cell + 1, end[self._of]) - begun, 0, None) * (DAY / parts)
        self._cell = cell % parts
        self.part = np.floor(end).astype(np.intp) % parts

        self._due = np.maximum(rate[self._cell] * seconds, 1e-12 * seconds / DAY)
        total = np.cumsum(self._due)
        after = total[np.cumsum(count) - 1][self._of] - total
        self._ended = np.exp(-np.minimum(after, 60.0)) * -np.expm1(-self._due)
        here = self._of, self._cell
        mix = np.zeros((size, parts))
        np.add.at(mix, here, self._ended)
        self._mix = np.maximum(mix, 1e-300)
        share = mix.sum(axis=1, keepdims=True)
        self.mix = np.where(share > 0, mix / np.maximum(share, 1e-300), np.eye(parts)[self.part])
        stays = np.zeros(size)
        np.add.at(stays, self._of, rate[self._cell] * seconds)
        stays[0] = 0.0
        self.stays = np.exp(-np.minimum(stays, 60.0))
        later = self._of > 0
        self.seconds = np.bincount(self._cell[later], seconds[later], parts).astype(np.float64)

    def moves(self, last: Floats) -> Floats:
        """The moves expected in each part (W,), by how probable (n, W) the last ones are in it.

        A piece with the last move has Poisson many, at least one; the pieces before it what is
        due, those after it none.
        """
        share = (last / self._mix)[self._of, self._cell] * self._ended
        passed = np.cumsum(share)
        total = np.cumsum(last.sum(axis=1))[self._of]
        due = np.maximum(self._due, 1e-9)
        many = due / -np.expm1(-due)
        found = share * many + np.clip(total - passed, 0, None) * self._due
        return np.bincount(self._cell, found, last.shape[1]).astype(np.float64)
