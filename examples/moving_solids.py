"""Solids that move, the sets of entities that their voxels form, and what begins and ends.

    python examples/moving_solids.py                writes a picture a step to out/moving_solids
    python examples/moving_solids.py --live         a window: arrow keys move the chosen solid

In the window: tab chooses the next solid, arrows move it along x and y, page up and down along z,
space turns it, backspace takes it away and brings it back. The slices go through the chosen solid.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from matplotlib.figure import Figure
from voxel_slices import VoxelSet, VoxelSlice, draw_slices, slices_picture

from semmap.fields import Box, Cone, Cylinder, Hull, RegionMap, Solid, Sphere
from semmap.fields.regions.shaped_region import Region
from semmap.fields.relations.event_bus import EventBus
from semmap.fields.relations.facts import RelationEvent
from semmap.fields.relations.tracker import RelationTracker
from semmap.geometry.voxel_keys import keys_of, voxels_of_keys

VOXEL = 0.025
LOW, HIGH = np.array((-1.6, -1.1, 0.0)), np.array((2.4, 1.1, 1.9))

COLOURS = {
    "table": "#c08d57",
    "mug": "#d9483b",
    "ball": "#3f7fd0",
    "ring": "#8a5fc0",
    "wedge": "#4f9d57",
    "human1": "#e08a3c",
    "fov_632": "#f7e38d",
    "zone_943": "#c6e6ee",
}
VIEWS = {"fov_632": "human1"}
SPACES = {"zone_943"}

Place = tuple[float, float, float]


def upright(place: Place, turn: float) -> list[Region]:
    """A person of 1.7 m."""
    x, y, z = place
    return [Cylinder((x, y, z + 0.72), 0.18, 1.44), Sphere((x, y, z + 1.57), 0.13)]


def four_legged(place: Place, turn: float) -> list[Region]:
    """A table: its top, and a leg in each corner."""
    x, y, z = place
    around = (0, 0, math.sin(turn / 2), math.cos(turn / 2))
    found: list[Region] = [Box((x, y, z + 0.7125), (1.2, 0.8, 0.075), around)]
    for u, v in ((0.55, 0.35), (0.55, -0.35), (-0.55, 0.35), (-0.55, -0.35)):
        leg_x = x + u * math.cos(turn) - v * math.sin(turn)
        leg_y = y + u * math.sin(turn) + v * math.cos(turn)
        found.append(Box((leg_x, leg_y, z + 0.3375), (0.075, 0.075, 0.675), around))
    return found


def torus(place: Place, turn: float) -> list[Region]:
    """A ring, which is no convex solid."""
    mesh = trimesh.creation.torus(0.3, 0.09, 24, 12)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, (1, 0, 0)))
    return [Solid(mesh.vertices + np.array(place), mesh.faces)]


def tetrahedron(place: Place, turn: float) -> list[Region]:
    """The hull of four points that turns about z."""
    x, y, z = place
    around = [(turn + k * 2 * math.pi / 3) for k in range(3)]
    foot = [(x + 0.2 * math.cos(a), y + 0.2 * math.sin(a), z) for a in around]
    return [Hull([*foot, (x, y, z + 0.35)])]


def gaze(place: Place, turn: float) -> list[Region]:
    """What is seen from there, `turn` below the horizon."""
    return [Cone(place, (math.cos(turn), 0, -math.sin(turn)), 0.5, 2.6)]


SOLIDS: dict[str, tuple[Callable[[Place, float], list[Region]], Place, float]] = {
    "mug": (
        lambda p, t: [Cylinder(p, 0.06, 0.14, (math.sin(t), 0, math.cos(t)))],
        (2.0, 0.0, 1.4),
        0.0,
    ),
    "ball": (lambda p, t: [Sphere(p, 0.2)], (-0.9, 0.0, 0.2), 0.0),
    "ring": (torus, (0.1, 0.0, 0.09), 0.0),
    "wedge": (tetrahedron, (0.75, 0.0, 0.75), 0.0),
    "table": (four_legged, (1.1, 0.0, 0.0), 0.0),
    "fov_632": (gaze, (-1.15, 0.0, 1.57), 1.2),
    "human1": (upright, (-1.3, 0.0, 0.0), 0.0),
    "zone_943": (lambda p, t: [Box(p, (1.2, 0.8, 0.35))], (1.1, 0.0, 0.925), 0.0),
}
"""How each solid is made at a place and turned, and where it is at first."""


class Scene:
    """The solids, their voxels and relations."""

    def __init__(self) -> None:
        self.regions = RegionMap(VOXEL)
        self.relations = RelationTracker(self.regions, views=VIEWS, spaces=SPACES)
        self.events = EventBus()
        self.at = {name: (np.array(place), turn) for name, (_, place, turn) in SOLIDS.items()}
        for name in SOLIDS:
            self._put(name)
        self.begun = self.tell(SOLIDS)

    def move(
        self, name: str, by: Iterable[float] = (0, 0, 0), turn: float = 0.0
    ) -> list[RelationEvent]:
        """Move a solid by metres and turn it by radians; return what begins and ends."""
        place, turned = self.at[name]
        self.at[name] = place + np.array([*by]), turned + turn
        self._put(name)
        return self.tell([name])

    def toggle(self, name: str) -> list[RelationEvent]:
        """Take a solid away, or bring it back."""
        if name in self.regions:
            self.regions.remove(name)
        else:
            self._put(name)
        return self.tell([name])

    def tell(self, changed: Iterable[str]) -> list[RelationEvent]:
        """What begins and ends, told to all that listen."""
        events = self.relations.update(changed)
        self.events.publish(events)
        return events

    def _put(self, name: str) -> None:
        place, turn = self.at[name]
        first, *more = SOLIDS[name][0](tuple(place.tolist()), turn)
        self.regions.move(name, first)
        for region in more:
            self.regions.insert(name, region)

    def sets(self) -> dict[int, VoxelSet]:
        """The sets that there are, with their voxels."""
        parts = [np.zeros((0, 3), np.int32), *(self.regions.voxels(name) for name in SOLIDS)]
        voxels = voxels_of_keys(np.unique(keys_of(np.concatenate(parts))))
        numbers, counts = np.unique(
            self.regions.set_numbers_at((voxels + 0.5) * VOXEL), return_counts=True
        )
        order = list(SOLIDS)
        return {
            number: VoxelSet(tuple(sorted(map(str, members), key=order.index)), count)
            for (number, members), count in zip(
                self.regions.sets(numbers).items(), counts.tolist(), strict=True
            )
        }

    def slices(self, through: Place) -> list[VoxelSlice]:
        """From the side and from above, through a point."""
        x, y, z = (
            np.arange(low, high, VOXEL) + VOXEL / 2 for low, high in zip(LOW, HIGH, strict=True)
        )
        _, at_y, at_z = ((np.floor(np.array(through) / VOXEL) + 0.5) * VOXEL).tolist()
        side = np.stack(np.meshgrid(x, at_y, z, indexing="ij"), -1)[:, 0].swapaxes(0, 1)
        above = np.stack(np.meshgrid(x, y, at_z, indexing="ij"), -1)[:, :, 0].swapaxes(0, 1)
        found = []
        for points, rows, what, title, cut in (
            (side, 2, "z", f"from the side, at y = {at_y:.4g} m", at_z),
            (above, 1, "y", f"from above, at z = {at_z:.4g} m", at_y),
        ):
            numbers = self.regions.set_numbers_at(points.reshape(-1, 3)).reshape(points.shape[:2])
            extent = (LOW[0], HIGH[0], LOW[rows], HIGH[rows])
            found.append(VoxelSlice(numbers, extent, title, ("x", what), ("h", cut)))
        return found

    def picture(self, through: Place, title: str, events: list[RelationEvent]) -> dict[str, Any]:
        """What `draw_slices` takes."""
        sets = self.sets()
        whole = sum(each.voxels for each in sets.values())
        # What is near fills the page; what touches does so both ways.
        holds = [
            f"{f.subject} {f.relation} {f.object}"
            for f in sorted(self.relations.holding(), key=str)
            if f.relation != "near" and (f.relation != "touching" or str(f.subject) < str(f.object))
        ]
        return {
            "slices": self.slices(through),
            "sets": sets,
            "colours": COLOURS,
            "title": f"{title}: {whole:,} voxels of {VOXEL * 100:g} cm",
            "events": [str(event) for event in events],
            "relations": holds,
        }


STORY: tuple[tuple[str, tuple[tuple[str, Place, float], ...]], ...] = (
    ("a mug is brought", (("mug", (-0.35, 0, -0.15), 0.0),)),
    ("human1 looks up", (("mug", (-0.25, 0, -0.1), 0.0), ("fov_632", (0, 0, 0), -0.5))),
    ("human1 begins to see it", (("mug", (-0.15, 0, -0.1), 0.0), ("fov_632", (0, 0, 0), -0.3))),
    ("the mug is put down", (("mug", (0, 0, -0.229), 0.0),)),
    ("it trembles", (("mug", (0.001, 0, -0.002), 0.0), ("ball", (0.2, 0, 0), 0.0))),
    ("the ball rolls against the ring", (("ball", (0.24, 0, 0), 0.0),)),
    ("the ring is set upright", (("ring", (0, 0, 0.3), math.pi / 2),)),
    ("the wedge is pushed against the mug", (("wedge", (0.33, 0, 0), 0.4),)),
    ("the mug tilts over the edge", (("mug", (0.46, 0, 0.0), 0.9),)),
    ("it falls", (("mug", (0.12, 0, -0.76), 0.67),)),
    ("human1 looks away", (("fov_632", (0, 0, 0), -0.8), ("ball", (-0.4, 0, 0), 0.0))),
)
"""What moves by how much at each step, and how far it turns."""

STEP = 0.05
KEYS = {
    "left": (-STEP, 0, 0),
    "right": (STEP, 0, 0),
    "down": (0, -STEP, 0),
    "up": (0, STEP, 0),
    "pagedown": (0, 0, -STEP),
    "pageup": (0, 0, STEP),
}


def tell_story(folder: Path, steps: int = len(STORY)) -> None:
    """A picture a step, and what begins and ends on the terminal."""
    scene = Scene()
    watched = (0.0, 0.0, 0.82)
    path = slices_picture(folder / "00.png", **scene.picture(watched, "at first", scene.begun))
    print(f"{path}: at first", *map(str, scene.begun), sep="\n    ")
    for i, (title, moves) in enumerate(STORY[:steps], 1):
        events: list[RelationEvent] = []
        for name, by, turn in moves:
            events += scene.move(name, by, turn)
        path = slices_picture(folder / f"{i:02}.png", **scene.picture(watched, title, events))
        print(f"{path}: {title}", *map(str, events), sep="\n    ")


class LivePicture:
    """A figure in which keys move the first of the solids."""

    def __init__(self, figure: Figure) -> None:
        self.figure = figure
        self.scene = Scene()
        self.names = list(SOLIDS)
        self.scene.events.subscribe(print)
        figure.canvas.mpl_connect("key_press_event", lambda event: self.press(event.key))
        self.show(self.scene.begun)

    def press(self, key: str | None) -> None:
        """Choose, move, turn or take away; other keys do nothing."""
        name = self.names[0]
        if key == "tab":
            self.names.append(self.names.pop(0))
            self.show([])
        elif key in KEYS:
            self.show(self.scene.move(name, KEYS[key]))
        elif key == " ":
            self.show(self.scene.move(name, turn=0.1))
        elif key == "backspace":
            self.show(self.scene.toggle(name))

    def show(self, events: list[RelationEvent]) -> None:
        """Draw the slices through the chosen solid."""
        name = self.names[0]
        x, y, z = self.scene.at[name][0].tolist()
        title = f"{name} is chosen (tab: the next; arrows, page up and down, space, backspace)"
        draw_slices(self.figure, **self.scene.picture((x, y, z), title, events))
        self.figure.canvas.draw_idle()


def live() -> bool:
    """Open a window and wait until it is closed; False where none can be opened."""
    from matplotlib import pyplot

    try:
        figure = pyplot.figure("moving solids", figsize=(13, 9))
    except ImportError:  # the backend that was asked for finds no display
        return False
    if getattr(figure.canvas, "required_interactive_framework", None) is None:
        pyplot.close(figure)
        return False
    manager = figure.canvas.manager
    if manager is not None and manager.key_press_handler_id is not None:
        figure.canvas.mpl_disconnect(manager.key_press_handler_id)  # arrows are ours
    LivePicture(figure)
    pyplot.show()
    return True


def main() -> None:
    """Open the window, or write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--live", action="store_true", help="a window that listens to keys")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/moving_solids"))
    parser.add_argument("--steps", type=int, default=len(STORY), help="how many to tell")
    options = parser.parse_args()
    if options.live:
        if live():
            return
        print("no window can be opened here, so the pictures are written instead")
    tell_story(options.output, max(options.steps, 0))


if __name__ == "__main__":
    main()
