"""What the demo asks for and does in a world: the object, where it goes, and where it begins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from sqlalchemy import text

from semmap.query.snapshot import Snapshot
from semmap.yaml_file import parse_yaml, read_text

SMALL = 0.4
"""Metres of the longest side of an object that the demo asks for."""


@dataclass(frozen=True)
class DemoChoices:
    """The object that the demo asks for, and the task with it.

    `type` is None if no small object stands on a table; `place` is the room of such an object. The
    robot begins in the room `start`, and may bring the object `onto` these, the preferred first.
    """

    type: str | None = None
    table_type: str = "table"
    place: str | None = None
    onto: tuple[str, ...] = ()
    start: str | None = None


def read_choices(path: Path) -> DemoChoices:
    """The choices that a file beside a world makes; none without such a file."""
    if not path.is_file():
        return DemoChoices()
    given = parse_yaml(read_text(path, "a file of choices", ValueError), str(path), ValueError)
    onto = given.get("onto")
    return DemoChoices(
        type=given.get("object"), onto=(onto,) if onto else (), start=given.get("from")
    )


def choose(seen: Snapshot, given: DemoChoices) -> DemoChoices:
    """Complete the choices from the current map.

    The object is the rarest small one on the most furnished table. Tables in other rooms come
    first as targets. The robot starts at home, or else in another room than the object's.
    """
    row = seen.connection.execute(text(_OBJECT), {"type": given.type, "small": SMALL}).first()
    start = given.start or seen.connection.execute(text(_HOME)).scalar()
    if row is None:
        return replace(given, type=None, start=start)
    tables = seen.connection.execute(
        text(_TABLES), {"holder": row.holder, "room": row.room}
    ).scalars()
    return DemoChoices(row.type, row.table_type, row.room, given.onto or tuple(tables), start)


def figure_3(choices: DemoChoices) -> str:
    """The statement of Figure 3 (Deeken et al.), for the chosen types."""
    return FIGURE_3.format(table=choices.table_type, object=choices.type)


FIGURE_3 = (
    "SELECT ob_a.label, ob_b.label, Box3D(ST_Collect(face.triangle)) "
    "FROM object ob_a, inventory inv_ab, object ob_b, inventory inv_bc, object ob_c, face, "
    "fa_to_ob "
    "WHERE ob_a.type = 'room' AND inv_ab.inv_id = ob_a.inv_id AND ob_b.id = inv_ab.ob_id "
    "AND ob_b.type = '{table}' AND inv_bc.inv_id = ob_b.inv_id AND ob_c.id = inv_bc.ob_id "
    "AND ob_c.type = '{object}' AND fa_to_ob.ob_id = ob_b.id AND face.id = fa_to_ob.face_id "
    "GROUP BY ob_a.label, ob_b.label"
)
"""Tables that hold an object, their rooms and boxes, as Deeken et al. print it in Figure 3."""

_CARRIED = "furniture,appliance,building_element,fixture,vehicle,agent"

_OBJECT = f"""
WITH held AS (
    SELECT e.id, coalesce(CAST(:type AS text), e.type) AS type, h.id AS holder, r.name AS room,
           greatest(ST_XMax(w.box) - ST_XMin(w.box), ST_YMax(w.box) - ST_YMin(w.box),
                    ST_ZMax(w.box) - ST_ZMin(w.box)) AS longest,
           CASE WHEN h.type = ANY (subtypes('table')) THEN 'table' ELSE 'support_furniture' END
               AS table_type
    FROM entity e JOIN placement p ON p.entity_id = e.id JOIN world w ON w.entity_id = e.id
    JOIN entity h ON h.id = p.holder_id AND h.type = ANY (subtypes('support_furniture'))
    JOIN placement hp ON hp.entity_id = h.id
    JOIN entity r ON r.id = hp.holder_id AND r.kind = 'room'
    WHERE e.map_id = current_map() AND e.kind = 'object' AND w.footprint IS NOT NULL
      AND NOT EXISTS (SELECT FROM unnest(string_to_array('{_CARRIED}', ',')) t (name)
                      WHERE e.type = ANY (subtypes(t.name)))
      AND (CAST(:type AS text) IS NULL OR e.type = ANY (subtypes(:type)))
)
SELECT k.type, k.holder, k.room, k.table_type FROM held k
WHERE k.longest <= :small AND k.type IS NOT NULL
ORDER BY (SELECT count(*) FROM placement p WHERE p.holder_id = k.holder) DESC,
         (SELECT count(*) FROM entity e WHERE e.map_id = current_map() AND e.type = k.type),
         k.longest, k.id
LIMIT 1
"""

_TABLES = """
SELECT e.name FROM entity e JOIN placement p ON p.entity_id = e.id
JOIN world w ON w.entity_id = e.id
JOIN entity r ON r.id = p.holder_id AND r.kind = 'room'
WHERE e.map_id = current_map() AND e.type = ANY (subtypes('support_furniture')) AND e.id <> :holder
  AND w.footprint IS NOT NULL
ORDER BY r.name = :room, e.type = ANY (subtypes('table')) DESC, ST_Area(w.footprint) DESC, e.id
LIMIT 6
"""

_HOME = """
SELECT r.name FROM entity e JOIN world w ON w.entity_id = e.id
JOIN world k ON ST_Intersects(k.footprint, w.footprint)
     AND k.storey_id IS NOT DISTINCT FROM w.storey_id
JOIN entity r ON r.id = k.entity_id AND r.kind = 'room' AND r.map_id = e.map_id
WHERE e.map_id = current_map() AND e.kind = 'region'
  AND (e.type = ANY (subtypes('home_region')) OR e.properties->>'home' = 'true')
ORDER BY e.id, r.id LIMIT 1
"""
