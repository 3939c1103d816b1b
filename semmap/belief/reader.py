"""Read places, and the meshes that hide them, from the map."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from sqlalchemy import text

from semmap.belief.error import BeliefError
from semmap.belief.observation_columns import Observations
from semmap.belief.places import BeliefPlace, Surface
from semmap.belief.sighting_model import SightingModel
from semmap.belief.store.beliefs import ELSEWHERE
from semmap.geometry.pose import Pose
from semmap.query.entity_query import entity_id
from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import read_entities
from semmap.query.storey_scene import NO_TRIANGLES

_PLACES = """
SELECT e.name, e.kind, y.name AS storey, coalesce(w.pose, '{0,0,0,0,0,0,1}') AS pose,
       ST_AsBinary(w.footprint) AS footprint,
       ARRAY[ST_XMin(w.box), ST_YMin(w.box), ST_ZMin(w.box)] AS low,
       ARRAY[ST_XMax(w.box), ST_YMax(w.box), ST_ZMax(w.box)] AS high,
       coalesce(e.type = ANY (subtypes('container') || subtypes('storage_furniture')), false)
           AS stores, w.pose[3] + r.floor AS floor, w.pose[3] + r.ceiling AS ceiling,
       kept_at((ST_ZMin(w.box) + ST_ZMax(w.box)) / 2 - coalesce(f.pose[3], 0)) AS inside,
       s.outlines, s.heights, s.weights
FROM places_for(ARRAY[CAST(:id AS bigint)]) p JOIN entity e ON e.id = p.place_id
LEFT JOIN world w ON w.entity_id = e.id LEFT JOIN room r ON r.entity_id = e.id
LEFT JOIN entity y ON y.id = w.storey_id LEFT JOIN world f ON f.entity_id = y.id
LEFT JOIN LATERAL (
    SELECT array_agg(ST_AsBinary(ST_Force2D(pose_apply(ST_Force3D(s.outline), w.pose))))
               AS outlines, array_agg(w.pose[3] + s.height) AS heights,
           array_agg(kept_at(w.pose[3] + s.height - coalesce(f.pose[3], 0))) AS weights
    FROM entity_model m JOIN support_surface s ON s.model_id = m.model_id AND s.height IS NOT NULL
    WHERE m.entity_id = e.id AND abs(w.pose[4]) < 1e-3 AND abs(w.pose[5]) < 1e-3) s
    ON e.kind = 'object'
ORDER BY e.name
"""

ROOM_HEIGHT = 2.5
"""Metres, of a room whose ceiling is unknown."""


def read_places(seen: Snapshot, name: str) -> list[BeliefPlace]:
    """Return the places at which an object or agent of the map has room."""
    number = entity_id(seen.session, name)
    return [_place(row) for row in seen.connection.execute(text(_PLACES), {"id": number})]


def _place(row: Any) -> BeliefPlace:
    footprint = None if row.footprint is None else shapely.from_wkb(bytes(row.footprint))
    surfaces = [
        Surface(shapely.from_wkb(bytes(outline)), float(height), float(weight))
        for outline, height, weight in zip(
            row.outlines or (), row.heights or (), row.weights or (), strict=True
        )
    ]
    low, high = (None if footprint is None else np.array(v, float) for v in (row.low, row.high))
    if row.kind == "room" and footprint is not None:
        assert low is not None
        assert high is not None
        low[2] = row.floor if row.floor is not None else low[2]
        top = row.ceiling if row.ceiling is not None else max(high[2], low[2] + ROOM_HEIGHT)
        high[2] = top
        surfaces = [Surface(footprint, float(low[2]))]
    pose = Pose(*row.pose)
    return BeliefPlace(
        row.name,
        row.kind,
        tuple(surfaces),
        low,
        high,
        footprint,
        pose,
        row.storey,
        stores=row.stores,
        inside=1.0 if row.inside is None else float(row.inside),
    )


def read_occluders(seen: Snapshot, without: Collection[str]) -> NDArray[np.float64]:
    """Return the triangles (F, 3, 3) of rooms, objects and shut doors, which hide what is behind.

    The leaves of open doors hide nothing.

    Without the objects that are looked for: the map may have them where they are not.
    """
    parts = [
        entity.triangles
        for entity in read_entities(seen, kinds=("room", "object", "connector"))
        if entity.name not in without and entity.state != "open"
    ]
    return np.concatenate([NO_TRIANGLES, *parts])


def read_agent_pose(seen: Snapshot, name: str, at: datetime | None = None) -> Pose:
    """Return the pose of an agent in the map's frame, now or at a moment.

    `BeliefError` if it had no place in the map then.
    """
    number = entity_id(seen.session, name)
    pose = seen.connection.execute(
        text("SELECT pose_at(:id, coalesce(CAST(:at AS timestamptz), statement_timestamp()))"),
        {"id": number, "at": at},
    ).scalar()
    if pose is None:
        raise BeliefError(f"{name} was not placed in the map then: place it, or give a point")
    return Pose(*pose)


def read_room_at(seen: Snapshot, point: Sequence[float]) -> str | None:
    """Return the room of a point (3,) of the map, as the inventory has it, or None.

    In an opening or within a wall, it is the nearer room.
    """
    x, y, z = point
    name = seen.connection.execute(
        text(
            "SELECT e.name FROM room_at(current_map(), ST_Expand(ST_MakePoint(:x, :y), 0.001), "
            ":z) r JOIN entity e ON e.id = r.room_id"
        ),
        {"x": x, "y": y, "z": z},
    ).scalar()
    return None if name is None else str(name)


def read_height(seen: Snapshot, name: str) -> float | None:
    """Return the height of an object, metres; None where it is unknown.

    An agent of unknown size is as high as a person, 1.8 m.
    """
    number = entity_id(seen.session, name)
    height = seen.connection.execute(
        text(
            "SELECT coalesce(s.height, CASE WHEN e.kind = 'agent' THEN 1.8 END) "
            "FROM entity e, LATERAL size_of(e.id) s WHERE e.id = :id"
        ),
        {"id": number},
    ).scalar()
    return None if height is None else float(height)


def is_wide(seen: Snapshot, place: str) -> bool:
    """Whether a place is a room, storey or region: a person means anywhere in it."""
    row = seen.session.execute(
        "SELECT kind FROM entity WHERE map_id = current_map() AND name = %s", (place,)
    ).fetchone()
    return row is not None and row[0] in ("room", "storey", "region")


_POSITIONS = """
SELECT e.name, (ST_XMin(w.box) + ST_XMax(w.box)) / 2 + moved.x,
       (ST_YMin(w.box) + ST_YMax(w.box)) / 2 + moved.y,
       ST_ZMin(w.box) + moved.z, ST_ZMax(w.box) + moved.z,
       extract(epoch FROM %(at)s - known.since)::float8
FROM entity e JOIN world w ON w.entity_id = e.id, LATERAL pose_at(e.id, %(at)s) p (pose),
     LATERAL (SELECT p.pose[1] - w.pose[1], p.pose[2] - w.pose[2], p.pose[3] - w.pose[3])
         moved (x, y, z),
     LATERAL (SELECT max(t.at) FROM (
         SELECT n.since FROM placement n WHERE n.entity_id = e.id
         UNION ALL SELECT lower(h.during) FROM placement_history h WHERE h.entity_id = e.id
         UNION ALL SELECT o.at FROM observation o
                   WHERE o.entity_id = e.id AND o.seen AND o.position IS NOT NULL) t (at)
      WHERE t.at <= %(at)s) known (since)
WHERE e.map_id = current_map() AND e.name = ANY (%(names)s)
  AND w.box IS NOT NULL AND p.pose IS NOT NULL
"""


def read_positions(
    seen: Snapshot, names: Sequence[str], at: datetime | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where the map has objects, and since when.

    (n, 4) the middle x and y and the lowest and highest z in the map's frame, metres, and (n,) the
    seconds since each was put or seen there; NaN of one without a place.
    """
    moment = at or datetime.now(UTC)
    rows = seen.session.execute(_POSITIONS, {"names": list(names), "at": moment}).fetchall()
    row_of = {name: number for number, name in enumerate(names)}
    where, age = np.full((len(names), 4), np.nan), np.full(len(names), np.nan)
    for name, *box, seconds in rows:
        where[row_of[name]] = box
        age[row_of[name]] = max(seconds, 0.0) if seconds is not None else np.nan
    return where, age


@dataclass(frozen=True, eq=False)
class BeliefColumns:
    """Priors and observations of some objects, as arrays for inference.

    The last of `places` is *elsewhere*. `prior` (objects, places) is by what the map was told: 0
    where there is no room. `observations` are those since then, their ages relative to the moment
    that was asked for. `mobility` (objects,); `volume` (objects,) cubic metres, NaN where unknown.
    """

    objects: tuple[str, ...]
    places: tuple[str, ...]
    prior: NDArray[np.float64]
    observations: Observations
    mobility: NDArray[np.float64]
    volume: NDArray[np.float64]

    def known_volume(self) -> NDArray[np.float64]:
        """The volumes; `BeliefError` where one is unknown."""
        for name, volume in zip(self.objects, self.volume, strict=True):
            if not volume > 0:
                fix = "teach it, or give the object a shape in the map"
                raise BeliefError(f"{name}: its volume is unknown: {fix}")
        return self.volume


_PRIORS = """
SELECT t.name, coalesce(e.name, 'elsewhere') AS place, p.probability
FROM belief_at(%(ids)s, %(at)s, NULL, false) p
JOIN entity t ON t.id = p.entity_id LEFT JOIN entity e ON e.id = p.place_id
"""

_LOOKS = """
WITH place AS MATERIALIZED (SELECT * FROM places_for(%(ids)s)),
stated AS MATERIALIZED (
    SELECT s.entity_id, max(s.at) AS at
    FROM (SELECT array_agg(entity_id) AS ids, array_agg(place_id) AS places FROM place) p,
    LATERAL statements_about(p.ids, p.places, %(at)s) s GROUP BY 1)
SELECT t.name, e.name AS place, o.seen, o.visible, coalesce(o.hit, d.hit),
       coalesce(o.false_alarm, d.false_alarm),
       extract(epoch FROM %(at)s - o.at)::float8 AS age
FROM observation o JOIN entity t ON t.id = o.entity_id
JOIN place p ON p.entity_id = o.entity_id
 AND (p.place_id = o.place_id OR o.inside AND is_held_by(p.place_id, o.place_id))
JOIN entity e ON e.id = p.place_id LEFT JOIN stated s ON s.entity_id = o.entity_id
LEFT JOIN LATERAL learned_rate(t.map_id, o.observer_id, o.distance) d
    ON o.hit IS NULL AND o.false_alarm IS NULL
WHERE o.entity_id = ANY (%(ids)s) AND o.at <= %(at)s AND o.at >= coalesce(s.at, '-infinity')
ORDER BY o.at, o.id
"""


def read_columns(seen: Snapshot, names: Sequence[str], at: datetime | None = None) -> BeliefColumns:
    """Return priors and observations of objects as arrays.

    An observation anywhere in a room is an entry for each place in it, which has the same
    likelihood up to a constant. `BeliefError` for what is not an object or agent, or named twice.
    """
    session = seen.session
    ids = [entity_id(session, name) for name in names]
    for number, name in enumerate(names):
        if name in names[:number]:
            raise BeliefError(f"{name} is named twice: name each object once")
    moment = at or datetime.now(UTC)
    values = {"ids": ids, "at": moment}
    priors = session.execute(_PRIORS, values).fetchall()
    places = sorted({place for _, place, _ in priors} - {ELSEWHERE})
    places.append(ELSEWHERE)
    row_of = {name: row for row, name in enumerate(names)}
    column_of = {place: column for column, place in enumerate(places)}
    prior = np.zeros((len(names), len(places)))
    for name, place, share in priors:
        prior[row_of[name], column_of[place]] = share
    for name, shares in zip(names, prior, strict=True):
        if not shares.any():
            raise BeliefError(f"{name} has no place in a belief: name an object or an agent")
    looks = session.execute(_LOOKS, values).fetchall()
    sizes = session.execute(
        "SELECT coalesce(property_of(t.id, 'mobility'), 1), coalesce(property_of(t.id, 'volume'), "
        "s.base * s.height) FROM unnest(%s::bigint[]) WITH ORDINALITY t (id, number), "
        "LATERAL size_of(t.id) s ORDER BY t.number",
        (ids,),
    ).fetchall()
    rates = [[np.nan if look[i] is None else look[i] for look in looks] for i in (4, 5)]
    return BeliefColumns(
        tuple(names),
        tuple(places),
        prior,
        Observations(
            np.array([row_of[look[0]] for look in looks], np.intp),
            np.array([column_of[look[1]] for look in looks], np.intp),
            np.array([look[6] for look in looks], np.float64),
            np.array([look[2] for look in looks], np.bool_),
            np.array([look[3] for look in looks], np.float64),
            *(np.array(rate, np.float64) for rate in rates),
        ),
        np.array([mobility for mobility, _ in sizes], np.float64),
        np.array([np.nan if volume is None else volume for _, volume in sizes], np.float64),
    )


def read_model(seen: Snapshot) -> SightingModel:
    """Return how the map judges sightings."""
    row = seen.session.execute(
        "SELECT there, elsewhere, change, seconds FROM belief_model_of(current_map())"
    ).fetchone()
    assert row is not None
    return SightingModel(*row)
