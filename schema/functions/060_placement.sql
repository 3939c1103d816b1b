-- What follows a change of placements: world pose, box and footprint of what moved and of all that
-- it holds; former placements; the announcement.

CREATE FUNCTION refresh_world(ids bigint[])
RETURNS bigint[] LANGUAGE sql SECURITY DEFINER SET search_path = semmap, public AS $$
-- World coordinates of the given entities and of what they hold, from the top down. An entity
-- that is reached twice (itself given, and below another given one) counts where it was reached
-- from the highest start: only there was its holder fresh. Returns all that moved.
WITH RECURSIVE tree (entity_id, map_id, storey_id, pose, depth) AS (
    SELECT p.entity_id, e.map_id, CASE e.kind WHEN 'storey' THEN e.id ELSE h.storey_id END,
           CASE WHEN p.holder_id IS NULL THEN p.pose ELSE pose_compose(h.pose, p.pose) END, 0
    FROM unnest(ids) AS given (id)
    JOIN placement p ON p.entity_id = given.id
    JOIN entity e ON e.id = p.entity_id
    LEFT JOIN world h ON h.entity_id = p.holder_id
    LEFT JOIN unnest(ids) AS above (id) ON above.id = p.holder_id
    WHERE above.id IS NULL
  UNION ALL
    SELECT p.entity_id, e.map_id, CASE e.kind WHEN 'storey' THEN e.id ELSE t.storey_id END,
           pose_compose(t.pose, p.pose), t.depth + 1
    FROM tree t
    JOIN placement p ON p.holder_id = t.entity_id
    JOIN entity e ON e.id = p.entity_id
), placed AS (
    SELECT DISTINCT ON (entity_id) entity_id, map_id, storey_id, pose
    FROM tree ORDER BY entity_id, depth DESC
), shape AS (
    -- The outline where the model has one and stands upright, else the convex hull on the ground.
    SELECT t.entity_id, h.hull,
           coalesce(CASE WHEN abs(t.pose[4]) < 1e-6 AND abs(t.pose[5]) < 1e-6
                         THEN ST_Force2D(pose_apply(ST_Force3D(m.outline), t.pose)) END,
                    ST_ConvexHull(ST_Force2D(h.hull))) AS flat
    FROM placed t
    JOIN entity_model em ON em.entity_id = t.entity_id
    JOIN model m ON m.id = em.model_id
    CROSS JOIN LATERAL (SELECT pose_apply(m.hull, t.pose) OFFSET 0) h (hull)
), solid AS (
    SELECT entity_id, hull,
           CASE WHEN ST_Dimension(flat) = 2 THEN flat ELSE ST_Buffer(flat, 0.001, 1) END AS flat
    FROM shape
), extent AS (
    SELECT entity_id,
           CASE count(*) WHEN 1 THEN (array_agg(hull))[1] ELSE ST_Collect(hull) END AS hull,
           ST_Multi(CASE count(*) WHEN 1 THEN (array_agg(flat))[1] ELSE ST_Union(flat) END) AS footprint
    FROM solid GROUP BY entity_id
), kept AS (
    INSERT INTO world AS w (entity_id, map_id, storey_id, pose, box, footprint)
    SELECT t.entity_id, t.map_id, t.storey_id, t.pose,
           coalesce(diagonal(x.hull), ST_MakeLine(here, here)), x.footprint
    FROM placed t
    CROSS JOIN LATERAL ST_MakePoint(t.pose[1], t.pose[2], t.pose[3]) AS here
    LEFT JOIN extent x ON x.entity_id = t.entity_id
    ON CONFLICT (entity_id) DO UPDATE
    SET map_id = excluded.map_id, storey_id = excluded.storey_id, pose = excluded.pose,
        box = excluded.box, footprint = excluded.footprint
    RETURNING entity_id)
SELECT array_agg(entity_id) FROM kept
$$;

CREATE FUNCTION holders_of(ids bigint[])
RETURNS SETOF bigint LANGUAGE sql STABLE AS $$
-- The chain of holders above the given entities, up to the map.
WITH RECURSIVE up (id) AS (
    SELECT holder_id FROM semmap.placement WHERE entity_id = ANY (ids) AND holder_id IS NOT NULL
  UNION
    SELECT p.holder_id FROM up JOIN semmap.placement p ON p.entity_id = up.id WHERE p.holder_id IS NOT NULL)
SELECT id FROM up
$$;

CREATE FUNCTION lock_holders(ids bigint[])
RETURNS void LANGUAGE sql AS $$
-- Nobody moves a holder while something is put into it: else the world would be computed from a
-- pose that is already a former one.
SELECT FROM semmap.placement
WHERE entity_id IN (SELECT semmap.holders_of(ids)) AND NOT entity_id = ANY (ids[1:1000])
ORDER BY entity_id FOR SHARE
$$;

CREATE FUNCTION check_holders(ids bigint[])
RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    wrong text;
BEGIN
    SELECT e.name INTO wrong
    FROM semmap.placement p JOIN semmap.entity e ON e.id = p.entity_id JOIN semmap.entity h ON h.id = p.holder_id
    WHERE p.entity_id = ANY (ids) AND h.map_id <> e.map_id LIMIT 1;
    IF wrong IS NOT NULL THEN
        RAISE EXCEPTION 'the holder of % is in another map', wrong
            USING ERRCODE = 'check_violation', HINT = 'A holder is an entity of the same map.';
    END IF;
    SELECT e.name INTO wrong
    FROM semmap.placement p JOIN semmap.entity e ON e.id = p.entity_id LEFT JOIN semmap.placement h ON h.entity_id = p.holder_id
    WHERE p.entity_id = ANY (ids) AND p.holder_id IS NOT NULL AND h.entity_id IS NULL LIMIT 1;
    IF wrong IS NOT NULL THEN
        RAISE EXCEPTION 'the holder of % has no placement', wrong
            USING ERRCODE = 'check_violation', HINT = 'Place the holder first.';
    END IF;
    WITH RECURSIVE up (start, id) AS (
        SELECT entity_id, holder_id FROM semmap.placement WHERE entity_id = ANY (ids) AND holder_id IS NOT NULL
      UNION
        SELECT up.start, p.holder_id FROM up JOIN semmap.placement p ON p.entity_id = up.id
        WHERE p.holder_id IS NOT NULL AND up.id <> up.start)
    SELECT e.name INTO wrong FROM up JOIN semmap.entity e ON e.id = up.start WHERE up.id = up.start LIMIT 1;
    IF wrong IS NOT NULL THEN
        RAISE EXCEPTION '% would hold itself', wrong
            USING ERRCODE = 'check_violation', HINT = 'A holder must not stand in what it holds.';
    END IF;
END $$;

CREATE FUNCTION placement_inserted()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public AS $$
DECLARE
    ids bigint[];
BEGIN
    SELECT array_agg(entity_id) INTO ids FROM fresh;
    IF ids IS NULL THEN
        RETURN NULL;
    END IF;
    PERFORM check_holders(ids);
    PERFORM lock_holders(ids);
    PERFORM record_change('moved', refresh_world(ids));
    RETURN NULL;
END $$;

CREATE FUNCTION placement_stamp()
RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    NEW.since := greatest(statement_timestamp(), OLD.since + interval '1 microsecond');
    RETURN NEW;
END $$;

CREATE FUNCTION placement_updated()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public AS $$
DECLARE
    moved bigint[];
    rehung bigint[];
BEGIN
    SELECT array_agg(entity_id), array_agg(entity_id) FILTER (WHERE o.holder_id IS DISTINCT FROM n.holder_id)
        INTO moved, rehung
        FROM former o JOIN fresh n USING (entity_id)
        WHERE (o.holder_id, o.pose, o.relation, o.confidence) IS DISTINCT FROM (n.holder_id, n.pose, n.relation, n.confidence);
    IF moved IS NULL THEN
        RETURN NULL;
    END IF;
    IF rehung IS NOT NULL THEN
        PERFORM check_holders(rehung);
    END IF;
    PERFORM lock_holders(moved);
    PERFORM record_change('moved', refresh_world(moved));

    -- Former placements, thinned: within `keep_every` of the last one kept, that one lasts on.
    WITH version AS (
        SELECT o.*, n.since AS until, r.keep_every
        FROM former o JOIN fresh n USING (entity_id)
        JOIN entity e ON e.id = o.entity_id
        LEFT JOIN retention r ON r.kind = e.kind
        WHERE o.entity_id = ANY (moved)
    ), prolonged AS (
        UPDATE placement_history h SET during = tstzrange(lower(h.during), v.until)
        FROM version v
        WHERE v.keep_every IS NOT NULL AND h.entity_id = v.entity_id
          AND lower(h.during) > v.since - v.keep_every AND upper(h.during) = v.since
        RETURNING h.entity_id
    )
    INSERT INTO placement_history (entity_id, holder_id, pose, relation, confidence, during)
        SELECT entity_id, holder_id, pose, relation, confidence, tstzrange(since, until)
        FROM version WHERE NOT EXISTS (SELECT FROM prolonged p WHERE p.entity_id = version.entity_id);
    RETURN NULL;
END $$;

CREATE FUNCTION placement_deleted()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public AS $$
BEGIN
    INSERT INTO placement_history (entity_id, holder_id, pose, relation, confidence, during)
        SELECT entity_id, holder_id, pose, relation, confidence,
               tstzrange(since, greatest(statement_timestamp(), since + interval '1 microsecond'))
        FROM former;
    PERFORM record_change('moved', ARRAY(SELECT entity_id FROM former));
    RETURN NULL;
END $$;

CREATE TRIGGER placement_stamp BEFORE UPDATE ON placement
    FOR EACH ROW WHEN (OLD IS DISTINCT FROM NEW) EXECUTE FUNCTION placement_stamp();
CREATE TRIGGER placement_inserted AFTER INSERT ON placement REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION placement_inserted();
CREATE TRIGGER placement_updated AFTER UPDATE ON placement REFERENCING OLD TABLE AS former NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION placement_updated();
CREATE TRIGGER placement_deleted AFTER DELETE ON placement REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION placement_deleted();

CREATE FUNCTION put(thing bigint, into_holder bigint, how text DEFAULT 'in', sure double precision DEFAULT NULL)
RETURNS void LANGUAGE plpgsql AS $$
-- Another holder, at the same place in the world (null: the map itself).
BEGIN
UPDATE semmap.placement p
SET holder_id = into_holder, relation = how, confidence = sure,
    pose = CASE WHEN into_holder IS NULL THEN w.pose
                ELSE semmap.pose_compose(semmap.pose_inverse((SELECT h.pose FROM semmap.world h WHERE h.entity_id = into_holder)), w.pose) END
FROM semmap.world w
WHERE p.entity_id = thing AND w.entity_id = thing;
IF NOT FOUND THEN
    RAISE EXCEPTION 'entity % is not put anywhere: it has no placement, or you may not move it', thing
        USING ERRCODE = 'insufficient_privilege', HINT = 'A robot moves objects, regions and agents.';
END IF;
END $$;

CREATE FUNCTION move_to(thing bigint, x double precision, y double precision, z double precision, yaw double precision DEFAULT NULL)
RETURNS void LANGUAGE plpgsql AS $$
-- To a place in the map's frame, in the hands of the same holder; what it holds comes along.
BEGIN
UPDATE semmap.placement p
SET pose = CASE WHEN p.holder_id IS NULL THEN target
                ELSE semmap.pose_compose(semmap.pose_inverse((SELECT h.pose FROM semmap.world h WHERE h.entity_id = p.holder_id)), target) END
FROM semmap.world w, LATERAL (SELECT CASE WHEN yaw IS NULL THEN ARRAY[x, y, z] || w.pose[4:7] ELSE semmap.planar_pose(x, y, yaw, z) END) t (target)
WHERE p.entity_id = thing AND w.entity_id = thing;
IF NOT FOUND THEN
    RAISE EXCEPTION 'entity % is not moved: it has no placement, or you may not move it', thing
        USING ERRCODE = 'insufficient_privilege', HINT = 'A robot moves objects, regions and agents.';
END IF;
END $$;
