"""Limits on input: one table, checked where input enters.

The defaults are ample for a building. An environment variable changes each of them.

Why: docs/decisions/limits_are_one_table_raised_by_environment_variables.md
"""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass

NO_CHARACTER = re.compile("[\x00\ud800-\udfff]")
"""A code point that no text of the database has: NUL, and halves of surrogate pairs."""


@dataclass(frozen=True)
class Limit:
    """The most of something that input may have; `covers` says what is counted, for the docs.

    >>> limit = Limit("wheels", 4, "wheels", "wheels of a robot")
    >>> limit.variable, limit.value, limit.exceeded_by(5)
    ('SEMMAP_MAX_WHEELS', 4, True)
    """

    name: str
    default: float
    unit: str
    covers: str

    @property
    def variable(self) -> str:
        """The environment variable that changes the limit."""
        return f"SEMMAP_MAX_{self.name.upper()}"

    @property
    def value(self) -> float:
        """The limit as it is now; ValueError if the variable holds no number above 0."""
        text = os.environ.get(self.variable, "").strip()
        if not text:
            return self.default
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not 0 < number < math.inf:
            raise ValueError(f"{self.variable} is {text!r}: give a number above 0, or unset it")
        return int(number) if number.is_integer() else number

    def exceeded_by(self, found: float) -> bool:
        """True where `found` is more than the limit, or is NaN."""
        return not found <= self.value

    def check(
        self, found: float, error: Callable[[str, str], Exception], fix: str, verb: str = "has"
    ) -> None:
        """Raise an error where the limit is exceeded.

        `error` makes it of the problem, in which `verb` stands before `found`, and of how to fix
        it: the sentence `fix`, and the variable.
        """
        if self.exceeded_by(found):
            raise error(
                f"{verb} {self.text(found)}, the limit is {self.text(self.value)}",
                f"{fix} {self.variable} raises the limit.",
            )

    def text(self, number: float) -> str:
        """A number with the unit, thousands separated; whole mebibytes as such."""
        number = min(number, sys.float_info.max)  # a file may state an integer of 400 digits
        if self.unit == "bytes" and number % 2**20 == 0:
            return f"{number / 2**20:,.0f} MiB"
        plain = f"{number:,.0f}" if 1000 <= abs(number) < 1e15 else f"{number:g}"
        return f"{plain} {self.unit}"


TEXT_BYTES = Limit(
    "text_bytes",
    64 * 2**20,
    "bytes",
    "a world, robot, annotation or ontology, as text or GeoPackage",
)
CONFIG_BYTES = Limit(
    "config_bytes", 2**20, "bytes", "a file of parts, policy, rules, domain or map"
)
MESH_BYTES = Limit("mesh_bytes", 512 * 2**20, "bytes", "a mesh file, unpacked")
ELEMENTS = Limit(
    "elements",
    2_000_000,
    "values",
    "a YAML file, aliases unfolded; lists and objects of JSON; elements of XML; facts of RDF; "
    "features of a GeoPackage",
)
RDF_CHARACTERS = Limit(
    "rdf_characters", 2**29, "characters", "the facts of an RDF file, prefixes unfolded"
)
TRIANGLES = Limit("triangles", 20_000_000, "triangles", "a mesh file or model with all it nests")
PARTS = Limit("parts", 20_000, "parts", "meshes placed in a file or model, nested ones included")
PRIMS = Limit("prims", 250_000, "prims", "a USD stage, references and variants unfolded")
NESTING = Limit("nesting", 64, "levels", "elements, models, nodes or lists within each other")
VERTICES = Limit("vertices", 50_000, "vertices", "the outline of a room, region or object")
ENTRIES = Limit("entries", 1_000_000, "entries", "a world file")
NAME_CHARACTERS = Limit("name_characters", 500, "characters", "a name, type or label")
EXTENT = Limit("extent", 10_000, "m", "coordinates, sizes and offsets in a file or percept")
SURFACE_TRIANGLES = Limit(
    "surface_triangles", 300_000, "triangles", "a model in which support surfaces are looked for"
)
PIXELS = Limit("pixels", 2**26, "pixels", "the image of an occupancy grid")
MAP_EDGES = Limit(
    "map_edges", 250_000, "edges", "of occupied cells, in an occupancy grid that is imported"
)
ARRAY_VALUES = Limit("array_values", 2**26, "values", "an array of a NumPy file")
CLOUD_POINTS = Limit("cloud_points", 5_000_000, "points", "a point cloud of a camera")
UNPACKED = Limit("unpacked", 100, "times its size", "a recording (MCAP), unpacked")
GRID_CELLS = Limit("grid_cells", 2**30, "cells", "an occupancy grid or costmap")
LINKS = Limit("links", 500, "links", "a robot")
ACTIONS = Limit("actions", 200, "actions", "a domain file")
REGION_VOXELS = Limit("region_voxels", 2**30, "voxels", "a region, or a shape of an entity")
REGION_BLOCKS = Limit(
    "region_blocks", 2**18, "blocks", "blocks of 8 x 8 x 8 voxels on the border of a region"
)
QUERY_CHARACTERS = Limit("query_characters", 1_000_000, "characters", "a query")
QUERY_WORDS = Limit("query_words", 2_500, "words", "a query, marks and numbers counted")
QUERY_ROWS = Limit("query_rows", 2**24, "rows", "solutions of a query, or a part of one")
QUERY_SECONDS = Limit("query_seconds", 60, "s", "evaluating a query, or SPARQL in shapes")
REGEX_SECONDS = Limit(
    "regex_seconds", 1, "s", "matching one name in REGEX of a query on fields, or in sh:pattern"
)
REQUEST_BYTES = Limit(
    "request_bytes", 256 * 2**20, "bytes", "a request to a service of fields: an image with labels"
)
REQUEST_SECONDS = Limit(
    "request_seconds", 60, "s", "until a request of more than 1 MiB to that service has its end"
)
MESSAGE_BYTES = Limit(
    "message_bytes", 4 * 2**20, "bytes", "a message to a server of KnowledgeCore's protocol"
)
MESSAGE_SECONDS = Limit(
    "message_seconds", 20, "s", "until such a message has its end, and until its answer is taken"
)
BUNDLE_AHEAD = Limit(
    "bundle_ahead", 86_400, "s", "the time of a bundle of manipulation knowledge, after the clock"
)
READER_BYTES = Limit(
    "reader_bytes",
    8 * 2**30,
    "bytes",
    "the memory in which a USD or LAZ file is read, or SPARQL in shapes is evaluated",
)
READER_SECONDS = Limit("reader_seconds", 600, "s", "a process that reads or evaluates these")

LIMITS = tuple(each for each in list(vars().values()) if isinstance(each, Limit))
"""All limits, in the order of the documentation."""
