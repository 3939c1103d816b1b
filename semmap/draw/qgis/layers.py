"""The layers of a floor plan: which view, which features, how drawn, which form."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from xml.etree.ElementTree import Element

from semmap.draw.floor_plan import GROUND, OVERHEAD, REGIONS
from semmap.draw.palette import HIDDEN, INK, OBJECTS, ROOMS, STATES, family
from semmap.draw.qgis.markup import Option, one_of, quoted, sql_text
from semmap.draw.qgis.symbols import (
    SymbolRule,
    arrow,
    drawn,
    fill,
    hatch,
    labelling,
    line,
    outline,
    rule_renderer,
)

WALL, WALL_LOW = "#343a46", "#9a9ea6"
WALLS = ("wall", "building_shell", "house", "elevator_shaft", "column", "fence")
"""Types that are drawn solid where a floor plan cuts them."""

_OTHER_ROOM, _OTHER_OBJECT = "#e8e6df", "#a8a29a"
_WIDE = 2.4
"""Metres beyond which an open door has no leaf."""

Supertypes = Mapping[str, tuple[str, ...]]
"""Each type with its supertypes, itself first, then the nearest."""


@dataclass(frozen=True)
class StoreyGroup:
    """What one group of layers shows; without a name, what is on no storey. Metres."""

    name: str | None
    elevation: float = 0.0
    extent: tuple[float, float, float, float] | None = None  # x0, y0, x1, y1


@dataclass(frozen=True, eq=False)
class FormField:
    """A column in a form: its widget with options, the value of new features, if it is edited."""

    name: str
    widget: str = "TextEdit"
    options: Mapping[str, Option] = field(default_factory=dict)
    default: str = ""
    editable: bool = True

    @property
    def title(self) -> str:
        """What the form calls it."""
        return self.name.replace("_deg", " (degrees)").replace("_", " ")


@dataclass(frozen=True, eq=False)
class QgisLayer:
    """A layer of features of one view."""

    key: str
    title: str
    view: str
    geometry: str | None  # the type of its geometries; None: a table
    renderer: Element | None = None
    labels: Element | None = None
    fields: Sequence[FormField] = ()
    where: str = ""
    shown: bool = True


def storey_layers(
    map_name: str, storey: StoreyGroup, types: Supertypes, section_height: float
) -> list[QgisLayer]:
    """Return the layers of a storey, the uppermost first."""
    on = f'"storey" = {sql_text(storey.name)}' if storey.name else '"storey" IS NULL'
    here = f'"map" = {sql_text(map_name)} AND {on}'
    floor, cut = storey.elevation, storey.elevation + section_height
    homes = [
        FormField("map", "Hidden", default=quoted(map_name)),
        FormField("storey", default=quoted(storey.name) if storey.name else "", editable=False),
    ]
    made = [
        replace(doors(types), where=here),
        replace(structure(types, cut), where=f'{here} AND "structure"'),
        replace(objects(types, floor), where=f'{here} AND NOT "structure"'),
        replace(regions(types, floor), where=here),
        replace(rooms(types), where=here),
    ]
    return [replace(each, fields=[*homes, *each.fields]) for each in made]


def default_layers(types: Supertypes) -> list[QgisLayer]:
    """Return one layer a view, as it looks at first where it is opened alone."""
    return [doors(types), objects(types), regions(types), rooms(types), storeys()]


def rooms(types: Supertypes) -> QgisLayer:
    """Return the rooms, coloured by their type."""
    colours = {known: fill(code, edge="#8a8f98") for known, code in ROOMS.items()}
    rules = _rules(types, lambda above: _first(above, ROOMS) if "room" in above else None, colours)
    rules.append(SymbolRule("room", "ELSE", [fill(_OTHER_ROOM, edge="#8a8f98")]))
    said = "\"name\" || if(coalesce(\"label\", '') IN ('', \"name\"), '', '\\n' || \"label\")"
    fields = [
        *_described("room"),
        FormField("floor", default="0"),
        FormField("ceiling", default="2.5"),
        _PROPERTIES,
    ]
    return QgisLayer(
        "room", "rooms", "gis_room", "MultiPolygon", rule_renderer("fill", rules),
        labelling(said, 8, INK, bold=True, priority=9), fields,
    )  # fmt: skip


def objects(types: Supertypes, floor: float | None = None) -> QgisLayer:
    """Return the objects, coloured by the family of their type.

    With the z of a `floor`, those overhead and in the ground are dotted outlines.
    """
    rules = []
    if floor is not None:
        away = f'"low" >= {floor + OVERHEAD} OR "high" < {floor - GROUND}'
        rules = [SymbolRule("overhead or below", away, [outline("#8a8f98")])]
        seen = f" AND NOT coalesce({away}, false)"
    else:
        seen = ""
    colours = {known: _solid(code) for known, code in OBJECTS.items()}
    rules += _rules(types, lambda a: None if HIDDEN & set(a) else family(a), colours, seen)
    rules.append(SymbolRule("object", "ELSE", [_solid(_OTHER_OBJECT)]))
    low = "0" if floor is None else str(floor)
    fields = [
        *_described("object"),
        FormField("holder", editable=False),
        FormField("low", default=low),
        FormField("high", default=f"{low} + 1"),
        FormField("heading_deg", default="0"),
        FormField("structure", "Hidden", editable=False),
        _PROPERTIES,
    ]
    return QgisLayer(
        "object", "objects", "gis_object", "MultiPolygon", rule_renderer("fill", rules, "high"),
        labelling('"name"', 5.5, "#23262b", inside=True, priority=3), fields,
    )  # fmt: skip


def structure(types: Supertypes, cut: float) -> QgisLayer:
    """Return parts of the building: walls that the plane at z `cut` cuts solid, others light."""
    is_cut = f'("low" <= {cut} AND "high" > {cut})'
    kinds = (  # label, types, condition, symbol
        ("walls", WALLS, is_cut, fill(WALL, edge=WALL, width=0.1)),
        ("walls above or below", WALLS, f"NOT {is_cut}", outline(WALL_LOW, "dash")),
        ("windows", ("window",), is_cut, fill("#a9cfe0", edge=WALL)),
        ("door leaves and frames", ("door_leaf", "door_frame"), is_cut, fill("#a87c50", 0.8)),
        ("stairs", ("stair_flight", "ramp_flight"), "true", fill("#b8b2a6", 0.6, edge=WALL)),
        ("railings", ("railing",), "true", outline(WALL_LOW, "solid")),
    )
    rules = []
    for label, above, condition, drawing in kinds:
        names = [name for name, known in types.items() if set(above) & set(known)]
        rules.append(SymbolRule(label, f"{one_of('type', names)} AND {condition}", [drawing]))
    return QgisLayer(
        "structure", "walls", "gis_object", "MultiPolygon", rule_renderer("fill", rules, "high"),
        None, objects(types).fields,
    )  # fmt: skip


def regions(types: Supertypes, floor: float = 0.0) -> QgisLayer:
    """Return the regions, hatched by type."""
    hatched = {name: hatch(code) for name, code, _ in REGIONS}
    rules = _rules(types, lambda above: _first(above, hatched), hatched)
    rules.append(SymbolRule("other", "ELSE", [hatch("#7d5fb2", "b_diagonal")]))
    fields = [
        *_described("region"),
        FormField("holder", editable=False),
        FormField("low", default=str(floor)),
        FormField("high", default=f"{floor} + 2"),
        FormField("origin", editable=False),
        _PROPERTIES,
    ]
    return QgisLayer(
        "region", "regions", "gis_region", "MultiPolygon", rule_renderer("fill", rules),
        labelling('"name"', 6, "#7d5fb2", inside=True), fields,
    )  # fmt: skip


def doors(types: Supertypes) -> QgisLayer:
    """Return connectors: doors as in a floor plan, by state, and the way along stairs."""
    passages = sorted(name for name, above in types.items() if "opening" in above)
    is_opening = f'(coalesce({one_of("type", passages)}, false) OR "width" > {_WIDE})'
    rules = [
        SymbolRule("stairs and ramps", "\"form\" IN ('stairs', 'ramp')", [arrow(STATES["open"])])
    ]
    for state, code in STATES.items():
        way = line(code, 0.1, style="dot")
        lift = f"\"form\" = 'elevator_door' AND \"state\" = '{state}'"
        panels = [drawn(panel, line(code, 0.9)) for panel in _PANELS]
        rules.append(SymbolRule(f"lift door, {state}", lift, [*_GAP, *panels, way]))
        holds = f"\"form\" = 'door' AND \"state\" = '{state}'"
        if state == "open":
            dashed = drawn(_OPENING, line(code, 0.3, style="dash"))
            rules.append(SymbolRule("opening", f"{holds} AND {is_opening}", [*_GAP, dashed, way]))
            holds += f" AND NOT {is_opening}"
            leaf = [drawn(_LEAF, line(code, 0.6)), drawn(_SWING, line(code, 0.2, style="dash"))]
        else:
            leaf = [drawn(_OPENING, line(code, 0.9))]
        rules.append(SymbolRule(f"door, {state}", holds, [*_GAP, *leaf, way]))
    states = {name: quoted(name)[1:-1] for name in STATES}
    fields = [
        FormField("name"),
        _type("connector"),
        FormField("form", editable=False, default="'door'"),
        FormField("place_a", editable=False),
        FormField("place_b", editable=False),
        FormField("state", "ValueMap", {"map": states}, "'open'"),
        FormField("direction", "ValueMap", {"map": {k: k for k in ("both", "forward", "backward")}},
              "'both'"),
        FormField("behaviour", default="'pass_door'"),
        FormField("width", default="0.9"),
        FormField("height"),
        FormField("step", default="0"),
        FormField("permissions"),
        _PROPERTIES,
    ]  # fmt: skip
    return QgisLayer(
        "connector", "doors", "gis_connector", "LineString", rule_renderer("line", rules),
        labelling('"name"', 5.5, STATES["open"], on_line=True, priority=7), fields,
    )  # fmt: skip


def storeys() -> QgisLayer:
    """Return the storeys: the union of their rooms, with elevation and height."""
    fields = [
        *_described("storey"),
        FormField("elevation"),
        FormField("height"),
        _PROPERTIES,
    ]
    rules = [SymbolRule("storey", "ELSE", [outline(INK, "solid", 0.4)])]
    return QgisLayer(
        "storey", "storeys", "gis_storey", "MultiPolygon", rule_renderer("fill", rules), None,
        fields, shown=False,
    )  # fmt: skip


def value_list() -> QgisLayer:
    """Return the types, which forms offer as values."""
    return QgisLayer(TYPES, "types", "gis_type", None, shown=False)


TYPES = "semmap_types"
"""The key of the layer that has the types."""


def _rules(
    types: Supertypes,
    family_of: Callable[[Sequence[str]], str | None],
    drawings: Mapping[str, Element],
    seen: str = "",
) -> list[SymbolRule]:
    """A rule for each family that some type is of, in the order of the drawings."""
    names: dict[str | None, list[str]] = {}
    for name, above in types.items():
        names.setdefault(family_of(above), []).append(name)
    return [
        SymbolRule(known.replace("_", " "), one_of("type", names[known]) + seen, [drawing])
        for known, drawing in drawings.items()
        if known in names
    ]


def _first(above: Sequence[str], known: Collection[str]) -> str | None:
    return next((each for each in above if each in known), None)


def _type(kind: str) -> FormField:
    options: dict[str, Option] = {
        "Layer": TYPES,
        "LayerName": "types",
        "LayerProviderName": "postgres",
        "Key": "name",
        "Value": "name",
        "FilterExpression": f"\"kind\" = '{kind}'",
        "AllowNull": True,
        "AllowMulti": False,
        "OrderByValue": True,
        "UseCompleter": False,
    }
    return FormField("type", "ValueRelation", options)


def _described(kind: str) -> list[FormField]:
    return [FormField("name"), _type(kind), FormField("label")]


_PROPERTIES = FormField("properties", options={"IsMultiline": True}, default="'{}'")

_WAY = "azimuth(start_point($geometry), end_point($geometry))"
_MIDDLE = "centroid($geometry)"
_HALF = 'coalesce("width", 0.9) / 2'
_HINGE = f"project({_MIDDLE}, {_HALF}, {_WAY} - pi() / 2)"
_LATCH = f"project({_MIDDLE}, {_HALF}, {_WAY} + pi() / 2)"
_OPENING = f"make_line({_HINGE}, {_LATCH})"
_LEAF = f"make_line({_HINGE}, project({_HINGE}, 2 * {_HALF}, {_WAY} + pi()))"
_SWING = (
    f"make_line(array_foreach(generate_series(0, 6), project({_HINGE}, 2 * {_HALF}, "
    f"{_WAY} + pi() / 2 + @element * pi() / 12)))"
)
_PANELS = (
    f"make_line({_HINGE}, project({_HINGE}, 0.72 * {_HALF}, {_WAY} + pi() / 2))",
    f"make_line({_LATCH}, project({_LATCH}, 0.72 * {_HALF}, {_WAY} - pi() / 2))",
)
_GAP = [drawn(_OPENING, line("#ffffff", 0.12, unit="MapUnit"))]


def _solid(code: str) -> Element:
    """An area of a colour, with a darker edge."""
    dark = "#" + "".join(f"{int(0.62 * int(code[k : k + 2], 16)):02x}" for k in (1, 3, 5))
    return fill(code, 0.9, edge=dark)
