"""Named joint states of a robot, from the SRDF files beside its URDF."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from semmap.limits import TEXT_BYTES
from semmap.robot.error import RobotError


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
