"""Write the files of the office: `office.sdf`, its models, and `office_rooms.geojson`.

Run it after a change of `plan.py` or `furniture.py`: ``python examples/office/make_office.py``.
"""

from __future__ import annotations

import json
import math
import shutil
import sys
from pathlib import Path

import shapely
from furniture import MODELS, Model
from plan import (
    DOOR_HEIGHT,
    DOORS,
    EAST,
    FIRST,
    ITEMS,
    NORTH,
    OUTER,
    REGIONS,
    ROOMS,
    SOUTH,
    STAIR_HOLE,
    STOREYS,
    WALL,
    WINDOW,
    WINDOWS,
    Storey,
)
from solids import Solid, box, prism, without, write

SLAB = 0.2
"""Thickness of the floors, metres."""

LOOSE = {"muffin", "cup", "plate", "tray", "book", "laptop"}
"""Models that are made to be carried; all others are static."""


def walls(storey: Storey) -> Solid:
    """All that is neither a room nor a door or window, from floor to ceiling."""
    rooms = [shapely.box(*r.inside) for r in ROOMS if r.storey is storey]
    solid = prism(
        shapely.difference(shapely.box(*OUTER), shapely.union_all(rooms)), 0, storey.height
    )
    deep = 2 * WALL
    holes = []
    for door in DOORS:
        if door.storey is storey:
            size = (door.width, deep) if door.along == "x" else (deep, door.width)
            holes.append(box((*size, DOOR_HEIGHT + 1), (*door.middle, -1)))
    for on, wall, along, width in WINDOWS:
        if on is storey:
            size, middle = _in_wall(wall, along, width, deep)
            holes.append(box((*size, WINDOW[1] - WINDOW[0]), (*middle, WINDOW[0])))
    return without(solid, holes)


def _in_wall(
    wall: str, along: float, width: float, deep: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Size and middle of an opening in an outer wall."""
    if wall in (SOUTH, NORTH):
        return (width, deep), (along, (OUTER[1] if wall == SOUTH else OUTER[3] - WALL) + WALL / 2)
    return (deep, width), ((OUTER[2] - WALL if wall == EAST else OUTER[0]) + WALL / 2, along)


def floor(storey: Storey) -> Solid:
    """The slab below a storey."""
    outline = shapely.box(*OUTER)
    if storey is FIRST:
        outline = outline.difference(shapely.box(*STAIR_HOLE))
    return prism(outline, -SLAB, 0)


# -- models -----------------------------------------------------------------------------------


def write_model(folder: Path, name: str, model: Model) -> None:
    """A model's folder: `model.config`, `model.sdf` and, if it has one, its mesh."""
    home = folder / name
    home.mkdir(parents=True)
    geometries = []
    if model.make is not None:
        write(model.make(), home / "meshes" / f"{name}{model.ending}")
        uri = f"model://{name}/meshes/{name}{model.ending}"
        geometries.append(("", f"<mesh><uri>{uri}</uri></mesh>"))
    for size, (x, y, z) in model.boxes:
        pose = f"<pose>{_text(x, y, z + size[2] / 2)} 0 0 0</pose>"
        geometries.append((pose, f"<box><size>{_text(*size)}</size></box>"))
    parts = [
        f'      <{role} name="{role}{number}">{pose}<geometry>{geometry}</geometry></{role}>'
        for number, (pose, geometry) in enumerate(geometries, 1)
        for role in ("visual", "collision")
    ]
    static = "false" if name in LOOSE else "true"
    (home / "model.sdf").write_text(
        '<?xml version="1.0"?>\n<sdf version="1.9">\n'
        f'  <model name="{name}">\n    <static>{static}</static>\n    <link name="link">\n'
        + "\n".join(parts)
        + "\n    </link>\n  </model>\n</sdf>\n"
    )
    (home / "model.config").write_text(
        f'<?xml version="1.0"?>\n<model>\n  <name>{name}</name>\n  <version>1.0</version>\n'
        '  <sdf version="1.9">model.sdf</sdf>\n'
        "  <description>Of the office example.</description>\n"
        "</model>\n"
    )


def write_world(path: Path) -> None:
    """The world: every instance, where it stands."""
    elevation = {room.name: room.storey.elevation for room in ROOMS}
    instances = [
        (f"{name}-{s.short}", f"{model}_{s.short}", (0.0, 0.0, s.elevation), 0.0)
        for s in STOREYS
        for name, model in (("slab", "floor"), ("walls", "walls"))
    ]
    instances += [
        (i.name, i.model, (i.x, i.y, elevation[i.room] + i.z), math.radians(i.yaw)) for i in ITEMS
    ]
    includes = [
        f"    <include><name>{name}</name><uri>model://{model}</uri>"
        f"<pose>{_text(*at)} 0 0 {_text(yaw)}</pose></include>"
        for name, model, at, yaw in instances
    ]
    path.write_text(
        '<?xml version="1.0"?>\n<sdf version="1.9">\n  <world name="office">\n'
        + "\n".join(includes)
        + "\n  </world>\n</sdf>\n"
    )


def _text(*values: float) -> str:
    return " ".join(f"{v:.6f}".rstrip("0").rstrip(".") for v in values)


# -- annotation -------------------------------------------------------------------------------


def features() -> list[dict[str, object]]:
    """Storeys, the elevator, rooms, doors and regions as GeoJSON features."""
    made = [
        _feature(
            {"kind": "storey", "name": s.name, "elevation": s.elevation, "height": s.height},
            "Polygon",
            _ring(OUTER),
        )
        for s in STOREYS
    ]
    made.append(
        _feature({"kind": "elevator", "name": "elevator", "type": "elevator"}, "Point", [3.0, 8.3])
    )
    for room in ROOMS:
        properties = {"kind": "room", "name": room.name, "type": room.type, "label": room.label}
        properties |= {"storey": room.storey.name, "floor": 0.0, "ceiling": room.storey.height}
        if room.elevator:
            properties |= {"elevator": room.elevator, "ceiling": 2.3}
        made.append(_feature(properties, "Polygon", _ring(room.inside)))
    for door in DOORS:
        properties = {"kind": "connector", "name": door.name, "type": door.type}
        properties |= {
            "storey": door.storey.name,
            "joins": ",".join(door.joins),
            "state": door.state,
        }
        properties |= {"behaviour": door.behaviour}
        ends = [[round(v, 4) for v in end] for end in door.line]
        made.append(_feature(properties, "LineString", ends))
    for region in REGIONS:
        properties = {"kind": "region", "name": region.name, "type": region.type}
        properties |= {"storey": region.storey.name, **region.properties}
        made.append(_feature(properties, "Polygon", _ring(region.outline)))
    return made


def _feature(properties: dict[str, object], kind: str, coordinates: object) -> dict[str, object]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _ring(bounds: tuple[float, float, float, float]) -> list[list[list[float]]]:
    x0, y0, x1, y1 = bounds
    return [[[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]]


def write_annotation(path: Path) -> None:
    """The GeoJSON file, one line a feature."""
    lines = ",\n".join(json.dumps(feature) for feature in features())
    path.write_text(f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n')


def main(folder: Path) -> None:
    """Write all files into a folder; models that were there are replaced."""
    shutil.rmtree(folder / "models", ignore_errors=True)
    for name, model in MODELS.items():
        write_model(folder / "models", name, model)
    for storey in STOREYS:
        write_model(folder / "models", f"floor_{storey.short}", Model(lambda s=storey: floor(s)))
        write_model(folder / "models", f"walls_{storey.short}", Model(lambda s=storey: walls(s)))
    write_world(folder / "office.sdf")
    write_annotation(folder / "office_rooms.geojson")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
