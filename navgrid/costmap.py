"""The layered costmap of a robot (Deeken et al., sections 4.2 and 4.3).

Each robot part gets its own costmap, so an arm may pass over a table that its base passes under:
the obstacles at the part's heights, and around them costs that fall off from the part's inscribed
radius. A cell is blocked (253, or 254 where an obstacle is) if the part's footprint fits there at
no heading. In the master, which joins all parts, the robot is a point: it is blocked where the
whole robot fits at no heading. So it blocks no cell that the shape can be in, and where it is not
blocked, some heading fits, though not each.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navgrid.cost_source import CostSource, cost_sources
from navgrid.field_layer import FieldLayer, FieldVoxels, field_notes, social_costs, sort_fields
from navgrid.grid import Grid
from navgrid.headings import Motion, hits
from navgrid.inflation import INSCRIBED, LETHAL, UNKNOWN, inflate
from navgrid.layer_members import LayerMembers
from navgrid.obstacle_layers import Interval, ObstacleLayers
from navgrid.policy import Layer, Policy
from navgrid.terrain import DriveLimits
from navgrid.window import Window, grown, seen_from, whole, window_around
from semmap.draw.picture import Picture
from semmap.error import InvalidArgumentError
from semmap.query.geometry_notes import geometry_notes, level_notes
from semmap.query.storey_scene import SceneEntity, StoreyScene
from semmap.robot import Part

if TYPE_CHECKING:  # fields need OpenVDB, a costmap without them does not
    from semmap.fields.maps.representation_map import RepresentationMap


@dataclass(frozen=True)
class Inflation:
    """How costs fall off around obstacles, as in the inflation layer of costmap_2d.

    The inflation radius is in metres, the factor of scaling in 1/metre.
    """

    inflation_radius: float = 0.55
    cost_scaling_factor: float = 3.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value < math.inf:
                raise ValueError(f"{name} is {value}: give a finite number, 0 or more")

    def radii(self, part: Part, padding: float) -> tuple[float, float]:
        """Return the inscribed and the inflation radius of a part on a layer, metres."""
        inscribed = part.inscribed_radius
        return inscribed + padding, max(self.inflation_radius, inscribed) + padding

    def costs(
        self, cells: NDArray[np.bool_], resolution: float, part: Part, padding: float
    ) -> NDArray[np.uint8]:
        """Return the costs of a part on a layer with these occupied cells, below `INSCRIBED`."""
        inscribed, reach = self.radii(part, padding)
        found = inflate(
            cells,
            resolution,
            inscribed_radius=inscribed,
            inflation_radius=reach,
            cost_scaling_factor=self.cost_scaling_factor,
        )
        return np.minimum(found, INSCRIBED - 1)


class Costmap:
    """The costs of a storey for a robot.

    Parameters
    ----------
    scene : StoreyScene
        The entities of the storey, from `semmap.query.storey_reader.read_scene`.
    parts : sequence of Part
        The parts of the robot, from `semmap.robot.robot_parts`.
    grid : Grid
        From `navgrid.scene_grid`, for example.
    policy : Policy, optional
        Which entity goes on which layer; by default that of ``navgrid/policy.yaml``.
    limits : DriveLimits, optional
        The steps and slopes that the robot drives over.
    static : mapping of (rows, columns) bool arrays, optional
        Further layers by name, such as a SLAM map; they are obstacles at every height.
    fields : mapping of RepresentationMap or FieldVoxels, optional
        Fields by name, such as those of `navgrid.readers.fields`. The policy states by property
        whether they are obstacles at their heights or social costs.
    threads : int, optional
        By default one a processor.

    Attributes
    ----------
    occupied : dict of (parts, rows, columns) bool arrays, by layer
    costs : (parts, rows, columns) uint8
        With the meaning of costmap_2d: 0 free, 253 inscribed, 254 lethal, 255 unknown.
    fits : (parts, rows, columns) uint16
        Bit h is set where a part fits at heading h of `navgrid.headings.HEADINGS`.
    master : (rows, columns) uint8
        The maximum over the parts, and 253 where they fit at no common heading; a known cost takes
        precedence over unknown.
    unknown : (rows, columns) bool
        The cells outside of every room and doorway.
    fields_without_rule : list of str
        The names of fields that have no effect, as the policy does not name their property.
    posture : str
        The posture that the robot's parts are in, in words; empty where it is not known.
    seconds : dict of float
        Of the last whole computation, for ``slabs`` and ``inflation``.

    Raises
    ------
    ValueError
        There is no part, a part is not higher than a step, or two layers have the same name.

    Examples
    --------
    A table of 0.7 m, which a low robot passes under:

    >>> from semmap.geometry.mesh import box_mesh
    >>> from semmap.robot import Part
    >>> top = box_mesh((1, 1, 0.7), (2, 2, 0.75)).triangles
    >>> table = SceneEntity(1, "table1", "object", ("table", "object"), top)
    >>> square = np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])
    >>> base = Part("base", ("base_link",), (0.0, 0.3), square, 0.2, 0.283)
    >>> mast = Part("mast", ("mast_link",), (0.3, 1.2), square / 4, 0.05, 0.071)
    >>> costmap = Costmap(
    ...     StoreyScene("ground", 0.0, (table,)), [base, mast], Grid((0, 0), 0.05, (60, 60))
    ... )
    >>> [int(costs.max()) for costs in costmap.costs]
    [0, 254]
    >>> costmap.explain(1.5, 1.5)[0].entities
    ('table1',)
    """

    occupied: dict[str, NDArray[np.bool_]]
    costs: NDArray[np.uint8]
    fits: NDArray[np.uint16]
    master: NDArray[np.uint8]
    seconds: dict[str, float]

    def __init__(
        self,
        scene: StoreyScene,
        parts: Sequence[Part],
        grid: Grid,
        *,
        policy: Policy | None = None,
        inflation: Inflation | None = None,
        limits: DriveLimits | None = None,
        static: Mapping[str, NDArray[np.bool_]] | None = None,
        fields: Mapping[str, RepresentationMap | FieldVoxels] | None = None,
        threads: int | None = None,
    ) -> None:
        self.scene = scene
        self.parts: list[Part] = [*parts]
        self.grid = grid
        self.policy: Policy = policy or Policy.default()
        self.inflation: Inflation = inflation or Inflation()
        self.limits: DriveLimits = limits or DriveLimits()
        self.static: dict[str, NDArray[np.bool_]] = dict(static or {})
        self.fields: dict[str, FieldVoxels] = {
            name: _as_voxels(name, each) for name, each in (fields or {}).items()
        }
        self.posture: str = ""
        self._social: dict[str, NDArray[np.uint8]] = {}
        self._sort_fields()
        _check(self)
        members = LayerMembers(scene, self.policy, self.limits)
        self.obstacles: ObstacleLayers = ObstacleLayers(members, grid, threads=threads)
        self._compute()

    def _compute(self) -> None:
        start = time.perf_counter()
        self.occupied = {
            layer.name: self.obstacles.cells(layer.name, self.intervals)
            for layer in self.policy.layers
        }
        for name, cells in self.static.items():
            self.occupied[name] = np.broadcast_to(cells, (len(self.parts), *cells.shape)).copy()
        self._social.clear()
        for field in self._field_layers.values():
            self._render_field(field)
        rendered = time.perf_counter()
        self.costs = np.empty((len(self.parts), *self.grid.shape), np.uint8)
        self.fits = np.empty(self.costs.shape, np.uint16)
        self.master = np.empty(self.grid.shape, np.uint8)
        self._inflate(whole(self.grid))
        self.seconds = {"slabs": rendered - start, "inflation": time.perf_counter() - rendered}

    def _sort_fields(self) -> None:
        self._field_layers: dict[str, FieldLayer]
        self.fields_without_rule: list[str]
        self._field_layers, self.fields_without_rule = sort_fields(self.fields, self.policy)

    def _render_field(self, field: FieldLayer) -> None:
        floor = self.obstacles.levels
        if field.is_social:
            self._social[field.name] = social_costs(field.values(floor, self.intervals, self.grid))
        else:
            self.occupied[field.name] = field.obstacles(floor, self.intervals, self.grid)

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """(rows, columns) bool: the cells outside of every room and doorway."""
        return self.obstacles.unknown

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The layers that hold obstacles: the policy's, the static ones, and fields."""
        fields = [f for f in self._field_layers.values() if not f.is_social]
        return (
            *self.policy.layers,
            *(Layer(name) for name in self.static),
            *(Layer(field.name, field.padding) for field in fields),
        )

    @property
    def field_layers(self) -> tuple[FieldLayer, ...]:
        """The fields that the policy puts on a layer."""
        return tuple(self._field_layers.values())

    @property
    def social(self) -> dict[str, NDArray[np.uint8]]:
        """(parts, rows, columns) uint8 by field: costs below those of obstacles."""
        return dict(self._social)

    @property
    def intervals(self) -> list[Interval]:
        """The heights at which each part meets obstacles, metres above the floor.

        Heights within a step of the floor do not count.
        """
        step = self.limits.ground
        return [(max(low, step), high) for low, high in (part.interval for part in self.parts)]

    def section(self, height: float) -> NDArray[np.bool_]:
        """Return the (rows, columns) bool cells that a laser would see, the localisation map.

        These are cells in which the plane `height` metres above the floor cuts entities, and the
        inside of closed ones (Deeken et al., section 4.2).
        """
        found: NDArray[np.bool_] = self.obstacles.solids([(height, height)])[0]
        return found

    @property
    def reach(self) -> int:
        """The number of cells beyond which an occupied cell has no effect."""
        padding = max(layer.padding for layer in self.layers)
        metres = max(
            max(self.inflation.radii(part, padding)[1], part.circumscribed_radius + padding)
            for part in self.parts
        )
        return math.ceil(metres / self.grid.resolution - 1e-9) + 1

    def hits(self, part: int, window: Window, motion: Motion = "stand") -> NDArray[np.uint16]:
        """Return where a part meets obstacles of a window, by heading, as `navgrid.headings.hits`.

        The part is given by its number. Only obstacles in the window count.
        """
        found = np.zeros(self.unknown[window].shape, np.uint16)
        for padding in {layer.padding for layer in self.layers}:
            layers = [layer.name for layer in self.layers if layer.padding == padding]
            cells = np.any([self.occupied[name][part][window] for name in layers], axis=0)
            if cells.any():
                footprint = self.parts[part].footprint
                found |= hits(cells, footprint, self.grid.resolution, motion, padding)
        return found

    def _inflate(self, window: Window) -> None:
        """Compute the costs in a window from the occupied cells within reach of it."""
        outer = grown(window, self.reach, self.grid)
        inner = seen_from(outer, window)
        hidden, resolution = self.unknown[window], self.grid.resolution
        lethal = np.zeros(hidden.shape, np.bool_)
        for number, part in enumerate(self.parts):
            cost = np.zeros(hidden.shape, np.uint8)
            occupied = np.zeros(hidden.shape, np.bool_)
            for layer in self.layers:
                cells = self.occupied[layer.name][number][outer]
                if cells.any():
                    found = self.inflation.costs(cells, resolution, part, layer.padding)
                    np.maximum(cost, found[inner], out=cost)
                    occupied |= cells[inner]
            for social in self._social.values():
                np.maximum(cost, social[number][window], out=cost)
            fits = ~self.hits(number, outer)[inner]
            self.fits[number][window] = fits
            self.costs[number][window] = _blocked(cost, fits, occupied, hidden)
            lethal |= occupied
        fits = np.bitwise_and.reduce(self.fits[:, *window])
        known = joined(self.costs[:, *window])
        self.master[window] = _blocked(
            np.where(known == UNKNOWN, 0, known), fits, lethal & (fits == 0), hidden
        )

    def update(self, entities: Iterable[SceneEntity], gone: Iterable[int] = ()) -> Window | None:
        """Replace or add entities, remove others, and compute the costs near them again.

        The result equals that of a new costmap. If floors or rooms changed, everything is computed.
        `gone` has the ids of removed ones. Returns the rows and columns whose costs were computed;
        None if no cell is affected.
        """
        change = self.obstacles.update(entities, gone)
        if change.floors:
            self._compute()
            return whole(self.grid)
        window = window_around(change.bounds, self.grid)
        if window is None:
            return None
        for layer in change.layers:
            self.occupied[layer][:, *window] = self.obstacles.cells(layer, self.intervals, window)
        wide = grown(window, self.reach, self.grid)
        self._inflate(wide)
        return wide

    def set_field(self, name: str, field: RepresentationMap | FieldVoxels | None) -> Window | None:
        """Add or replace the field of a name, or remove it with None.

        Returns the rows and columns whose costs were computed; None if no cell is affected.
        ValueError if another layer has this name.
        """
        if name in self.static or name in {layer.name for layer in self.policy.layers}:
            raise _name_is_taken("field", name)
        before = self._field_cells(name)
        self._social.pop(name, None)
        self.occupied.pop(name, None)
        self.fields = {k: v for k, v in self.fields.items() if k != name}
        if field is not None:
            self.fields[name] = _as_voxels(name, field)
        self._sort_fields()
        if name in self._field_layers:
            self._render_field(self._field_layers[name])
        wide = self._window_around(before | self._field_cells(name))
        if wide is not None:
            self._inflate(wide)
        return wide

    def field_window(self, name: str) -> Window | None:
        """Return the rows and columns whose costs depend on a field; None if no cell does."""
        return self._window_around(self._field_cells(name))

    def _field_cells(self, name: str) -> NDArray[np.bool_]:
        """(rows, columns) bool: where a field has an effect of its own, for any part."""
        cells = self._social.get(name, self.occupied.get(name))
        if cells is None or name not in self.fields:
            return np.zeros(self.grid.shape, np.bool_)
        return np.asarray(cells.any(axis=0))

    def _window_around(self, touched: NDArray[np.bool_]) -> Window | None:
        if not touched.any():
            return None
        rows, columns = np.nonzero(touched.any(axis=1))[0], np.nonzero(touched.any(axis=0))[0]
        window = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        return grown(window, self.reach, self.grid)

    @property
    def notes(self) -> list[str]:
        """Sentences about the posture, missing geometry and storeys, and fields, for a person."""
        fields = field_notes(self.field_layers, self.fields_without_rule)
        said = [self.posture] if self.posture else []
        return [*said, *geometry_notes(self.scene.entities), *level_notes(self.scene), *fields]

    def write(
        self,
        folder: Path | str,
        *,
        laser_height: float = 0.25,
        headings: int = 0,
        picture: bool = True,
    ) -> dict[str, Any]:
        """Write the maps of all parts and ``nav2_params.yaml``; return a summary.

        Parameters
        ----------
        laser_height : float
            Of the localisation map above the floor, metres.
        headings : int
            Also write for so many headings where the robot's shape collides.
        picture : bool
            Draw each costmap, too.

        Raises
        ------
        ValueError
            The robot can stand nowhere.
        """
        from navgrid.costmap_output import write_costmap

        return write_costmap(self, Path(folder), laser_height, headings, picture=picture)

    def plot(self, title: str = "master costmap") -> Picture:
        """Draw the master costmap in the colours of RViz."""
        from navgrid.costmap_output import draw_master

        return Picture.drawn(lambda path: draw_master(self, path, title))

    def _repr_png_(self) -> bytes:
        return self.plot().png

    def __repr__(self) -> str:
        return f"<costmap of {self.scene.storey}: {self.grid.size_text}>"

    def explain(self, x: float, y: float) -> list[CostSource]:
        """Return the causes of the cost at a point of the map, metres, the highest cost first.

        For each part and layer within reach, these are the entities at the nearest occupied cells;
        none for a cell without cost. ValueError for a point that is not on the grid.
        """
        if not (math.isfinite(x) and math.isfinite(y)):
            raise InvalidArgumentError(f"({x}, {y}) is not a point: give two finite numbers")
        return cost_sources(self, *self.grid.cell(x, y))


def _check(costmap: Costmap) -> None:
    if not costmap.parts:
        raise ValueError("a costmap needs the parts of a robot: give one or more")
    step = costmap.limits.ground
    for part in costmap.parts:
        low, high = part.interval
        if high <= max(low, step):
            raise ValueError(
                f"part {part.name} reaches from {low:.3f} to {high:.3f} m, all within a step "
                f"of {costmap.limits.max_step} m: it can meet only floor. Join it to another part"
            )
    taken = {layer.name for layer in costmap.policy.layers}
    for name, cells in costmap.static.items():
        if cells.shape != costmap.grid.shape:
            raise ValueError(
                f"static layer {name} has the shape {cells.shape}; give it that of the grid, "
                f"{costmap.grid.shape}"
            )
        if name in taken:
            raise _name_is_taken("static layer", name)
    for name in costmap.fields:
        if name in taken | {*costmap.static}:
            raise _name_is_taken("field", name)


def _blocked(
    cost: NDArray[np.uint8],
    fits: NDArray[np.uint16],
    occupied: NDArray[np.bool_],
    hidden: NDArray[np.bool_],
) -> NDArray[np.uint8]:
    """Costs that are blocked where no heading fits, and unknown where cells are hidden."""
    found = cost.copy()
    none = fits == 0
    found[none] = INSCRIBED
    found[none & occupied] = LETHAL
    found[hidden & (found < INSCRIBED)] = UNKNOWN
    return found


def joined(costs: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the maximum of (n, rows, columns) costs; known costs take precedence over unknown."""
    known = np.where(costs == UNKNOWN, 0, costs).max(axis=0)
    known[(costs == UNKNOWN).all(axis=0)] = UNKNOWN
    found: NDArray[np.uint8] = known
    return found


def _as_voxels(name: str, field: RepresentationMap | FieldVoxels) -> FieldVoxels:
    try:
        return field if isinstance(field, FieldVoxels) else FieldVoxels.of_map(field)
    except ValueError as error:
        raise ValueError(f"field {name}: {error}") from None


def _name_is_taken(what: str, name: str) -> ValueError:
    return ValueError(f"{what} {name}: another layer has this name; give it a different one")
