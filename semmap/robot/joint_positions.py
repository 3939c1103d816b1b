"""Joint positions that a user gives: as JSON, a file of it, or a state of the robot's SRDF."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from semmap.finite_number import is_finite_number
from semmap.limits import TEXT_BYTES
from semmap.robot.error import RobotError


def joints_of(robot: Path, state: str | Mapping[str, float] | None) -> dict[str, float]:
    """The joint positions that a `posture` describes, radians or metres.

    They are given by name, as JSON, as the name of a file that holds it, or as that of a state in
    the SRDF of the URDF `robot`; none where None. ValueError where it is none of these.
    """
    if state is None:
        return {}
    if not isinstance(state, str):
        return _checked(dict(state))
    text = state
    if not state.lstrip().startswith("{"):
        named = read_states(robot)
        if state in named:
            return named[state]
        try:
            text = Path(state).read_text("utf-8")
        except OSError as error:
            known = f"the SRDF has {', '.join(sorted(named))}" if named else "there is no SRDF"
            raise ValueError(
                f"posture= {state}: is neither JSON nor a file ({error.strerror}) nor a state of "
                f'the robot\'s SRDF; give {{"joint": number}}; {known}'
            ) from None
    try:
        joints = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f'posture= is not JSON ({error}); give {{"joint": number}}') from None
    return _checked(joints)


def _checked(joints: Any) -> dict[str, float]:
    if not isinstance(joints, dict) or not all(map(is_finite_number, joints.values())):
        raise ValueError('posture= takes joint positions as {"joint": number}')
    return joints


def read_states(urdf: Path) -> dict[str, dict[str, float]]:
    """The joint positions of each named state, radians or metres.

    Read are the files ``*.srdf`` in the folder of the URDF, and in the folder ``srdf`` beside that.
    States of the same name, of several groups of joints, are joined. RobotError where an SRDF is
    not well-formed XML, or a joint's value is not a number.
    """
    states: dict[str, dict[str, float]] = {}
    for folder in (urdf.parent, urdf.parent.parent / "srdf"):
        for path in sorted(folder.glob("*.srdf")):
            for state in _root(path).iterfind("group_state"):
                joints = states.setdefault(state.get("name", ""), {})
                for joint in state.iterfind("joint"):
                    joints[joint.get("name", "")] = _value(path, joint)
    return states


def _root(path: Path) -> Element:
    TEXT_BYTES.check(
        path.stat().st_size,
        lambda problem, fix: RobotError(f"{path}: {problem}. {fix}"),
        "Remove what is not a state.",
    )
    try:
        root: Element = fromstring(path.read_bytes(), forbid_dtd=True)
    except (ParseError, DefusedXmlException) as error:
        raise RobotError(f"{path}: is not well-formed XML ({error}); fix it") from None
    return root


def _value(path: Path, joint: Element) -> float:
    text = joint.get("value", "")
    try:
        return float(text.split()[0])
    except (IndexError, ValueError):
        raise RobotError(
            f"{path}: joint {joint.get('name')}: its value {text!r} is not a number; give one"
        ) from None
