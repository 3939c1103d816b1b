"""The result of a parser: the entries of a world file, and what it left out."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Container, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from shapely import MultiPolygon, Polygon

from semmap.error import Error
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import IDENTITY, Pose

Kind = Literal["room", "object", "region", "connector", "elevator", "storey", "agent"]
ShapeKind = Literal["mesh", "box", "cloud", "polygon"]

OUTSIDE = "outside"
"""The name of the outdoors: an exterior door joins a place and this."""

NOT_OUTSIDE = f"{OUTSIDE} is where doors lead that leave the building: give another name"


class WorldError(Error):
    """A file that cannot be trusted as a whole; none of it is imported.

    `element` says where in the file (an XPath-like name, a line, a feature), `problem` what is
    wrong, `fix` what the user can do.
    """

    def __init__(self, path: Path | str, element: str, problem: str, fix: str) -> None:
        self.path, self.element, self.problem, self.fix = str(path), element, problem, fix
        super().__init__(f"{path}: {element}: {problem}. {fix}")

    def __reduce__(self) -> tuple[type[WorldError], tuple[str, str, str, str]]:
        return WorldError, (self.path, self.element, self.problem, self.fix)


class Refused(Exception):
    """An element of a file that cannot be used: what is wrong, and how to fix it."""

    def __init__(self, problem: str, fix: str) -> None:
        super().__init__(f"{problem}. {fix}")
        self.problem, self.fix = problem, fix


@dataclass(frozen=True)
class Skipped:
    """An element that cannot be used; it is left out and named in the summary."""

    element: str
    problem: str
    fix: str

    def __post_init__(self) -> None:
        for name, given in vars(self).items():  # text that every terminal and database accepts
            printable = given.replace("\0", "\ufffd").encode("utf-8", "replace").decode()
            object.__setattr__(self, name, printable)


@dataclass
class Shape:
    """A geometric model of an entry, in the entry's own frame, metres.

    `mesh` is the surface that navigation and relations use, of boxes and polygons, too; `outline`
    is the footprint where the area under the mesh is not (of a room, of walls).
    """

    kind: ShapeKind
    mesh: Mesh | None = None
    outline: Polygon | MultiPolygon | None = None
    role: Literal["visual", "collision"] = "visual"
    uri: str | None = None


@dataclass
class PlaceDetail:
    """What a room adds: heights in its frame, metres, and the elevator whose cabin it is."""

    floor: float = 0.0
    ceiling: float | None = None
    elevator: str | None = None


@dataclass
class StoreyDetail:
    """What an entry of kind storey adds: elevation above the origin and clear height, metres."""

    elevation: float = 0.0
    height: float | None = None


@dataclass
class RegionDetail:
    """What a region adds: from when until when it is valid, aware; None is open."""

    since: datetime | None = None
    until: datetime | None = None


@dataclass
class ConnectorDetail:
    """What a connector adds (Deeken et al., section 3.4).

    It joins two places, the second of which may be `OUTSIDE`; x of its frame points from the first
    to the second. In each is a pose in the connector's frame at which a robot faces it. `behaviour`
    names the robot behaviour that passing needs (``pass_door``, ``call_elevator``, ...). `width`
    and `height` are of the clear opening, `step` that of its threshold, metres; a robot needs one
    of the `permissions`.
    """

    places: tuple[str, str]
    poses: tuple[Pose, Pose]
    type: Literal["door", "elevator_door", "stairs", "ramp"] = "door"
    direction: Literal["both", "forward", "backward"] = "both"
    state: Literal["open", "closed", "locked"] = "open"
    behaviour: str = "pass_door"
    width: float | None = None
    height: float | None = None
    step: float = 0.0
    permissions: tuple[str, ...] = ()


@dataclass
class Entry:
    """One entity of the world (Deeken et al., section 3.3): any of its parts may be empty.

    `pose` is relative to the entry named by `holder`, or to the map where it is None; import
    derives a finer holder (the room, the table) for objects whose `holder` is None or a storey.
    `relation` is how a stated holder holds it.
    `type` is the T-Box name in lower snake case (``dining_table``), None where unknown.
    `front` is the heading of the entity's front in its own frame, radians from +x.
    """

    name: str
    kind: Kind
    type: str | None = None
    label: str | None = None
    properties: dict[str, Any] = field(default_factory=dict)
    holder: str | None = None
    pose: Pose | None = IDENTITY
    shapes: list[Shape] = field(default_factory=list)
    detail: PlaceDetail | StoreyDetail | RegionDetail | ConnectorDetail | None = None
    front: float = 0.0
    relation: Literal["in", "on"] = "in"


def poses_in_map(entries: Sequence[Entry]) -> dict[str | None, Pose]:
    """Return by name the poses of entries in the map, of which holders come before what they hold.

    An entry whose holder is of another file has its pose as if that stood at the map's origin.
    """
    poses: dict[str | None, Pose] = {None: IDENTITY}
    for entry in entries:
        poses[entry.name] = poses.get(entry.holder, IDENTITY) @ (entry.pose or IDENTITY)
    return poses


@dataclass
class WorldLink:
    """A named relation between two entries (Deeken et al., section 3.3, A3)."""

    subject: str
    relation: str
    object: str
    properties: dict[str, Any] = field(default_factory=dict)


@dataclass
class World:
    """The content of a file. Names in `entries` are unique; a holder comes before what it holds.

    `georeference` places its frame on the earth; `surveyed` if that was chosen here, for
    coordinates of the earth.
    """

    name: str
    source: Path
    entries: list[Entry] = field(default_factory=list)
    links: list[WorldLink] = field(default_factory=list)
    skipped: list[Skipped] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    georeference: dict[str, Any] | None = None
    surveyed: bool = False


def unique_name(name: str, taken: Container[str]) -> str:
    """Return `name`, with a free suffix `_2`, `_3`, ... if it is taken.

    It is the first one where the numbers have no gap.

    >>> unique_name("chair", {"chair", "chair_2"})
    'chair_3'
    """
    if name not in taken:
        return name
    high = 2
    while f"{name}_{high}" in taken:
        high *= 2
    numbers = range(high // 2 + 1, high)
    first = bisect_left(numbers, True, key=lambda number: f"{name}_{number}" not in taken)
    return f"{name}_{numbers[first] if first < len(numbers) else high}"
