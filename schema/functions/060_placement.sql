-- Triggers on placements: they maintain the world pose, box and footprint of moved entities and their
-- contents, the history and the change log.

CREATE FUNCTION leaning_outline(outline geometry, hull geometry, pose double precision[])
RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- The ground below a model that leans by less than 30 degrees: the outline at half of its height, grown by what it leans
-- from there to its top and bottom; none of it outside of its hull. `hull` is in the model's frame. Null if it leans more.
SELECT CASE WHEN lean < 0.5 THEN ST_CollectionExtract(ST_Intersection(
           ST_Buffer(ST_Force2D(semmap.pose_apply(ST_Force3D(outline, (ST_ZMin(hull) + ST_ZMax(hull)) / 2), pose)),
                     lean * (ST_ZMax(hull) - ST_ZMin(hull)) / 2 + 1e-4, 'join=mitre'),
           ST_ConvexHull(ST_Force2D(semmap.pose_apply(hull, pose)))), 3) END
FROM (SELECT 1 - 2 * (pose[4] ^ 2 + pose[5] ^ 2)) u (upright),
     LATERAL (SELECT CASE WHEN upright > 0 THEN sqrt(1 - upright ^ 2) ELSE 1 END) l (lean);
END;

CREATE FUNCTION refresh_world(ids bigint[])
RETURNS jsonb LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- Computes the world coordinates of the given entities and of their contents, from the top down. An entity can be
-- reached twice: it is given, and below another given one. Then the path from the highest start counts, because
-- only there is its holder up to date. Returns all that moved, each as [id, former world pose, world pose, holder].
-- In PL/pgSQL, which keeps the plan: planning takes ten times as long as a move.
DECLARE
    moved jsonb;
BEGIN
WITH RECURSIVE tree (entity_id, map_id, storey_id, holder_id, pose, depth) AS (
    SELECT p.entity_id, e.map_id, CASE e.kind WHEN 'storey' THEN e.id ELSE h.storey_id END, p.holder_id,
           CASE WHEN p.holder_id IS NULL THEN p.pose ELSE semmap.pose_compose(h.pose, p.pose) END, 0
    FROM unnest(ids) AS given (id)
    JOIN semmap.placement p ON p.entity_id = given.id
    JOIN semmap.entity e ON e.id = p.entity_id
    LEFT JOIN semmap.world h ON h.entity_id = p.holder_id
    LEFT JOIN unnest(ids) AS above (id) ON above.id = p.holder_id
    WHERE above.id IS NULL
  UNION ALL
    SELECT p.entity_id, e.map_id, CASE e.kind WHEN 'storey' THEN e.id ELSE t.storey_id END, p.holder_id,
           semmap.pose_compose(t.pose, p.pose), t.depth + 1
    FROM tree t
    -- for each entity of its own, since a join of all would read every placement of a small map
    CROSS JOIN LATERAL (SELECT q.* FROM semmap.placement q WHERE q.holder_id = t.entity_id OFFSET 0) p
    JOIN semmap.entity e ON e.id = p.entity_id
), placed AS (
    SELECT DISTINCT ON (entity_id) entity_id, map_id, storey_id, holder_id, pose
    FROM tree ORDER BY entity_id, depth DESC
), kept AS (
    -- The models of each entity are looked up one entity after the other: a join of all could be planned as a nested
    -- loop, which is quadratic, because the plan is that of a move of one entity.
    INSERT INTO semmap.world AS w (entity_id, map_id, storey_id, pose, box, footprint)
    SELECT t.entity_id, t.map_id, t.storey_id, t.pose,
           coalesce(semmap.diagonal(x.hull), ST_MakeLine(here, here)), x.footprint
    FROM placed t
    CROSS JOIN LATERAL ST_MakePoint(t.pose[1], t.pose[2], t.pose[3]) AS here
    CROSS JOIN LATERAL (
        SELECT CASE cardinality(g.hulls) WHEN 1 THEN g.hulls[1] ELSE ST_Collect(g.hulls) END,
               ST_Multi(CASE cardinality(g.flats) WHEN 1 THEN g.flats[1] ELSE ST_UnaryUnion(ST_Collect(g.flats), 1e-6) END)
        FROM (SELECT array_agg(h.hull) AS hulls,
                     array_agg(CASE ST_Dimension(f.flat) WHEN 2 THEN f.flat ELSE ST_Buffer(f.flat, 0.001, 1) END) AS flats
              FROM semmap.entity_model em
              JOIN semmap.model m ON m.id = em.model_id
              CROSS JOIN LATERAL (SELECT semmap.pose_apply(m.hull, t.pose) OFFSET 0) h (hull)
              -- The outline where the model has one and does not lie, else the convex hull on the ground.
              CROSS JOIN LATERAL (
                  SELECT coalesce(CASE WHEN abs(t.pose[4]) < 1e-6 AND abs(t.pose[5]) < 1e-6
                                       THEN ST_Force2D(semmap.pose_apply(ST_Force3D(m.outline), t.pose))
                                       ELSE semmap.leaning_outline(m.outline, m.hull, t.pose) END,
                                  ST_ConvexHull(ST_Force2D(h.hull))) OFFSET 0) f (flat)
              WHERE em.entity_id = t.entity_id) g OFFSET 0) x (hull, footprint)
    ON CONFLICT (entity_id) DO UPDATE
    SET map_id = excluded.map_id, storey_id = excluded.storey_id, pose = excluded.pose,
        box = excluded.box, footprint = excluded.footprint
    RETURNING w.entity_id)
-- The row of `world` is the former one: this statement does not see what it writes.
SELECT jsonb_agg(jsonb_build_array(t.entity_id, (SELECT w.pose FROM semmap.world w WHERE w.entity_id = t.entity_id),
                                   t.pose, t.holder_id)) INTO moved FROM placed t;
RETURN moved;
END $$;

CREATE FUNCTION record_moves(moves jsonb, placed jsonb, why text)
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- Records what refresh_world returned. The facts of the row: `poses`, as there; `placed`, former holder and holder of
-- each entity that was not only carried along; `why`: moved, or derived.
BEGIN
    INSERT INTO semmap.change (map_id, what, entities, facts)
        SELECT e.map_id, 'moved', array_agg(e.id ORDER BY e.id),
               jsonb_build_object('poses', jsonb_agg(m.move), 'placed', placed, 'why', why)
        FROM jsonb_array_elements(moves) m (move) JOIN semmap.entity e ON e.id = (m.move ->> 0)::bigint GROUP BY e.map_id;
END $$;

CREATE FUNCTION holders_of(ids bigint[])
RETURNS SETOF bigint LANGUAGE sql STABLE
BEGIN ATOMIC
-- The chain of holders above the given entities, up to the map.
WITH RECURSIVE up (id) AS (
    SELECT holder_id FROM semmap.placement WHERE entity_id = ANY (ids) AND holder_id IS NOT NULL
  UNION
    SELECT p.holder_id FROM up JOIN semmap.placement p ON p.entity_id = up.id WHERE p.holder_id IS NOT NULL)
SELECT id FROM up;
END;

-- How concurrent transactions keep `world` equal to `placement`. A transaction that writes the world coordinates
-- of an entity has a lock on its row in `placement`, or on that of an entity above it. Share locks keep the chains
-- of holders above it unchanged: the new chain, and the previous one, because a transaction that moves the
-- previous holder does not see yet that the entity has left it. Then the coordinates are computed, by a statement
-- that sees everything committed before. Locks are taken from the entity upwards, along one chain in the order of
-- ids.

CREATE FUNCTION lock_holders(holders bigint[])
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- Locks the given holders and all above them against moves until the transaction ends.
DECLARE
    locked bigint[] := '{}';
    chain bigint[];
BEGIN
    LOOP
        chain := ARRAY(
            WITH RECURSIVE up (id) AS (
                SELECT unnest(holders)
              UNION
                -- no join: its plan would read all placements of a small map
                SELECT (SELECT p.holder_id FROM semmap.placement p WHERE p.entity_id = up.id) FROM up)
            SELECT id FROM up WHERE id IS NOT NULL);
        EXIT WHEN chain <@ locked;  -- another transaction may have moved a holder while this one waited
        PERFORM FROM semmap.placement WHERE entity_id = ANY (chain) ORDER BY entity_id FOR SHARE;
        locked := chain;
    END LOOP;
END $$;

CREATE FUNCTION queue_writer()
RETURNS void LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Lets one transaction at a time move entities: two that move several entities in different orders could
-- deadlock. It waits a second for the transaction before it, and twice as long for each one that follows: who
-- asks again stands last, so that others who take turns would keep it waiting. If one transaction lasts so long,
-- it continues: the row locks keep the world coordinates correct, and the server resolves a deadlock. So it does at once
-- where a robot has the turn and is idle. It does not wait if an admin turns the setting `semmap.queue` off.
DECLARE
    seconds integer := 1;
    patience text := current_setting('lock_timeout');
    key integer := hashtext('semmap.placement');
    holder text;
    former_holder text;
BEGIN
    IF current_setting('semmap.queue', true) = 'off' AND semmap.is_trusted(semmap.caller()) THEN
        RETURN;
    END IF;
    IF semmap.end_idle_robots() AND patience = '0' THEN
        patience := set_config('lock_timeout', '11s', true);  -- then an error, and the next attempt ends the robot in the way
    END IF;
    IF pg_try_advisory_xact_lock(0, key) THEN
        RETURN;
    END IF;
    LOOP
        EXIT WHEN semmap.robot_wastes_turn();
        BEGIN
            PERFORM set_config('lock_timeout', seconds || 's', true);
            PERFORM pg_advisory_xact_lock(0, key);
            PERFORM set_config('lock_timeout', patience, true);
            RETURN;
        EXCEPTION WHEN lock_not_available THEN
            SELECT l.virtualtransaction INTO holder FROM pg_catalog.pg_locks l
                WHERE l.locktype = 'advisory' AND l.granted AND l.classid = 0 AND l.objid::bigint = key::bigint & 4294967295
                  AND l.objsubid = 2 AND l.database = (SELECT oid FROM pg_catalog.pg_database WHERE datname = current_database());
        END;
        EXIT WHEN holder = former_holder;
        former_holder := holder;
        seconds := least(2 * seconds, 60);
    END LOOP;
END $$;

CREATE FUNCTION placement_queued()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
BEGIN
    PERFORM semmap.queue_writer();
    RETURN NULL;
END $$;

CREATE FUNCTION check_holders(ids bigint[])
RETURNS void LANGUAGE plpgsql
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off SET search_path = semmap, public, pg_temp AS $$
DECLARE
    wrong record;
BEGIN
    SELECT e.name, h.map_id <> e.map_id AS is_foreign INTO wrong
    FROM semmap.placement p JOIN semmap.entity e ON e.id = p.entity_id JOIN semmap.entity h ON h.id = p.holder_id
    LEFT JOIN semmap.placement k ON k.entity_id = p.holder_id
    WHERE p.entity_id = ANY (ids) AND (h.map_id <> e.map_id OR k.entity_id IS NULL) ORDER BY is_foreign DESC LIMIT 1;
    IF wrong.is_foreign THEN
        RAISE EXCEPTION 'the holder of % is in another map', wrong.name
            USING ERRCODE = 'check_violation', HINT = 'A holder is an entity of the same map.';
    ELSIF FOUND THEN
        RAISE EXCEPTION 'the holder of % has no placement', wrong.name
            USING ERRCODE = 'check_violation', HINT = 'Place the holder first.';
    END IF;
    WITH RECURSIVE up (start, id) AS (
        SELECT entity_id, holder_id FROM semmap.placement WHERE entity_id = ANY (ids) AND holder_id IS NOT NULL
      UNION
        SELECT up.start, p.holder_id FROM up JOIN semmap.placement p ON p.entity_id = up.id
        WHERE p.holder_id IS NOT NULL AND up.id <> up.start)
    SELECT e.name INTO wrong FROM up JOIN semmap.entity e ON e.id = up.start WHERE up.id = up.start LIMIT 1;
    IF FOUND THEN
        RAISE EXCEPTION '% would hold itself', wrong.name
            USING ERRCODE = 'check_violation', HINT = 'A holder must not stand in what it holds.';
    END IF;
END $$;

CREATE FUNCTION placement_inserted()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
DECLARE
    ids bigint[];
BEGIN
    SELECT array_agg(entity_id) INTO ids FROM fresh;
    IF ids IS NULL THEN
        RETURN NULL;
    END IF;
    PERFORM semmap.lock_holders(ARRAY(SELECT DISTINCT holder_id FROM fresh));
    PERFORM semmap.check_holders(ids);
    PERFORM semmap.record_moves(semmap.refresh_world(ids), '{}', 'moved');
    PERFORM semmap.follow_geometry(ids, ARRAY(SELECT entity_id FROM fresh WHERE holder_id IS NOT NULL AND confidence IS NULL));
    RETURN NULL;
END $$;

CREATE FUNCTION placement_stamp()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- A changed holder counts as stated, unless it is derived.
BEGIN
    NEW.since := semmap.next_version(OLD.since);
    IF NEW.holder_id IS DISTINCT FROM OLD.holder_id AND NEW.confidence = OLD.confidence
       AND (coalesce(current_setting('semmap.deriving', true), '') = '' OR NOT semmap.is_trusted()) THEN
        NEW.confidence := NULL;
    END IF;
    RETURN NEW;
END $$;

CREATE FUNCTION placement_updated()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
DECLARE
    moved bigint[];
    rehung bigint[];
    stated bigint[];
    restated bigint[];
    rooms bigint[];
    left_behind bigint[];
    placed jsonb;
    deriving boolean := coalesce(current_setting('semmap.deriving', true), '') = 'on';
BEGIN
    SELECT array_agg(entity_id), array_agg(entity_id) FILTER (WHERE o.holder_id IS DISTINCT FROM n.holder_id),
           array_agg(entity_id) FILTER (WHERE o.holder_id IS DISTINCT FROM n.holder_id
                                          AND n.holder_id IS NOT NULL AND n.confidence IS NULL),
           array_agg(entity_id) FILTER (WHERE (o.holder_id, o.confidence) IS DISTINCT FROM (n.holder_id, n.confidence)
                                          AND n.holder_id IS NOT NULL AND n.confidence IS NULL),
           jsonb_object_agg(entity_id, jsonb_build_array(o.holder_id, n.holder_id))
        INTO moved, rehung, stated, restated, placed
        FROM former o FULL JOIN fresh n USING (entity_id)  -- full: a cached nested loop would be quadratic
        WHERE coalesce(o.entity_id = n.entity_id, false)
          AND (o.holder_id, o.pose, o.relation, o.confidence) IS DISTINCT FROM (n.holder_id, n.pose, n.relation, n.confidence);
    IF moved IS NULL THEN
        RETURN NULL;
    END IF;
    PERFORM semmap.lock_holders(ARRAY(SELECT holder_id FROM former UNION SELECT holder_id FROM fresh));
    IF rehung IS NOT NULL THEN
        PERFORM semmap.check_holders(rehung);
    END IF;
    rooms := ARRAY(
        SELECT entity_id FROM semmap.room WHERE entity_id = ANY (moved)
      UNION
        SELECT r.entity_id FROM semmap.storey s JOIN semmap.placement p ON p.holder_id = s.entity_id
        JOIN semmap.room r ON r.entity_id = p.entity_id WHERE s.entity_id = ANY (moved));
    IF rooms <> '{}' AND NOT deriving THEN
        left_behind := semmap.neighbours_of(rooms);
    END IF;
    PERFORM semmap.record_moves(semmap.refresh_world(moved), placed, CASE WHEN deriving THEN 'derived' ELSE 'moved' END);

    -- Thin out the history: a placement within `keep_every` of the last stored one extends that one.
    WITH changed AS MATERIALIZED (
        SELECT o.*, n.since AS until FROM former o FULL JOIN fresh n USING (entity_id)
        WHERE coalesce(o.entity_id = n.entity_id, false)
          AND (o.holder_id, o.pose, o.relation, o.confidence) IS DISTINCT FROM (n.holder_id, n.pose, n.relation, n.confidence)
    ), version AS (
        SELECT c.*, e.kind, r.keep_every
        FROM changed c JOIN semmap.entity e ON e.id = c.entity_id LEFT JOIN semmap.retention r ON r.kind = e.kind
    ), prolonged AS (
        UPDATE semmap.placement_history h SET during = tstzrange(lower(h.during), v.until)
        FROM version v
        WHERE v.keep_every IS NOT NULL AND v.until > v.since AND h.entity_id = v.entity_id
          AND lower(h.during) > v.since - v.keep_every AND upper(h.during) = v.since
        RETURNING h.entity_id
    ), expired AS (
        DELETE FROM semmap.placement_history h USING version v JOIN semmap.retention r ON r.kind = v.kind
        WHERE h.entity_id = v.entity_id AND lower(h.during) < now() - r.keep_for AND upper(h.during) < now() - r.keep_for
    )
    INSERT INTO semmap.placement_history (entity_id, holder_id, pose, relation, confidence, during, reason)
        SELECT entity_id, holder_id, pose, relation, confidence,
               semmap.former_span('semmap.placement_history', entity_id, since, until),
               CASE WHEN deriving THEN CASE WHEN confidence IS NULL AND holder_id IS NOT NULL
                                            THEN 'the geometry contradicted the stated holder'
                                            ELSE 'the geometry showed another holder' END END
        FROM version FULL JOIN (SELECT entity_id AS id FROM prolonged) p ON p.id = version.entity_id WHERE p.id IS NULL;
    IF NOT deriving THEN
        PERFORM semmap.follow_geometry(moved || rooms, stated, left_behind, restated);
    END IF;
    RETURN NULL;
END $$;

CREATE FUNCTION follow_geometry(moved bigint[], stated bigint[], left_behind bigint[] DEFAULT '{}', restated bigint[] DEFAULT NULL)
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- After a move: refuses a stated holder that the pose contradicts, or that is far smaller, recognises what is a part of
-- the building now, or is none any more, and derives the other holders that the move changes. `left_behind` is what rooms
-- were near before; `restated` also has those whose derived holder is stated now. Does nothing if the setting
-- `semmap.deriving` is off: then derive_again does it at the end.
DECLARE
    around bigint[];
    wrong record;
BEGIN
    IF current_setting('semmap.deriving', true) = 'off' THEN
        RETURN;
    END IF;
    IF stated <> '{}' THEN
        SELECT e.name, h.name AS holder, round(ST_3DDistance(w.box, k.box)::numeric, 2) AS metres INTO wrong
            FROM unnest(stated) s (id) JOIN semmap.placement p ON p.entity_id = s.id
            JOIN semmap.entity e ON e.id = s.id AND e.kind = 'object' JOIN semmap.entity h ON h.id = p.holder_id
            JOIN semmap.world w ON w.entity_id = e.id JOIN semmap.world k ON k.entity_id = h.id
            WHERE semmap.is_apart(s.id, p.holder_id) LIMIT 1;
        IF wrong IS NOT NULL THEN
            RAISE EXCEPTION '% is not in or on %: they are % m apart', wrong.name, wrong.holder, wrong.metres
                USING ERRCODE = 'check_violation', HINT = 'Move it there, or give its pose together with its holder.';
        END IF;
    END IF;
    restated := coalesce(restated, stated);
    IF restated <> '{}' THEN
        -- A tray fits on a mug, a table does not; a towel hangs from a hook.
        SELECT e.name, h.name AS holder, round(ST_Area(w.footprint)::numeric, 3) AS large,
               round(ST_Area(k.footprint)::numeric, 3) AS small INTO wrong
            FROM unnest(restated) s (id) JOIN semmap.placement p ON p.entity_id = s.id
            JOIN semmap.entity e ON e.id = s.id AND e.kind = 'object'
            JOIN semmap.entity h ON h.id = p.holder_id AND h.kind = 'object'
            JOIN semmap.world w ON w.entity_id = e.id JOIN semmap.world k ON k.entity_id = h.id
            WHERE ST_Area(w.footprint) > 25 * greatest(ST_Area(k.footprint), 0.0001)
              AND ST_ZMin(w.box) >= ST_ZMin(k.box) - 0.01 LIMIT 1;
        IF wrong IS NOT NULL THEN
            RAISE EXCEPTION '% is too large to be on or in %: it covers % m2, % only %', wrong.name, wrong.holder, wrong.large,
                wrong.holder, wrong.small
                USING ERRCODE = 'check_violation', HINT = 'Put it on something larger.';
        END IF;
    END IF;
    around := semmap.neighbours_of(moved) || coalesce(left_behind, '{}');
    PERFORM semmap.recognise_parts(around);
    PERFORM semmap.derive_again(around);
END $$;

CREATE FUNCTION pose_below(holder bigint, pose double precision[])
RETURNS double precision[] LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- A pose relative to a holder, in the map's frame; null where the holder has no place.
BEGIN
    RETURN CASE WHEN holder IS NULL THEN pose
                ELSE semmap.pose_compose((SELECT w.pose FROM semmap.world w WHERE w.entity_id = holder), pose) END;
END $$;

CREATE FUNCTION placement_deleted()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    INSERT INTO semmap.placement_history (entity_id, holder_id, pose, relation, confidence, during)
        SELECT entity_id, holder_id, pose, relation, confidence,
               semmap.former_span('semmap.placement_history', entity_id, since, semmap.next_version(since))
        FROM former;
    PERFORM semmap.record_moves(
        (SELECT jsonb_agg(jsonb_build_array(entity_id, semmap.pose_below(holder_id, pose), NULL, holder_id)) FROM former),
        (SELECT jsonb_object_agg(entity_id, jsonb_build_array(holder_id, NULL)) FROM former), 'moved');
    IF coalesce(current_setting('semmap.dropping', true), '') = '' THEN
        UPDATE semmap.change c SET facts = c.facts || jsonb_build_object('placed', coalesce(c.facts -> 'placed', '{}') || (
            SELECT jsonb_object_agg(entity_id, jsonb_build_array(holder_id, NULL)) FROM former WHERE entity_id = ANY (c.entities)))
        WHERE c.xid = pg_current_xact_id()::text::bigint AND c.what = 'removed'
          AND EXISTS (SELECT FROM former WHERE entity_id = ANY (c.entities));
        -- The contents of what has no place any more stay where they are.
        UPDATE semmap.placement p SET holder_id = NULL, relation = 'in', confidence = NULL, pose = w.pose
        FROM semmap.world w WHERE w.entity_id = p.entity_id AND p.holder_id IN (SELECT entity_id FROM former);
    END IF;
    RETURN NULL;
END $$;

CREATE FUNCTION placement_leaves()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Before a placement is deleted: a transaction that moves its holder must not write the entity's world row again.
BEGIN
    PERFORM semmap.lock_holders(ARRAY[OLD.holder_id]);
    RETURN OLD;
END $$;

CREATE TRIGGER placement_queued BEFORE UPDATE OR DELETE ON placement
    FOR EACH STATEMENT EXECUTE FUNCTION placement_queued();
CREATE TRIGGER placement_queued BEFORE DELETE ON entity
    FOR EACH STATEMENT EXECUTE FUNCTION placement_queued();
CREATE TRIGGER placement_leaves BEFORE DELETE ON placement
    FOR EACH ROW WHEN (OLD.holder_id IS NOT NULL) EXECUTE FUNCTION placement_leaves();
CREATE TRIGGER placement_stamp BEFORE UPDATE ON placement
    FOR EACH ROW WHEN (OLD IS DISTINCT FROM NEW) EXECUTE FUNCTION placement_stamp();
CREATE TRIGGER placement_inserted AFTER INSERT ON placement REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION placement_inserted();
CREATE TRIGGER placement_updated AFTER UPDATE ON placement REFERENCING OLD TABLE AS former NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION placement_updated();
CREATE TRIGGER placement_deleted AFTER DELETE ON placement REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION placement_deleted();

CREATE FUNCTION hold_still(thing bigint, into_holder bigint)
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Before a pose relative to a holder is computed from world coordinates: locks the holder against moves.
BEGIN
    IF NOT semmap.may_move(semmap.caller(), thing) THEN
        RAISE EXCEPTION 'entity % is not moved: you may not move it', thing
            USING ERRCODE = 'insufficient_privilege', HINT = 'A robot moves objects, regions and agents.';
    END IF;
    PERFORM semmap.queue_writer();
    PERFORM semmap.lock_holders(ARRAY[into_holder, (SELECT holder_id FROM semmap.placement WHERE entity_id = thing)]);
END $$;

CREATE FUNCTION put(thing bigint, into_holder bigint, how text DEFAULT 'in', sure double precision DEFAULT NULL)
RETURNS void LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Gives an entity another holder at the same world pose (null: the map itself).
BEGIN
PERFORM semmap.hold_still(thing, into_holder);
IF into_holder IS NOT NULL AND NOT EXISTS (SELECT FROM semmap.world WHERE entity_id = into_holder) THEN
    RAISE EXCEPTION 'the holder % is not in the map, or has no placement', into_holder
        USING ERRCODE = 'check_violation', HINT = 'Place the holder first.';
END IF;
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
RETURNS void LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Moves an entity to a pose in the map's frame. Its contents move along; its holder is derived from the geometry.
BEGIN
PERFORM semmap.hold_still(thing, NULL);
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
