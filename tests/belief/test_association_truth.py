"""Detections in a simulated flat whose truth is known: they are as often right as they say."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

import numpy as np
import pytest

import semmap
from semmap.belief.association import ALIKE, CLASS_SPREAD
from semmap.belief.identify import FALSE_ALARM, NEW, SURE, Detection, identify
from semmap.belief.store.beliefs import read_belief
from semmap.belief.within_place import STAYS
from tests.conftest import MakeDatabase

TABLES = {f"table{k}": (2.0 + 3.0 * k, 2.0) for k in range(4)}
SIDES, TOP = (1.6, 1.2), 0.75
HIT, LACKING, FALSE = 0.8, 0.25, 0.08
VIEWS = 150
DAY = 86_400.0


class Seen(NamedTuple):
    """A hypothesis, its probability, and whether it was so."""

    what: str
    probability: float
    true: bool


@pytest.fixture(scope="module")
def flat(make_database: MakeDatabase) -> Iterator[semmap.Map]:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        made = db.create_map("flat")
        made.add_room("hall", [(0, 0), (14, 0), (14, 4), (0, 4)], floor=0, ceiling=2.7)
        for name, (x, y) in TABLES.items():
            made.add_object(name, type="table", size=(*SIDES, TOP), pose=(x, y, 0, 0))
        for k, (x, y) in enumerate(((1.7, 2.0), (2.3, 2.2), (5.0, 1.8), (8.0, 2.1))):
            made.add_object(f"mug{k}", type="mug", size=(0.08, 0.08, 0.1), pose=(x, y, TOP, 0))
        yield made


def sides(what: str, draw: np.random.Generator) -> tuple[float, float, float]:
    """A measured size: of a known mug with an error, of others as the model says."""
    scale = draw.normal(0.0, 0.1)
    if what in (NEW, FALSE_ALARM):
        alike = draw.random() < ALIKE
        scale += draw.normal(0.0, CLASS_SPREAD) if alike else draw.uniform(-0.5, 0.5) * np.log(1000)
    width, depth, height = np.array((0.08, 0.08, 0.1)) * np.exp(scale)
    return float(width), float(depth), float(height)


def view(flat: semmap.Map, draw: np.random.Generator) -> list[list[Seen]]:
    """One table is seen at a time; what is there is drawn from the beliefs about each mug.

    A mug that has not left its table mostly stands where it stood, any other one anywhere on it.
    """
    at = datetime.now(UTC) + timedelta(seconds=float(draw.choice([60, 0.1 * DAY, DAY])))
    age = (at - datetime.now(UTC)).total_seconds()
    name = str(draw.choice([*TABLES]))
    x, y = TABLES[name]

    def anywhere() -> tuple[float, float]:
        along, across = (np.array(SIDES) / 2 - 0.02) * draw.uniform(-1, 1, 2)
        return x + along, y + across

    there: list[tuple[str, tuple[float, float]]] = []
    with flat.snapshot() as seen:
        for k in range(4):
            belief = read_belief(seen, f"mug{k}", at)
            if draw.random() > belief[name]:
                continue
            pose, held = flat[f"mug{k}"].pose, flat[f"mug{k}"].holder.name
            stayed = min(np.exp(-age / DAY) / belief[name], 1.0) * STAYS if held == name else 0.0
            spot = (
                tuple(draw.normal((pose.x, pose.y), 0.1)) if draw.random() < stayed else anywhere()
            )
            there.append((f"mug{k}", spot))
        there += [(NEW, anywhere()) for _ in range(draw.poisson(LACKING))]
        found = [each for each in there if draw.random() < HIT]
        found += [(FALSE_ALARM, anywhere()) for _ in range(draw.poisson(FALSE))]
        if not found:
            return []
        identities = identify(
            seen,
            [Detection("mug", (*spot, TOP + 0.05), sides(what, draw)) for what, spot in found],
            at=at,
            hit=HIT,
            false_alarm=FALSE,
            new=LACKING,
        )
    for identity in identities:
        assert sum(identity.may_be.values()) == pytest.approx(1)
    return [
        [Seen(what, share, what == truth) for what, share in identity.may_be.items()]
        for (truth, _), identity in zip(found, identities, strict=True)
    ]


def test_identities_are_right_as_often_as_they_say(flat: semmap.Map) -> None:
    draw = np.random.default_rng(7)
    every = [each for _ in range(VIEWS) for each in view(flat, draw)]
    assert len(every) > VIEWS / 2
    told = [one for each in every for one in each]
    for low, high in ((0.0, 0.1), (0.1, 0.4), (0.4, 0.7), (0.7, 0.9), (0.9, 1.01)):
        shares = [one for one in told if low <= one.probability < high]
        expected = sum(one.probability for one in shares)
        spread = np.sqrt(sum(one.probability * (1 - one.probability) for one in shares))
        right = sum(one.true for one in shares)
        print(f"{low} to {high}: {len(shares)} told, {expected:.1f} expected, {right} right")
        assert abs(right - expected) < 3 * spread + 1
    for kind in (NEW, FALSE_ALARM):
        shares = [one for one in told if one.what == kind]
        spread = np.sqrt(sum(one.probability * (1 - one.probability) for one in shares))
        assert abs(sum(one.true - one.probability for one in shares)) < 3 * spread + 1
    best = [max(each, key=lambda one: one.probability) for each in every]
    sure = [one for one in best if one.probability >= SURE]
    print(f"{len(every)} detections: {np.mean([one.true for one in best]):.2f} right")
    print(f"{len(sure)} sure: {np.mean([one.true for one in sure]):.3f} right")
    assert np.mean([one.true for one in sure]) > SURE - 0.05
    assert len(sure) > len(every) / 4
