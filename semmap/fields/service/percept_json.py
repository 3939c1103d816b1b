"""Percepts as JSON: what a socket and a recording contain (docs/fields.md)."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.draw.depth_camera import look_at
from semmap.fields.sources.percepts import Gaze, People, PersonMotion, RobotState, Segmentation
from semmap.geometry.pose import Pose

Percept = Gaze | People | RobotState | Segmentation


def read_percept(percept: Any, folder: Path | None = None, time: datetime | None = None) -> Percept:
    """Return a percept of its JSON; which kind it is follows from its keys.

    Its time is ISO 8601 with a zone, or `time`, or now. Images name files of `folder`, if given.
    Raises ValueError: it is no percept; the message names the wrong part.
    """
    if not isinstance(percept, Mapping):
        raise ValueError('a percept is an object, such as {"poses": {"human1": [...]}}')
    for key, read in _KINDS.items():
        if key in percept:
            when = time or read_time(percept)
            try:
                return read(percept, when, folder)
            except (TypeError, KeyError, AttributeError) as error:
                raise ValueError(f"the percept with {key} is wrong: {error!r}") from None
    raise ValueError(f"the percept has none of the keys {', '.join(_KINDS)}: add one")


def read_time(percept: Mapping[str, Any]) -> datetime:
    """Return the time of a percept, now if it has none; ValueError for one without a zone."""
    given = percept.get("time")
    if given is None:
        return datetime.now(UTC)
    try:
        time = datetime.fromisoformat(str(given))
    except ValueError:
        raise ValueError(f"time: {given} is not like 2026-01-31T12:00:00Z") from None
    if time.tzinfo is None:
        raise ValueError(f"time: {given} has no time zone: for UTC write {given}Z")
    return time


def _gaze(percept: Mapping[str, Any], time: datetime, _: Path | None) -> Gaze:
    poses = percept["poses"]
    return Gaze({str(name): _pose(pose, f"poses.{name}") for name, pose in poses.items()}, time)


def _people(percept: Mapping[str, Any], time: datetime, _: Path | None) -> People:
    people = {}
    for name, motion in percept["people"].items():
        numbers = {str(key): float(value) for key, value in motion.items()}
        if not all(np.isfinite(list(numbers.values()))):
            raise ValueError(f"people.{name} has a number that is not finite: give metres")
        people[str(name)] = PersonMotion(**({"yaw": 0.0} | numbers))
    return People(people, time)


def _robot(percept: Mapping[str, Any], time: datetime, _: Path | None) -> RobotState:
    joints = {str(name): float(value) for name, value in percept.get("joints", {}).items()}
    return RobotState(_pose(percept["pose"], "pose"), time, joints)


def _image(percept: Mapping[str, Any], time: datetime, folder: Path | None) -> Segmentation:
    depth = _array(percept["depth"], "depth", folder).astype(np.float32)
    labels = _array(percept["labels"], "labels", folder).astype(np.int32)
    names = {int(number): str(name) for number, name in percept["names"].items()}
    pose = _pose(percept["pose"], "pose")
    return Segmentation(depth, labels, names, percept["intrinsics"], pose, time)


_KINDS: dict[str, Callable[[Mapping[str, Any], datetime, Path | None], Percept]] = {
    "poses": _gaze,
    "people": _people,
    "depth": _image,
    "pose": _robot,
}


def _pose(given: Any, name: str) -> NDArray[np.float64]:
    if isinstance(given, Mapping):
        return np.asarray(look_at(given["from"], given["to"]), float)
    pose = np.asarray(given, float)
    if pose.shape == (7,):
        pose = np.asarray(Pose(*pose.tolist()).matrix, float)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ValueError(
            f'{name} is not a pose: give a 4 x 4 matrix, seven numbers, or {{"from": [x, y, z], '
            '"to": [x, y, z]}'
        )
    return pose


def _array(given: Any, name: str, folder: Path | None) -> NDArray[Any]:
    if isinstance(given, Mapping):
        return _npy(io.BytesIO(base64.b64decode(given["npy"])), name)
    if not isinstance(given, str):
        return np.asarray(given)
    if folder is None:
        raise ValueError(f"{name}: only a recording can name files: send an array, or npy")
    path = (folder / given).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise ValueError(f"{name}: {given} is outside of the recording")
    if path.suffix == ".npy":
        return _npy(path, name)
    from PIL import Image

    pixels = np.asarray(Image.open(path))
    return pixels / 1000 if name == "depth" else pixels


def _npy(file: Any, name: str) -> NDArray[Any]:
    try:
        return np.asarray(np.load(file, allow_pickle=False))
    except ValueError as error:
        raise ValueError(f"{name} is not a NumPy file: {error}") from None
