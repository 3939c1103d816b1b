-- All entities in a relation to one entity: the spatial index selects candidates, so that a query for
-- everything on the table does not scan the map. Each function returns the ids for which the relation is true.

DO $$
-- things_R(b): what is in the relation is_R to b; supports_of(a): what a is on. Over and under, heights do not count.
DECLARE
    name text;
    relation text;
    pair text;
    reach text;
    heights text;
BEGIN
    FOR name, relation, pair, reach, heights IN VALUES
        ('things_on', 'is_on', 'wo.entity_id, thing', 'tolerance double precision DEFAULT 0.01', '&&&'),
        ('supports_of', 'is_on', 'thing, wo.entity_id', 'tolerance double precision DEFAULT 0.01', '&&&'),
        ('things_above', 'is_above', 'wo.entity_id, thing', 'tolerance double precision DEFAULT 0.01', '&&'),
        ('things_under', 'is_under', 'wo.entity_id, thing', 'tolerance double precision DEFAULT 0.01', '&&'),
        ('things_touching', 'is_touching', 'wo.entity_id, thing', 'tolerance double precision DEFAULT 0.01', '&&&'),
        ('things_near', 'is_near', 'wo.entity_id, thing', 'distance double precision', '&&&')
    LOOP
        EXECUTE format($def$
CREATE FUNCTION %1$I(thing bigint, %4$s)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 10 COST 100000
BEGIN ATOMIC
SELECT wo.entity_id FROM semmap.world wg JOIN semmap.world wo ON wo.map_id = wg.map_id
  AND wo.box && semmap.grown(wg.box, $2) AND wo.box %5$s semmap.grown(wg.box, $2)
WHERE wg.entity_id = thing AND semmap.%2$I(%3$s, $2);
END;
$def$, name, relation, pair, reach, heights);
    END LOOP;
END $$;

CREATE FUNCTION things_held(b bigint)
RETURNS SETOF bigint LANGUAGE plpgsql STABLE PARALLEL SAFE ROWS 100 SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- The contents of b, and their contents, by placement. For each of its own, by index: a join of all could scan the
-- placements, and without statistics this would, too.
BEGIN
    RETURN QUERY
    WITH RECURSIVE down (id) AS (
        SELECT p.entity_id FROM semmap.placement p WHERE p.holder_id = b
      UNION
        SELECT p.id FROM down CROSS JOIN LATERAL (SELECT q.entity_id FROM semmap.placement q WHERE q.holder_id = down.id OFFSET 0) p (id))
    SELECT d.id FROM down d;
END $$;

CREATE FUNCTION contents_of(b bigint)
RETURNS SETOF bigint LANGUAGE plpgsql STABLE ROWS 100 SET search_path = semmap, public, pg_temp AS $$
-- What b holds, and what that holds. In a room: what is in it, see room_of; of other rooms those that it holds.
BEGIN
    IF (SELECT kind FROM semmap.entity WHERE id = b) = 'room' THEN
        RETURN QUERY
            SELECT t.id FROM semmap.things_in(b) t (id) JOIN semmap.entity e ON e.id = t.id WHERE e.kind <> 'room'
          UNION
            SELECT t.id FROM semmap.things_held(b) t (id) JOIN semmap.entity e ON e.id = t.id WHERE e.kind = 'room';
    ELSE
        RETURN QUERY SELECT semmap.things_held(b);
    END IF;
END $$;

CREATE FUNCTION things_in(b bigint, tolerance double precision DEFAULT 0.01)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 100 COST 100000
BEGIN ATOMIC
-- What is in b: see is_in. What is in a room can be in its openings; of what it holds, the rest is looked at for itself.
WITH zone AS MATERIALIZED (
    SELECT w.map_id, w.footprint, e.kind, semmap.grown(w.box, tolerance + CASE e.kind WHEN 'room' THEN 0.5 ELSE 0 END) AS box
    FROM semmap.entity e LEFT JOIN semmap.world w ON w.entity_id = e.id WHERE e.id = b)
SELECT wo.entity_id
FROM zone z JOIN semmap.world wo ON wo.map_id = z.map_id AND wo.box && z.box AND wo.box &&& z.box
WHERE z.footprint IS NOT NULL AND semmap.is_in(wo.entity_id, b, tolerance)
UNION
SELECT held.id
FROM zone z CROSS JOIN semmap.things_held(b) held (id)
WHERE z.map_id IS NOT NULL AND z.footprint IS NULL OR semmap.is_nowhere(held.id)
   OR z.kind = 'room' AND NOT coalesce((  -- by index: a join would scan the world
          SELECT z.footprint IS NOT NULL AND wo.box && z.box AND wo.box &&& z.box FROM semmap.world wo WHERE wo.entity_id = held.id), false)
      AND semmap.is_in(held.id, b, tolerance);
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
