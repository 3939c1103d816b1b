"""Which objects were at a place at a time, by what was known then and since."""

from __future__ import annotations

from datetime import datetime

import numpy as np

from semmap.belief.chain import smooth
from semmap.belief.error import BeliefError
from semmap.belief.learning import detector_rates, habits
from semmap.belief.store.beliefs import things_named
from semmap.belief.store.history import Question, read_history
from semmap.belief.store.learning import read_learned
from semmap.query.entity_query import entity_id
from semmap.query.snapshot import Snapshot
from semmap.snake_case import snake_case

YEARS = 10
"""How far from now questions may be."""

_OF_TYPE = """
SELECT id, name FROM entity WHERE map_id = current_map() AND kind = 'object'
  AND coalesce(type, '') <> ALL (subtypes('building_element'))
  AND CASE WHEN %(names)s::text[] IS NULL THEN type = ANY (subtypes(%(type)s))
           ELSE name = ANY (%(names)s) END
"""


def which(seen: Snapshot, kind: str, place: str, at: datetime | None = None) -> dict[str, float]:
    """Return how probable each object of a type was in or on a place, the most probable first.

    `kind` is a type, else the name of an object; `at` has a time zone, and is now where None. Looks
    since then count as those before. LookupError without such a place or object; `BeliefError` for
    what is no object, a place where none of them has room, and times more than `YEARS` away.
    """
    ((now,),) = seen.session.execute("SELECT clock_timestamp()").fetchall()
    at = at or now
    if abs((at - now).days) > 365 * YEARS:
        raise BeliefError(f"{at.isoformat()} is more than {YEARS} years away")
    inside = entity_id(seen.session, place)
    wanted = {"type": snake_case(kind), "names": None}
    rows = seen.session.execute(_OF_TYPE, wanted).fetchall()
    if not rows:
        named = things_named(seen, kind)
        rows = seen.session.execute(_OF_TYPE, wanted | {"names": named}).fetchall()
        if not rows:
            raise BeliefError(
                f"{named[0]} is an agent or a part of the building: `semmap where {named[0]}` or "
                "its pose says where it is"
            )
    names = dict(rows)
    history = read_history(seen, Question([*names], inside, at))
    learned = read_learned(seen.session, history)
    found, can_be = {}, False
    for track in history.tracks:
        rates = detector_rates(track, history.detectors, learned)
        passed = smooth(track, *habits(track, learned), *rates, history.stated)
        (row,) = np.flatnonzero(track.visible == 0)  # no look shows nothing
        found[names[track.subjects[-1]]] = float(passed.there[row])
        can_be = can_be or bool(track.hits[row].any())
    if not can_be:
        raise BeliefError(
            f"{place} is no place of {kind}: name furniture with room for it, a room or a storey"
        )
    return dict(sorted(found.items(), key=lambda one: (-one[1], one[0])))
