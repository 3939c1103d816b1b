"""The commands `semmap regions find`, `draw` and `ls`."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import datetime
from enum import StrEnum
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semmap import cli

# NumPy, Shapely and SQLAlchemy are slow to import: the functions below import what they use.
if TYPE_CHECKING:
    import psycopg
    from shapely import Polygon
    from sqlalchemy import Connection

__all__ = ["regions"]

regions = typer.Typer(
    no_args_is_help=True, help="Parts of rooms and objects: drawn, or found in the geometry."
)


class Sort(StrEnum):
    """Kinds of regions that geometry shows."""

    surfaces = "surfaces"
    floor = "floor"
    observation = "observation"


@regions.command()
def find(
    sort: Annotated[
        Sort, typer.Argument(help="Of objects: surfaces, observation; of rooms: floor.")
    ],
    names: Annotated[list[str] | None, typer.Argument(metavar="NAME...")] = None,
    type_: Annotated[
        str | None, typer.Option("--type", help="All of this type: table, kitchen, room.")
    ] = None,
    near: Annotated[
        float, typer.Option(help="observation: least distance from the object, metres.")
    ] = 0.5,
    far: Annotated[
        float, typer.Option(help="observation: largest distance from the object, metres.")
    ] = 1.2,
    headroom: Annotated[float, typer.Option(help="floor: free height above it, metres.")] = 2.0,
    max_step: Annotated[float, typer.Option(help="floor: highest step up or down, metres.")] = 0.03,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Find regions in the geometry of rooms and objects.

    surfaces: where other objects can stand; floor: the walkable floor of a room as it is now;
    observation: the ring around an object from which to observe it.
    """
    from sqlalchemy.exc import DBAPIError

    from semmap.ingest.regions import extraction

    if not names and type_ is None:
        raise typer.BadParameter("name rooms or objects, or give --type")
    seek: dict[Sort, Callable[[Connection, int], int | list[int]]] = {
        Sort.surfaces: extraction.find_support_surfaces,
        Sort.floor: partial(extraction.find_walkable_floor, headroom=headroom, max_step=max_step),
        Sort.observation: partial(extraction.find_observation_area, near=near, far=far),
    }
    kind = "room" if sort is Sort.floor else "object"
    found: list[int] = []
    with cli.engine().begin() as connection:
        cli.choose_map(connection, map_name)
        for name in names or []:
            made = seek[sort](connection, entity_named(connection, name))
            found += made if isinstance(made, list) else [made]
        for entity in all_of_type(connection, type_, kind) if type_ else []:
            try:
                with connection.begin_nested():
                    made = seek[sort](connection, entity)
            except (ValueError, DBAPIError) as error:  # some of many may have none
                reason = error.orig if isinstance(error, DBAPIError) else error
                cli.err.print(f"left out: {reason}", style="yellow")
                continue
            found += made if isinstance(made, list) else [made]
        answer = listed(connection, found)
    cli.show_rows(*answer, json_)


@regions.command()
def draw(
    name: str,
    polygon: Annotated[
        str | None, typer.Option(help='Corners "x,y x,y x,y ..." in the map\'s frame, metres.')
    ] = None,
    box: Annotated[str | None, typer.Option(help="X0,Y0,Z0,X1,Y1,Z1 in the map's frame.")] = None,
    type_: Annotated[str, typer.Option("--type", help="Such as blocked_region.")] = "region",
    holder: Annotated[
        str | None, typer.Option(help="Room or object that holds it, and with which it moves.")
    ] = None,
    where: Annotated[
        list[str] | None, typer.Option("--property", help="KEY=VALUE; repeatable.")
    ] = None,
    since: Annotated[datetime | None, typer.Option(help="It is valid from then on.")] = None,
    until: Annotated[datetime | None, typer.Option(help="It is valid until then.")] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Draw or redraw a region: a polygon from floor to ceiling, or a box."""
    from sqlalchemy import text

    from semmap.ingest.regions.extraction import draw_region

    with cli.engine().begin() as connection:
        cli.choose_map(connection, map_name)
        region = draw_region(
            connection,
            connection.execute(text("SELECT current_map()")).scalar_one(),
            name,
            None if polygon is None else outline_of(polygon),
            box=None if box is None else box_of(box),
            type=type_,
            holder=None if holder is None else entity_named(connection, holder),
            properties=dict(property_of(given) for given in where or []),
            valid=None if since is None and until is None else (zoned(since), zoned(until)),
        )
        answer = listed(connection, [region])
    cli.show_rows(*answer, json_)


@regions.command()
def ls(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the regions, with their owners and origins."""
    with cli.engine().connect() as connection:
        cli.choose_map(connection, map_name)
        answer = listed(connection)
    cli.show_rows(*answer, json_)


def listed(
    connection: Connection, ids: list[int] | None = None
) -> tuple[list[str], list[tuple[Any, ...]]]:
    """Return the regions of the current map, or those with these ids, as columns and rows."""
    from sqlalchemy import text

    result = connection.execute(
        text(
            "SELECT e.name, e.type, r.origin, o.name AS of, h.name AS holder, "
            "round(CAST(ST_Area(w.footprint) AS numeric), 3) AS area, "
            "round(CAST(ST_ZMin(w.box) AS numeric), 3) AS low, "
            "round(CAST(ST_ZMax(w.box) AS numeric), 3) AS high, cardinality(r.faces) AS faces "
            "FROM region r JOIN entity e ON e.id = r.entity_id "
            "LEFT JOIN entity o ON o.id = r.of_id LEFT JOIN placement p ON p.entity_id = e.id "
            "LEFT JOIN entity h ON h.id = p.holder_id LEFT JOIN world w ON w.entity_id = e.id "
            "WHERE e.map_id = current_map() "
            "AND (CAST(:ids AS bigint[]) IS NULL OR e.id = ANY(:ids)) ORDER BY e.name"
        ),
        {"ids": ids},
    )
    rows = [tuple(float(v) if hasattr(v, "as_tuple") else v for v in row) for row in result]
    return list(result.keys()), rows


def _driver(connection: Connection) -> psycopg.Connection[Any]:
    import psycopg

    driver = connection.connection.driver_connection
    assert isinstance(driver, psycopg.Connection)
    return driver


def entity_named(connection: Connection, name: str) -> int:
    """Return the id of the entity of that name in the current map; an error has similar names."""
    from semmap.query import entity_query

    return entity_query.entity_id(_driver(connection), name)


def all_of_type(connection: Connection, type_: str, kind: str) -> list[int]:
    """Return the ids of the placed entities of a kind and type, subtypes included."""
    from sqlalchemy import text

    from semmap.query import entity_query

    rows = entity_query.find(_driver(connection), type=type_)
    names = [row["name"] for row in rows if row["kind"] == kind]
    return list(
        connection.execute(
            text(
                "SELECT e.id FROM entity e JOIN world w ON w.entity_id = e.id "
                "WHERE e.map_id = current_map() AND e.name = ANY(:names) ORDER BY e.name"
            ),
            {"names": names},
        ).scalars()
    )


def outline_of(given: str) -> Polygon:
    """Return the polygon of ``x,y x,y x,y ...``."""
    import shapely

    try:
        corners = [tuple(float(v) for v in corner.split(",")) for corner in given.split()]
    except ValueError:
        corners = []
    if len(corners) < 3 or any(len(corner) != 2 for corner in corners):
        raise ValueError(f'--polygon takes three corners or more, "x,y x,y x,y", not {given}')
    polygon = shapely.Polygon(corners)
    if not polygon.is_valid:
        raise ValueError(f"--polygon crosses its own border: {shapely.is_valid_reason(polygon)}")
    return polygon


def zoned(moment: datetime | None) -> datetime | None:
    """Return a moment with a time zone, by default that of the machine."""
    return moment if moment is None or moment.tzinfo else moment.astimezone()


def box_of(given: str) -> tuple[float, float, float, float, float, float]:
    """Return the box of ``x0,y0,z0,x1,y1,z1``."""
    try:
        x0, y0, z0, x1, y1, z1 = (float(v) for v in given.split(","))
    except ValueError:
        raise ValueError(
            f"--box takes six numbers with commas between, x0,y0,z0,x1,y1,z1, not {given}"
        ) from None
    return x0, y0, z0, x1, y1, z1


def property_of(given: str) -> tuple[str, Any]:
    """Return the key and the value, JSON or else text, of ``KEY=VALUE``."""
    key, equals, value = given.partition("=")
    if not equals or not key:
        raise ValueError(f"--property takes KEY=VALUE, not {given}")
    try:
        return key, json.loads(value)
    except json.JSONDecodeError:
        return key, value
