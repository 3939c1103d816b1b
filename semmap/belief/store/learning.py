"""Learn from the history of a map in the database, and keep what was learned there.

Priors, moves and rates of detectors in `schema/functions/480_belief.sql` follow from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import psycopg
from psycopg import errors

from semmap.belief.calibration import Calibration, calibrate
from semmap.belief.chain import DAY, Floats
from semmap.belief.error import BeliefError
from semmap.belief.learning import (
    NOTHING,
    DetectorRates,
    Learned,
    MoveLift,
    WordLifts,
    learn,
    parts_of_day,
    predicted_sightings,
)
from semmap.belief.store.history import ABOUT, History, read_history
from semmap.query.snapshot import Snapshot
from semmap.suggestions import suggestion

PARTS = parts_of_day(6)
"""Of the day, in which habits have rates and places of their own: four hours each."""


@dataclass(frozen=True, eq=False)
class LearnedBelief:
    """What was learned from the history of a map.

    Attributes
    ----------
    things, statements, looks : how many it was learned from
    lifts : rows of `subject` (a type or thing), `about`, `word`, `lift`, and the counts `seen` and
        `expected`: so many times as often as expected it was there, or moved; `by_part` is how many
        times as often as in the whole day in each part of it, from midnight on
    detectors : rows of `observer`, `within` (metres), `hit`, `false_alarm`, and how many looks at
        where things were (`there`) and were not (`elsewhere`) they are from; None stands for all
    before, without_hours, after : with days held out, how well it was known before each look of
        these days whether it would see the thing: with nothing learned and no former placements in
        the prior, and with what was learned from the other days, without the hours of habits and
        with them
    """

    things: int
    statements: int
    looks: int
    lifts: list[dict[str, Any]]
    detectors: list[dict[str, Any]]
    before: Calibration | None = None
    without_hours: Calibration | None = None
    after: Calibration | None = None

    def as_json(self) -> dict[str, Any]:
        """All of it as plain values."""
        judged = ("before", "without_hours", "after")
        curves = {name: getattr(self, name) for name in judged}
        return vars(self) | {name: one and one.as_json() for name, one in curves.items()}


def learn_belief(
    seen: Snapshot, hold_out: float = 0.0, time_zone: str | None = None
) -> LearnedBelief:
    """Learn from the history of the map, and keep it; beliefs follow in the same transaction.

    With `hold_out` days, what was learned without them is judged by them first. A `time_zone` is
    that of the map from now on. `BeliefError` if it is unknown, if the map has no history, no looks
    or nothing before these days, or for a login that may not do this.
    """
    if not (math.isfinite(hold_out) and hold_out >= 0):
        raise BeliefError(f"hold_out is {hold_out:g}: give days, at least 0")
    if time_zone is not None:
        _check_zone(seen.session, time_zone)
    _lock(seen.session)
    history = read_history(seen, time_zone=time_zone)
    tracks, detectors, stated = history.tracks, history.detectors, history.stated
    if not tracks:
        raise BeliefError(
            "the map has no history of things: observe objects, or move them, and learn then"
        )
    judged: list[Calibration] = []
    if hold_out:
        latest = max((t for track in tracks for t in track.at[~track.told].tolist()), default=None)
        if latest is None:
            raise BeliefError("the map has no looks to judge by: observe objects, or hold out none")
        cut = latest - hold_out * DAY
        if not any((track.at < cut).any() for track in tracks):
            raise BeliefError("nothing is known before the days that are held out: hold out fewer")
        known = [track.until(cut) for track in tracks]
        steady = learn(known, detectors, stated=stated)
        earlier = learn(known, detectors, stated=stated, day=PARTS)
        judged = [_judge(history, one, cut) for one in (NOTHING, steady, earlier)]
    learned = learn(tracks, detectors, stated=stated, day=PARTS)
    if time_zone is not None:
        seen.session.execute(_KEEP_ZONE, (time_zone,))
    _keep(seen.session, history, learned)
    told = sum(int(track.told.sum()) for track in tracks)
    return LearnedBelief(
        len(tracks),
        told,
        sum(len(track.at) for track in tracks) - told,
        _rows(seen.session, _LIFTS),
        _rows(seen.session, _DETECTORS),
        *judged,
    )


def _lock(session: psycopg.Connection[Any]) -> None:
    """Let one session learn at a time; `BeliefError` for a login that may not, or if one does."""
    try:
        session.execute("LOCK TABLE learned_lift, detector_rate IN SHARE ROW EXCLUSIVE MODE")
    except errors.InsufficientPrivilege as error:
        raise BeliefError(f"{error.diag.message_primary}: an admin of the map may learn") from error
    except errors.LockNotAvailable as error:
        raise BeliefError("another session learns: wait until it has ended") from error


def _check_zone(session: psycopg.Connection[Any], time_zone: str) -> None:
    """Refuse a time zone that is none of the names: PostgreSQL takes other texts, as UTC+2."""
    known = session.execute(
        "SELECT name FROM pg_timezone_names WHERE name !~ '^[A-Za-z]+[+-]?[0-9]'"
    ).fetchall()
    names = [name for (name,) in known]
    if time_zone not in names:
        hint = suggestion(time_zone, names, "give a name as Europe/Berlin, or UTC")
        raise BeliefError(f"there is no time zone {time_zone}{hint}")


def forget_learned(session: psycopg.Connection[Any]) -> int:
    """Delete what was learned from the history of the map; return how many lifts that were.

    `BeliefError` for a login that may not do this, or while another session learns.
    """
    _lock(session)
    lifts = session.execute("DELETE FROM learned_lift WHERE map_id = current_map()").rowcount
    session.execute("DELETE FROM detector_rate WHERE map_id = current_map()")
    session.execute("SELECT refresh_beliefs()")
    return lifts


def _judge(history: History, learned: Learned, cut: float) -> Calibration:
    chance, true = [], []
    for track in history.tracks:
        looks = (track.at >= cut) & ~track.told
        found = predicted_sightings(track, learned, history.detectors, history.stated)
        chance.append(found[looks])
        true.append(track.seen[looks])
    return calibrate(np.concatenate(chance), np.concatenate(true))


_KEEP_ZONE = """
INSERT INTO belief_model (map_id, time_zone) VALUES (current_map(), %s)
ON CONFLICT (map_id) DO UPDATE SET time_zone = excluded.time_zone
WHERE belief_model.time_zone <> excluded.time_zone
"""

_KEEP_LIFTS = """
INSERT INTO learned_lift
    (map_id, type, entity_id, about, word, word_id, lift, seen, expected, by_part)
SELECT current_map(), l.type, l.thing, l.about, l.word, l.word_id, l.lift, l.seen, l.expected,
       l.by_part::float8[]
FROM unnest(%s::text[], %s::bigint[], %s::text[], %s::text[], %s::bigint[], %s::float8[],
    %s::float8[], %s::float8[], %s::text[])
    l (type, thing, about, word, word_id, lift, seen, expected, by_part)
WHERE (l.thing IS NULL OR EXISTS (SELECT FROM entity e WHERE e.id = l.thing))  -- deleted meanwhile
  AND (l.word_id IS NULL OR EXISTS (SELECT FROM entity e WHERE e.id = l.word_id))
"""

_KEEP_RATES = """
INSERT INTO detector_rate (map_id, observer_id, within, hit, false_alarm, there, elsewhere)
SELECT current_map(), d.* FROM unnest(%s::bigint[], %s::float8[], %s::float8[], %s::float8[],
    %s::float8[], %s::float8[]) d (observer, within, hit, false_alarm, there, elsewhere)
WHERE d.observer IS NULL OR EXISTS (SELECT FROM entity e WHERE e.id = d.observer)
"""


def _keep(session: psycopg.Connection[Any], history: History, learned: Learned) -> None:
    """Replace what the map has learned before."""
    rows: list[tuple[Any, ...]] = []
    for subject, lift in learned.moves.items():
        counts = lift.lift, lift.seen, lift.expected
        rows.append((*_subject(subject), "moves", None, None, *counts, _array(lift.by_part)))
    for (subject, kind), lifts in learned.places.items():
        counts = np.column_stack([lifts.lift, lifts.seen, lifts.expected]).tolist()
        for number in np.flatnonzero(lifts.expected).tolist():
            word = history.words[number]
            parts = None if lifts.by_part is None else lifts.by_part[:, number]
            rows.append((*_subject(subject), ABOUT[kind], *word, *counts[number], _array(parts)))
    rates = [
        (*(*names, None, None)[:2], one.hit, one.false_alarm, one.there, one.elsewhere)
        for names, one in learned.detectors.items()
    ]
    session.execute("DELETE FROM learned_lift WHERE map_id = current_map()")
    session.execute("DELETE FROM detector_rate WHERE map_id = current_map()")
    for statement, table in ((_KEEP_LIFTS, rows), (_KEEP_RATES, rates)):
        if table:
            session.execute(statement, [list(column) for column in zip(*table, strict=True)])
    session.execute("SELECT refresh_beliefs()")


def _array(numbers: Floats | None) -> str | None:
    """As text of an array in SQL: unnest takes arrays of arrays apart."""
    return None if numbers is None else "{" + ",".join(map(repr, numbers.tolist())) + "}"


_READ_LIFTS = """
SELECT coalesce(type, entity_id::text), entity_id IS NULL, about, word, word_id, lift, seen,
       expected, by_part
FROM learned_lift WHERE map_id = current_map() ORDER BY id
"""

_READ_RATES = """
SELECT observer_id, within, hit, false_alarm, there, elsewhere
FROM detector_rate WHERE map_id = current_map()
"""


def read_learned(session: psycopg.Connection[Any], history: History) -> Learned:
    """Read what was learned, with the words of a history; what it has no words for is left out."""
    numbers = {word: number for number, word in enumerate(history.words)}
    places: dict[tuple[Any, int], WordLifts] = {}
    moves: dict[Any, MoveLift] = {}
    parts = 1
    rows = session.execute(_READ_LIFTS)
    for name, is_type, about, word, word_id, lift, seen, expected, by_part in rows:
        subject = name if is_type else int(name)
        hours = None if by_part is None else np.array(by_part)
        parts = max(parts, len(by_part or [0]))
        if about == "moves":
            moves[subject] = MoveLift(lift, seen, expected, hours)
        elif (word, word_id) in numbers:
            key = subject, ABOUT.index(about)
            if key not in places:
                size = len(numbers)
                hourly = None if hours is None else np.ones((len(hours), size))
                ones = np.ones((3, size))
                places[key] = WordLifts(ones[0], ones[1], ones[2], hourly)
            found, number = places[key], numbers[word, word_id]
            found.lift[number], found.seen[number], found.expected[number] = lift, seen, expected
            if found.by_part is not None:
                found.by_part[:, number] = hours
    detectors = {
        tuple(name for name in (observer, within) if name is not None): DetectorRates(*rates)
        for observer, within, *rates in session.execute(_READ_RATES)
    }
    return Learned(places, moves, detectors, parts)


def _subject(subject: object) -> tuple[object, object]:
    """A type and no thing, or a thing and no type."""
    return (subject, None) if isinstance(subject, str) else (None, subject)


_LIFTS = """
SELECT coalesce(t.name, l.type) AS subject, l.about, coalesce(w.name, l.word) AS word, l.lift,
       l.seen, l.expected, l.by_part
FROM learned_lift l LEFT JOIN entity t ON t.id = l.entity_id LEFT JOIN entity w ON w.id = l.word_id
WHERE l.map_id = current_map() ORDER BY l.id
"""

_DETECTORS = """
SELECT e.name AS observer, d.within, d.hit, d.false_alarm, d.there, d.elsewhere
FROM detector_rate d LEFT JOIN entity e ON e.id = d.observer_id
WHERE d.map_id = current_map() ORDER BY e.name NULLS FIRST, d.within NULLS FIRST
"""


def _rows(session: psycopg.Connection[Any], statement: str) -> list[dict[str, Any]]:
    from psycopg.rows import dict_row

    with session.cursor(row_factory=dict_row) as cursor:
        return cursor.execute(statement).fetchall()
