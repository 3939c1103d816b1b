"""Beliefs by methods of a map; Bayes' rule by hand and Shapely judge them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import psycopg
import pytest
from PIL import Image

from semmap import Map
from semmap.belief.identify import Detection


@pytest.fixture
def flat(flat_map: Map) -> Iterator[Map]:
    """The flat with a storey, for one test: what the test changes is undone."""
    with flat_map.transaction() as transaction:
        flat_map.add_storey("ground", height=2.7)
        yield flat_map
        raise psycopg.Rollback(transaction)


def test_a_sighting_changes_the_belief_by_bayes_rule(flat: Map) -> None:
    prior = flat.where("coke")
    assert sum(prior.values()) == pytest.approx(1)
    assert list(prior.values()) == sorted(prior.values(), reverse=True)
    flat.observe("coke", "bench", hit=0.9, false_alarm=0.02)
    flat.observe("coke", "counter", seen=False, hit=0.8, false_alarm=0.01)
    likelihood = dict.fromkeys(prior, 0.02 * 0.99) | {"bench": 0.9 * 0.99, "counter": 0.02 * 0.2}
    weights = {place: prior[place] * likelihood[place] for place in prior}
    found = flat.where("coke")
    for place, weight in weights.items():
        assert found[place] == pytest.approx(weight / sum(weights.values()), abs=0.01)
    assert found.best == "bench"
    assert found.rows[0]["last_seen"] is not None
    assert "nowhere" not in found
    assert found == dict(found)
    assert "<td>bench</td>" in found._repr_html_()
    before = flat.where("coke", datetime(2020, 1, 1, tzinfo=UTC))
    assert before["bench"] == pytest.approx(prior["bench"])


def test_estimates_keep_the_reasons(flat: Map) -> None:
    flat.observe("cereal", "table")
    plain = flat.beliefs(["mug", "cereal"])
    moved = flat.beliefs(["mug", "cereal"], moves=1e9)
    hidden = flat.beliefs(["mug", "cereal"], occlusion=True)
    for name in ("mug", "cereal"):
        for found in (moved[name], hidden[name]):
            assert set(found) == set(plain[name])
            assert sum(found.values()) == pytest.approx(1)
            seen = {row["place"]: row["last_seen"] for row in found.rows}
            assert seen == {row["place"]: row["last_seen"] for row in plain[name].rows}
    again = flat.where("cereal", moves=1e9)
    assert dict(again) == pytest.approx(dict(moved["cereal"]), abs=1e-6)
    assert flat.beliefs([]) == {}


def test_a_belief_is_drawn_kept_and_exported(flat: Map, tmp_path: Path) -> None:
    found = flat.where("coke")
    for number, about in enumerate(("coke", found)):
        path = flat.draw("ground", belief=about).save(tmp_path / f"{number}.png")
        with Image.open(path) as picture:
            assert min(picture.size) > 100
    with pytest.raises(LookupError, match="no storey named attic"):
        flat.draw("attic", belief=found)
    made = flat.belief_field("coke", voxel_size=0.1)
    again = flat.belief_field("coke", voxel_size=0.1)
    assert (made["field"], made["voxels"]) == ("belief-coke", again["voxels"])
    assert again["version"] == made["version"] + 1
    program = flat.export_belief(["coke"])
    facts = re.findall(r"([\d.e-]+)::is_in\('coke', '(\w+)'\)", program)
    priors = {row["place"]: row["prior"] for row in found.rows}
    assert {place: float(share) for share, place in facts} == pytest.approx(priors)
    message = flat.initial_belief(["coke", "mug"])
    assert dict(zip(message["location"], message["coke"], strict=True)) == pytest.approx(
        dict(found)
    )


def test_detections_are_known_objects_or_new_ones(flat: Map) -> None:
    flat.observe("mug", "bench")
    mug, apple = flat.identify([Detection("mug", (6, 1, 0.5)), Detection("apple", (6, 1, 0.5))])
    assert mug.place == "bench"
    assert sum(mug.may_be.values()) == pytest.approx(1)
    assert mug.known["mug"] > 0.9
    assert (apple.place, apple.known) == (None, {})
    assert 0.95 < apple.new == 1 - apple.false_alarm


def test_bad_input_is_refused_in_words(flat: Map) -> None:
    for names, options, message in (
        (["cok"], {}, "no entity cok; did you mean coke"),
        (["cok\0"], {}, "no entity cok"),
        (["kitchen"], {}, "kitchen is a room: it does not move"),
        (["mug"], {"moves": -1}, "seconds is -1"),
        (["mug"], {"moves": 5, "occlusion": True}, "choose occlusion or moves"),
        (["mug", "mug"], {"occlusion": True}, "mug is named twice"),
        (["coke"], {"occlusion": True}, "its volume is unknown"),
    ):
        with pytest.raises((ValueError, LookupError), match=message), flat.transaction():
            flat.beliefs(names, **options)
    for given, message in (
        (["kitchen"], "kitchen has no place in a belief"),
        (["mug", "mug"], "mug is named twice"),
    ):
        with pytest.raises(ValueError, match=message), flat.transaction():
            flat.export_belief(given)
    with pytest.raises(ValueError, match=r"mug was detected at \(1, 2\): give x, y, z"):
        flat.identify([Detection("mug", (1, 2))])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="NUL"), flat.transaction():
        flat.belief_field("mug", "a\0")
    with pytest.raises(ValueError, match="voxel_size is nan"), flat.transaction():
        flat.belief_field("mug", voxel_size=float("nan"))


def test_an_object_without_a_pose_has_its_own_size(flat: Map) -> None:
    """Not the typical one of its type: a wide plate and a narrow one, both not placed."""
    for name, side in (("wide", 0.9), ("narrow", 0.1)):
        flat.add_object(name, type="plate", size=(side, side / 2, 0.03))
        row = flat.execute("SELECT sides, height, base FROM size_of(entity_id(%s))", name)[0]
        assert row[0] == pytest.approx([side / 2, side])
        assert row[1:] == pytest.approx((0.03, side**2 / 2))
