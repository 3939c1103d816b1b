"""Homes with furniture at random, and what is learned of their use, beside the truth."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

import semmap
from semmap import Map
from semmap.belief.chain import Track, smooth
from semmap.belief.learning import detector_rates, habits, learn
from semmap.belief.store.history import read_history
from tests.examples.script import load_example

DAYS, HELD_OUT = 21, 6
Forecasts = tuple[NDArray[np.float64], NDArray[np.bool_]]
"""(n,) probabilities, and (n,) whether each came true."""


def furnished_home(db: semmap.Database, seed: int) -> Map:
    """A building of three rooms with furniture at random."""
    random = np.random.default_rng(seed)
    home = db.create_map(f"home{seed}")
    for number, kind in enumerate(("kitchen", "living_room", "bedroom")):
        x = 5.1 * number
        outline = [(x, 0), (x + 5, 0), (x + 5, 4), (x, 4)]
        home.add_room(f"r{number}", outline, floor=0, ceiling=2.6, type=kind)
        for place, type_ in enumerate(random.permutation(["table", "desk", "cabinet", "shelf"])):
            size = *random.uniform(0.5, 0.9, 2), random.uniform(0.4, 0.9)
            pose = (x + 1.2 + 2.4 * (place % 2), 1 + 2 * (place // 2), 0)
            home.add_object(f"f{number}{place}", type=str(type_), size=size, pose=pose)
    return home


class Use:
    """Weeks of use of a home by things and a rover that are added to it, the last days held out.

    Attributes
    ----------
    moves : oldest first, which the map is not told
    cut : when the days begin that nothing is learned from
    moments : of these days
    """

    def __init__(self, home: Map, seed: int, days: int = DAYS) -> None:
        self._household, random = load_example("household"), np.random.default_rng(seed)
        today = datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
        since = today - timedelta(days=days)
        self.home, self.things = home, sorted(things := self._household.add_things(home))
        home.add_agent("rover", type="robot", size=(0.4, 0.4, 1), pose=(0.5, 0.5, 0))
        self._weights = self._household.weights_of(home, self.things)
        self.moves = self._household.live(random, things, self._weights, since, days)
        places = sorted({place for own in self._weights.values() for place in own})
        self._looks = self._household.patrol(random, self.moves, places, since, days)
        self.cut = since + timedelta(days=days - HELD_OUT)
        hours = np.sort(random.uniform(0, 24 * HELD_OUT, 4 * HELD_OUT))
        self.moments = [self.cut + timedelta(hours=float(hour)) for hour in hours]

    def store(self, *, late: bool) -> None:
        """Store the looks before the days that are held out, or in them."""
        looks = [look for look in self._looks if (look.at >= self.cut) == late]
        self._household.store(self.home, looks, self._weights, "rover")

    def place_of(self, thing: str, moment: datetime) -> str | None:
        """Where a thing was in truth; None if it was not in the house."""
        own = [move for move in self.moves if move.thing == thing]
        place = own[bisect_right([move.at for move in own], moment) - 1].place
        return None if place is None else str(place)


def learned_and_not(home: Map, seed: int) -> tuple[Forecasts, Forecasts]:
    """Beliefs at random times of days that nothing was learned from, by looks until then.

    Each place of each thing, and whether it was there by the moves that the map was not told:
    after learning from the days before, and with nothing learned.
    """
    use = Use(home, seed)
    use.store(late=False)
    home.learn_belief()
    use.store(late=True)
    after = _judged(use)
    home.forget_learned()
    return after, _judged(use)


def learned_by_hours(
    home: Map, seed: int, ways: Mapping[str, NDArray[np.float64] | None], days: int = DAYS
) -> dict[str, Forecasts]:
    """The same, of each way to smooth the hours of habits, as `learn` takes it."""
    use = Use(home, seed, days)
    for late in (False, True):
        use.store(late=late)
    with home.snapshot() as seen:
        history = read_history(seen)
    names = dict(home.execute("SELECT id, name FROM entity WHERE map_id = current_map()"))
    found: dict[str, Forecasts] = {}
    for name, day in ways.items():
        known = [track.until(use.cut.timestamp()) for track in history.tracks]
        learned = learn(known, history.detectors, stated=history.stated, day=day)
        chance, true = [], []
        for track in history.tracks:
            if names[track.subjects[-1]] not in use.things:
                continue
            asked, rows = _with_moments(track, [moment.timestamp() for moment in use.moments])
            rates = detector_rates(asked, history.detectors, learned)
            passed = smooth(asked, *habits(asked, learned), *rates, history.stated)
            chance.append(passed.forecast[rows].ravel())
            places = [names[history.words[word][1]] for word in track.words[:, -1]]
            where = [use.place_of(names[track.subjects[-1]], moment) for moment in use.moments]
            true.append([place == at for at in where for place in [*places, None]])
        found[name] = np.concatenate(chance), np.concatenate(true)
    return found


def _with_moments(track: Track, moments: Sequence[float]) -> tuple[Track, NDArray[np.intp]]:
    """A track with looks at nothing at these times, and their rows."""
    size, many = len(track.at), len(moments)
    order = np.argsort(np.append(track.at, moments), kind="stable")
    nothing = {
        "at": np.array(moments),
        "hits": np.zeros((many, track.hits.shape[1]), bool),
        "told": np.zeros(many, bool),
        "seen": np.zeros(many, bool),
        "visible": np.zeros(many),
        "hit": np.full(many, 0.5),
        "false_alarm": np.full(many, 0.5),
        "detector": np.full(many, -1),
        "clock": np.zeros(many),
    }
    columns = {k: np.concatenate([getattr(track, k), v])[order] for k, v in nothing.items()}
    return replace(track, **columns), np.flatnonzero(order >= size)


def unsure(forecasts: Forecasts) -> Forecasts:
    """Those that are neither nearly 0 nor nearly 1; most are nearly 0."""
    chance, true = forecasts
    rows = (chance > 0.05) & (chance < 0.95)
    return chance[rows], true[rows]


def _judged(use: Use) -> Forecasts:
    ids = [use.home.execute("SELECT entity_id(%s)", name)[0][0] for name in use.things]
    chance, true = [], []
    for moment in use.moments:
        where = {name: use.place_of(name, moment) for name in use.things}
        for name, place, share in use.home.execute(
            "SELECT t.name, p.name, b.probability FROM belief_at(%s, %s) b "
            "JOIN entity t ON t.id = b.entity_id LEFT JOIN entity p ON p.id = b.place_id",
            *(ids, moment),
        ):
            chance.append(share)
            true.append(where[name] == place)
    return np.array(chance), np.array(true)
