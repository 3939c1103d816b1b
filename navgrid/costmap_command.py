"""`semmap costmap`: the layered costmaps of a robot, as Nav2 loads them, with pictures."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table
from rich.text import Text

from navgrid.costmap import Blame, Costmap, Inflation
from navgrid.headings import collisions
from navgrid.map_file import file_name
from navgrid.nav2 import Files, write_nav2
from navgrid.policy import Policy
from navgrid.robot_options import MaxSlope, MaxStep, Parts, State, Urdf, parts_of
from navgrid.scene import MARGIN, Bounds, grid_of
from navgrid.source import read_scene, read_storey_names
from navgrid.static_map import map_layer
from navgrid.terrain import Gait
from semmap import cli
from semmap.draw.palette import PART_COLOURS

__all__ = ["costmap_command", "draw_costmap"]


def costmap_command(
    robot: Urdf,
    folder: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for maps, parameters, pictures.")
    ] = None,
    state: State = None,
    parts: Parts = None,
    policy: Annotated[
        Path | None, typer.Option(help="Which entity goes on which layer; YAML.")
    ] = None,
    static_map: Annotated[
        Path | None, typer.Option(help="A map.yaml, as from SLAM, as a layer more.")
    ] = None,
    map_name: cli.MapName = None,
    storey: Annotated[str | None, typer.Option(help="Only this storey.")] = None,
    rooms: Annotated[
        str | None, typer.Option(help="Only these rooms: lab1,corridor1 (semmap route --rooms).")
    ] = None,
    box: Annotated[str | None, typer.Option(help="Only X0,Y0,X1,Y1, metres.")] = None,
    resolution: Annotated[float, typer.Option(help="Metres a cell.")] = 0.05,
    inflation_radius: Annotated[float, typer.Option(help="Metres, as in costmap_2d.")] = 0.55,
    cost_scaling_factor: Annotated[float, typer.Option(help="1/metre, as in costmap_2d.")] = 3.0,
    max_step: MaxStep = 0.02,
    max_slope: MaxSlope = 6.0,
    laser_height: Annotated[float, typer.Option(help="Of the localisation map, metres.")] = 0.25,
    at: Annotated[
        datetime | None, typer.Option(help="When: regions count while they hold. By default now.")
    ] = None,
    headings: Annotated[
        int, typer.Option(help="Also write the precise form for so many headings.")
    ] = 0,
    why: Annotated[
        str | None, typer.Option(help="X,Y: tell what makes that place cost what it costs.")
    ] = None,
    picture: Annotated[bool, typer.Option(help="Draw each costmap as a PNG, too.")] = True,
    json_: cli.Json = False,
) -> None:
    """Compute a robot's layered costmaps and write them as Nav2 loads them."""
    if folder is None and why is None:
        raise typer.BadParameter("name a folder (-o), or ask --why X,Y")
    shape = parts_of(robot, state, parts)
    rules = Policy.default() if policy is None else Policy.read(policy)
    fall = Inflation(inflation_radius, cost_scaling_factor)
    gait = Gait(max_step, math.radians(max_slope))
    moment = datetime.now(UTC) if at is None else at if at.tzinfo else at.astimezone()
    wanted = None if rooms is None else [name.strip() for name in rooms.split(",")]
    bounds = None if box is None else numbers(box, 4, "--box X0,Y0,X1,Y1")
    made: list[Costmap] = []
    with cli.open_map(map_name) as connection:
        names = read_storey_names(connection)
        reach = max(p.radius for p in shape) + inflation_radius + max(
            layer.padding for layer in rules.layers
        )  # fmt: skip
        for name in names if storey is None else [storey]:
            try:
                scene = read_scene(
                    connection, name, bounds=_four(bounds), rooms=wanted, margin=reach,
                    moment=moment,
                )  # fmt: skip
            except LookupError:
                if wanted is None or storey is not None or len(names) == 1:
                    raise
                continue  # these rooms are on another storey
            if not scene.things and not scene.places:
                continue
            # Beyond a part, so far as it has an effect there: costs are those of the whole map.
            bounded = wanted is not None or bounds is not None
            grid = grid_of(scene, resolution, _four(bounds), reach if bounded else MARGIN)
            static = {} if static_map is None else {"static_map": map_layer(static_map, grid)}
            made.append(Costmap(scene, shape, grid, rules, fall, gait, static=static))
    if not made:
        raise LookupError("nothing is there; name a storey, rooms or a box of the map")
    if why is not None:
        answer(made, numbers(why, 2, "--why X,Y"), json_)
        return
    assert folder is not None
    written = []
    for costmap in made:
        place = folder if len(made) == 1 else folder / file_name(costmap.scene.storey)
        said = write_nav2(costmap, place, laser_height=laser_height)
        if headings:
            said["collisions"] = str(_write_headings(costmap, headings, place))
        if picture:
            said["pictures"] = [str(p) for p in draw_costmap(costmap, place)]
        written.append({**said, "folder": str(place)})
    if json_:
        print(json.dumps(written))
        return
    show(written)


def draw_costmap(costmap: Costmap, folder: Path) -> list[Path]:
    """The master and each part's costmap, as pictures in the colours of costmap_2d."""
    from semmap.draw.costmap import costmap_picture  # slow to load, as all that draws

    storey, grid = costmap.scene.storey, costmap.grid
    drawn = [
        costmap_picture(
            costmap.master, grid.origin, grid.resolution, folder / "master.png",
            title=f"{storey}: master costmap",
        )
    ]  # fmt: skip
    for number, part in enumerate(costmap.parts):
        low, high = part.interval
        drawn.append(
            costmap_picture(
                costmap.costs[number], grid.origin, grid.resolution,
                folder / f"{file_name(part.name)}.png",
                title=f"{storey}: {part.name}, {low:.2f} to {high:.2f} m",
            )
        )  # fmt: skip
    return drawn


def answer(made: Iterable[Costmap], point: tuple[float, ...], json_: bool) -> None:
    """Tell what makes a place cost what it costs."""
    rows: list[dict[str, Any]] = []
    for costmap in made:
        try:
            row, column = costmap.cell(point[0], point[1])
        except ValueError:
            continue
        rows.append(
            {
                "storey": costmap.scene.storey,
                "cost": int(costmap.master[row, column]),
                "because": [asdict(blame) for blame in costmap.why(point[0], point[1])],
            }
        )
    if not rows:
        raise ValueError(f"{point} is on none of the grids")
    if json_:
        print(json.dumps(rows))
        return
    for said in rows:
        cli.out.print(f"{said['storey']}: cost {said['cost']}")
        blames = [Blame(**b) for b in said["because"]]
        table = Table(box=None, pad_edge=False, header_style="bold")
        for name in ("cost", "part", "layer", "metres off", "entities"):
            table.add_column(name)
        for b in blames:
            table.add_row(str(b.cost), b.part, b.layer, f"{b.distance:.2f}", ", ".join(b.entities))
        if blames:
            cli.out.print(table)


def show(written: Iterable[Files]) -> None:
    """What was written, in words."""
    for said in written:
        cli.out.print(
            f"{said['storey']}: {said['folder']}: {len(said['maps'])} maps of {said['width']} x "
            f"{said['height']} cells of {said['resolution']:g} m, frame {said['frame']}"
        )
        for k, part in enumerate(said["parts"]):
            low, high = (round(end, 3) + 0.0 for end in part["interval"])
            radius = part[f"{part['inflate_by']}_radius"]
            cli.out.print(
                Text.assemble(
                    "  ", (part["name"], PART_COLOURS[k % len(PART_COLOURS)]),
                    f": {low:.2f} to {high:.2f} m, {part['inflate_by']} radius {radius:.2f} m",
                )
            )  # fmt: skip


def numbers(said: str, count: int, what: str) -> tuple[float, ...]:
    """So many finite numbers with commas between."""
    try:
        found = tuple(float(v) for v in said.split(","))
    except ValueError:
        found = ()
    if len(found) != count or not all(map(math.isfinite, found)):
        raise ValueError(f"{what} takes {count} numbers with commas between, not {said}")
    return found


def _four(values: tuple[float, ...] | None) -> Bounds | None:
    return None if values is None else (values[0], values[1], values[2], values[3])


def _write_headings(costmap: Costmap, headings: int, folder: Path) -> Path:
    path = folder / "collisions.npz"
    np.savez_compressed(
        path,
        collisions=collisions(costmap, headings),
        headings=2 * np.pi * np.arange(headings) / headings,
        origin=costmap.grid.origin,
        resolution=costmap.grid.resolution,
    )
    return path
