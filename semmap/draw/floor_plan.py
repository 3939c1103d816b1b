"""The floor plan of a storey: rooms, grid, doors, objects, regions and a route."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib.patheffects as effects
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Arc, Patch, PathPatch, Polygon, Rectangle
from matplotlib.path import Path as Curve
from numpy.typing import NDArray
from scipy.ndimage import label

from semmap.draw.labels import AROUND, Labels, Style
from semmap.draw.palette import HIDDEN, INK, PATH, STATES, family, object_colour, room_colour
from semmap.draw.sheet import draw_title, paper_sheet, save_sheet
from semmap.draw.view import DoorView, ObjectView, OccupancyView, Outline, RegionView, StoreyView

Point = NDArray[np.float64]

FLAT = {"carpet"}
OVERHEAD, GROUND = 1.9, 0.3
"""Metres above and below the floor beyond which things are not on a plan."""
CUT = 1.2
"""Metres above the floor from which things are outlines alone, as in plans of architects."""

REGIONS: tuple[tuple[str, str, str], ...] = (  # type, colour, hatch
    ("blocked_region", "#c0392b", "////"),
    ("keepout_zone", "#c0392b", "////"),
    ("home_region", "#2b8a4b", "...."),
    ("stop_region", "#1d8a8a", "...."),
    ("navigation_region", "#1f6fb2", "\\\\\\\\"),
    ("region", "#7d5fb2", "\\\\"),
)
ASSUMED: Style = {"ls": (0, (2.5, 1.5)), "hatch": "....."}
"""How a plan shows objects with the typical box of their type."""
HANGING: Style = {"fc": "none", "ls": (0, (3, 2)), "lw": 0.9}
"""How it shows lamps, hoods and boards above that."""

_WALL = "#343a46"
_SHADES = [("white", 0.0), ("#8a8f98", 0.22), (_WALL, 0.20), (_WALL, 0.80), (_WALL, 0.96)]
"""Of cells: free, unknown, occupied by what is drawn, enclosed by walls, and occupied."""
_MARGIN = 0.55
_NEAR = 10.0
"""Metres from the rooms of a storey within which things make its plan larger; no ground does."""
_COVERED = 0.1
"""The share of a name that others may cover; names of large rooms come first."""
_DETAILED = 8.0
"""Points a metre from which doors have leaves, poses and names."""
_DOUBLE, _OPENING = 1.3, 2.4  # widths beyond which a door has two leaves, or none, metres

_KITE = [[0.13, 0, 0], [-0.09, 0.085, 0], [-0.045, 0, 0], [-0.09, -0.085, 0]]
"""The sign of a pose, metres in its frame."""

_ARROW = {
    "arrowstyle": "-|>,head_width=0.34,head_length=0.5",
    "color": PATH,
    "lw": 0,
    "ec": "white",
}
_ARROW |= {"shrinkA": 0, "shrinkB": 0, "mutation_scale": 13}

_SOUGHT = "#b3261e"
"""Of what robots look for and people are."""


def _halo(width: float, alpha: float) -> Style:
    stroke = effects.withStroke(linewidth=width, foreground="white", alpha=alpha)
    return {"path_effects": [stroke]}


_HALO = _halo(2.2, 0.85)
_BOLD: Style = {"weight": "bold", "zorder": 8}
_LEAST, _TYPE = 2.5, 6.5
"""Points of the smallest letters: of a room's name, and of one with its type below."""
_LETTER = 0.65
"""Widths of bold letters to their size: what is surely too long is not tried, which takes long."""
_PER_DOOR, _LEAST_DOOR = 2.5, 3.6
"""Square inches of a plan for each door below which their names are smaller, to so many points."""
_ROOM_NAME = _BOLD | _HALO | {"fontsize": 9.5, "color": INK, "linespacing": 1.1}
_DOOR_NAME = _BOLD | {"fontsize": 6.8, "color": "white"}
_REGION_NAME = _BOLD | _HALO | {"fontsize": 7, "style": "italic"}
_SOUGHT_NAME = _BOLD | _HALO | {"fontsize": 7, "color": _SOUGHT}
_OBJECT_NAME: Style = {"fontsize": 5.8, "color": "#23262b", "zorder": 7.5} | _halo(1.4, 0.7)


def floor_plan(
    storey: StoreyView,
    path: Path | str,
    *,
    title: str = "",
    width: float = 13.0,
    dpi: int = 200,
    over: Callable[[Axes], None] | None = None,
) -> Path:
    """Draw the plan of a storey and save it as PNG; return the path of the picture.

    Parameters
    ----------
    title : by default the name of the storey
    width : inches; the height follows from the storey
    over : draws more before names are written; its axes are metres of the map's frame

    Examples
    --------
    >>> import tempfile
    >>> from semmap.draw.view import RoomView
    >>> storey = StoreyView("ground", rooms=[RoomView("lab", shapely.box(0, 0, 4, 3), 0.0, 2.5)])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     floor_plan(storey, f"{folder}/plan.png", width=4, dpi=50).name
    'plan.png'
    """
    x0, y0, x1, y1 = _bounds(storey)
    missing = left_out(storey)
    gone = {name for names in missing.values() for name in names}
    objects = sorted((o for o in shown_objects(storey) if o.name not in gone), key=_height)
    head, foot = 0.62, 0.95
    sheet = width - 0.9  # inches for the plan itself
    height = sheet * (y1 - y0) / (x1 - x0)
    whole = height + head + foot
    figure = paper_sheet(width, whole, dpi)
    axes = figure.add_axes((0.6 / width, foot / whole, sheet / width, height / whole))
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)
    axes.set_aspect("equal")

    per_metre = 72 * sheet / (x1 - x0)  # points
    floors = [_curves(room.outline) for room in storey.rooms]
    colours = [room_colour(room.types, room.name) for room in storey.rooms]
    axes.add_collection(PathCollection(floors, facecolors=colours, edgecolors="none", zorder=1))
    for region in storey.regions:
        _region(axes, region)
    for entity in objects:
        _object(axes, entity, storey.elevation)
    if storey.occupancy is not None:
        _walls(axes, storey.occupancy, [o.footprint for o in objects if o.footprint is not None])
    else:
        style: Style = {"facecolors": "none", "edgecolors": _WALL, "linewidths": 1.6, "zorder": 4}
        axes.add_collection(PathCollection(floors, **style))
    if per_metre < _DETAILED:
        _strokes(axes, storey.doors)
    for door in storey.doors if per_metre >= _DETAILED else ():
        _door(axes, door)
    for line in storey.path:
        _path(axes, line)
    if over is not None:
        over(axes)
    _frame(axes, x0, y0, x1, y1)
    level = 1 - 0.36 / whole
    style = {"fontsize": 8.5, "color": "#6b6f76", "va": "center", "ha": "right"}
    summary = figure.text(
        1 - 0.3 / width, level, _summary(storey, len(objects), missing), fontdict=style
    )
    free = summary.get_window_extent().x0 / figure.bbox.width - 0.2 / width
    draw_title(figure, title or storey.name, level, 15, left=0.6 / width, right=free)
    _write(axes, storey, objects, per_metre)
    _legend(figure, axes, storey, objects, foot / whole)
    return save_sheet(figure, path)


def _bounds(storey: StoreyView) -> tuple[float, float, float, float]:
    """The bounds of rooms, doors, path and what is near; else of the grid; with a margin."""
    shapes: list[Any] = [r.outline for r in storey.rooms]
    shapes += [shapely.Point(p.x, p.y) for d in storey.doors for p in d.poses]
    shapes += [shapely.MultiPoint(p[:, :2]) for p in storey.path]
    things = [o.footprint for o in shown_objects(storey) if o.footprint is not None]
    around = shapely.union_all([shapely.box(*shape.bounds) for shape in shapes]).envelope
    near = [shapely.intersection(t, around.buffer(_NEAR)) for t in things if not t.covers(around)]
    shapes += [part for part in near if not part.is_empty] if shapes else things
    if not shapes and storey.occupancy is not None:
        left, right, bottom, top = storey.occupancy.extent
        shapes.append(shapely.box(left, bottom, right, top))
    if not shapes:
        raise ValueError(f"{storey.name}: there is nothing to draw: no rooms, objects or grid")
    boxes = np.array([s.bounds for s in shapes])
    low, high = boxes[:, :2].min(axis=0) - _MARGIN, boxes[:, 2:].max(axis=0) + _MARGIN
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def shown_objects(storey: StoreyView) -> list[ObjectView]:
    """The objects on a plan: no parts of the building, nothing overhead, nothing in the ground."""
    low, high = storey.elevation - GROUND, storey.elevation + OVERHEAD

    def is_between(entity: ObjectView) -> bool:
        if entity.mesh is None:
            return True
        z = entity.mesh.vertices[:, 2]
        return bool(z.min() < high and z.max() >= low)

    return [o for o in storey.objects if not HIDDEN & set(o.types) and is_between(o)]


def left_out(storey: StoreyView) -> dict[str, list[str]]:
    """Return the names of objects that a plan does not show, by the reason."""
    paper = shapely.box(*_bounds(storey))
    shown = shown_objects(storey)
    reasons = {
        "without a shape": [o.name for o in shown if o.footprint is None],
        "beyond the plan": [
            o.name for o in shown if o.footprint is not None and not paper.intersects(o.footprint)
        ],
    }
    return {reason: names for reason, names in reasons.items() if names}


def _height(entity: ObjectView) -> float:
    return 0.0 if entity.mesh is None else float(entity.mesh.vertices[:, 2].max())


def _polygons(outline: Outline) -> list[shapely.Polygon]:
    return [p for p in getattr(outline, "geoms", [outline]) if not p.is_empty]


def _curves(outline: Outline) -> Curve:
    """A polygon with its holes."""
    rings = [r for p in _polygons(outline) for r in (p.exterior, *p.interiors)]
    return Curve.make_compound_path(
        *(Curve(np.asarray(ring.coords)[:, :2], closed=True) for ring in rings)
    )


def _fill(axes: Axes, outline: Outline, **style: Any) -> None:
    axes.add_patch(PathPatch(_curves(outline), **style))


def _walls(axes: Axes, grid: OccupancyView, outlines: list[Outline]) -> None:
    """Draw the occupied cells: dark for the building, a light shade over objects."""
    rows, columns = np.nonzero(grid.cells > 50)
    solid = _enclosed(grid.cells)
    shades = np.zeros(grid.cells.shape, np.uint8)
    shades[(grid.cells < 0) & ~solid] = 1
    shades[solid] = 3
    shades[rows, columns] = 4
    if outlines:
        covered = shapely.union_all([t.buffer(0.75 * grid.resolution) for t in outlines])
        shapely.prepare(covered)
        x = grid.origin[0] + (columns + 0.5) * grid.resolution
        y = grid.origin[1] + (rows + 0.5) * grid.resolution
        over = shapely.contains_xy(covered, x, y)
        shades[rows[over], columns[over]] = 2
    left, right = axes.get_xlim()
    per_cell = axes.get_window_extent().width / (right - left) * grid.resolution  # pixels
    for axis in (0, 1):  # of the cells of a pixel, the darkest: no thin wall is lost
        count = grid.cells.shape[axis]
        pixels = min(count, max(1, round(count * per_cell)))
        first = np.arange(pixels) * count // pixels
        shades = np.maximum.reduceat(shades, first, axis=axis)
    for shown, zorder in (([1], 1.5), ([2, 3, 4], 4)):
        palette = np.zeros((len(_SHADES), 4), np.uint8)
        palette[shown] = np.round(255 * np.array([to_rgba(*_SHADES[k]) for k in shown]))
        axes.imshow(
            palette[shades],
            extent=grid.extent,
            origin="lower",
            interpolation="nearest",
            zorder=zorder,
        )


def _enclosed(cells: NDArray[np.int8]) -> NDArray[np.bool_]:
    """The unknown cells that walls enclose: those that are not connected to the border."""
    parts, count = label(cells < 0)
    border = np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]])
    inner = np.setdiff1d(np.arange(1, count + 1), border)
    found: NDArray[np.bool_] = np.isin(parts, inner)
    return found


def _region(axes: Axes, region: RegionView) -> None:
    _, colour, hatch = _region_style(region)
    fill, edge = to_rgba(colour, 0.10), to_rgba(colour, 0.75)
    _fill(axes, region.outline, fc=fill, ec=edge, hatch=hatch, lw=1.1, ls=(0, (4, 2)), zorder=2)


def _region_style(region: RegionView) -> tuple[str, str, str]:
    if region.blocked:
        return REGIONS[0]
    return next((r for r in REGIONS if r[0] in region.types), REGIONS[-1])


def _object(axes: Axes, entity: ObjectView, floor: float) -> None:
    assert entity.footprint is not None
    hangs = entity.mesh is not None and entity.mesh.vertices[:, 2].min() >= floor + CUT
    colour = object_colour(entity.types)
    r, g, b = (0.62 * c for c in to_rgb(colour))
    if FLAT & set(entity.types):
        fill, edge, above = to_rgba(colour, 0.45), (r, g, b, 0.5), 2.5
    else:
        fill, edge, above = to_rgba(colour, 0.85), (r, g, b, 0.95), 3.0
    style = HANGING if hangs else ASSUMED if entity.assumed else {}
    _fill(axes, entity.footprint, **{"fc": fill, "ec": edge, "lw": 0.7, "zorder": above} | style)


def _strokes(axes: Axes, doors: Sequence[DoorView]) -> None:
    """Draw doors as their openings, where more would be a blot."""
    ends = [_opening(door) for door in doors]
    colours = [STATES.get(door.state, STATES["open"]) for door in doors]
    axes.add_collection(LineCollection(ends, colors=colours, linewidths=1.6, zorder=5))


def _opening(door: DoorView) -> NDArray[np.float64]:
    """The ends (2, 2) of a door's opening, metres; of stairs, those of the way."""
    a, b = (np.array([p.x, p.y]) for p in door.poses)
    length = float(np.hypot(*(b - a)))
    if length < 1e-6 or door.type in ("stairs", "ramp"):
        return np.stack([a, b])
    way = (b - a) / length
    half = np.array([-way[1], way[0]]) * (door.width or 0.9) / 2
    return np.stack([(a + b) / 2 - half, (a + b) / 2 + half])


def _door(axes: Axes, door: DoorView) -> None:
    """Draw a door: its opening, and its open leaf or sliding panels."""
    a, b = (np.array([p.x, p.y]) for p in door.poses)
    length = float(np.hypot(*(b - a)))
    if length < 1e-6:
        return
    middle, way = (a + b) / 2, (b - a) / length
    along = np.array([-way[1], way[0]])
    w = door.width or 0.9
    colour = STATES.get(door.state, STATES["open"])
    hinge, latch = middle - along * w / 2, middle + along * w / 2

    def stroke(start: Point, end: Point, lw: float, **style: Any) -> None:
        style = Style(solid_capstyle="butt", zorder=5) | style
        axes.plot(*np.stack([start, end]).T, color=colour, lw=lw, **style)

    for pose in door.poses:
        axes.add_patch(Polygon(pose.apply(_KITE)[:, :2], fc="white", ec=colour, lw=0.8, zorder=5.5))
    if door.type == "elevator_door":
        for end, panel in ((hinge, along), (latch, -along)):
            stroke(end, end + panel * w * 0.36, 3.2)
        return
    if door.type in ("stairs", "ramp"):
        arrow = {"arrowstyle": "->", "color": colour, "lw": 1.4}
        axes.annotate("", (b[0], b[1]), (a[0], a[1]), arrowprops=arrow)
        return
    for end in (hinge, latch):
        stroke(end - 0.07 * way, end + 0.07 * way, 2.2)
    if door.state != "open":
        stroke(hinge, latch, 2.6)
    elif door.type == "opening" or w > _OPENING:
        stroke(hinge, latch, 1.2, ls=(0, (4, 3)))
    else:
        leaves = [(hinge, along), (latch, -along)][: 1 if w <= _DOUBLE else 2]
        reach = w / len(leaves)
        for pivot, shut in leaves:
            stroke(pivot, pivot - way * reach, 1.8, solid_capstyle="round")
            turns = [math.degrees(math.atan2(v[1], v[0])) for v in (-way, shut)]
            start, end = turns if (turns[1] - turns[0]) % 360 <= 180 else turns[::-1]
            swing: Style = {"color": colour, "lw": 0.8, "ls": (0, (3, 2)), "zorder": 5}
            at = pivot[0], pivot[1]
            axes.add_patch(Arc(at, 2 * reach, 2 * reach, theta1=start, theta2=end, **swing))


def _path(axes: Axes, line: NDArray[np.float64]) -> None:
    """Draw a route as a line with arrows, and a dot at its start."""
    xy = line[:, :2]
    rounded: Style = {"solid_capstyle": "round", "solid_joinstyle": "round"}
    axes.plot(*xy.T, color="white", lw=5.5, alpha=0.9, zorder=6, **rounded)
    axes.plot(*xy.T, color=PATH, lw=2.8, zorder=6.1, **rounded)
    steps = np.hypot(*np.diff(xy, axis=0).T)
    gone = np.concatenate([[0.0], np.cumsum(steps)])
    if gone[-1] > 0.3:
        for at in np.arange(min(1.2, gone[-1] / 2), gone[-1] - 0.3, 2.4):
            p, q = (
                (np.interp(s, gone, xy[:, 0]), np.interp(s, gone, xy[:, 1]))
                for s in (at - 0.12, at + 0.12)
            )
            axes.annotate("", q, p, zorder=6.2, arrowprops=_ARROW)
    axes.plot(*xy[0], "o", ms=8, mfc="white", mec=PATH, mew=2.2, zorder=6.3)
    axes.plot(*xy[-1], "o", ms=8, mfc=PATH, mec="white", mew=1.4, zorder=6.3)


def _frame(axes: Axes, x0: float, y0: float, x1: float, y1: float) -> None:
    for side in axes.spines.values():
        side.set_visible(False)
    step = _round_length((x1 - x0) / 10)
    axes.set_xticks(np.arange(math.ceil(x0 / step), math.floor(x1 / step) + 1) * step)
    axes.set_yticks(np.arange(math.ceil(y0 / step), math.floor(y1 / step) + 1) * step)
    axes.tick_params(length=0, labelsize=7, colors="#8a8f98", pad=3)
    axes.grid(True, color="#dfdbd0", lw=0.6, zorder=0)
    axes.set_axisbelow(True)


def _round_length(length: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is at most `length`, metres."""
    power = 10.0 ** math.floor(math.log10(max(length, 1e-3)))
    return max(k * power for k in (1, 2, 5) if k * power <= length * 1.0001)


def _summary(storey: StoreyView, drawn: int, missing: dict[str, list[str]]) -> str:
    counts = {"room": len(storey.rooms), "door": len(storey.doors), "object": drawn}
    parts = [f"{n} {what}{'s' * (n > 1)}" for what, n in counts.items() if n]
    parts += [f"{len(names)} {reason}" for reason, names in missing.items()]
    if storey.occupancy is not None:
        rows, columns = storey.occupancy.cells.shape
        parts.append(f"grid {columns} x {rows} at {storey.occupancy.resolution:g} m")
    return "  ·  ".join(parts)


def _broken(name: str) -> list[str]:
    """A name on two lines and on three, parted at spaces and signs; none where it has too few."""
    parts = re.findall(r"[^\s_/,.-]+[\s_/,.-]*", name)
    found = []
    for lines in range(2, min(len(parts), 3) + 1):
        ends = np.cumsum([len(part) for part in parts])
        line = np.minimum((ends - 1) * lines // ends[-1], lines - 1)
        texts = ["".join(np.array(parts)[line == k]).strip() for k in range(lines)]
        found.append("\n".join(text for text in texts if text))
    return found


def _write(axes: Axes, storey: StoreyView, objects: list[ObjectView], per_metre: float) -> None:
    """Write the names of rooms, doors, regions and objects where there is space for them."""
    labels = Labels(axes)
    for line in storey.path:
        for a, b in pairwise(line[:, :2]):
            for x, y in np.linspace(a, b, 2 + int(np.hypot(*(b - a)) / 0.2)):
                labels.keep_clear(x, y, 2.0)
    middles = [np.mean([(p.x, p.y) for p in door.poses], axis=0) for door in storey.doors]
    for x, y in middles:
        labels.keep_clear(x, y, 0.16 * per_metre)
    labels.shun([o.footprint.bounds for o in objects if o.footprint is not None])
    for room in sorted(storey.rooms, key=lambda r: -r.outline.area):
        spots = _spots(room.outline)
        kind = room.label or (room.types[0].replace("_", " ") if room.types else "")
        told = kind in ("", "room") or kind.lower() in room.name.lower()
        x, y = spots[0]
        place: Style = {"inside": room.outline.bounds, "most": _COVERED} | _ROOM_NAME
        place["offsets"] = [((u - x) * per_metre, (v - y) * per_metre) for u, v in spots]
        both = None if told else labels.put(x, y, f"{room.name}\n{kind}", least=_TYPE, **place)
        texts = [] if both is not None else [room.name, *_broken(room.name)]
        wide = (room.outline.bounds[2] - room.outline.bounds[0]) * per_metre / _LEAST / _LETTER
        while len(texts) > 1 and max(map(len, texts[0].split("\n"))) > wide:
            del texts[0]
        for text in texts:
            if labels.put(x, y, text, least=_LEAST, **place) is not None:
                break
    labels.shun([])
    near = max(9.0, 0.30 * per_metre)
    beside = _ring((near, near + 8, near + 16, near + 26))
    area = axes.get_window_extent().width * axes.get_window_extent().height / labels.dpi**2
    crowd = math.sqrt(area / _PER_DOOR / max(1, len(middles)))
    size = {"fontsize": max(_LEAST_DOOR, _DOOR_NAME["fontsize"] * min(1.0, crowd))}
    named = zip(storey.doors, middles, strict=True) if per_metre >= _DETAILED else ()
    for door, (x, y) in named:
        colour = STATES.get(door.state, STATES["open"])
        box: Style = {"boxstyle": "round,pad=0.22,rounding_size=0.5", "fc": colour, "ec": "white"}
        plate: Style = {**_DOOR_NAME, **size, "bbox": box | {"lw": 0.5}}
        labels.put(x, y, door.name, offsets=beside, most=_COVERED, **plate)
    for region in storey.regions:
        c = region.outline.representative_point()
        _, colour, _ = _region_style(region)
        kind = region.types[0].replace("_region", "").replace("_", " ") if region.types else ""
        text = region.name
        if kind and kind not in region.name.lower():
            text += f" ({kind})"
        style = {**_REGION_NAME, "color": colour}
        labels.put(c.x, c.y, text, offsets=((0, 0), *AROUND), most=_COVERED, **style)
    for entity in sorted(objects, key=lambda o: -o.footprint.area if o.footprint else 0.0):
        if entity.footprint is None or not entity.types:
            continue
        c = middle_of_object(entity.footprint)
        x0, y0, x1, y1 = entity.footprint.bounds
        text = entity.types[0].replace("_", " ")
        if {"food", "robot", "person"} & set(entity.types):
            leader: Style = {"color": _SOUGHT, "lw": 0.7}
            labels.put(c.x, c.y, text, offsets=AROUND, most=math.inf, leader=leader, **_SOUGHT_NAME)
            axes.plot(c.x, c.y, "o", ms=9, mfc="none", mec=_SOUGHT, mew=1.3, zorder=7)
            continue
        turn = 90 if (y1 - y0) > 1.6 * (x1 - x0) else 0
        within = (1.12 * (x1 - x0), 1.2 * (y1 - y0))
        labels.put(c.x, c.y, text, within=within, rotation=turn, **_OBJECT_NAME)


def middle_of_object(footprint: Outline) -> shapely.Point:
    """Return the middle of a footprint; where that is beside it, of its widest place."""
    filled = shapely.union_all([shapely.Polygon(p.exterior) for p in _polygons(footprint)])
    if filled.covers(footprint.centroid):
        return footprint.centroid
    return shapely.Point(shapely.maximum_inscribed_circle(footprint).coords[0])


def _ring(radii: Iterable[float]) -> list[tuple[float, float]]:
    turns = np.deg2rad((45, 135, -45, -135, 90, -90, 0, 180))
    return [(float(r * np.cos(a)), float(r * np.sin(a))) for r in radii for a in turns]


def _spots(outline: Outline) -> list[tuple[float, float]]:
    """Points for the name of a room, the middle and the widest places first."""
    largest = max(_polygons(outline), key=lambda p: p.area)
    middle = largest.centroid if largest.contains(largest.centroid) else largest.point_on_surface()
    x0, y0, x1, y1 = largest.bounds
    inner = largest.buffer(-0.35)
    if inner.is_empty:
        inner = largest
    xs, ys = np.meshgrid(np.linspace(x0, x1, 15), np.linspace(y0, y1, 15))
    inside = shapely.contains_xy(inner, xs.ravel(), ys.ravel())
    points = np.stack([xs.ravel()[inside], ys.ravel()[inside]], axis=1)
    away = np.hypot(points[:, 0] - middle.x, points[:, 1] - middle.y)
    return [(middle.x, middle.y), *map(tuple, points[np.argsort(away)].tolist())]


def _legend(
    figure: Figure, axes: Axes, storey: StoreyView, objects: list[ObjectView], foot: float
) -> None:
    """Draw a scale bar and the meaning of the colours."""
    left, bottom, width, _ = axes.get_position().bounds
    x0, x1 = axes.get_xlim()
    length = _round_length((x1 - x0) / 6)
    share = width * length / (x1 - x0)
    y = bottom - 0.50 * foot
    for i in range(4):
        at, colour = (left + i * share / 4, y), INK if i % 2 == 0 else "white"
        bar = Rectangle(at, share / 4, 0.045 * foot, fc=colour, ec=INK, lw=0.7)
        bar.set_transform(figure.transFigure)
        figure.add_artist(bar)
    for x, number in ((left, "0"), (left + share, f"{length:g} m")):
        figure.text(x, y - 0.05 * foot, number, fontsize=7, color=INK, ha="center", va="top")

    handles: list[Any] = []
    if storey.path:
        handles.append(Line2D([], [], color=PATH, lw=2.8, label="route"))
    for state, colour in STATES.items():
        if any(d.state == state for d in storey.doors):
            handles.append(Line2D([], [], color=colour, lw=2.2, label=f"door, {state}"))
    kinds = Counter(f for o in objects if (f := family(o.types)) is not None)
    for kind, _ in kinds.most_common(14):
        handles.append(Patch(fc=object_colour([kind]), ec="none", label=kind.replace("_", " ")))
    if any(o.assumed for o in objects):
        handles.append(Patch(fc="none", ec=INK, label="assumed size", **ASSUMED))
    for name, colour, hatch in dict.fromkeys(_region_style(r) for r in storey.regions):
        label_ = name.replace("_", " ")
        handles.append(Patch(fc=to_rgba(colour, 0.12), ec=colour, hatch=hatch, label=label_))
    if handles:
        figure.legend(
            handles=handles,
            loc="lower right",
            bbox_to_anchor=(left + width, 0.01),
            ncols=min(9, max(1, math.ceil(len(handles) / 2))),
            fontsize=7,
            frameon=False,
            labelcolor=INK,
            handlelength=1.3,
            handleheight=0.9,
            columnspacing=1.2,
            handletextpad=0.5,
            borderaxespad=0.0,
        )
