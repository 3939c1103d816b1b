"""Percepts as JSON: what a socket and a recording contain (docs/fields.md)."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.draw.depth_camera import look_at
from semmap.fields.sources.percepts import Gaze, People, PersonMotion, RobotState, Segmentation
from semmap.finite_number import finite_numbers, is_finite_number
from semmap.geometry.pose import Pose
from semmap.limits import EXTENT
from semmap.npy_file import read_npy

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
            except KeyError as error:
                raise ValueError(f"the percept with {key} is wrong: it has no {error}") from None
            except (TypeError, AttributeError, ValueError) as error:
                raise ValueError(f"the percept with {key} is wrong: {error}") from None
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
    poses = _by_name(percept["poses"], "poses", "a pose")
    return Gaze({name: _pose(pose, f"poses.{name}") for name, pose in poses.items()}, time)


def _people(percept: Mapping[str, Any], time: datetime, _: Path | None) -> People:
    given = _by_name(percept["people"], "people", '{"x": 1.0, "y": 2.0}')
    return People({name: _motion(each, f"people.{name}") for name, each in given.items()}, time)


_NEEDED = ("x", "y")


def _motion(given: Any, name: str) -> PersonMotion:
    known = [each.name for each in fields(PersonMotion)]
    of = f"{name} has {' and '.join(_NEEDED)}, and may have {', '.join(known[len(_NEEDED) :])}"
    if not isinstance(given, Mapping):
        raise ValueError(f"{name} is {given!r}: {of}")
    for key in _NEEDED:
        if key not in given:
            raise ValueError(f"{name} has no {key}: give metres")
    for key, value in given.items():
        if key not in known:
            raise ValueError(f"{name} has {key}: {of}")
        if not is_finite_number(value):
            raise ValueError(f"{name}: {key} is {value!r}, not finite: give a number")
        _check_extent(abs(value), f"{name}: {key}")
    return PersonMotion(**({"yaw": 0.0} | {key: float(value) for key, value in given.items()}))


def _robot(percept: Mapping[str, Any], time: datetime, _: Path | None) -> RobotState:
    given = _by_name(percept.get("joints", {}), "joints", "a number")
    joints = {}
    for name, value in given.items():
        if not is_finite_number(value):
            raise ValueError(f"joints.{name} is {value!r}: give radians or metres")
        joints[name] = float(value)
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


def _by_name(given: Any, name: str, value: str) -> dict[str, Any]:
    """The values by name of a part of a percept."""
    if not isinstance(given, Mapping):
        raise ValueError(f'{name} is {given!r}: give {value} by name, {{"anna": ...}}')
    return {str(key): each for key, each in given.items()}


def _pose(given: Any, name: str) -> NDArray[np.float64]:
    if isinstance(given, Mapping):
        eye, target = (finite_numbers(given.get(key, ()), 3) for key in ("from", "to"))
        if eye is None or target is None:
            raise ValueError(f'{name} is {given!r}: give {{"from": [x, y, z], "to": [x, y, z]}}')
        _check_extent(max(map(abs, (*eye, *target))), name)
        return np.asarray(look_at(eye, target), float)
    pose = np.asarray(given, float)
    if pose.shape == (7,):
        pose = np.asarray(Pose(*pose.tolist()).matrix, float)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ValueError(
            f'{name} is not a pose: give a 4 x 4 matrix, seven numbers, or {{"from": [x, y, z], '
            '"to": [x, y, z]}'
        )
    _check_extent(np.abs(pose[:3, 3]).max(), name)
    return pose


def _check_extent(furthest: float, name: str) -> None:
    if EXTENT.exceeded_by(furthest):
        raise ValueError(
            f"{name} reaches {EXTENT.text(furthest)}: give positions within "
            f"{EXTENT.text(EXTENT.value)} of the map's origin. {EXTENT.variable} raises the limit."
        )


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
        return read_npy(file)
    except ValueError as error:
        raise ValueError(f"{name} is not a NumPy file: {error}") from None
