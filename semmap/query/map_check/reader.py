"""Read a map for its check: world poses are composed again, shapes placed again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, wraps
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from numpy.typing import NDArray
from psycopg.rows import dict_row

from semmap.geometry.ground_outline import leaning_outline
from semmap.geometry.outline import placed_outline
from semmap.geometry.overlay import united
from semmap.geometry.pose import Pose
from semmap.query.meshes import models_triangles
from semmap.query.snapshot import Snapshot

Floats = NDArray[np.float64]


@dataclass(eq=False)
class CheckedEntity:
    """An entity as its placement, models and outline have it; metres in the map's frame."""

    name: str
    kind: str
    row: dict[str, Any]  # the columns of the statement
    pose: Pose | None = None  # composed of those of its holders; None without a placement
    holder: CheckedEntity | None = None
    triangles: Floats = field(default_factory=lambda: np.empty((0, 3, 3)))
    hull: Floats = field(default_factory=lambda: np.empty((0, 3)))
    outline: shapely.Geometry | None = None

    @cached_property
    def low(self) -> Floats:
        """(3,) the lowest corner of its box; its place without geometry."""
        return np.asarray(self._corners.min(axis=0))

    @cached_property
    def high(self) -> Floats:
        """(3,) the highest corner of its box."""
        return np.asarray(self._corners.max(axis=0))

    @cached_property
    def stand(self) -> Floats:
        """(3,) the middle of its lowest level."""
        return np.append((self.low + self.high)[:2] / 2, self.low[2])

    @property
    def _corners(self) -> Floats:
        if len(self.hull):
            return self.hull
        assert self.pose is not None
        return self.pose.translation[None]

    @cached_property
    def chain(self) -> list[CheckedEntity]:
        """Its holder, what holds that, and so on."""
        found: list[CheckedEntity] = []
        above = self.holder
        while above is not None and above not in found:
            found.append(above)
            above = above.holder
        return found

    @cached_property
    def compared(self) -> WeakKeyDictionary[CheckedEntity, dict[str, Any]]:
        """Results of `once_a_pair` for it and other entities."""
        return WeakKeyDictionary()

    @cached_property
    def face_boxes(self) -> tuple[Floats, Floats]:
        """(F, 3) each: the lowest and highest corner of each face."""
        a, b, c = (self.triangles[:, k] for k in range(3))
        return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)

    def faces_over(self, low: Floats, high: Floats) -> Floats:
        """The faces above, in or below a box."""
        lowest, highest = self.face_boxes
        met = (highest[:, 0] >= low[0]) & (lowest[:, 0] <= high[0])
        met &= (highest[:, 1] >= low[1]) & (lowest[:, 1] <= high[1])
        return np.asarray(self.triangles[met])

    @property
    def ground(self) -> shapely.Geometry:
        """Its outline; its point without geometry."""
        return shapely.Point(*self.low[:2]) if self.outline is None else self.outline


T = TypeVar("T")


def once_a_pair(
    compare: Callable[[CheckedEntity, CheckedEntity], T],
) -> Callable[[CheckedEntity, CheckedEntity], T]:
    """Keep what a comparison finds: trials of moves ask again about pairs that do not move."""

    @wraps(compare)
    def compared(one: CheckedEntity, two: CheckedEntity) -> T:
        known = one.compared.setdefault(two, {})
        if compare.__name__ not in known:
            known[compare.__name__] = compare(one, two)
        found: T = known[compare.__name__]
        return found

    return compared


_ENTITIES = """
SELECT e.id, e.name, e.kind, e.type, p.holder_id, p.relation, p.confidence, p.pose,
       w.pose AS world, w.map_id AS world_map,
       r.floor, r.ceiling, r.elevator_id, s.elevation, s.height,
       c.place_a, c.place_b, c.form, c.state, c.width, c.height AS clear_height, c.pose_a, c.pose_b,
       c.direction,
       e.type IN (SELECT sub FROM type_closure WHERE super = 'building_element') AS structure,
       e.type IN (SELECT sub FROM type_closure WHERE super IN
                  ('floor', 'ground', 'carpet', 'stair_flight', 'ramp_flight', 'ramp')) AS laid,
       e.type IN (SELECT sub FROM type_closure WHERE super IN ('ramp_flight', 'ramp')) AS ramp,
       e.type IN (SELECT sub FROM type_closure WHERE super = 'fixture') AS fixture,
       e.type IN (SELECT sub FROM type_closure WHERE super IN ('door', 'door_leaf')) AS leaf,
       e.type IN (SELECT sub FROM type_closure WHERE super = 'ceiling_lamp') AS hanging,
       e.type IN (SELECT sub FROM type_closure WHERE super IN ('seat', 'bed')) AS rest,
       e.type IN (SELECT sub FROM type_closure WHERE super = 'robot') AS robot,
       usual.size AS typical,
       e.type IN (SELECT sub FROM type_closure WHERE super IN ('seat', 'table', 'bed', 'drinkware')
                  EXCEPT SELECT sub FROM type_closure
                  WHERE super IN ('fixture', 'storage_furniture')) AS stands,
       e.properties ? 'type_guess' AS guessed,
       e.type IN (SELECT sub FROM type_closure
                  WHERE super IN ('container', 'storage_furniture')) AS storage,
       (SELECT array_agg(em.model_id ORDER BY em.model_id) FROM entity_model em
        WHERE em.entity_id = e.id AND (em.role = 'visual' OR NOT EXISTS (SELECT FROM entity_model v
              WHERE v.entity_id = e.id AND v.role = 'visual'))) AS models
FROM entity e LEFT JOIN placement p ON p.entity_id = e.id LEFT JOIN world w ON w.entity_id = e.id
     LEFT JOIN room r ON r.entity_id = e.id LEFT JOIN storey s ON s.entity_id = e.id
     LEFT JOIN connector c ON c.entity_id = e.id
     LEFT JOIN (SELECT DISTINCT ON (n.sub) n.sub, t.typical_size AS size
                FROM type_closure n JOIN semantic_type t ON t.name = n.super
                WHERE t.typical_size IS NOT NULL
                ORDER BY n.sub, (SELECT count(*) FROM type_closure a WHERE a.sub = n.super) DESC,
                         n.super) usual ON usual.sub = e.type
WHERE e.map_id = current_map() ORDER BY e.name
"""


def read_checked_entities(seen: Snapshot) -> list[CheckedEntity]:
    """Return the entities of the current map, by name."""
    with seen.session.cursor(row_factory=dict_row) as cursor:
        rows = cursor.execute(_ENTITIES).fetchall()
    by_id = {row["id"]: CheckedEntity(row["name"], row["kind"], row) for row in rows}
    for entity in by_id.values():
        entity.holder = by_id.get(entity.row["holder_id"])
        if entity.row["pose"] is not None:
            entity.pose = _composed(entity.row, by_id)
    solid = {"object", "agent"}
    meshed = {m for e in by_id.values() if e.kind in solid for m in e.row["models"] or ()}
    every = {m for e in by_id.values() for m in e.row["models"] or ()}
    triangles = models_triangles(seen.session, meshed)
    shapes = {
        number: (
            shapely.get_coordinates(shapely.from_wkb(bytes(hull)), include_z=True),
            None if outline is None else shapely.from_wkb(bytes(outline)),
        )
        for number, hull, outline in seen.session.execute(
            "SELECT id, ST_AsBinary(hull), ST_AsBinary(outline) FROM model WHERE id = ANY (%s)",
            ([*every],),
        )
    }
    for entity in by_id.values():
        if entity.pose is not None and entity.row["models"]:
            _place(entity, entity.pose, triangles, shapes)
    return [*by_id.values()]


def _composed(row: dict[str, Any], by_id: dict[int, CheckedEntity]) -> Pose:
    pose, above, seen = Pose(*row["pose"]), row["holder_id"], {row["id"]}
    while above is not None and above not in seen:
        seen.add(above)
        holder = by_id[above].row
        pose, above = Pose(*holder["pose"]) @ pose, holder["holder_id"]
    return pose


def _place(
    entity: CheckedEntity, pose: Pose, triangles: dict[int, Floats], shapes: dict[int, Any]
) -> None:
    upright = abs(pose.qx) < 1e-6 and abs(pose.qy) < 1e-6
    parts, hulls, flats = [], [], []
    for model in entity.row["models"]:
        own, outline = shapes[model]
        hull = pose.apply(own)
        hulls.append(hull)
        if model in triangles:
            parts.append(pose.apply(triangles[model].reshape(-1, 3)).reshape(-1, 3, 3))
        ground = None
        if outline is not None:
            ground = (
                placed_outline(outline, pose) if upright else leaning_outline(outline, own, pose)
            )
        if ground is not None:
            flats.append(ground)
        else:
            flat = shapely.MultiPoint(hull[:, :2]).convex_hull
            flats.append(flat if flat.area else flat.buffer(0.001))
    entity.hull = np.concatenate(hulls)
    entity.outline = flats[0] if len(flats) == 1 else united(flats)
    if parts:
        entity.triangles = parts[0] if len(parts) == 1 else np.concatenate(parts)
