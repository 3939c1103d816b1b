-- Which places lead to which: is_reachable. Topology, not geometry: has no frame and no tolerance.

CREATE FUNCTION place_of(thing bigint)
RETURNS bigint LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- The room of an entity: itself if it is a room, else the nearest room among its holders, else itself.
SELECT coalesce(semmap.holding_room(thing), thing);
END;

CREATE FUNCTION reachable_from(place bigint)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 100
BEGIN ATOMIC
-- The places that can be reached from the place of an entity, it among them: through connectors that are
-- not locked, in their direction, and by elevators, whose cabins on all storeys are joined. The outside,
-- which is not in the map, joins no two doors.
WITH RECURSIVE reached (id) AS (
    SELECT semmap.place_of(place)
  UNION
    SELECT step.id FROM reached r CROSS JOIN LATERAL (
        SELECT c.place_b FROM semmap.connector c
        WHERE c.place_a = r.id AND c.state <> 'locked' AND c.direction IN ('both', 'forward')
      UNION ALL
        SELECT c.place_a FROM semmap.connector c
        WHERE c.place_b = r.id AND c.state <> 'locked' AND c.direction IN ('both', 'backward')
      UNION ALL
        SELECT other.entity_id FROM semmap.room cabin JOIN semmap.room other ON other.elevator_id = cabin.elevator_id
        WHERE cabin.entity_id = r.id) step (id)
    WHERE step.id IS NOT NULL)
SELECT id FROM reached WHERE id IS NOT NULL;
END;

CREATE FUNCTION is_reachable(place_a bigint, place_b bigint)
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE COST 10000
BEGIN ATOMIC
-- A way leads from the place of a to the place of b, see reachable_from. From a place to itself, always.
SELECT coalesce(semmap.place_of(place_b) IN (SELECT semmap.reachable_from(place_a)), false);
END;
