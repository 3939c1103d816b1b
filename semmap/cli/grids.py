"""`semmap grid` and `semmap costmap`: grids of each storey and robot as files for Nav2.

The commands load their modules when they run, so that their help is quick.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer import Option

from semmap import cli
from semmap.cli.operation_command import MethodCall, command_of
from semmap.cli.options import Json
from semmap.cli.output import print_folded
from semmap.cli.texts import numbers

if TYPE_CHECKING:
    from navgrid.costmap import Costmap
    from navgrid.occupancy_grid import StoreyGrid
    from semmap.api.map import Map


@dataclass(frozen=True)
class Contents:
    """The fields, and the voxels, that count in a grid."""

    field: list[str] = Option(
        (), help="Only this field of the map; may be repeated. By default all."
    )
    no_fields: bool = Option(False, "--no-fields", help="Leave out the fields of the map.")
    from_voxels: bool = Option(
        False, "--from-voxels", help="Take voxels from the mirror, not meshes."
    )
    voxel_size: float = Option(
        0.05, help="Edge of the mirror's voxels, metres, with --from-voxels."
    )

    def arguments(self, house: Map) -> dict[str, Any]:
        """What `Map.grids` takes; the fields whose sources ended are noted."""
        from navgrid.readers.fields import LIVE

        if self.no_fields and self.field:
            raise ValueError("--field and --no-fields exclude each other: give one of them")
        ended = [] if self.no_fields or self.field else house.ended_fields
        if ended:
            what = f"fields of sources without an update for {LIVE:.0f} s, not used"
            cli.err.print(f"{what}: {', '.join(ended)}", style="yellow")
        return {
            "fields": [] if self.no_fields else self.field or None,
            "voxel_size": self.voxel_size if self.from_voxels else None,
        }


@command_of("Map.grids", interval="LOW,HIGH", fields=None, voxel_size=None)
def grid_command(
    call: MethodCall,
    *,
    folder: Path = Option(..., "--output", "-o", help="Folder for the maps."),
    contents: Contents,
    picture: bool = Option(True, help="Draw each grid as plan.png, too."),
    json_: Json = False,
) -> None:
    """Write the obstacles of each storey as a Nav2 map (map.yaml, map.pgm)."""
    from navgrid.grid import check_storey_names
    from navgrid.map_file import folder_of

    grids = call(**contents.arguments(call.handle))
    check_storey_names(grid.scene.storey for grid in grids)
    written = [
        grid.write(folder_of(grid.scene.storey, folder, len(grids)), picture=picture)
        for grid in grids
    ]
    if json_:
        print(json.dumps(written))
    else:
        _show_grids(grids, written)


def _show_grids(grids: Sequence[StoreyGrid], written: Sequence[dict[str, Any]]) -> None:
    for grid, row in zip(grids, written, strict=True):
        print(
            f"{row['storey']}: {row['map']}, {row['width']} x {row['height']} cells of "
            f"{row['resolution']:g} m: {row['occupied']} occupied, {row['free']} free, "
            f"{row['unknown']} unknown"
        )
        for note in grid.notes:
            cli.out.print(f"{row['storey']}: {note}", style="yellow")


@command_of(
    "Map.costmaps",
    robot="--robot",
    posture="--state",
    bounds="--box",
    rooms=None,
    fields=None,
    voxel_size=None,
)
def costmap_command(
    call: MethodCall,
    *,
    folder: Path | None = Option(None, "--output", "-o", help="Folder for maps and pictures."),
    rooms: str | None = Option(None, help="Only these rooms: bath,hall (semmap route --rooms)."),
    laser_height: float = Option(0.25, help="Of the localisation map above the floor, metres."),
    contents: Contents,
    headings: int = Option(0, help="Also write collisions by heading, for so many headings."),
    explain: str | None = Option(
        None, "--explain", "--why", metavar="X,Y", help="Show the causes of a place's cost."
    ),
    picture: bool = Option(True, help="Draw each costmap as a PNG, too."),
    json_: Json = False,
) -> None:
    """Compute a robot's layered costmaps and write them for Nav2."""
    if folder is None and explain is None:
        raise typer.BadParameter("give a folder (-o) or a point (--explain X,Y)")
    point = None if explain is None else numbers(explain, "--explain X,Y", 2)
    names = None if rooms is None else [name.strip() for name in rooms.split(",")]
    costmaps = call(rooms=names, **contents.arguments(call.handle))
    if point is not None:
        _show_explanation(costmaps, point[0], point[1], json_)
    elif folder is not None:
        files = {"laser_height": laser_height, "headings": headings, "picture": picture}
        _write(costmaps, folder, files, json_)


def _show_explanation(costmaps: Iterable[Costmap], x: float, y: float, json_: bool) -> None:
    """Print the causes of the cost at a point, per storey; ValueError if it is on no grid."""
    rows: list[dict[str, Any]] = []
    for costmap in costmaps:
        try:
            row, column = costmap.grid.cell(x, y)
        except ValueError:
            continue
        rows.append(
            {
                "storey": costmap.scene.storey,
                "cost": int(costmap.master[row, column]),
                "because": [asdict(source) for source in costmap.explain(x, y)],
            }
        )
    if not rows:
        raise ValueError(f"({x}, {y}) is on none of the grids; give a point within the map")
    if json_:
        print(json.dumps(rows))
        return
    for found in rows:
        print(f"{found['storey']}: cost {found['cost']}")
        lines = [
            (
                str(source["cost"]),
                source["part"],
                source["layer"],
                f"{source['distance']:.2f}",
                _causes(source),
            )
            for source in found["because"]
        ]
        if lines:
            print_folded(("cost", "part", "layer", "metres away", "entities"), lines)


def _causes(source: dict[str, Any]) -> str:
    entities = ", ".join(
        f"{name} (assumed size)" if name in source["assumed"] else name
        for name in source["entities"]
    )
    return entities if source["field"] is None else f"{entities} (field {source['field']})"


def _write(costmaps: Sequence[Costmap], folder: Path, options: Any, json_: bool) -> None:
    """Write costmaps; print the files, per storey, and what costmaps say of objects and fields."""
    from rich.text import Text

    from navgrid.costmap_output import drivable, write_costmaps
    from semmap.draw.palette import PART_COLOURS

    costmaps, closed = drivable(costmaps)
    for reason in closed:
        cli.err.print(f"left out: {reason}", style="yellow")
    written = write_costmaps(costmaps, folder, **options)
    if json_:
        print(json.dumps(written))
        return
    for files in written:
        cli.out.print(
            f"{files['storey']}: {files['folder']}: {len(files['maps'])} maps of "
            f"{files['width']} x {files['height']} cells of {files['resolution']:g} m, "
            f"frame {files['frame']}"
        )
        for number, part in enumerate(files["parts"]):
            low, high = (round(end, 3) + 0.0 for end in part["interval"])
            radii = part["inscribed_radius"], part["circumscribed_radius"]
            cli.out.print(
                Text.assemble(
                    "  ",
                    (part["name"], PART_COLOURS[number % len(PART_COLOURS)]),
                    f": {low:.2f} to {high:.2f} m, {radii[0]:.2f} to {radii[1]:.2f} m "
                    "around the axis",
                )
            )
        cli.out.print(
            f"  the shape fits at some headings, not all, in {files['some_headings']} cells"
        )
    for costmap in costmaps:
        for note in costmap.notes:
            cli.out.print(f"{costmap.scene.storey}: {note}", style="yellow")
