"""Simple solids of scenes, by the same code and with the same limits as those of SDF."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from semmap.geometry.mesh import Mesh
from semmap.ingest.sdf.geometries import Geometries
from semmap.ingest.sdf.resources import Resources


def solid(tag: str, where: str, **sizes: float | Iterable[float]) -> Mesh:
    """Return a box, cylinder, sphere, ellipsoid, capsule, cone or plane about the origin.

    `sizes` are the elements of SDF, metres; `where` is the element, for the error `Unusable`.

    >>> solid("box", "crate", size=(1, 2, 3)).bounds.tolist()
    [[-0.5, -1.0, -1.5], [0.5, 1.0, 1.5]]
    """
    return Geometries(Resources()).mesh(solid_element(tag, **sizes), Path(), where)


def solid_element(tag: str, **values: float | str | Iterable[float]) -> Element:
    """Return a `<geometry>` of SDF."""
    geometry = Element("geometry")
    shape = SubElement(geometry, tag)
    for name, value in values.items():
        text = value if isinstance(value, str) else None
        if text is None:
            numbers = value if isinstance(value, Iterable) else [value]
            text = " ".join(repr(float(number)) for number in numbers)
        SubElement(shape, name).text = text
    return geometry
