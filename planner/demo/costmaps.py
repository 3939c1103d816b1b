"""The part of the demo that a robot has: its costmaps, and Figures 5, 6, 7 and 9."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from navgrid.costmap import Costmap
from navgrid.costmap_output import draw_costmap
from navgrid.grid import scene_grid
from navgrid.map_file import file_name
from navgrid.nav2 import write_nav2
from planner.demo.figures import blocked_region, passage, robot_figures
from planner.demo.office import office_folder
from semmap import cli
from semmap.draw.view import StoreyView
from semmap.geometry.mesh import Mesh
from semmap.query.storey_reader import read_scene
from semmap.robot import LinkGroup, Part, load_robot, robot_parts

__all__ = ["robot_demo"]

ROBOT, GROUPS = "delivery_robot.urdf", "delivery_robot_parts.yaml"

START, GOAL, GAP = (14.8, 5.2), (16.0, 1.5), (16.0, 2.35)
"""In lab2 of the office: inside its door, behind the workbenches, and between these."""


def robot_demo(
    map_name: str, folder: Path, storeys: Sequence[StoreyView], say: Callable[..., Any]
) -> list[Path]:
    """Write the delivery robot's costmaps of each storey, draw them; the pictures made.

    Raises
    ------
    LookupError
        The examples are not beside this package, as in a checkout they are.
    """
    example = office_folder()
    robot = load_robot(example / ROBOT)
    parts = robot_parts(robot, {}, example / GROUPS)
    meshes = robot.link_meshes({})
    pictures = robot_figures(parts, meshes, folder)
    with cli.open_map(map_name) as connection:
        for storey in storeys:
            scene = read_scene(connection, storey.name)
            if not scene.entities and not scene.floors:
                continue
            costmap = Costmap(scene, parts, scene_grid(scene, 0.05))
            place = folder if len(storeys) == 1 else folder / file_name(storey.name)
            files = write_nav2(costmap, place / "costmap")
            say(f"   {place / 'costmap'}: {len(files['maps'])} maps and nav2_params.yaml")
            pictures += draw_costmap(costmap, place / "costmap")
            region = blocked_region(costmap, folder)
            pictures += [] if region is None else [region]
        if map_name == "office":
            whole = robot_parts(robot, {}, [LinkGroup("robot", robot.links)])
            pictures += _between_the_workbenches(connection, storeys, parts, whole, meshes, folder)
    for picture in pictures:
        if picture.name.startswith("figure"):
            say(f"   {picture}")
    return pictures


def _between_the_workbenches(
    connection: Any,
    storeys: Sequence[StoreyView],
    parts: Sequence[Part],
    whole: Sequence[Part],
    meshes: Mapping[str, Mesh],
    folder: Path,
) -> list[Path]:
    """Figure 9 in lab2, where the layered costmap alone knows a way."""
    view = next((s for s in storeys if any(r.name == "lab2" for r in s.rooms)), None)
    if view is None:
        return []
    lab = next(r for r in view.rooms if r.name == "lab2")
    things = [
        o
        for o in view.objects
        if o.footprint is not None
        and lab.outline.contains(o.footprint.centroid)
        and "building_element" not in o.types
    ]
    scene = read_scene(connection, view.name, rooms=["lab2"], margin=1.0)
    grid = scene_grid(scene, 0.025)
    found = passage(
        Costmap(scene, parts, grid),
        Costmap(scene, whole, grid),
        START,
        GOAL,
        GAP,
        replace(view, rooms=[lab], objects=things),
        meshes,
        folder,
    )
    return [] if found is None else found.pictures
