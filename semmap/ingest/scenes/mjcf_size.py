"""The size of an MJCF model once MuJoCo has compiled it, from its elements.

MuJoCo makes room for all that a file claims; one that fails at that hangs at the next file.
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

from semmap.ingest.world import WorldError
from semmap.ingest.xml_file import read_xml
from semmap.limits import NESTING, PARTS, PIXELS

REPEATED = ("replicate", "composite", "flexcomp")

ARRAYS = {"texture": ("width", "height"), "hfield": ("nrow", "ncol"), "numeric": ("size",)}
"""Elements with an array of as many values as the product of these attributes."""


def check_size(root: Element, path: Path) -> None:
    """Raise a WorldError for more elements, or longer arrays, than the limits allow.

    Repetitions count, and so do the files that others include or attach.
    """
    size = _Size(path)
    count = size.count(root, 0)
    PARTS.check(count, partial(WorldError, path, "model"), "Split the scene.")
    size.check_array("size", size.users * count)


class _Size:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.files: dict[str, int] = {}  # the elements of those that are included
        self.models: dict[str, int] = {}  # those of models to attach, by name
        self.users = 0  # the most numbers of a user that an element has

    def count(self, element: Element, depth: int) -> int:
        """Return how many elements there are once all repetitions are written out."""
        tag = element.tag
        NESTING.check(depth, partial(WorldError, self.path, f"<{tag}>"), "Nest it less deeply.")
        if tag in ARRAYS:
            self.check_array(tag, math.prod(_number(element, name) for name in ARRAYS[tag]))
        if tag == "size":
            own = [_number(element, name) for name in element.attrib if name.startswith("nuser")]
            self.users = max([self.users, *own])
        inner = sum(self.count(each, depth + 1) for each in element)
        if tag in ("include", "model"):
            inner += self._file(element.get("file", ""), depth)
        if tag == "model":
            self.models[element.get("name", Path(element.get("file", "")).stem)] = inner
        if tag == "attach":
            inner += self.models.get(element.get("model", ""), 0)
        return (_number(element, "count") if tag in REPEATED else 1) * (1 + inner)

    def _file(self, name: str, depth: int) -> int:
        file = self.path.parent / name
        if name not in self.files and file.suffix != ".mjb" and file.is_file():
            self.files[name] = self.count(read_xml(file), depth + 1)
        return self.files.get(name, 0)

    def check_array(self, tag: str, values: int) -> None:
        PIXELS.check(values, partial(WorldError, self.path, f"<{tag}>"), "Give a smaller one.")


def _number(element: Element, name: str) -> int:
    """Return the product of the whole numbers of an attribute; 1 without any."""
    words = element.get(name, "1").split()
    return math.prod(int(word[:9]) for word in words if word.isdecimal())
