"""What a QGIS project needs of a map, and where QGIS keeps projects and styles in a database."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import psycopg

from semmap.query.snapshot import Snapshot
from semmap.query.supertypes import read_supertypes

StoreyRow = tuple[str | None, float, tuple[float, float, float, float] | None]
"""Name, elevation in metres, and the extent (x0, y0, x1, y1) of its rooms, else of all on it."""


class MapContents(NamedTuple):
    """The storeys of a map from the lowest up, and the types with their supertypes."""

    storeys: list[StoreyRow]
    types: dict[str, tuple[str, ...]]
    section_height: float
    georeference: tuple[int, float, float, float] | None  # EPSG, easting, northing, rotation


def read_contents(seen: Snapshot) -> MapContents:
    """Return what a project shows; what is on no storey counts as a storey without a name."""
    storeys: list[StoreyRow] = [
        (name, elevation, None if x0 is None else (x0, y0, x1, y1))
        for name, elevation, x0, y0, x1, y1 in seen.session.execute(
            "SELECT s.name, coalesce(k.pose[3], 0), ST_XMin(b), ST_YMin(b), ST_XMax(b), ST_YMax(b) "
            "FROM (SELECT e.id, e.name FROM entity e WHERE e.kind = 'storey' "
            "AND e.map_id = current_map() UNION ALL SELECT NULL, NULL) s "
            "LEFT JOIN world k ON k.entity_id = s.id CROSS JOIN LATERAL ("
            "SELECT coalesce(ST_Extent(w.footprint) FILTER (WHERE r.entity_id IS NOT NULL), "
            "ST_Extent(w.footprint)), count(w.footprint) "
            "FROM world w LEFT JOIN room r ON r.entity_id = w.entity_id "
            "WHERE w.map_id = current_map() AND w.storey_id IS NOT DISTINCT FROM s.id) e (b, n) "
            "WHERE s.id IS NOT NULL OR e.n > 0 ORDER BY s.id IS NULL, 2, s.id"
        )
    ]
    (height, *grid), *_ = seen.session.execute(
        "SELECT section_height(), crs, easting, northing, rotation FROM map "
        "WHERE id = current_map()"
    )
    georeference = None if grid[0] is None else (grid[0], grid[1], grid[2], grid[3])
    return MapContents(storeys or [(None, 0.0, None)], read_supertypes(seen), height, georeference)


PROJECTS = (
    "CREATE TABLE IF NOT EXISTS public.qgis_projects "
    "(name text PRIMARY KEY, metadata jsonb, content bytea)"
)
STYLES = (
    "CREATE TABLE IF NOT EXISTS public.layer_styles (id serial PRIMARY KEY, "
    "f_table_catalog varchar, f_table_schema varchar, f_table_name varchar, "
    "f_geometry_column varchar, stylename text, styleqml xml, stylesld xml, useasdefault boolean, "
    "description text, owner varchar(63) DEFAULT CURRENT_USER, ui xml, "
    "update_time timestamp DEFAULT CURRENT_TIMESTAMP, type varchar)"
)
"""The tables as QGIS itself makes them."""

_STYLE = "floor plan"


def store_project(seen: Snapshot, content: bytes, styles: Mapping[str, tuple[str, str]]) -> None:
    """Keep a project under its map's name, and default styles of the views.

    `styles` has for each view its kind of geometry, ``Polygon`` or ``Line``, and the style.
    PermissionError if the user may not make or write QGIS's tables.
    """
    try:
        with seen.session.transaction():
            _store(seen, content, styles)
    except psycopg.errors.InsufficientPrivilege as error:
        raise PermissionError(
            "a project is stored in public.qgis_projects and public.layer_styles: "
            f"{error.diag.message_primary}. Let the owner of the database store it"
        ) from error


def _store(seen: Snapshot, content: bytes, styles: Mapping[str, tuple[str, str]]) -> None:
    for table, made in (("qgis_projects", PROJECTS), ("layer_styles", STYLES)):
        known = seen.session.execute("SELECT to_regclass(%s)", (f"public.{table}",)).fetchone()
        if known == (None,):
            seen.session.execute(made)
            seen.session.execute(
                f"GRANT SELECT ON public.{table} TO semmap_reader, semmap_robot, semmap_admin"
            )
    seen.session.execute(
        "INSERT INTO public.qgis_projects VALUES (%s, jsonb_build_object('last_modified_time', "
        "now(), 'last_modified_user', CURRENT_USER), %s) ON CONFLICT (name) DO UPDATE "
        "SET metadata = excluded.metadata, content = excluded.content",
        (seen.name, content),
    )
    for view, (geometry, style) in styles.items():
        key = {"view": view, "name": _STYLE, "type": geometry, "style": style}
        seen.session.execute(
            "DELETE FROM public.layer_styles WHERE f_table_catalog = current_database() "
            "AND f_table_schema = 'semmap' AND f_table_name = %(view)s AND stylename = %(name)s",
            key,
        )
        seen.session.execute(
            "INSERT INTO public.layer_styles (f_table_catalog, f_table_schema, f_table_name, "
            "f_geometry_column, stylename, styleqml, useasdefault, description, type) VALUES "
            "(current_database(), 'semmap', %(view)s, 'geom', %(name)s, "
            "XMLPARSE(DOCUMENT %(style)s), true, 'by semmap gis project', %(type)s)",
            key,
        )
