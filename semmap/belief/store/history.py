"""Read what a map knows of where its objects were, as tracks to learn from and to ask."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, NamedTuple

import numpy as np
import psycopg

from semmap.belief.chain import Track
from semmap.query.snapshot import Snapshot

ABOUT = ("room_type", "room", "place_type", "place")
"""What the words of a place are about, the general ones first."""

PORTION = 200
"""Things whose priors are read at once: those of many take more than linear time."""

_THINGS = """
SELECT e.id, ARRAY(SELECT c.super FROM type_closure c WHERE c.sub = coalesce(e.type, e.kind)
                   ORDER BY (SELECT count(*) FROM type_closure n WHERE n.sub = c.super), c.super),
       greatest(coalesce(property_of(e.id, 'mobility'), 1), 0) / m.moves, m.stated, m.time_zone
FROM entity e, belief_model_of(current_map()) m
WHERE e.map_id = current_map() AND e.kind = 'object'
  AND coalesce(e.type, '') <> ALL (subtypes('building_element'))
  AND CASE WHEN %(things)s::bigint[] IS NOT NULL THEN e.id = ANY (%(things)s)
           ELSE EXISTS (SELECT FROM observation o WHERE o.entity_id = e.id)
             OR EXISTS (SELECT FROM placement_history h WHERE h.entity_id = e.id) END
ORDER BY e.id
"""

_PRIORS = "SELECT entity_id, place_id, prior FROM prior_of(%s, %s) ORDER BY 1, 2 NULLS LAST"

_WORDS = "SELECT place_id, about, word, word_id FROM place_words(%s)"

_STATEMENTS = """
SELECT s.entity_id, extract(epoch FROM s.at)::float8,
       extract(epoch FROM s.at AT TIME ZONE %s::text - s.at AT TIME ZONE 'UTC')::float8, s.place_ids
FROM statements_about(%s, %s, clock_timestamp(), false) s
"""

_LOOKS = """
SELECT o.entity_id, extract(epoch FROM o.at)::float8,
       extract(epoch FROM o.at AT TIME ZONE %s::text - o.at AT TIME ZONE 'UTC')::float8,
       o.place_id, o.inside, o.seen, o.visible,
       coalesce(o.hit, m.there + m.change * f.fresh),
       coalesce(o.false_alarm, m.elsewhere - m.change * f.fresh),
       CASE WHEN o.hit IS NULL AND o.false_alarm IS NULL THEN o.observer_id END,
       look_within(o.distance)
FROM observation o, belief_model_of(current_map()) m,
     LATERAL (SELECT greatest(extract(epoch FROM %s::timestamptz - o.at), 0)::float8) a (age),
     LATERAL (SELECT exp(-least(coalesce(a.age * greatest(coalesce(property_of(o.entity_id,
         'mobility'), 1), 0) / m.seconds, 0), 700))) f (fresh)  -- else each look is judged fresh
WHERE o.entity_id = ANY (%s)
ORDER BY o.at, o.id
"""

_WITHIN_PLACE = """
SELECT b.outer_id, p.id FROM unnest(%s::bigint[]) b (outer_id), unnest(%s::bigint[]) p (id)
WHERE p.id = b.outer_id OR is_held_by(p.id, b.outer_id)
"""


_HAS_LEARNED = "SELECT EXISTS (SELECT FROM learned_lift WHERE map_id = current_map())"

_CLOCK = """
SELECT extract(epoch FROM %(at)s::timestamptz)::float8,
    extract(epoch FROM %(at)s::timestamptz AT TIME ZONE %(zone)s::text
                       - %(at)s::timestamptz AT TIME ZONE 'UTC')::float8
"""


@dataclass(frozen=True, eq=False)
class History:
    """The tracks of a map's things, and the names of the words and detectors in them."""

    tracks: list[Track]
    words: list[tuple[str | None, int | None]]
    detectors: list[tuple[Any, ...]]
    stated: float


class Question(NamedTuple):
    """Whether objects were in or on a place at a time."""

    things: Sequence[int]
    place: int
    at: datetime


class HistoryEntry(NamedTuple):
    """A statement or look, as the columns of `Track` have it; None is elsewhere."""

    at: float
    clock: float
    told: bool
    places: Sequence[int | None]
    seen: bool = False
    visible: float = 1.0
    hit: float = 0.5
    false_alarm: float = 0.5
    detector: int = -1


def read_history(
    seen: Snapshot, asked: Question | None = None, time_zone: str | None = None
) -> History:
    """Read what the map knows of where its objects were, parts of the building left out.

    All objects with a history, by the clock of a time zone, by default the map's; or those that are
    `asked` about, each with a look at nothing that is the question.
    """
    session = seen.session
    things = None if asked is None else [*asked.things]
    rows = session.execute(_THINGS, {"things": things}).fetchall()
    zone = time_zone or rows[0][4] if rows else "UTC"
    ids = [row[0] for row in rows]
    former = asked is not None and not session.execute(_HAS_LEARNED).fetchall()[0][0]
    prior: dict[int, dict[int | None, float]] = defaultdict(dict)  # elsewhere is the last place
    for first in range(0, len(ids), PORTION):
        portion = ids[first : first + PORTION]
        for thing, place, share in session.execute(_PRIORS, (portion, former)):
            prior[thing][place] = share
    numbers, words = _words(session, {p for own in prior.values() for p in own if p is not None})
    pairs = [(thing, place) for thing in ids for place in prior[thing]]
    columns = [[pair[column] for pair in pairs] for column in (0, 1)]
    entries: dict[int, list[HistoryEntry]] = defaultdict(list)
    for thing, at, clock, places in session.execute(_STATEMENTS, [zone, *columns]):
        entries[thing].append(HistoryEntry(at, clock, True, places))
    detectors: dict[tuple[Any, ...], int] = {}
    looks = session.execute(_LOOKS, (zone, asked and asked.at, ids)).fetchall()
    wide = {look[3] for look in looks if look[4]} | ({asked.place} if asked else set())
    held = _held(session, wide, numbers)
    for thing, at, clock, place, inside, saw, visible, *rates, observer, within in looks:
        detector = -1
        if observer is not None:
            names = (observer,) if within is None else (observer, within)
            detector = detectors.setdefault(names, len(detectors))
        places = held[place] if inside else [place]
        hit, false_alarm = rates
        entry = HistoryEntry(at, clock, False, places, saw, visible, hit, false_alarm, detector)
        entries[thing].append(entry)
    question = []
    if asked is not None:
        ((at, clock),) = session.execute(_CLOCK, {"at": asked.at, "zone": zone}).fetchall()
        question = [HistoryEntry(at, clock, False, held[asked.place], False, 0.0)]
    tracks = []
    for thing, types, rate, *_ in rows:
        known = [e for e in entries[thing] if not prior[thing].keys().isdisjoint(e.places)]
        if asked is None:
            known = _without_echoes(sorted(known, key=lambda entry: (entry.at, entry.told)))
        else:  # as the database orders them; the question comes after what is at its time
            known.sort(key=lambda entry: (entry.at, not entry.told))
            known = _without_repeats(known, question[0].at) + question
            known.sort(key=lambda entry: entry.at)
        if known:
            tracks.append(_track((*types, thing), rate, prior[thing], numbers, known))
    return History(tracks, words, list(detectors), rows[0][3] if rows else 0.0)


def _without_echoes(entries: Sequence[HistoryEntry]) -> list[HistoryEntry]:
    """Entries in their order, without statements of what was seen just before.

    The map follows sightings: what it states then is what the sighting says.
    """
    kept: list[HistoryEntry] = []
    for entry in entries:
        last = kept[-1] if kept else None
        echo = entry.told and last is not None and last.seen and {*entry.places} & {*last.places}
        if not echo:
            kept.append(entry)
    return kept


def _without_repeats(entries: Sequence[HistoryEntry], at: float) -> list[HistoryEntry]:
    """Entries without those that state a place again, as beliefs leave them out: the last counts.

    One before a time and one after it both count.
    """
    kept: list[HistoryEntry] = []
    later: HistoryEntry | None = None
    for entry in reversed(entries):
        same = entry.told and later is not None and {*entry.places} == {*later.places}
        if not same or later is None or entry.at <= at < later.at:
            kept.append(entry)
        later = entry if entry.told else later
    return kept[::-1]


def _track(
    subjects: tuple[Any, ...],
    rate: float,
    prior: Mapping[int | None, float],
    numbers: Mapping[int, list[int]],
    entries: Sequence[HistoryEntry],
) -> Track:
    at, clock, told, _, seen, visible, hit, false_alarm, detector = zip(*entries, strict=True)
    words = [numbers[place] for place in prior if place is not None]
    return Track(
        subjects,
        np.array([*prior.values()]),
        np.array(words, np.intp).reshape(-1, len(ABOUT)),
        rate,
        np.array(at, np.float64),
        np.array([[place in entry.places for place in prior] for entry in entries], np.bool_),
        np.array(told, np.bool_),
        np.array(seen, np.bool_),
        np.array(visible, np.float64),
        np.array(hit, np.float64),
        np.array(false_alarm, np.float64),
        np.array(detector, np.intp),
        np.array(clock, np.float64),
    )


def _words(
    session: psycopg.Connection[Any], places: set[int]
) -> tuple[dict[int, list[int]], list[tuple[str | None, int | None]]]:
    """The numbers of the words about each place by `ABOUT`, -1 for none, and the words."""
    numbers: dict[tuple[str | None, int | None], int] = {}
    of = {place: [-1] * len(ABOUT) for place in places}
    for place, about, word, word_id in session.execute(_WORDS, (sorted(places),)):
        number = numbers.setdefault((word, word_id), len(numbers))
        of[place][ABOUT.index(about)] = number
    return of, list(numbers)


def _held(
    session: psycopg.Connection[Any], outer: set[int], places: Iterable[int]
) -> dict[int, list[int]]:
    """Of some places, those in each of some rooms, storeys or pieces of furniture, and itself."""
    found: dict[int, list[int]] = {place: [] for place in outer}
    for place, inner in session.execute(_WITHIN_PLACE, (sorted(outer), sorted(places))):
        found[place].append(inner)
    return found
