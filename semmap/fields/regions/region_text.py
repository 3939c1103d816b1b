"""Regions as text, such as "SPHERE(x y z radius)", in metres and radians."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

import numpy as np

from semmap.fields.checks import as_points
from semmap.fields.regions.shaped_region import Box, Cone, Cylinder, Hull, Region, Sphere

Values = list[float]

_OF_VALUES: Mapping[str, tuple[tuple[int, ...], Callable[[Values], Region]]] = {
    "SPHERE": ((4,), lambda n: Sphere(n[:3], n[3])),
    "BOX": ((6, 10), lambda n: Box(n[:3], n[3:6], *[n[6:]] * (len(n) > 6))),
    "CYLINDER": ((5, 8), lambda n: Cylinder(n[:3], n[3], n[4], *[n[5:]] * (len(n) > 5))),
    "CONE": ((8,), lambda n: Cone(n[:3], n[3:6], n[6], n[7])),
}
"""Forms with a fixed number of values: the allowed numbers, and the region."""

_OF_POINTS: Mapping[str, Callable[[list[Values]], Region]] = {
    "HULL": Hull,
    "POINTS": lambda points: as_points(np.array(points).reshape(-1, 3), "POINTS"),
}
"""Forms with any number of points."""

FORMS: Mapping[str, str] = {
    "SPHERE": "SPHERE(x y z radius)",
    "BOX": "BOX(x y z width depth height), with a unit quaternion x y z w for a turned one",
    "CYLINDER": "CYLINDER(x y z radius height), with a direction x y z for one that lies",
    "CONE": "CONE(apex x y z, direction x y z, angle height)",
    "HULL": "HULL(x y z, x y z, ...)",
    "POINTS": "POINTS(x y z, x y z, ...)",
}
"""The text of each form: a centre first, lengths in metres, angles in radians."""

_TEXT = re.compile(r"\s*([A-Za-z]+)\s*\(([^()]*)\)\s*")


def read_region(text: str) -> Region:
    """Return the region that a text describes; the ValueError for others shows the form."""
    match = _TEXT.fullmatch(text)
    name = match[1].upper() if match else ""
    if match is None or name not in FORMS:
        forms = ", ".join(form.split("(")[0] for form in FORMS)
        raise ValueError(f"this is not a region: write {forms}(...)")
    try:
        groups = [
            [float(number) for number in group.split()]
            for group in match[2].split(",")
            if group.strip()
        ]
    except ValueError as error:
        raise ValueError(f"{error}: write {FORMS[name]}") from None
    if name in _OF_VALUES:
        counts, make = _OF_VALUES[name]
        numbers = [number for group in groups for number in group]
        if len(numbers) not in counts:
            raise ValueError(f"{name} has {len(numbers)} numbers: write {FORMS[name]}")
        return make(numbers)
    if any(len(group) != 3 for group in groups):
        raise ValueError(f"{name} takes points of three numbers: write {FORMS[name]}")
    return _OF_POINTS[name](groups)
