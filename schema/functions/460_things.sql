-- All entities in a relation to one entity: the spatial index selects candidates, so that a query for
-- everything on the table does not scan the map. Each function returns the ids for which the relation is true.

CREATE FUNCTION things_on(b bigint, tolerance double precision DEFAULT 0.01)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 10 COST 100000
BEGIN ATOMIC
-- What is on b: see is_on.
SELECT wo.entity_id FROM semmap.world wg JOIN semmap.world wo ON wo.map_id = wg.map_id
  AND wo.box && semmap.grown(wg.box, tolerance)
  AND wo.box &&& semmap.grown(wg.box, tolerance)
WHERE wg.entity_id = b AND semmap.is_on(wo.entity_id, b, tolerance);
END;

CREATE FUNCTION supports_of(a bigint, tolerance double precision DEFAULT 0.01)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 10 COST 100000
BEGIN ATOMIC
-- What a is on: the converse of things_on.
SELECT wo.entity_id FROM semmap.world wg JOIN semmap.world wo ON wo.map_id = wg.map_id
  AND wo.box && semmap.grown(wg.box, tolerance)
  AND wo.box &&& semmap.grown(wg.box, tolerance)
WHERE wg.entity_id = a AND semmap.is_on(a, wo.entity_id, tolerance);
END;

CREATE FUNCTION things_above(b bigint, tolerance double precision DEFAULT 0.01)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 10 COST 100000
BEGIN ATOMIC
-- What is above b: see is_above.
SELECT wo.entity_id FROM semmap.world wg JOIN semmap.world wo ON wo.map_id = wg.map_id
  AND wo.box && semmap.grown(wg.box, tolerance)
WHERE wg.entity_id = b AND semmap.is_above(wo.entity_id, b, tolerance);
END;

CREATE FUNCTION things_under(b bigint, tolerance double precision DEFAULT 0.01)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 10 COST 100000
BEGIN ATOMIC
-- What is under b: see is_under.
SELECT wo.entity_id FROM semmap.world wg JOIN semmap.world wo ON wo.map_id = wg.map_id
  AND wo.box && semmap.grown(wg.box, tolerance)
WHERE wg.entity_id = b AND semmap.is_under(wo.entity_id, b, tolerance);
END;

CREATE FUNCTION things_touching(b bigint, tolerance double precision DEFAULT 0.01)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 10 COST 100000
BEGIN ATOMIC
-- What touches b: see is_touching.
SELECT wo.entity_id FROM semmap.world wg JOIN semmap.world wo ON wo.map_id = wg.map_id
  AND wo.box && semmap.grown(wg.box, tolerance)
  AND wo.box &&& semmap.grown(wg.box, tolerance)
WHERE wg.entity_id = b AND semmap.is_touching(wo.entity_id, b, tolerance);
END;

CREATE FUNCTION things_near(b bigint, distance double precision)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 10 COST 100000
BEGIN ATOMIC
-- What is near b: see is_near.
SELECT wo.entity_id FROM semmap.world wg JOIN semmap.world wo ON wo.map_id = wg.map_id
  AND wo.box && semmap.grown(wg.box, distance)
  AND wo.box &&& semmap.grown(wg.box, distance)
WHERE wg.entity_id = b AND semmap.is_near(wo.entity_id, b, distance);
END;

CREATE FUNCTION things_held(b bigint)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 100
BEGIN ATOMIC
-- The contents of b, and their contents, by placement.
WITH RECURSIVE down (id) AS (
    SELECT entity_id FROM semmap.placement WHERE holder_id = b
  UNION
    SELECT p.entity_id FROM down JOIN semmap.placement p ON p.holder_id = down.id)
SELECT id FROM down;
END;

CREATE FUNCTION contents_of(b bigint)
RETURNS SETOF bigint LANGUAGE plpgsql STABLE ROWS 100 SET search_path = semmap, public, pg_temp AS $$
-- What b holds, and what that holds. In a room: the objects and agents whose room it is, see room_of; of regions and
-- parts of the building those that it holds.
BEGIN
    IF (SELECT kind FROM semmap.entity WHERE id = b) = 'room' THEN
        RETURN QUERY
            SELECT t.id FROM semmap.things_in(b) t (id) JOIN semmap.entity e ON e.id = t.id
            WHERE semmap.has_room(e.kind, e.type)
          UNION
            SELECT t.id FROM semmap.things_held(b) t (id) JOIN semmap.entity e ON e.id = t.id
            WHERE NOT semmap.has_room(e.kind, e.type);
    ELSE
        RETURN QUERY SELECT semmap.things_held(b);
    END IF;
END $$;

CREATE FUNCTION things_in(b bigint, tolerance double precision DEFAULT 0.01)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 100 COST 100000
BEGIN ATOMIC
-- What is in b: see is_in. What is in a room can be in its openings.
SELECT wo.entity_id
FROM semmap.world wg
CROSS JOIN LATERAL (SELECT semmap.grown(wg.box, tolerance + CASE e.kind WHEN 'room' THEN 0.5 ELSE 0 END)
                    FROM semmap.entity e WHERE e.id = b OFFSET 0) g (zone)
JOIN semmap.world wo ON wo.map_id = wg.map_id AND wo.box && g.zone AND wo.box &&& g.zone
WHERE wg.entity_id = b AND wg.footprint IS NOT NULL AND semmap.is_in(wo.entity_id, b, tolerance)
UNION
SELECT held.id FROM semmap.things_held(b) held (id)
WHERE (SELECT w.footprint IS NULL FROM semmap.world w WHERE w.entity_id = b) OR semmap.is_nowhere(held.id)
   OR (SELECT kind FROM semmap.entity WHERE id = b) = 'room' AND semmap.is_in(held.id, b, tolerance);
END;

CREATE FUNCTION containers_of(a bigint, tolerance double precision DEFAULT 0.01)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 10 COST 100000
BEGIN ATOMIC
-- What a is in: the converse of things_in.
SELECT wo.entity_id FROM semmap.world wg JOIN semmap.world wo ON wo.map_id = wg.map_id
  AND wo.box && semmap.grown(wg.box, tolerance)
WHERE wg.entity_id = a AND wo.footprint IS NOT NULL AND semmap.is_in(a, wo.entity_id, tolerance)
UNION
SELECT up.id FROM semmap.holders_of(ARRAY[a]) up (id)
WHERE (SELECT w.footprint IS NULL FROM semmap.world w WHERE w.entity_id = up.id) OR semmap.is_nowhere(a)
UNION
SELECT r.id FROM semmap.room_of(a) r (id) WHERE semmap.is_in(a, r.id, tolerance);
END;
