"""The part of the demo about a robot's costmaps: Figures 5, 6, 7 and 9."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from navgrid.costmap import Costmap
from navgrid.costmap_output import draw_costmap
from navgrid.grid import scene_grid
from navgrid.inflation import INSCRIBED, UNKNOWN
from navgrid.launch_files import write_building_launch
from navgrid.map_file import folder_of
from navgrid.nav2 import Files, write_nav2
from navgrid.slabs import area_cells
from planner.robot_class import RobotClass
from semmap.api.driving_posture import driving_posture
from semmap.api.map import Map
from semmap.cli.demo.figures import blocked_region, passage, robot_figures
from semmap.cli.demo.passage_search import find_passage
from semmap.draw.view import RoomView, StoreyView
from semmap.geometry.mesh import Mesh
from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import read_scene
from semmap.robot import LinkGroup, Part, load_robot, robot_parts
from semmap.robot.urdf import Robot

MOST = 4
"""Number of rooms in which a passage for Figure 9 is searched."""


@dataclass(frozen=True)
class DemoRobot:
    """A robot in a joint state: JSON, a file or an SRDF state; `groups` of its links, YAML; m/s."""

    urdf: Path
    state: str | None = None
    groups: Path | None = None
    speed: float = 0.8

    @cached_property
    def _loaded(self) -> tuple[Robot, Mapping[str, float]]:
        chosen = driving_posture(None, self.urdf, self.state, self.groups)
        return load_robot(self.urdf), chosen.joints

    @cached_property
    def parts(self) -> list[Part]:
        """Its parts (Deeken et al., section 4.3)."""
        robot, state = self._loaded
        return robot_parts(robot, state, self.groups)

    @cached_property
    def whole(self) -> Part:
        """All of it as one part."""
        robot, state = self._loaded
        return robot_parts(robot, state, [LinkGroup("robot", robot.links)])[0]

    @cached_property
    def meshes(self) -> Mapping[str, Mesh]:
        """The meshes of its links in this state."""
        robot, state = self._loaded
        return robot.link_meshes(state)

    def robot_class(self, name: str) -> RobotClass:
        """Robots of its shape."""
        return RobotClass(name, tuple(self.parts), speed=self.speed)


def robot_demo(
    house: Map,
    folder: Path,
    storeys: Sequence[StoreyView],
    robot: DemoRobot,
    say: Callable[..., Any],
    pixels: int = 1800,
) -> list[Path]:
    """Write the robot's costmaps of each storey, draw them and the figures; the pictures made."""
    meshes = robot.meshes
    pictures = robot_figures(robot.parts, meshes, folder)
    wanted: list[tuple[float, StoreyView, RoomView]] = []
    written: list[Files] = []
    with house.snapshot() as seen:
        for storey in storeys:
            scene = read_scene(seen, storey.name)
            if not scene.entities and not scene.floors:
                continue
            costmap = Costmap(scene, robot.parts, scene_grid(scene, 0.05))
            place = folder_of(storey.name, folder / "costmap", len(storeys))
            written.append(write_nav2(costmap, place))
            say(f"   {place}: {len(written[-1]['maps'])} maps and nav2_params.yaml")
            pictures += draw_costmap(costmap, place)
            if not any(p.name == FIGURE_5 for p in pictures):
                region = blocked_region(costmap, storey, folder)
                pictures += [] if region is None else [region]
            single = Costmap(scene, [robot.whole], costmap.grid)
            hidden = (costmap.master < INSCRIBED) & (single.master >= INSCRIBED)
            for room in storey.rooms:
                cells = hidden & area_cells(room.outline, costmap.grid)
                wanted.append((float(cells.sum()) * costmap.grid.resolution**2, storey, room))
        if len(written) > 1:
            write_building_launch(folder / "costmap", written)
        wanted = sorted((w for w in wanted if w[0] > 0), key=lambda w: -w[0])[:MOST]
        for _, storey, room in wanted:
            drawn = _passage_in(seen, storey, room, robot, meshes, folder, pixels)
            if drawn:
                pictures += drawn
                break
    for picture in pictures:
        if picture.name.startswith("figure"):
            say(f"   {picture}")
    names = [p.name for p in pictures]
    if FIGURE_5 not in names:
        say("   no Figure 5: the map has no region that is blocked, such as a flight of stairs")
    if not any(name.startswith("figure9") for name in names):
        say(
            "   no Figure 9: the parts of this robot pass nowhere where a costmap of its whole "
            "height has no way"
        )
    return pictures


FIGURE_5 = "figure5_staircase.png"


def _passage_in(
    seen: Snapshot,
    storey: StoreyView,
    room: RoomView,
    robot: DemoRobot,
    meshes: Mapping[str, Mesh],
    folder: Path,
    pixels: int,
) -> list[Path]:
    """Figure 9 in a room; no picture if the layered costmap knows no other way there."""
    scene = read_scene(seen, storey.name, rooms=[room.name], margin=1.0)
    grid = scene_grid(scene, 0.025)
    layered, single = (Costmap(scene, parts, grid) for parts in (robot.parts, [robot.whole]))
    outside = ~area_cells(room.outline, grid)
    for made in (layered, single):
        made.master[outside] = UNKNOWN
    found = find_passage(layered.master, single.master, grid)
    if found is None:
        return []
    objects = [
        o
        for o in storey.objects
        if o.footprint is not None
        and room.outline.contains(o.footprint.centroid)
        and "building_element" not in o.types
    ]
    view = replace(storey, rooms=[room], objects=objects)
    return passage(layered, single, found.start, found.goal, view, meshes, folder, pixels)
