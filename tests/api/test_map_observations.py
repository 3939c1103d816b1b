"""Observations by methods of a map; SciPy and Shapely judge where detections are."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from scipy.spatial.transform import Rotation

from semmap import Map
from semmap.belief.identify import Detection

TABLE = shapely.box(0.7, 1.1, 2.3, 1.9)


@pytest.fixture
def flat(flat_map: Map) -> Iterator[Map]:
    """The flat, for one test: what the test changes is undone."""
    with flat_map.transaction() as transaction:
        yield flat_map
        raise psycopg.Rollback(transaction)


def stored(flat: Map) -> list[tuple[Any, ...]]:
    return flat.execute(
        "SELECT e.name, p.name, o.seen, o.inside, o.visible, w.name, o.position FROM observation o "
        "JOIN entity e ON e.id = o.entity_id JOIN entity p ON p.id = o.place_id "
        "LEFT JOIN entity w ON w.id = o.observer_id ORDER BY o.id"
    )


def test_a_room_means_anywhere_in_it(flat: Map) -> None:
    flat.observe("mug", "table", at=datetime(2026, 5, 1, 12), visible=0.5, observer="robot")
    flat.observe("mug", "kitchen", seen=False)
    flat.observe("mug", "kitchen", inside=False)
    row = flat.observe("mug", "kitchen", position=(0.1, 0.2, 0))
    assert row["inside"] is False
    assert stored(flat) == [
        ("mug", "table", True, False, 0.5, "robot", None),
        ("mug", "kitchen", False, True, 1.0, None, None),
        ("mug", "kitchen", True, False, 1.0, None, None),
        ("mug", "kitchen", True, False, 1.0, None, [0.1, 0.2, 0.0]),
    ]
    (at,) = flat.execute("SELECT min(at) FROM observation")
    assert at[0] == datetime(2026, 5, 1, 12).astimezone(), "local without a time zone"


def test_a_detection_in_the_frame_of_a_robot(flat: Map) -> None:
    turn = Rotation.from_euler("z", 2.5)
    flat["robot"].move_to(2.6, 0.8, 0, 2.5)
    for point in ((1.2, 0.1, 0.76), (0.9, -0.3, 0.76), (1.0, -1.0, 0.02)):
        there = turn.apply(point) + np.array((2.6, 0.8, 0))
        row = flat.observe_point("mug", point, frame="robot", hit=0.7)
        on_table = TABLE.contains(shapely.Point(there[:2])) and there[2] > 0.75
        assert row["place"] == ("table" if on_table else "kitchen")
        pose = flat[row["place"]].pose
        assert pose is not None
        np.testing.assert_allclose(pose.apply([row["position"]])[0], there, atol=1e-9)
        assert row["observer"] == "robot"


def test_no_object_has_two_detections(flat: Map) -> None:
    flat.add_object(
        "cup", type="cup", size=(0.08, 0.08, 0.1), pose=(1.5, 1.5, 0.76, 0), define=True
    )
    seen = [Detection("cup", (x, 1.5, 0.8)) for x in (1.1, 1.95, 1.55)]
    rows = flat.observe_objects(seen)
    assert [row["object"] for row in rows] == ["cup_1", "cup_2", "cup"], "the nearest is the known"
    assert [row["new"] for row in rows] == [True, True, False]
    assert {(row["type"], row["place"]) for row in rows} == {("cup", "table")}
    assert all(row["probability"] > 0.9 for row in rows)
    for row, detection in zip(rows, seen, strict=True):
        pose = flat[row["object"]].pose
        assert pose is not None
        np.testing.assert_allclose((pose.x, pose.y), detection.point[:2], atol=0.02)


def test_objects_seen_again_at_their_points_are_each_itself(flat: Map) -> None:
    points = {"a": (1.0, 1.3), "b": (1.2, 1.7), "c": (2.0, 1.5)}
    for name, (x, y) in points.items():
        flat.add_object(name, type="apple", size=(0.07,) * 3, pose=(x, y, 0.76, 0), define=True)
    for order in (("c", "a", "b"), ("b", "c", "a")):
        rows = flat.observe_objects([Detection("apple", (*points[n], 0.8)) for n in order])
        assert [row["object"] for row in rows] == list(order)
        assert all(row["probability"] > 0.99 for row in rows)
    assert {name: (flat[name].pose.x, flat[name].pose.y) for name in points} == points


def test_interchangeable_objects_at_unknown_points_are_surely_at_the_place(flat: Map) -> None:
    for name in ("a", "b"):
        flat.add_object(name, type="apple", size=(0.07,) * 3, define=True)
        flat.observe(name, "table")
    rows = flat.observe_objects([Detection("apple", (x, 1.5, 0.8)) for x in (1.0, 2.0)])
    assert sorted(row["object"] for row in rows) == ["a", "b"]
    for row, x in zip(rows, (1.0, 2.0), strict=True):
        assert row["probability"] == pytest.approx(0.5, abs=0.05)
        assert flat[row["object"]].pose.x == pytest.approx(x)


def test_a_doubtful_view_of_one_of_several_alike_says_nothing_new_of_its_room(flat: Map) -> None:
    """They are believed in the room already: each of the stools may be the one that was seen."""
    for n in range(3):
        flat.add_object(f"s{n}", type="stool", size=(0.3, 0.3, 0.4), pose=(1 + n, 2.6, 0, 0))
    room = str(flat["s0"].room.name)  # type: ignore[union-attr]
    (row,) = flat.observe_objects([Detection("stool", (1.5, 2.9, 0.2))])
    assert row["place"] == room
    assert row["probability"] < 0.9
    assert [flat[f"s{n}"].pose.x for n in range(3)] == [1, 2, 3]  # type: ignore[union-attr]
    assert all(flat.where(f"s{n}")[room] > 0.9 for n in range(3))


def test_one_of_four_alike_that_moved_moves_none_of_them(flat: Map) -> None:
    """All are in the room surely, but which one was detected is not known."""
    points = {"a": (0.3, 0.3), "b": (0.3, 2.7), "c": (0.9, 0.6), "d": (0.9, 2.4)}
    for name, (x, y) in points.items():
        flat.add_object(name, type="stool", size=(0.3, 0.3, 0.4), pose=(x, y, 0, 0))
    for x, y in ((2.6, 1.4), (2.6, 0.5)):
        (row,) = flat.observe_objects([Detection("stool", (x, y, 0.2), (0.3, 0.3, 0.4))])
        assert row["object"] in points
        assert row["probability"] < 0.9
        for name, point in points.items():
            assert (flat[name].pose.x, flat[name].pose.y) == pytest.approx(point)
    now = flat.beliefs(list(points))
    assert all(belief.rows[0]["place"] == "kitchen" for belief in now.values())


def test_a_doubtful_view_that_is_repeated_says_nothing_new(flat: Map) -> None:
    """Within ten seconds: later it is another look, which makes it surer."""
    for name, (x, y) in {"a": (4.6, 0.3), "b": (4.6, 2.7), "c": (5.2, 0.4)}.items():
        flat.add_object(name, type="stool", size=(0.3, 0.3, 0.4), pose=(x, y, 0, 0))
    flat.add_object("lost", type="stool", size=(0.3, 0.3, 0.4))
    seen = [Detection("stool", (2.6, 1.4, 0.2), (0.3, 0.3, 0.4))]
    begin = datetime.now(UTC) - timedelta(seconds=60)
    counts = []
    for second in (0, 0.2, 1, 5, 9.9, 11, 12):
        flat.observe_objects(seen, at=begin + timedelta(seconds=second))
        counts.append(len(stored(flat)))
    assert counts[0] > 0
    assert len({*counts[:5]}) == 1
    assert counts[5] > counts[4]
    assert counts[6] == counts[5]
    assert flat["lost"].pose is None


def test_a_view_tells_what_was_seen_and_what_was_missed(flat: Map) -> None:
    view = (0.2, 1.5, 1.4, 0.0, 0.5)
    rows = flat.observe_view(view, ["mug", "cereal"], {"cereal": (1.5, 1.5, 0.8)})
    seen = [(row["object"], row["place"]) for row in rows if row["seen"]]
    missed = {row["place"] for row in rows if not row["seen"] and row["object"] == "mug"}
    assert seen == [("cereal", "table")]
    assert "table" in missed
    assert "bench" not in missed, "it is in the hall"
    assert len(stored(flat)) == len(rows)
    behind = flat.observe_view((*view[:3], math.pi, 0.5), ["mug"], furthest=2.0)
    assert "table" not in {row["place"] for row in behind}
    same = flat.observe_view(view, ["mug"], frame="robot", furthest=0.01)
    assert same == []


VIEW = (0.2, 1.5, 1.4, 0.0, 0.5)
REFUSED: dict[str, tuple[str, tuple[Any, ...], dict[str, Any], str]] = {
    "place": ("observe", ("mug", "tabel"), {}, "no entity tabel; did you mean table"),
    "itself": ("observe", ("mug", "mug"), {}, "an object is not its own place"),
    "share": ("observe", ("mug", "table"), {"visible": 0}, "visible is 0"),
    "rate": ("observe", ("mug", "table"), {"hit": 2}, "hit is 2"),
    "future": ("observe", ("mug", "table"), {"at": datetime(9999, 1, 1)}, "in the future"),
    "position": ("observe", ("mug", "table"), {"position": (1, 2)}, "position is"),
    "room": ("observe", ("kitchen", "table"), {}, "kitchen is a room"),
    "two": ("observe_point", ("mug", (1, 2)), {}, "give x, y, z in metres"),
    "text": ("observe_point", ("mug", ("a", 1, 2)), {}, "give x, y, z in metres"),
    "far": ("observe_point", ("mug", (99, 1, 2)), {}, "no place has room for it"),
    "agent": ("observe_point", ("mug", (1, 1, 1)), {"frame": "rob"}, "did you mean robot"),
    "names": ("observe_view", (VIEW,), {}, "name the objects that are looked for"),
    "view": ("observe_view", (VIEW[:4], ["mug"]), {}, "a view is x, y, z, yaw and pitch"),
    "NaN": ("observe_view", ((*VIEW[:4], math.nan), ["mug"]), {}, "a view is x, y, z, yaw"),
    "seen": ("observe_view", (VIEW, (), {"mug": (1, 2)}), {}, "give x, y, z in metres"),
    "opening": ("observe_view", (VIEW, ["mug"]), {"opening": 9}, "the view opens 9 rad"),
    "range": ("observe_view", (VIEW, ["mug"]), {"furthest": 0}, "the range of the view is 0"),
    "cloud": ("observe_view", (VIEW, ["mug"]), {"cloud": [[1, 2]]}, r"shape \(1, 2\)"),
    "file": ("observe_view", (VIEW, ["mug"]), {"cloud": "gone.ply"}, "gone.ply does not exist"),
    "without": ("observe_view", (VIEW, ["mug"]), {"without": ["table"]}, "without is for a cloud"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_input_is_refused_in_words(flat: Map, case: str) -> None:
    method, words, options, message = REFUSED[case]
    with pytest.raises((ValueError, LookupError), match=message):
        getattr(flat, method)(*words, **options)
    assert stored(flat) == []
