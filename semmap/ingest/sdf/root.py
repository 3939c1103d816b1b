"""The root element of an SDF file; old notation becomes the present one."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

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
