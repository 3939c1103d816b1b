"""Symbols, rules that choose among them, and labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from semmap.draw.qgis.markup import colour, element, option_map

SymbolLayer = Element
"""One drawing step of a symbol."""


def fill(code: str, alpha: float = 1.0, *, edge: str | None = None, width: float = 0.2) -> Element:
    """Return a filled area, with an edge of `width` millimetres."""
    inside = {"color": colour(code, alpha), "style": "solid" if alpha else "no"}
    return _area(inside, "solid" if edge else "no", edge or code, width)


def hatch(code: str, style: str = "f_diagonal") -> Element:
    """Return a hatched area with an edge."""
    return _area({"color": colour(code, 0.5), "style": style}, "dash", code, 0.3)


def outline(code: str, style: str = "dot", width: float = 0.2) -> Element:
    """Return the edge of an area alone."""
    return _area({"style": "no"}, style, code, width)


def _area(inside: dict[str, str], style: str, code: str, width: float) -> Element:
    edge = {
        "outline_style": style,
        "outline_color": colour(code),
        "outline_width": str(width),
        "outline_width_unit": "MM",
    }
    return _layer("SimpleFill", inside | edge)


def line(code: str, width: float, *, unit: str = "MM", style: str = "solid") -> Element:
    """Return a line of a width in millimetres, or in metres with the unit ``MapUnit``."""
    options = {
        "line_color": colour(code),
        "line_width": str(width),
        "line_width_unit": unit,
        "line_style": style,
        "capstyle": "flat",
    }
    return _layer("SimpleLine", options)


def arrow(code: str) -> Element:
    """Return an arrow along a line."""
    size = {"head_length": "2", "head_thickness": "1", "arrow_width": "0.4"}
    size |= {"arrow_start_width": "0.4", "is_curved": "0", "is_repeated": "0"}
    made = _layer("ArrowLine", size)
    made.append(symbol("fill", "arrow", fill(code)))
    return made


def drawn(expression: str, stroke: SymbolLayer) -> Element:
    """Return the line that an expression makes of the feature, drawn with a stroke."""
    options = {"SymbolType": "Line", "geometryModifier": expression, "units": "MapUnit"}
    made = _layer("GeometryGenerator", options)
    made.append(symbol("line", "drawn", stroke))
    return made


def symbol(kind: str, name: str, *layers: SymbolLayer) -> Element:
    """Return a symbol: its layers, the lowest first."""
    return element("symbol", *layers, type=kind, name=name, alpha=1, clip_to_extent=1, force_rhr=0)


def _layer(kind: str, options: dict[str, str]) -> Element:
    made = element("layer", option_map(options), enabled=1, locked=0)
    made.set("class", kind)
    made.set("pass", "0")
    return made


@dataclass(frozen=True, eq=False)
class SymbolRule:
    """How features are drawn; `holds` is an expression, and ``ELSE`` all others."""

    label: str
    holds: str
    layers: Sequence[SymbolLayer]


def rule_renderer(kind: str, rules: Sequence[SymbolRule], upwards: str | None = None) -> Element:
    """Return the renderer of rules on ``fill`` or ``line`` features.

    Features with a larger value of the column `upwards` are drawn later.
    """
    choices, symbols = element("rules", key="rules"), element("symbols")
    for number, rule in enumerate(rules):
        key = f"rule{number}"
        each = element("rule", key=key, symbol=number, label=rule.label, filter=rule.holds)
        choices.append(each)
        symbols.append(symbol(kind, str(number), *rule.layers))
    made = element("renderer-v2", choices, symbols, type="RuleRenderer", symbollevels=0)
    made.set("enableorderby", str(int(upwards is not None)))
    if upwards is not None:
        clause = element("orderByClause", text=f'"{upwards}"', asc=1, nullsFirst=1)
        made.append(element("orderby", clause))
    return made


def labelling(
    expression: str, size: float, code: str, *, bold: bool = False, inside: bool = False,
    on_line: bool = False, priority: int = 5,
) -> Element:  # fmt: skip
    """Return labels of `size` points; with `inside` only where a polygon has room for them."""
    style = element(
        "text-style",
        element("text-buffer", bufferDraw=1, bufferSize=0.7, bufferSizeUnits="MM",
                bufferColor="255,255,255,220", bufferOpacity=1, bufferJoinStyle=128),
        element("background", shapeDraw=0),
        element("shadow", shadowDraw=0),
        fieldName=expression, isExpression=1, fontFamily="DejaVu Sans", fontSize=size,
        fontSizeUnit="Point", textColor=colour(code), textOpacity=1, multilineHeight=1,
        namedStyle="Bold" if bold else "Book", fontWeight=75 if bold else 50,
    )  # fmt: skip
    place = element(
        "placement", placement=1 if on_line else 4, dist=0, distUnits="MM",
        quadOffset=4, priority=priority, fitInPolygonOnly=int(inside), centroidInside=1,
        polygonPlacementFlags=2, placementFlags=10, offsetUnits="MM", layerType="UnknownGeometry",
    )  # fmt: skip
    if on_line:  # near its end, beside what is drawn in its middle
        near_end = "line_interpolate_point($geometry, 0.9 * length($geometry))"
        place.set("geometryGeneratorEnabled", "1")
        place.set("geometryGenerator", near_end)
        place.set("geometryGeneratorType", "PointGeometry")
        place.set("layerType", "PointGeometry")
    shown = element("rendering", drawLabels=1, obstacle=1, obstacleType=1, obstacleFactor=1)
    format_ = element("text-format", multilineAlign=1, wrapChar="")
    return element("labeling", element("settings", style, format_, place, shown), type="simple")
