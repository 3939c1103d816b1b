"""Storeys in 3D, one above the other, their walls cut open (Deeken et al., Figures 2 and 8)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle, pairwise, permutations
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from semmap.arrays import Floats
from semmap.draw.labels import AROUND, Labels, Style
from semmap.draw.palette import BOX_COLOURS, INK, PAPER, PATH, object_colour, room_colour
from semmap.draw.rasteriser import Camera, quarters
from semmap.draw.shading import Surfaces, shade
from semmap.draw.sheet import draw_title, rendered_sheet, save_sheet
from semmap.draw.view import ObjectView, Outline, RegionView, RoomView, StoreyView
from semmap.geometry.mesh import Mesh, prism_mesh
from semmap.geometry.morphology import polygons
from semmap.geometry.overlay import united, without
from semmap.geometry.parts import closed_parts

HIDDEN = {"ceiling", "roof", "ceiling_lamp", "beam", "ground"}
CUT = {"building_element", "curtain", "blind", "room_divider", "picture", "mirror", "board"}
UNCUT = {"floor", "stair_flight", "ramp_flight", "railing"}
HUNG = {
    "picture",
    "mirror",
    "clock",
    "sign",
    "air_conditioner",
    "security_camera",
    "light_switch",
    "range_hood",
    "lamp",
    "board",
    "handle",
}
UNNAMED = {"building_element", "curtain", "blind", "handle", "picture", "book", "stationery"}
_SLAB = 0.12
_CAP = "#3c4250"


@dataclass(frozen=True, eq=False)
class _Line:
    """A line through (N, 3) points, metres."""

    points: Floats
    colour: str
    width: float
    dashed: bool = False


def scene3d(
    storeys: Sequence[StoreyView],
    path: Path | str,
    *,
    title: str = "",
    boxes: bool = True,
    object_labels: bool = False,
    cut: float = 1.25,
    azimuth: float = -62.0,
    elevation: float = 42.0,
    width: int = 2200,
    marked: Sequence[RoomView] = (),
) -> Path:
    """Draw storeys in 3D and save the picture as PNG; return its path.

    Parameters
    ----------
    boxes : draw a coloured box around each room, with its name (Deeken et al., Figure 2)
    object_labels : write the semantic types of objects beside them (Figure 8)
    cut : height above a storey's floor at which walls are cut open, metres
    azimuth, elevation : from which the storeys are seen, degrees
    width : pixels
    marked : draw a coloured box around each, with its name, in the lowest storey

    Raises
    ------
    ValueError
        No room has an outline, and no object a mesh.
    """
    eye = np.deg2rad(azimuth), np.deg2rad(elevation)
    storeys = sorted(storeys, key=lambda s: s.elevation)
    tall = max((r.high - r.low for s in storeys for r in s.rooms), default=cut) if boxes else cut
    lifted = list(zip(storeys, _shifts(storeys, *eye, tall), strict=True))
    surfaces = [_surfaces(s, shift, cut) for s, shift in lifted]
    rooms = [(room, shift) for s, shift in lifted for room in s.rooms]
    routes = [
        np.insert(p[:, :2], 2, s.elevation + 0.08, axis=1) + shift
        for s, shift in lifted
        for p in s.path
    ]
    lines: list[_Line] = []
    if boxes:
        for (room, shift), colour in zip(rooms, cycle(BOX_COLOURS)):
            lines += [_Line(edge + shift, colour, 2.2) for edge in _box_edges(room)]
    for region, colour in zip(marked, cycle(BOX_COLOURS)):
        lines += [_Line(edge + lifted[0][1], colour, 2.2) for edge in _box_edges(region)]
    lines += [_Line(route, PATH, 5.0) for route in routes]
    lines += _rides(routes)

    points = [_uncut_points(s) for s in surfaces] + [line.points for line in lines]
    everything = np.concatenate([np.zeros((0, 3)), *points])
    if not len(everything):
        raise ValueError(
            "the picture is empty: no room has an outline and no object a mesh; import some"
        )
    camera = Camera.look(*eye, everything, 2 * width, 0.035)
    w, h = (n // 2 for n in camera.size)
    picture = np.empty((h, w, 3), np.float32)
    picture[:] = to_rgb(PAPER)
    depth = np.full((h, w), -np.inf)
    for storey in surfaces:  # one by one: a storey casts no shadow on the next
        if len(storey.triangles):
            _render(camera, storey, picture, depth)

    head = 130 if title else 0
    figure, axes = rendered_sheet(picture, 200, head)
    axes.set_xlim(0, 2 * w)
    axes.set_ylim(2 * h, 0)
    if title:
        draw_title(figure, title, 1 - 60 / (h + head), 15)
    for line in lines:
        _draw_line(axes, camera, depth, line)
    labels = Labels(axes)
    if len(storeys) > 1:
        for s, shift in lifted:
            _name_storey(labels, camera, s, shift)
    if boxes:
        _name_rooms(labels, camera, rooms)
    if marked:
        _name_rooms(labels, camera, [(region, lifted[0][1]) for region in marked])
    if object_labels:
        _name_objects(labels, camera, depth, lifted, cut)
    return save_sheet(figure, path)


def _render(camera: Camera, storey: Surfaces, picture: NDArray[np.float32], depth: Floats) -> None:
    """Draw a storey over the picture, at twice its resolution."""
    at = camera.project(_uncut_points(storey))
    low = np.maximum(np.floor(at[:, :2].min(axis=0)).astype(int) // 2 - 2, 0)
    high = np.minimum(np.ceil(at[:, :2].max(axis=0)).astype(int) // 2 + 3, picture.shape[1::-1])
    (left, top), (width, height) = low, high - low
    paper = np.array(to_rgb(PAPER), np.float32)
    window = camera.window(2 * left, 2 * top, 2 * width, 2 * height)
    fine, fine_depth = shade(window, storey, paper.astype(float), np.array(to_rgb(_CAP)))
    share = quarters(np.isfinite(fine_depth).astype(np.float32)).mean(axis=0)[..., None]
    there = np.s_[top : top + height, left : left + width]
    behind = picture[there] - paper
    picture[there] = quarters(fine).mean(axis=0) + (1 - share) * behind
    depth[there] = np.maximum(depth[there], quarters(fine_depth).max(axis=0))


def _shifts(
    storeys: Sequence[StoreyView], azimuth: float, elevation: float, tall: float
) -> list[Floats]:
    """The offsets that lift each storey, `tall` with its boxes, so that it hides nothing below."""
    shifts = [np.zeros(3)]
    bounds = [b for s in storeys if (b := _ground(s)) is not None]
    if bounds:
        low, high = np.min([b[0] for b in bounds], axis=0), np.max([b[1] for b in bounds], axis=0)
        way = np.maximum(np.abs([np.cos(azimuth), np.sin(azimuth)]), 1e-6)
        lift = float(np.min((high - low) / way)) * np.tan(elevation) + tall + 0.8
    for below, above in pairwise(storeys):
        rise = above.elevation - below.elevation
        shifts.append(shifts[-1] + np.array([0.0, 0.0, max(0.0, lift - rise) if bounds else 0.0]))
    return shifts


def _ground(storey: StoreyView) -> Floats | None:
    outlines = [r.outline for r in storey.rooms] or [
        o.footprint for o in storey.objects if o.footprint is not None
    ]
    if not outlines:
        return None
    boxes = np.array([o.bounds for o in outlines])
    return np.array([boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)])


def _floor(room: RoomView, regions: Sequence[RegionView]) -> Outline:
    """Where a room has a floor: not in a blocked region that reaches below it, such as stairs."""
    openings = [
        region.outline
        for region in regions
        if region.blocked and region.low is not None and region.low < room.low - _SLAB
    ]
    left = without(room.outline, united(openings)) if openings else room.outline
    return shapely.MultiPolygon(polygons(left))


def _surfaces(storey: StoreyView, shift: Floats, cut: float) -> Surfaces:
    """The surfaces of a storey, lifted by `shift`."""
    meshes: list[tuple[Mesh, str, float, bool]] = []  # with its colour, cut and cap
    for room in storey.rooms:
        colour = room_colour(room.types, room.name)
        outline = _floor(room, storey.regions)
        for polygon in getattr(outline, "geoms", [outline]):
            floor = prism_mesh(polygon, room.low - _SLAB, room.low + 0.006)
            meshes.append((floor, colour, np.inf, False))
    for entity in storey.objects:
        shown = _shown(entity, storey, cut)
        if shown is not None:
            is_cut = _is_cut(entity)
            at = storey.elevation + cut + float(shift[2]) if is_cut else np.inf
            cap = is_cut and bool(closed_parts(shown)[1].all())
            meshes.append((shown, entity.colour or object_colour(entity.types), at, cap))
    counts = [len(mesh.faces) for mesh, *_ in meshes]
    return Surfaces(
        np.concatenate([np.zeros((0, 3, 3)), *(mesh.triangles + shift for mesh, *_ in meshes)]),
        np.repeat(
            np.reshape([to_rgb(colour) for _, colour, *_ in meshes], (-1, 3)), counts, axis=0
        ),
        np.repeat(np.arange(len(counts), dtype=np.int32), counts),
        np.repeat(np.array([at for *_, at, _ in meshes], float), counts),
        np.repeat(np.array([cap for *_, cap in meshes], bool), counts),
    )


def _uncut_points(surfaces: Surfaces) -> Floats:
    """The corners of triangles, lowered to the cut where they are above it."""
    points = surfaces.triangles.copy()
    points[..., 2] = np.minimum(points[..., 2], surfaces.cuts[:, None])
    return points.reshape(-1, 3)


def _is_cut(entity: ObjectView) -> bool:
    return bool(CUT & set(entity.types)) and not UNCUT & set(entity.types)


def _shown(entity: ObjectView, storey: StoreyView, cut: float) -> Mesh | None:
    """The mesh of an object; None if the picture leaves it out."""
    if entity.mesh is None or not len(entity.mesh.faces) or HIDDEN & set(entity.types):
        return None
    low = float(entity.mesh.vertices[:, 2].min())
    if low > storey.elevation + cut and (_is_cut(entity) or HUNG & set(entity.types)):
        return None
    if "floor" in entity.types and storey.rooms:
        return None
    return entity.mesh


def _box_edges(room: RoomView) -> list[Floats]:
    """The twelve edges of a room's box, moved inwards a little to keep neighbours apart."""
    x0, y0, x1, y1 = room.outline.bounds
    low = np.array([x0, y0, room.low]) + 0.03
    high = np.array([x1, y1, room.high]) - 0.03
    corner = [np.where([i & 1, i & 2, i & 4], high, low) for i in range(8)]
    return [
        np.stack([corner[i], corner[i | bit]]) for i in range(8) for bit in (1, 2, 4) if not i & bit
    ]


def _rides(routes: Sequence[Floats]) -> list[_Line]:
    """Vertical lines from the end of a path on one storey to its start on another."""
    found = []
    for one, other in permutations(routes, 2):
        end, start = one[-1], other[0]
        if np.hypot(*(end[:2] - start[:2])) < 1.5 and abs(end[2] - start[2]) > 0.5:
            found.append(_Line(np.stack([end, start]), PATH, 3.5, dashed=True))
    return found


def _draw_line(axes: Axes, camera: Camera, depth: Floats, line: _Line) -> None:
    """Draw a line, faint where it is hidden."""
    pieces = []
    for a, b in pairwise(line.points):
        n = max(2, int(np.ceil(np.linalg.norm(b - a) / 0.05)))
        pieces.append(a + (b - a) * np.linspace(0, 1, n, endpoint=False)[:, None])
    at = camera.project(np.concatenate([*pieces, line.points[-1:]]))
    style: Style = {"color": line.colour, "lw": line.width * 0.6}
    if line.dashed:
        axes.plot(*at[:, :2].T, ls=(0, (1.2, 1.6)), dash_capstyle="round", **style)
        return
    style["solid_capstyle"] = "round"
    axes.plot(*at[:, :2].T, **style, alpha=0.45 if line.colour == PATH else 0.28)
    column = np.clip(at[:, 0] // 2, 0, depth.shape[1] - 1).astype(int)
    row = np.clip(at[:, 1] // 2, 0, depth.shape[0] - 1).astype(int)
    visible = np.where(depth[row, column] <= at[:, 2] + 0.06, 1.0, np.nan)
    axes.plot(at[:, 0] * visible, at[:, 1], **style)


def _name_storey(labels: Labels, camera: Camera, storey: StoreyView, shift: Floats) -> None:
    bounds = _ground(storey)
    if bounds is None:
        return
    (x0, y0), (x1, y1) = bounds
    corners = np.array([[x, y, storey.elevation] for x in (x0, x1) for y in (y0, y1)]) + shift
    x, y, _ = camera.project(corners).min(axis=0)
    style: Style = {"ha": "left", "va": "top", "fontsize": 11, "weight": "bold", "color": INK}
    labels.put(x, y, storey.name, most=math.inf, **style)


def _name_rooms(labels: Labels, camera: Camera, rooms: Sequence[tuple[RoomView, Floats]]) -> None:
    around = ((0, 0), (0, 10), (0, -10), *AROUND)
    style: Style = {"fontsize": 7.5, "color": "white", "weight": "bold", "linespacing": 1.05}
    for (room, shift), colour in zip(rooms, cycle(BOX_COLOURS)):
        centre = room.outline.representative_point()
        x, y, _ = camera.project(np.array([centre.x, centre.y, room.low]) + shift)
        told = not room.label or room.label in room.name
        name = room.name if told else f"{room.name}\n{room.label}"
        plate: Style = {"boxstyle": "round,pad=0.28,rounding_size=0.6", "fc": colour, "ec": "white"}
        plate |= {"lw": 0.6, "alpha": 0.93}
        leader: Style = {"color": colour, "lw": 0.8}
        labels.put(x, y, name, offsets=around, most=math.inf, leader=leader, bbox=plate, **style)


def _name_objects(
    labels: Labels,
    camera: Camera,
    depth: Floats,
    lifted: Sequence[tuple[StoreyView, Floats]],
    cut: float,
) -> None:
    """Write the types of objects, the largest first, where there is space for them."""
    named: list[tuple[float, str, str, Floats]] = []
    for storey, shift in lifted:
        for entity in storey.objects:
            shown = _shown(entity, storey, cut)
            if shown is None or not entity.types or UNNAMED & set(entity.types):
                continue
            bounds = shown.bounds
            top = np.array([*bounds.mean(axis=0)[:2], bounds[1, 2]]) + shift
            at = camera.project(top)
            row, column = int(at[1]) // 2, int(at[0]) // 2
            if depth[row, column] > at[2] + 0.25:
                continue  # it is hidden
            size = float(np.prod(np.maximum(np.ptp(bounds, axis=0), 0.05)))
            wanted = 10.0 if {"food", "robot", "person"} & set(entity.types) else size
            named.append((wanted, entity.types[0], object_colour(entity.types), at))
    written: list[tuple[str, Floats]] = []
    around, leader = ((0, 5), *AROUND), Style(color=INK, lw=0.5)
    for _, name, colour, at in sorted(named, key=lambda item: -item[0]):
        if any(n == name and np.hypot(*(p - at)[:2]) < 90 for n, p in written):
            continue  # one name for several objects of a type
        written.append((name, at))
        plate: Style = {"boxstyle": "round,pad=0.18,rounding_size=0.5", "fc": "white", "ec": colour}
        style: Style = {"fontsize": 6.2, "color": INK, "bbox": plate | {"lw": 0.9, "alpha": 0.9}}
        text = name.replace("_", " ")
        labels.put(at[0], at[1], text, offsets=around, leader=leader, **style)
