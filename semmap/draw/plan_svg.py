"""A plan as SVG, from outlines alone: quick, for notebooks. `floor_plan` makes the careful one."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping
from typing import Any

import shapely

from semmap.draw.palette import HIDDEN, INK, PAPER, PATH, STATES, object_colour, room_colour

MARGIN = 0.4
"""Around what is drawn, metres."""

LETTER = 0.55
"""Width of a letter by its height."""

CROWDED = 600
"""Objects beyond which tooltips are left out."""


def plan_svg(
    entities: Iterable[Mapping[str, Any]],
    types: Mapping[str, tuple[str, ...]],
    *,
    title: str = "",
    width: int = 640,
    marked: int | None = None,
) -> str:
    """Return outlines of entities as an SVG element, without parts of the building.

    `entities` are rows of `read_shapes`, `types` has each type's supertypes, the nearest first;
    `width` is pixels, and the entity with the id `marked` is outlined.
    """
    drawn = [row for row in entities if row["geometry"] is not None and _layer(row, types)]
    drawn.sort(key=lambda row: (_layer(row, types), row["high"] or 0.0))
    if not drawn:
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="40">'
            f'<text x="8" y="25" font-family="sans-serif" font-size="14" fill="{INK}">'
            f"{html.escape(title)}: no outlines yet</text></svg>"
        )
    rooms = [row for row in drawn if row["kind"] == "room"]
    x0, y0, x1, y1 = shapely.total_bounds([r["geometry"] for r in (rooms or drawn)])
    x0, y0, x1, y1 = x0 - MARGIN, y0 - MARGIN, x1 + MARGIN, y1 + MARGIN
    scale = width / (x1 - x0)
    height = max(round((y1 - y0) * scale), 1)
    thin = (x1 - x0) / width
    titled = len(drawn) <= CROWDED
    shapes = "".join(_shape(row, types, thin, titled, row["id"] == marked) for row in drawn)
    words = "".join(_word(row, thin) for row in rooms)
    head = f"<title>{html.escape(title)}</title>" if title else ""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="{x0:.3f} {-y1:.3f} {x1 - x0:.3f} {y1 - y0:.3f}" style="max-width:100%">{head}'
        f'<rect x="{x0:.3f}" y="{-y1:.3f}" width="{x1 - x0:.3f}" height="{y1 - y0:.3f}" '
        f'fill="{PAPER}"/><g stroke-linejoin="round">{shapes}</g>{words}</svg>'
    )


def _layer(row: Mapping[str, Any], types: Mapping[str, tuple[str, ...]]) -> int:
    """In which order it is drawn, the lowest first; 0: not at all."""
    if row["kind"] == "connector":
        return 4
    if shapely.get_dimensions(row["geometry"]) < 2 or HIDDEN & {*types.get(row["type"], ())}:
        return 0
    return {"room": 1, "region": 2, "object": 3, "agent": 5}.get(row["kind"], 0)


def _shape(
    row: Mapping[str, Any],
    types: Mapping[str, tuple[str, ...]],
    thin: float,
    titled: bool,
    marked: bool,
) -> str:
    kind, name = row["kind"], row["name"]
    above = types.get(row["type"], ())
    if kind == "connector":
        fill, stroke, width = "none", STATES.get(row["state"], PATH), 5.0
    elif kind == "region":
        fill, stroke, width = PATH, PATH, 1.0
    elif kind == "room":
        fill, stroke, width = room_colour(above, name), INK, 2.0
    else:
        fill, stroke, width = object_colour(above), INK, 0.7
    style = f'fill="{fill}" stroke="{stroke}" stroke-width="{width * thin:.4f}"'
    if kind == "region":
        style += f' fill-opacity="0.06" stroke-dasharray="{4 * thin:.4f}"'
    if marked:
        style += f' paint-order="stroke" style="stroke:{PATH};stroke-width:{4 * thin:.4f}"'
    kind_of = " ".join(filter(None, (row["type"] or kind, name)))
    tip = f"<title>{html.escape(kind_of)}</title>" if titled else ""
    shown = row["geometry"]
    if len(shapely.get_coordinates(shown)) > 50:
        shown = shown.simplify(0.5 * thin)
    return f'<path d="{_path(shown)}" fill-rule="evenodd" {style}>{tip}</path>'


def _path(geometry: shapely.Geometry) -> str:
    """The data of a path; y points down in SVG."""
    paths = []
    for part in shapely.get_parts(geometry):
        is_area = isinstance(part, shapely.Polygon)
        for ring in (part.exterior, *part.interiors) if is_area else (part,):
            points = "L".join(f"{x:.3f},{-y:.3f}" for x, y in shapely.get_coordinates(ring))
            paths.append(f"M{points}{'Z' if is_area else ''}")
    return "".join(paths)


def _word(row: Mapping[str, Any], thin: float) -> str:
    """The name of a room, in it, where there is space for it."""
    outline = row["geometry"]
    circle = shapely.maximum_inscribed_circle(outline, tolerance=20 * thin)
    place, radius = shapely.Point(circle.coords[0]), circle.length
    middle = outline.centroid  # of a long room, many circles are the largest
    if outline.covers(middle) and middle.distance(outline.boundary) > 0.8 * radius:
        place = middle
    size = min(13 * thin, 1.9 * radius / (LETTER * max(len(row["name"]), 1)))
    if size < 6 * thin:
        return ""
    text = (
        f'x="{place.x:.3f}" y="{-place.y + 0.35 * size:.3f}" font-family="sans-serif" '
        f'font-size="{size:.3f}" text-anchor="middle"'
    )
    name = html.escape(row["name"])
    halo = f'stroke="{PAPER}" stroke-width="{0.25 * size:.3f}" stroke-opacity="0.7" fill="none"'
    return f'<text {text} {halo}>{name}</text><text {text} fill="{INK}">{name}</text>'
