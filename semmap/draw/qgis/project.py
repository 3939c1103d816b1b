"""The files: a project (.qgz) with a group of layers a storey, and a default style a view."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from urllib.parse import quote, urlencode
from xml.etree.ElementTree import Element, tostring

from semmap.draw.qgis.layers import (
    TYPES,
    FormField,
    QgisLayer,
    StoreyGroup,
    Supertypes,
    storey_layers,
    storeys,
    value_list,
)
from semmap.draw.qgis.markup import Option, element, option_map, sql_text

VERSION = "3.22.0"
"""Of QGIS, whose format the files have."""

SCHEMA = "semmap"

Extent = tuple[float, float, float, float]


def project_file(
    map_name: str,
    shown: Sequence[StoreyGroup],
    types: Supertypes,
    connection: Mapping[str, str],
    *,
    section_height: float,
    frame: str = "",
) -> bytes:
    """Return a QGIS project of a map as the content of a .qgz file.

    Parameters
    ----------
    shown : the storeys from the lowest up; the first is visible, the others when they are checked
    connection : libpq's parameters of the database; of these, the password is left out
    section_height : metres above a storey's floor at which walls are cut
    frame : the CRS of the map's frame, WKT; without one, the project has none
    """
    source = _source(connection)
    tree, layers = element("layer-tree-group"), element("projectlayers")

    def add(layer: QgisLayer, group: Element, key: str) -> None:
        text = f"{source} {_table(layer)}"
        layers.append(_map_layer(layer, key, text, source, frame))
        group.append(_tree_layer(layer, key, text))

    plan = element("layer-tree-group", name=map_name, checked="Qt::Checked", expanded=1)
    plan.set("mutually-exclusive", "1")
    plan.set("mutually-exclusive-child", "0")
    here = f'"map" = {sql_text(map_name)}'
    for number, storey in enumerate(shown):
        group = element("layer-tree-group", name=storey.name or "on no storey", expanded=1)
        group.set("checked", "Qt::Unchecked" if number else "Qt::Checked")
        for layer in storey_layers(map_name, storey, types, section_height):
            add(layer, group, f"semmap_{layer.key}_{number}")
        plan.append(group)
    tree.append(plan)
    add(replace(storeys(), where=here), tree, "semmap_storeys")
    add(value_list(), tree, TYPES)

    extents = [storey.extent for storey in shown if storey.extent is not None]
    root = element(
        "qgis",
        element("title", text=map_name),
        element("projectCrs", _crs(frame)),
        tree,
        _canvas(extents[0] if extents else (0, 0, 10, 10), frame),
        layers,
        _properties(),
        projectname=map_name,
        version=VERSION,
    )
    return _zipped(f"{map_name.replace('/', '_')}.qgs", _document(root))


def style_file(layer: QgisLayer) -> str:
    """Return how a layer looks and is edited, as the content of a .qml file."""
    root = element("qgis", version=VERSION, styleCategories="AllStyleCategories")
    root.extend(_looks(layer, ""))
    return _document(root).decode()


def project_address(name: str, connection: Mapping[str, str]) -> str:
    """Return the address under which QGIS opens a project that a database keeps.

    QGIS takes no socket's folder in it, but from ``PGHOST``.
    """
    query = {"dbname": connection["dbname"], "schema": "public", "project": name}
    if connection.get("sslmode"):
        query["sslmode"] = connection["sslmode"]
    is_socket = connection["host"].startswith("/")
    server = "" if is_socket else f"{connection['host']}:{connection['port']}"
    user = quote(connection["user"])
    return f"postgresql://{user}@{server}?{urlencode(query, quote_via=quote)}"


def _document(root: Element) -> bytes:
    head = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
    return f"{head}{tostring(root, encoding='unicode')}".encode()


def _zipped(name: str, content: bytes) -> bytes:
    """A .qgz: equal projects are equal files."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def _source(connection: Mapping[str, str]) -> str:
    """The connection as QGIS states it: without the password, for which it asks."""
    kept = ("service", "dbname", "host", "port", "user", "sslmode")
    given = ((key, connection[key]) for key in kept if connection.get(key))
    return " ".join(f"{key}={_connection_value(value)}" for key, value in given)


def _connection_value(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"


def _table(layer: QgisLayer) -> str:
    if layer.geometry is None:
        return f"key='fid' checkPrimaryKeyUnicity='0' table=\"{SCHEMA}\".\"{layer.view}\""
    shape = f"srid=0 type={layer.geometry} checkPrimaryKeyUnicity='0'"
    where = f" sql={layer.where}" if layer.where else ""
    return f'key=\'fid\' {shape} table="{SCHEMA}"."{layer.view}" (geom){where}'


def _tree_layer(layer: QgisLayer, key: str, source: str) -> Element:
    return element(
        "layer-tree-layer", id=key, name=layer.title, providerKey="postgres", source=source,
        checked="Qt::Checked" if layer.shown else "Qt::Unchecked", expanded=0,
    )  # fmt: skip


def _map_layer(layer: QgisLayer, key: str, source: str, database: str, frame: str) -> Element:
    shape = {"MultiPolygon": "Polygon", "LineString": "Line", None: "No geometry"}[layer.geometry]
    flags = {"Identifiable": 1, "Removable": 1, "Searchable": 1, "Private": int(key == TYPES)}
    return element(
        "maplayer",
        element("id", text=key),
        element("datasource", text=source),
        element("layername", text=layer.title),
        element("srs", _crs(frame)),
        element("provider", text="postgres", encoding="UTF-8"),
        element("flags", *(element(name, text=str(value)) for name, value in flags.items())),
        *_looks(layer, database),
        type="vector", geometry=shape, wkbType=layer.geometry or "NoGeometry",
        labelsEnabled=int(layer.labels is not None), hasScaleBasedVisibilityFlag=0,
        simplifyDrawingHints=0, readOnly=0,
    )  # fmt: skip


def _looks(layer: QgisLayer, database: str) -> list[Element]:
    """Symbols, labels and form: what a project and a style have alike."""
    made = [each for each in (layer.renderer, layer.labels) if each is not None]
    configured = element("fieldConfiguration")
    aliases, defaults = element("aliases"), element("defaults")
    editable = element("editable", element("field", name="fid", editable=0))
    for each in layer.fields:
        config = option_map(_widget_options(each, database))
        widget = element("editWidget", element("config", config), type=each.widget)
        configured.append(element("field", widget, name=each.name, configurationFlags="None"))
        aliases.append(element("alias", field=each.name, name=each.title))
        default = element("default", field=each.name, expression=each.default, applyOnUpdate=0)
        defaults.append(default)
        editable.append(element("field", name=each.name, editable=int(each.editable)))
    hidden = element("editWidget", element("config", option_map({})), type="Hidden")
    configured.append(element("field", hidden, name="fid", configurationFlags="None"))
    name = '"name"' if any(each.name == "name" for each in layer.fields) else '"fid"'
    return [
        *made,
        configured,
        aliases,
        defaults,
        editable,
        element("editorlayout", text="generatedlayout"),
        element("previewExpression", text=name),
    ]


def _widget_options(each: FormField, database: str) -> dict[str, Option]:
    options = dict(each.options)
    if each.widget == "ValueRelation":
        options["LayerSource"] = f"{database} {_table(value_list())}"
    return options


def _crs(wkt: str) -> Element:
    """A CRS, or none."""
    return element("spatialrefsys", element("wkt", text=wkt), element("authid"))


def _canvas(extent: Extent, frame: str) -> Element:
    margin = 0.05 * max(extent[2] - extent[0], extent[3] - extent[1])
    sides = dict(zip(("xmin", "ymin", "xmax", "ymax"), extent, strict=True))
    sides = {k: v + (margin if k.endswith("max") else -margin) for k, v in sides.items()}
    view = element("extent", *(element(k, text=str(v)) for k, v in sides.items()))
    units = element("units", text="meters")
    made = element("mapcanvas", units, view, element("rotation", text="0"), name="theMapCanvas")
    made.append(element("destinationsrs", _crs(frame)))
    return made


def _properties() -> Element:
    """Lengths in metres, and a paper-coloured background."""
    units = element(
        "Measurement",
        element("DistanceUnits", text="meters", type="QString"),
        element("AreaUnits", text="m2", type="QString"),
    )
    colours = element(
        "Gui",
        *(
            element(f"CanvasColor{name}Part", text=str(value), type="int")
            for name, value in (("Red", 251), ("Green", 250), ("Blue", 247))
        ),
    )
    enabled = element("ProjectionsEnabled", text="1", type="int")
    return element("properties", units, colours, element("SpatialRefSys", enabled))
