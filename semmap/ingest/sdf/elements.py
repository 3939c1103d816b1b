"""The elements of SDF files: roots, numbers, flags and poses; old notation becomes the present."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.world import Skipped
from semmap.ingest.xml_file import read_xml

OLD_ATTRIBUTES = {
    "model": {"static": "static"},
    "include": {"filename": "uri"},
    "box": {"size": "size"},
    "sphere": {"radius": "radius"},
    "cylinder": {"radius": "radius", "length": "length"},
    "plane": {"normal": "normal", "size": "size"},
    "mesh": {"filename": "uri", "scale": "scale"},
}
"""What files with the root ``<gazebo>`` write as attributes: by element, attribute and element."""

_LARGEST = 1e12
"""Largest length, angle or factor; products of a few such numbers stay finite."""


class Unusable(Exception):
    """An element of the file that must be left out; it becomes a `Skipped`."""

    def __init__(self, element: str, problem: str, fix: str) -> None:
        super().__init__(element, problem, fix)
        self.skipped = Skipped(element, problem, fix)


@contextmanager
def leaving_out(skipped: list[Skipped]) -> Iterator[None]:
    """Leave out an element that turns out unusable in this block; add it to `skipped` once."""
    try:
        yield
    except Unusable as unusable:
        if unusable.skipped not in skipped:
            skipped.append(unusable.skipped)


def read_root(path: Path) -> Element:
    """Return the root of an SDF file: ``<sdf>``, or ``<gazebo>`` as before SDF 1.3."""
    root = read_xml(path, ("sdf", "gazebo"))
    if root.tag == "gazebo":
        for element in list(root.iter()):
            for attribute, tag in OLD_ATTRIBUTES.get(element.tag, {}).items():
                if attribute in element.attrib and element.find(tag) is None:
                    SubElement(element, tag).text = element.get(attribute)
            if element.tag == "origin":
                element.tag, element.text = "pose", element.get("pose")
    return root


def numbers(element: Element | None, count: int, where: str) -> tuple[float, ...]:
    """Return the `count` finite numbers of an element."""
    text = "" if element is None or element.text is None else element.text
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        values = ()
    if len(values) != count or not all(abs(v) <= _LARGEST for v in values):
        found = "it is missing" if element is None else f"it is {text.strip()[:80]!r}"
        raise Unusable(
            where, f"{count} finite number{'s'[: count > 1]} expected, {found}", "Correct the file."
        )
    return values


def flag(text: str | None) -> bool | None:
    """Return a boolean; None where it is absent or neither true nor false."""
    return {"true": True, "1": True, "false": False, "0": False}.get((text or "").strip().lower())


def local_pose(element: Element, where: str) -> tuple[Pose, str]:
    """Return the `<pose>` of an element, and the frame that it names (empty: the default).

    SDF 1.9 pose: `x y z` in metres and fixed-axis roll, pitch, yaw in radians, in degrees with
    ``degrees="true"``, or a quaternion `x y z w` with ``rotation_format="quat_xyzw"``. The
    ``frame`` attribute of SDF 1.4-1.6 is read as ``relative_to``.
    """
    pose = element.find("pose")
    if pose is None:
        return IDENTITY, ""
    frame = (pose.get("relative_to") or pose.get("frame") or "").strip()
    if pose.text is None or not pose.text.strip():
        return IDENTITY, frame
    where = f"{where}: pose"
    if pose.get("rotation_format") == "quat_xyzw":
        x, y, z, *q = numbers(pose, 7, where)
        length = math.hypot(*q)
        if length < 1e-9:
            raise Unusable(where, "the quaternion is zero", "Give a unit quaternion x y z w.")
        qx, qy, qz, qw = (v / length for v in q)
        return Pose(x, y, z, qx, qy, qz, qw), frame
    x, y, z, *rpy = numbers(pose, 6, where)
    if flag(pose.get("degrees")):
        rpy = [math.radians(v) for v in rpy]
    return Pose.from_rpy(x, y, z, *rpy), frame
