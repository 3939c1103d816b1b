"""The layered costmap: a stack of layers a robot part, joined to the terrain of a dot-shaped robot.

Deeken et al., sections 4.2 and 4.3: what things mean puts them on layers of their own; each part of
the robot has the layers' cells in its own interval of heights, inflated by its own footprint; the
master costmap is the highest of all.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navgrid.area import area_cells
from navgrid.field_layer import field_cells, social_costs
from navgrid.grid import Grid
from navgrid.inflation import INSCRIBED, UNKNOWN, inflate
from navgrid.occupancy import occupancy
from navgrid.policy import FLOOR, NONE, Layer, Policy
from navgrid.scene import Bounds, Scene, Thing
from navgrid.terrain import Gait, Level, drivable, levels
from semmap.robot import Part

if TYPE_CHECKING:
    from semmap.fields.maps.representation_map import RepresentationMap

__all__ = ["Blame", "Costmap", "Inflation"]

FIXED = "room_geometry"
"""The layer of what of floors no robot drives on, where the policy has it; else its first."""

Window = tuple[slice, slice]


@dataclass(frozen=True)
class Inflation:
    """How costs fall off, as costmap_2d's inflation layer has it; metres, 1/metre."""

    inflation_radius: float = 0.55
    cost_scaling_factor: float = 3.0


@dataclass(frozen=True)
class Blame:
    """Why a cell costs what it costs: a part's layer, and which entities are there.

    `distance` is that of the cell to theirs, metres; `cost` what this layer alone would ask.
    """

    part: str
    layer: str
    entities: tuple[str, ...]
    distance: float
    cost: int


@dataclass(eq=False)
class Costmap:
    """The costs of a scene for a robot, whose parts are in the order of the arrays.

    Attributes
    ----------
    static : further layers by name, (rows, columns) bool, in the way of every part: a SLAM map
    fields : further layers by name, representation maps: what a bool map or one of things holds is
        in the way of the parts at its height, and numbers from 0 to 1 are social costs
    occupied : by layer, (parts, rows, columns) bool
    costs : (parts, rows, columns) uint8, with the meaning of costmap_2d
    master : (rows, columns) uint8, the highest of all; a known cost beats unknown
    unknown : (rows, columns) bool, outside of every place
    seconds : what the last whole computation took, for slabs and for inflation
    """

    scene: Scene
    parts: Sequence[Part]
    grid: Grid
    policy: Policy = field(default_factory=Policy.default)
    inflation: Inflation = field(default_factory=Inflation)
    gait: Gait = field(default_factory=Gait)
    threads: int | None = None
    static: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    fields: Mapping[str, RepresentationMap] = field(default_factory=dict)
    occupied: dict[str, NDArray[np.bool_]] = field(init=False)
    costs: NDArray[np.uint8] = field(init=False)
    master: NDArray[np.uint8] = field(init=False)
    unknown: NDArray[np.bool_] = field(init=False)
    seconds: dict[str, float] = field(init=False)

    def __post_init__(self) -> None:
        if not self.parts:
            raise ValueError("a costmap is of a robot's parts: give one or more")
        for part in self.parts:
            low, high = part.interval
            if high <= max(low, self.gait.max_step):
                raise ValueError(
                    f"part {part.name} reaches from {low:.3f} to {high:.3f} m, all within a step "
                    f"of {self.gait.max_step} m: it touches nothing but floor. Join it to another"
                )
        for name, cells in self.static.items():
            if cells.shape != self.grid.shape or name in {la.name for la in self.policy.layers}:
                raise ValueError(f"static layer {name}: give it the grid's shape and its own name")
        taken = {la.name for la in self.policy.layers} | set(self.static)
        for name in self.fields:
            if name in taken:
                raise ValueError(f"field {name}: there is a layer of that name; give it its own")
        self.fields = dict(self.fields)
        self._social: dict[str, NDArray[np.uint8]] = {}
        self._things = {thing.id: thing for thing in self.scene.things}
        self._compute()

    # -- all of it ------------------------------------------------------------------------------

    def _compute(self) -> None:
        start = time.perf_counter()
        self._sort()
        self.unknown = self._unknown()
        self._levels: list[Level] = levels(
            self.scene.places, self._ramps, self.scene.elevation, self.gait, self.grid
        )
        everywhere = (slice(0, self.grid.shape[0]), slice(0, self.grid.shape[1]))
        self.occupied = {
            name: self._cells(self._members[name], everywhere) for name in self._members
        }
        for name, cells in self.static.items():
            self.occupied[name] = np.broadcast_to(cells, (len(self.parts), *cells.shape)).copy()
        self._social.clear()
        for name in self.fields:
            self._draw_field(name)
        drawn = time.perf_counter()
        self.costs = np.empty((len(self.parts), *self.grid.shape), np.uint8)
        self.master = np.empty(self.grid.shape, np.uint8)
        self._inflate(everywhere)
        self.seconds = {"slabs": drawn - start, "inflation": time.perf_counter() - drawn}

    @property
    def layers(self) -> tuple[Layer, ...]:
        """Those of the policy, static ones, and fields that are in the way."""
        fields = [name for name in self.fields if name not in self._social]
        return (*self.policy.layers, *(Layer(name) for name in [*self.static, *fields]))

    def _draw_field(self, name: str) -> None:
        values = field_cells(self.fields[name], self._levels, self.intervals, self.grid)
        if self.fields[name].value_type == "float32":
            self._social[name] = social_costs(values)
        else:
            self.occupied[name] = values > 0

    def _sort(self) -> None:
        """Things to layers; of floors, what is driven on to the terrain and the rest to walls."""
        self._members: dict[str, dict[int, Thing]] = {la.name: {} for la in self.policy.layers}
        fixed = FIXED if FIXED in self._members else self.policy.layers[0].name
        heights = sorted({p.floor for p in self.scene.places} or {self.scene.elevation})
        ground = []
        for thing in self._things.values():
            layer = self.policy.layer_of(thing)
            if layer == FLOOR:
                ground.append(thing)
            elif layer != NONE and thing.bounds is not None:
                self._members[layer][thing.id] = thing
        ramps = []
        faces = [t.triangles for t in ground]
        driven = drivable(np.concatenate([*faces, np.empty((0, 3, 3))]), heights, self.gait)
        start = 0
        for thing in ground:
            on = driven[start : start + len(thing.triangles)]
            start += len(thing.triangles)
            ramps.append(thing.triangles[on])
            if not on.all():
                self._members[fixed][thing.id] = replace(thing, triangles=thing.triangles[~on])
        flat = np.concatenate([*ramps, np.empty((0, 3, 3))])
        level = np.zeros(len(flat), np.bool_)
        for height in heights:
            level |= (np.abs(flat[:, :, 2] - height) < self.gait.ground).all(axis=1)
        self._ramps = flat[~level]
        self._floors = {t.id for t in ground}

    def _unknown(self) -> NDArray[np.bool_]:
        if not self.scene.places:
            return np.zeros(self.grid.shape, np.bool_)
        known = np.zeros(self.grid.shape, np.bool_)
        for place in self.scene.places:
            known |= area_cells(place.outline, self.grid)
        return ~known

    def _cells(self, things: Mapping[int, Thing], window: Window) -> NDArray[np.bool_]:
        """(parts, rows, columns): the cells of a window that things of a layer occupy."""
        rows, columns = (s.stop - s.start for s in window)
        found = np.zeros((len(self.parts), rows, columns), np.bool_)
        solids = [t for t in things.values() if t.kind != "region" and len(t.triangles)]
        if solids:
            found |= self._slabs(solids, self.intervals, window)
        for thing in things.values():
            if thing.kind == "region" and thing.outline is not None:
                found |= area_cells(thing.outline, self.grid)[window]
        return found

    def _slabs(
        self, things: Sequence[Thing], intervals: Sequence[tuple[float, float]], window: Window
    ) -> NDArray[np.bool_]:
        """(intervals, rows, columns): what of things is in intervals above each cell's floor."""
        triangles = np.concatenate([t.triangles for t in things])
        counts = [len(t.triangles) for t in things]
        floors = [level for level in self._levels if level.cells[window].any()]
        layers = occupancy(
            (
                triangles.reshape(-1, 3),
                np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3),
            ),
            [
                (level.floor + low, level.floor + high)
                for level in floors
                for low, high in intervals
            ],
            self.grid,
            solid=np.repeat(np.arange(len(things), dtype=np.int32), counts),
            fill=np.array([t.kind != "room" for t in things]),  # a room's shell encloses air
            threads=self.threads,
        )
        found = np.zeros((len(intervals), *self.unknown[window].shape), np.bool_)
        for number, level in enumerate(floors):
            here = layers[number * len(intervals) : (number + 1) * len(intervals), *window]
            found |= here & level.cells[window]
        return found

    @property
    def intervals(self) -> list[tuple[float, float]]:
        """Of each part what counts, metres above the floor: not what lies within a step of it."""
        step = self.gait.max_step
        return [(max(low, step), high) for low, high in (p.interval for p in self.parts)]

    def section(self, height: float) -> NDArray[np.bool_]:
        """(rows, columns) bool: what a plane at a height above the floor meets, metres.

        What a laser sees that is mounted there: the localisation map (Deeken et al., section 4.2).
        """
        everywhere = (slice(0, self.grid.shape[0]), slice(0, self.grid.shape[1]))
        things = [
            thing
            for members in self._members.values()
            for thing in members.values()
            if thing.kind != "region" and len(thing.triangles)
        ]
        if not things:
            return np.zeros(self.grid.shape, np.bool_)
        found: NDArray[np.bool_] = self._slabs(things, [(height, height)], everywhere)[0]
        return found

    # -- costs ----------------------------------------------------------------------------------

    def radii(self, part: Part, padding: float) -> tuple[float, float]:
        """Inscribed and inflation radius of a part on a layer with that padding, metres."""
        inscribed = part.radius + padding
        return inscribed, max(self.inflation.inflation_radius, part.radius) + padding

    @property
    def reach(self) -> int:
        """Cells beyond which nothing that is occupied has an effect."""
        metres = max(self.radii(p, la.padding)[1] for p in self.parts for la in self.layers)
        return max(0, math.ceil(metres / self.grid.resolution - 1e-9))

    def _inflate(self, window: Window) -> None:
        """Costs in a window, from what is occupied within reach of it."""
        outer = _grown(window, self.reach, self.grid)
        inner = tuple(
            slice(w.start - o.start, w.stop - o.start) for w, o in zip(window, outer, strict=True)
        )
        hidden = self.unknown[window]
        for number, part in enumerate(self.parts):
            cost = np.zeros(hidden.shape, np.uint8)
            for layer in self.layers:
                cells = self.occupied[layer.name][number][outer]
                if cells.any():
                    np.maximum(cost, self._cost(cells, part, layer.padding)[inner], out=cost)
            for social in self._social.values():
                np.maximum(cost, social[number][window], out=cost)
            cost[hidden & (cost < INSCRIBED)] = UNKNOWN
            self.costs[number][window] = cost
        self.master[window] = joined(self.costs[:, *window])

    def _cost(self, cells: NDArray[np.bool_], part: Part, padding: float) -> NDArray[np.uint8]:
        inscribed, reach = self.radii(part, padding)
        return inflate(
            cells,
            self.grid.resolution,
            inscribed_radius=inscribed,
            inflation_radius=reach,
            cost_scaling_factor=self.inflation.cost_scaling_factor,
        )

    # -- changes --------------------------------------------------------------------------------

    def update(self, things: Iterable[Thing], gone: Iterable[int] = ()) -> Window | None:
        """Take in what changed; the window of cells whose costs are new, None where there is none.

        Only the cells that these things touched before or touch now, and those within reach, are
        computed anew; the result is that of computing all. Where floors or rooms changed, all is.
        """
        bounds: list[Bounds] = []
        changed: set[str] = set()
        floors = False
        for number, thing in [*((t.id, t) for t in things), *((g, None) for g in gone)]:
            former = self._things.pop(number, None)
            if thing is not None:
                self._things[number] = thing
            for state, when in ((former, "before"), (thing, "now")):
                layer = NONE if state is None else self.policy.layer_of(state)
                floors |= layer == FLOOR
                if state is None or layer in (NONE, FLOOR):
                    continue
                if state.bounds is not None:
                    bounds.append(state.bounds)
                    changed.add(layer)
                    if when == "before":
                        self._members[layer].pop(number, None)
                    else:
                        self._members[layer][number] = state
        if floors:
            self._compute()
            return (slice(0, self.grid.shape[0]), slice(0, self.grid.shape[1]))
        window = self.window(bounds)
        if window is None:
            return None
        for name in changed:
            near = self._near(self._members[name], window)
            self.occupied[name][:, *window] = self._cells(near, window)
        wide = _grown(window, self.reach, self.grid)
        self._inflate(wide)
        return wide

    def lay(self, name: str, map: RepresentationMap | None) -> Window | None:
        """Lay a field, replace it, or take it away (None); the window of cells that are new.

        Raises
        ------
        ValueError
            A layer that is no field has that name.
        """
        if name in self.static or name in {la.name for la in self.policy.layers}:
            raise ValueError(f"field {name}: there is a layer of that name; give it its own")
        touched = np.zeros(self.grid.shape, np.bool_)
        for drawn in (self._social.pop(name, None), self.occupied.pop(name, None)):
            if drawn is not None:
                touched |= drawn.any(axis=0)
        self.fields = {k: v for k, v in self.fields.items() if k != name}
        if map is not None:
            self.fields[name] = map
            self._draw_field(name)
            drawn = self._social[name] if name in self._social else self.occupied[name]
            touched |= drawn.any(axis=0)
        if not touched.any():
            return None
        rows, columns = np.nonzero(touched.any(axis=1))[0], np.nonzero(touched.any(axis=0))[0]
        window = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        wide = _grown(window, self.reach, self.grid)
        self._inflate(wide)
        return wide

    def window(self, bounds: Iterable[Bounds]) -> Window | None:
        """The cells of the grid that boxes on the ground may meet, as one window."""
        boxes = [*bounds]
        if not boxes:
            return None
        low, high = np.min(boxes, axis=0)[:2], np.max(boxes, axis=0)[2:]
        found = []
        for axis in (1, 0):
            first, last = (
                math.floor((v[axis] - self.grid.origin[axis]) / self.grid.resolution)
                for v in (low, high)
            )
            size = self.grid.shape[1 - axis]
            if last + 1 < 0 or first - 1 >= size:
                return None
            found.append(slice(max(0, first - 1), min(size, last + 2)))
        return found[0], found[1]

    def _near(self, things: Mapping[int, Thing], window: Window) -> dict[int, Thing]:
        """Those of the things that may meet cells of a window."""
        x, y = (
            (origin + (cells.start - 1) * self.grid.resolution,
             origin + (cells.stop + 1) * self.grid.resolution)
            for origin, cells in zip(self.grid.origin, window[::-1], strict=True)
        )  # fmt: skip
        return {
            number: thing
            for number, thing in things.items()
            if (b := thing.bounds) is not None
            and b[0] <= x[1] and x[0] <= b[2] and b[1] <= y[1] and y[0] <= b[3]
        }  # fmt: skip

    # -- questions ------------------------------------------------------------------------------

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """The row and column of the cell that holds a point.

        Raises
        ------
        ValueError
            The point is not on the grid.
        """
        column, row = (
            math.floor((v - o) / self.grid.resolution)
            for v, o in zip((x, y), self.grid.origin, strict=True)
        )
        if not (0 <= row < self.grid.shape[0] and 0 <= column < self.grid.shape[1]):
            raise ValueError(f"({x}, {y}) is not on the grid {self.grid}")
        return row, column

    def why(self, x: float, y: float) -> list[Blame]:
        """What makes the cell at a point cost what it costs, the dearest first.

        For each part and layer within reach: the nearest occupied cells and who occupies them.
        """
        row, column = self.cell(x, y)
        outer = _grown((slice(row, row + 1), slice(column, column + 1)), self.reach, self.grid)
        found = []
        for number, part in enumerate(self.parts):
            for layer in self.layers:
                cells = self.occupied[layer.name][number][outer]
                if not cells.any():
                    continue
                at = np.argwhere(cells) + np.array([outer[0].start, outer[1].start])
                squared = ((at - (row, column)) ** 2).sum(axis=1)
                nearest = at[squared == squared.min()]
                cost = int(self._cost(cells, part, layer.padding)[
                    row - outer[0].start, column - outer[1].start])  # fmt: skip
                if cost:
                    distance = math.sqrt(squared.min()) * self.grid.resolution
                    names = self._occupants(layer.name, number, nearest)
                    found.append(Blame(part.name, layer.name, names, distance, cost))
            for name, social in self._social.items():
                if cost := int(social[number, row, column]):
                    names = (self.fields[name].about or name,)
                    found.append(Blame(part.name, name, names, 0.0, cost))
        return sorted(found, key=lambda b: (-b.cost, b.distance, b.part))

    def _occupants(self, layer: str, part: int, cells: NDArray[np.int64]) -> tuple[str, ...]:
        (r0, c0), (r1, c1) = cells.min(axis=0), cells.max(axis=0)
        window = (slice(int(r0), int(r1) + 1), slice(int(c0), int(c1) + 1))
        at = tuple((cells - (r0, c0)).T)
        if layer in self.static:
            return (layer,)
        if layer in self.fields:
            return (self.fields[layer].about or layer,)
        names = [
            thing.name
            for number, thing in self._near(self._members[layer], window).items()
            if self._cells({number: thing}, window)[part][at].any()
        ]
        return tuple(sorted(names))


def joined(costs: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The highest of (n, rows, columns) costs; a known one beats unknown."""
    known = np.where(costs == UNKNOWN, 0, costs).max(axis=0)
    known[(costs == UNKNOWN).all(axis=0)] = UNKNOWN
    found: NDArray[np.uint8] = known
    return found


def _grown(window: Window, cells: int, grid: Grid) -> Window:
    rows, columns = (
        slice(max(0, s.start - cells), min(size, s.stop + cells))
        for s, size in zip(window, grid.shape, strict=True)
    )
    return rows, columns
