"""Homes with furniture at random, and what is learned of their use, beside the truth."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

import semmap
from semmap import Map
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


def learned_and_not(home: Map, seed: int) -> tuple[Forecasts, Forecasts]:
    """Beliefs at random times of days that nothing was learned from, by looks until then.

    Each place of each thing, and whether it was there by the moves that the map was not told:
    after learning from the days before, and with nothing learned.
    """
    household, random = load_example("household"), np.random.default_rng(seed)
    today = datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
    since = today - timedelta(days=DAYS)
    things = household.add_things(home)
    home.add_agent("rover", type="robot", size=(0.4, 0.4, 1), pose=(0.5, 0.5, 0))
    weights = household.weights_of(home, list(things))
    moves = household.live(random, things, weights, since, DAYS)
    places = sorted({place for own in weights.values() for place in own})
    looks = household.patrol(random, moves, places, since, DAYS)
    cut = since + timedelta(days=DAYS - HELD_OUT)
    household.store(home, [look for look in looks if look.at < cut], weights, "rover")
    home.learn_belief()
    household.store(home, [look for look in looks if look.at >= cut], weights, "rover")
    hours = np.sort(random.uniform(8, 22, 4 * HELD_OUT))
    moments = [cut + timedelta(days=n // 4, hours=float(h)) for n, h in enumerate(hours)]
    after = _judged(home, things, moves, moments)
    home.forget_learned()
    return after, _judged(home, things, moves, moments)


def unsure(forecasts: Forecasts) -> Forecasts:
    """Those that are neither nearly 0 nor nearly 1; most are nearly 0."""
    chance, true = forecasts
    rows = (chance > 0.05) & (chance < 0.95)
    return chance[rows], true[rows]


def _judged(
    home: Map, things: Mapping[str, str], moves: Sequence[Any], moments: Sequence[datetime]
) -> Forecasts:
    names = sorted(things)
    ids = [home.execute("SELECT entity_id(%s)", name)[0][0] for name in names]
    chance, true = [], []
    for moment in moments:
        where = {}
        for name in names:
            own = [move for move in moves if move.thing == name]
            where[name] = own[bisect_right([move.at for move in own], moment) - 1].place
        for name, place, share in home.execute(
            "SELECT t.name, p.name, b.probability FROM belief_at(%s, %s) b "
            "JOIN entity t ON t.id = b.entity_id LEFT JOIN entity p ON p.id = b.place_id",
            *(ids, moment),
        ):
            chance.append(share)
            true.append(where[name] == place)
    return np.array(chance), np.array(true)
