"""Percepts as JSON, and recordings of them."""

from __future__ import annotations

import base64
import io
import json
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from semmap.fields.service.percept_feeds import Inbox, Recording, make_feed
from semmap.fields.service.percept_json import read_percept
from semmap.fields.sources.manager import EndOfPercepts
from semmap.fields.sources.percepts import Gaze, People, RobotState, Segmentation

NOW = "2026-01-01T12:00:00+00:00"


def test_each_kind_of_percept() -> None:
    gaze = read_percept({"time": NOW, "poses": {"human1": {"from": [0, 0, 1], "to": [1, 0, 1]}}})
    assert isinstance(gaze, Gaze)
    np.testing.assert_allclose(np.asarray(gaze.poses["human1"])[:3, 2], (1, 0, 0), atol=1e-12)
    assert gaze.time == datetime.fromisoformat(NOW)
    turned = read_percept({"poses": {"human1": [1, 2, 3, 0, 0, 0, 1]}})
    assert isinstance(turned, Gaze)
    np.testing.assert_allclose(np.asarray(turned.poses["human1"])[:3, 3], (1, 2, 3))
    people = read_percept({"people": {"anna": {"x": 1, "y": 2}}})
    assert isinstance(people, People)
    assert people.people["anna"].y == 2
    robot = read_percept({"pose": np.eye(4).tolist(), "joints": {"arm": 0.3}})
    assert isinstance(robot, RobotState)
    assert robot.joints == {"arm": 0.3}


def image(**more: Any) -> dict[str, Any]:
    return {
        "depth": [[1.0, 2.0]],
        "labels": [[0, 1]],
        "names": {"1": "mug"},
        "intrinsics": [1, 1, 0, 0],
        "pose": np.eye(4).tolist(),
    } | more


def test_images_from_arrays_and_files(tmp_path: Path) -> None:
    inline = read_percept(image())
    buffer = io.BytesIO()
    np.save(buffer, np.array([[1.0, 2.0]]))
    encoded = read_percept(image(depth={"npy": base64.b64encode(buffer.getvalue()).decode()}))
    Image.fromarray(np.array([[1000, 2000]], np.uint16)).save(tmp_path / "d.png")
    np.save(tmp_path / "l.npy", np.array([[0, 1]]))
    files = read_percept(image(depth="d.png", labels="l.npy"), tmp_path)
    for each in (inline, encoded, files):
        assert isinstance(each, Segmentation)
        np.testing.assert_allclose(each.depth, [[1, 2]])
        np.testing.assert_array_equal(each.labels, [[0, 1]])


@pytest.mark.parametrize(
    ("percept", "message"),
    [
        ([1], "a percept is an object"),
        ({"gaze": 1}, "none of the keys poses, people, depth, pose"),
        ({"poses": {"a": [1, 2]}}, "poses.a is not a pose"),
        ({"poses": [1]}, "the percept with poses is wrong"),
        ({"poses": {}, "time": "noon"}, "time: noon is not like"),
        ({"poses": {}, "time": "2026-01-01T12:00:00"}, "no time zone"),
        ({"people": {"a": {"x": float("nan"), "y": 0}}}, "not finite"),
        ({"people": {"a": {"x": 1}}}, "the percept with people is wrong"),
        ({"people": {"a": {"x": 1}}}, "people.a has no y: give metres"),
        ({"people": [{"x": 1}]}, r"people is \[\{'x': 1\}\]: give .* by name"),
        ({"people": {"a": [1, 2]}}, r"people.a is \[1, 2\]: people.a has x and y"),
        ({"people": {"a": {"x": 1, "y": 2, "up": 3}}}, "people.a has up: .* may have yaw, vx"),
        ({"people": {"a": {"x": "1", "y": 2}}}, "people.a: x is '1'"),
        ({"people": {"a": {"x": 1e9, "y": 0}}}, "people.a: x reaches .* within 10,000 m"),
        ({"poses": {"a": [1e9, 0, 0, 0, 0, 0, 1]}}, "poses.a reaches .* within 10,000 m"),
        ({"poses": {"a": {"from": [0, 0, 1]}}}, r"poses.a is .*: give \{.from.: \[x, y, z\]"),
        ({"pose": np.eye(4).tolist(), "joints": [1]}, r"joints is \[1\]: give a number by name"),
        ({"pose": np.eye(4).tolist(), "joints": {"a": "b"}}, "joints.a is 'b': give radians"),
        ({"depth": [[1.0]], "labels": [[0]]}, "the percept with depth is wrong: it has no 'names'"),
        (image(depth="../d.png"), "only a recording can name files"),
    ],
)
def test_wrong_percepts(percept: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read_percept(percept)


def test_files_outside_of_a_recording_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="outside of the recording"):
        read_percept(image(depth="../d.png"), tmp_path)


def recording(folder: Path, *seconds: float) -> Path:
    begin = datetime.fromisoformat(NOW)
    lines = [
        json.dumps(
            {"time": (begin + timedelta(seconds=s)).isoformat(), "people": {"a": {"x": s, "y": 0}}}
        )
        for s in seconds
    ]
    (folder / "walk.jsonl").write_text("\n".join(lines))
    return folder


def test_a_recording_keeps_its_pace(tmp_path: Path) -> None:
    begin = datetime.now(UTC)
    feed = Recording(recording(tmp_path, 0, 4, 100), "walk", begin=begin, speed=10)
    first = feed()
    assert isinstance(first, People)
    assert first.people["a"].x == 0
    assert feed() is first
    time.sleep(0.45)
    second = feed()
    assert isinstance(second, People)
    assert second.people["a"].x == 4
    assert second.time == begin + timedelta(seconds=0.4)


def test_a_recording_ends_or_begins_again(tmp_path: Path) -> None:
    long_ago = datetime.now(UTC) - timedelta(hours=1)
    over = Recording(recording(tmp_path, 0, 1), "walk", begin=long_ago)
    assert over() is not None
    with pytest.raises(EndOfPercepts):
        over()
    loop = Recording(recording(tmp_path, 0, 1), "walk", begin=long_ago, loop=True)
    assert loop() is not None
    loop()
    again = loop()
    assert isinstance(again, People)
    assert again.people["a"].x == 0


def test_wrong_recordings(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="files in that folder: none"):
        Recording(tmp_path, "walk")
    for text, message in (
        ("", "has no percepts"),
        ('{"people": {}}', "line 1: the percept has no time"),
        ("{", "line 1"),
    ):
        (tmp_path / "walk.jsonl").write_text(text)
        with pytest.raises(ValueError, match=message):
            Recording(tmp_path, "walk")
    with pytest.raises(ValueError, match="line 2: earlier"):
        Recording(recording(tmp_path, 1, 0), "walk")


def test_feeds_by_name(tmp_path: Path) -> None:
    assert isinstance(make_feed("socket", "gaze"), Inbox)
    assert isinstance(make_feed(f"recording:{recording(tmp_path, 0)}", "walk"), Recording)
    with pytest.raises(LookupError, match="there is no percept plug-in nose"):
        make_feed("plugin:nose", "gaze")
    with pytest.raises(ValueError, match="give socket, recording:FOLDER, mcap:FILE or plugin:NAME"):
        make_feed("soket", "gaze")
