-- Stored actions by instance, function, pose and shape, the best expected outcome first; and what outcomes change
-- (Tosello, Fan and Pagello, sections III and IV).

CREATE FUNCTION types_for(use text)
RETURNS text[] LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- The types whose objects are used for a function, such as drinking.
SELECT coalesce(array_agg(DISTINCT c.sub), '{}') FROM semmap.semantic_type t JOIN semmap.type_closure c ON c.super = t.name
WHERE use = ANY (t.functions);
END;

CREATE FUNCTION functions_of(of_type text)
RETURNS text[] LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- What objects of a type are used for.
SELECT coalesce(array_agg(DISTINCT f), '{}') FROM semmap.type_closure c JOIN semmap.semantic_type t ON t.name = c.super,
     LATERAL unnest(t.functions) f WHERE c.sub = of_type;
END;

CREATE FUNCTION gripper_named(gripper_name text DEFAULT NULL)
RETURNS integer LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The gripper of a name; without one, the preferred gripper, else the only one.
DECLARE
    found_id integer;
BEGIN
    IF gripper_name IS NOT NULL THEN
        SELECT d.id INTO found_id FROM semmap.device d JOIN semmap.gripper g ON g.device_id = d.id WHERE d.name = gripper_name;
        IF found_id IS NULL THEN
            RAISE EXCEPTION 'there is no gripper named %', gripper_name
                USING ERRCODE = 'no_data_found', HINT = semmap.did_you_mean(gripper_name,
                    ARRAY(SELECT d.name FROM semmap.device d JOIN semmap.gripper g ON g.device_id = d.id),
                    '`semmap manipulation grippers` lists them; `semmap manipulation add-gripper URDF` adds one.');
        END IF;
        RETURN found_id;
    END IF;
    SELECT device_id INTO found_id FROM semmap.gripper WHERE preferred
        OR NOT EXISTS (SELECT FROM semmap.gripper o WHERE o.device_id <> gripper.device_id);
    IF found_id IS NULL THEN
        RAISE EXCEPTION '%', CASE WHEN EXISTS (SELECT FROM semmap.gripper) THEN 'there are several grippers, and none is preferred'
                                  ELSE 'there is no gripper yet' END
            USING ERRCODE = 'no_data_found', HINT = 'Name one, or prefer one: semmap manipulation add-gripper URDF --prefer.';
    END IF;
    RETURN found_id;
END $$;

CREATE FUNCTION object_of(entity bigint)
RETURNS bigint LANGUAGE sql STABLE
BEGIN ATOMIC
-- The object model of an entity; null where nothing is known of it.
SELECT o.object_id FROM semmap.entity_object o WHERE o.entity_id = entity;
END;

CREATE FUNCTION find_objects(entities bigint[])
RETURNS void LANGUAGE sql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Determines the object models of entities again.
DELETE FROM semmap.entity_object WHERE entity_id = ANY (entities);
INSERT INTO semmap.entity_object (entity_id, object_id)
    SELECT DISTINCT ON (em.entity_id) em.entity_id, h.object_id
    FROM semmap.entity_model em JOIN semmap.model m ON m.id = em.model_id JOIN semmap.object_mesh h ON h.digest = m.digest
    WHERE em.entity_id = ANY (entities) ORDER BY em.entity_id, em.role DESC, h.object_id
$$;

CREATE FUNCTION entity_meshes_changed()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    IF EXISTS (SELECT FROM semmap.object_mesh) THEN
        PERFORM semmap.find_objects(ARRAY(SELECT DISTINCT entity_id FROM changed));
    END IF;
    RETURN NULL;
END $$;

CREATE FUNCTION object_meshes_changed()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    PERFORM semmap.find_objects(ARRAY(SELECT DISTINCT em.entity_id FROM changed c JOIN semmap.model m ON m.digest = c.digest
                                                            JOIN semmap.entity_model em ON em.model_id = m.id));
    RETURN NULL;
END $$;

CREATE TRIGGER entity_meshes_inserted AFTER INSERT ON entity_model REFERENCING NEW TABLE AS changed
    FOR EACH STATEMENT EXECUTE FUNCTION entity_meshes_changed();
CREATE TRIGGER entity_meshes_updated AFTER UPDATE ON entity_model REFERENCING NEW TABLE AS changed
    FOR EACH STATEMENT EXECUTE FUNCTION entity_meshes_changed();
CREATE TRIGGER entity_meshes_deleted AFTER DELETE ON entity_model REFERENCING OLD TABLE AS changed
    FOR EACH STATEMENT EXECUTE FUNCTION entity_meshes_changed();
CREATE TRIGGER object_meshes_inserted AFTER INSERT ON object_mesh REFERENCING NEW TABLE AS changed
    FOR EACH STATEMENT EXECUTE FUNCTION object_meshes_changed();
CREATE TRIGGER object_meshes_updated AFTER UPDATE ON object_mesh REFERENCING NEW TABLE AS changed
    FOR EACH STATEMENT EXECUTE FUNCTION object_meshes_changed();
CREATE TRIGGER object_meshes_deleted AFTER DELETE ON object_mesh REFERENCING OLD TABLE AS changed
    FOR EACH STATEMENT EXECUTE FUNCTION object_meshes_changed();

CREATE FUNCTION best_actions(objects bigint[], gripper integer, of_kind text DEFAULT 'grasp', most integer DEFAULT 10)
RETURNS TABLE (action_id bigint, object_id bigint, expected double precision)
LANGUAGE plpgsql STABLE ROWS 10 COST 1000 SET search_path = semmap, public, pg_temp AS $$
-- The stored actions on some object models with a gripper, the best expected outcome first. Of many objects, enough are
-- usually among the best actions of the gripper. Else, the best of all are on the objects with the best one each: one
-- entry of an index is read for each object, and `most` for these few.
DECLARE
    many CONSTANT integer := 100;
    depth CONSTANT integer := 2000;
    chosen bigint[];
BEGIN
    IF cardinality(objects) > many THEN
        chosen := ARRAY(
            SELECT a.id FROM (SELECT t.id, t.object_id, t.replaced_by FROM semmap.action t
                              WHERE t.gripper_id = gripper AND t.kind = of_kind ORDER BY t.expected DESC, t.id LIMIT depth) a
            WHERE a.replaced_by IS NULL AND a.object_id IN (SELECT unnest(objects)) LIMIT most);
    END IF;
    IF cardinality(chosen) = most THEN
        RETURN QUERY SELECT a.id, a.object_id, a.expected FROM semmap.action a WHERE a.id = ANY (chosen) ORDER BY a.expected DESC, a.id;
        RETURN;
    END IF;
    RETURN QUERY
    WITH first AS (
        SELECT o.id FROM unnest(objects) o (id), LATERAL (
            SELECT a.id, a.expected FROM semmap.action a
            WHERE a.object_id = o.id AND a.gripper_id = gripper AND a.kind = of_kind AND a.replaced_by IS NULL
            ORDER BY a.expected DESC, a.id LIMIT 1) a
        ORDER BY a.expected DESC, a.id LIMIT most
    )
    SELECT a.id, f.id, a.expected FROM first f, LATERAL (
        SELECT a.id, a.expected FROM semmap.action a
        WHERE a.object_id = f.id AND a.gripper_id = gripper AND a.kind = of_kind AND a.replaced_by IS NULL
        ORDER BY a.expected DESC, a.id LIMIT most) a
    ORDER BY a.expected DESC, a.id LIMIT most;
END $$;

CREATE FUNCTION known_actions(use text, gripper text DEFAULT NULL, of_kind text DEFAULT 'grasp', most integer DEFAULT 10)
RETURNS TABLE (action_id bigint, object_id bigint, expected double precision) LANGUAGE plpgsql STABLE ROWS 10 COST 1000 SET search_path = semmap, public, pg_temp AS $$
-- The best stored actions on all object models for a function, in any map or none: usually among the best of the gripper.
DECLARE
    depth CONSTANT integer := 500;
    chosen integer := semmap.gripper_named(gripper);
    types text[] := semmap.types_for(use);
    found_ids bigint[] := ARRAY(
        SELECT a.id FROM (SELECT t.id, t.object_id, t.replaced_by FROM semmap.action t
                          WHERE t.gripper_id = chosen AND t.kind = of_kind ORDER BY t.expected DESC, t.id LIMIT depth) a
        WHERE a.replaced_by IS NULL
          AND (SELECT o.type = ANY (types) OR o.functions @> ARRAY[use] FROM semmap.object_model o WHERE o.id = a.object_id)
        LIMIT most);
BEGIN
    IF cardinality(found_ids) = most THEN
        RETURN QUERY SELECT a.id, a.object_id, a.expected FROM semmap.action a WHERE a.id = ANY (found_ids) ORDER BY a.expected DESC, a.id;
        RETURN;
    END IF;
    RETURN QUERY SELECT * FROM semmap.best_actions(ARRAY(
        SELECT o.id FROM semmap.object_model o WHERE o.type = ANY (types)
        UNION SELECT o.id FROM semmap.object_model o WHERE o.functions @> ARRAY[use]), chosen, of_kind, most);
END $$;

CREATE FUNCTION linked_objects(entities bigint[])
RETURNS TABLE (entity_id bigint, object_id bigint, confidence double precision)
LANGUAGE plpgsql STABLE ROWS 10 SET search_path = semmap, public, pg_temp AS $$
-- The object models that stored links (`semmap interlink`) state to be the same as entities, or as their models, beside
-- their own. A link of one entity counts for all of its mesh. Undone with the link set, since only that has it.
BEGIN
    IF NOT EXISTS (SELECT FROM semmap.link_set s JOIN semmap.data_set d ON d.id IN (s.left_id, s.right_id) WHERE d.name = 'models') THEN
        RETURN;
    END IF;
    RETURN QUERY
    WITH linked AS MATERIALIZED (
        SELECT a.name, l.left_key AS key, o.id AS object, l.confidence FROM semmap.link_set s
        JOIN semmap.data_set a ON a.id = s.left_id JOIN semmap.data_set b ON b.id = s.right_id AND b.name = 'models'
        JOIN semmap.record_link l ON l.link_set_id = s.id JOIN semmap.object_model o ON o.key = l.right_key
      UNION ALL
        SELECT b.name, l.right_key, o.id, l.confidence FROM semmap.link_set s
        JOIN semmap.data_set a ON a.id = s.left_id AND a.name = 'models' JOIN semmap.data_set b ON b.id = s.right_id
        JOIN semmap.record_link l ON l.link_set_id = s.id JOIN semmap.object_model o ON o.key = l.left_key
    ), of_entity AS MATERIALIZED (
        SELECT e.id, l.object, l.confidence FROM linked l JOIN semmap.map m ON l.name = 'map ' || m.name
        JOIN semmap.entity e ON e.map_id = m.id AND e.name = l.key
    ), found AS (
        SELECT o.id, o.object, o.confidence FROM of_entity o WHERE o.id = ANY (entities)
      UNION ALL
        SELECT w.entity_id, o.object, o.confidence FROM of_entity o JOIN semmap.entity_model x ON x.entity_id = o.id
        JOIN semmap.entity_model w ON w.model_id = x.model_id WHERE w.entity_id = ANY (entities)
      UNION ALL
        SELECT h.entity_id, l.object, l.confidence FROM semmap.entity_object h JOIN semmap.object_model m ON m.id = h.object_id
        JOIN linked l ON l.name = 'models' AND l.key = m.key WHERE h.entity_id = ANY (entities)
    )
    SELECT f.id, f.object, max(f.confidence) FROM found f LEFT JOIN semmap.entity_object h ON h.entity_id = f.id
    WHERE f.object IS DISTINCT FROM h.object_id GROUP BY 1, 2;
END $$;

CREATE FUNCTION shape_frame(to_shape text, to_size double precision[], to_pose double precision[],
                            from_shape text, from_size double precision[], from_pose double precision[])
RETURNS double precision[] LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- The frame of a model in that of another one whose primitive is the same within 2 cm, up to the symmetry of the shape;
-- null where that is not known. Primitives of revolution that coincide in equal frames tell of no turn: the frames are equal.
SELECT CASE
    WHEN to_shape IS DISTINCT FROM from_shape OR to_shape IS NULL
         OR EXISTS (SELECT FROM unnest(to_size, from_size) AS u (a, b) WHERE abs(a - b) > 0.02) THEN NULL
    WHEN to_shape <> 'cuboid' AND abs(to_pose[1] - from_pose[1]) < 0.01 AND abs(to_pose[2] - from_pose[2]) < 0.01
         AND abs(to_pose[3] - from_pose[3]) < 0.01 AND (to_shape = 'sphere' OR t.axis > 0.99 OR (to_shape = 'cylinder' AND t.axis < -0.99))
         THEN '{0,0,0,0,0,0,1}'
    ELSE semmap.pose_compose(to_pose, semmap.pose_inverse(from_pose)) END
FROM (SELECT 1 - 2 * (q[4] * q[4] + q[5] * q[5]) AS axis FROM semmap.pose_compose(semmap.pose_inverse(from_pose), to_pose) q) t;
END;

CREATE FUNCTION actions_on(entities bigint[], gripper text DEFAULT NULL, of_kind text DEFAULT 'grasp', most integer DEFAULT 10)
RETURNS TABLE (entity text, action_id bigint, object_id bigint, kind text, approach text, family text, expected double precision,
               attempts double precision, successes double precision, pose double precision[], pre_pose double precision[],
               post_pose double precision[], motion double precision[], width double precision, posture jsonb, pre_posture jsonb,
               model_pose double precision[], contributor text, shift double precision[],
               link double precision, frame text)
LANGUAGE plpgsql STABLE ROWS 10 COST 1000 SET search_path = semmap, public, pg_temp AS $$
-- The best stored actions on entities of a map; `pose`, `pre_pose` and `post_pose` are in the map's frame, `model_pose` and
-- `motion` in that of the object model. "Grasp a cup!" is actions_on(entities_named('cup')), "grasp something suitable for
-- drinking!" actions_on(entities_for('drinking')), "grasp the object at [x, y, z]!" actions_on(ARRAY[entity_at(x, y, z)]).
-- Grasps and places of linked models follow: `link` is the confidence, by which `expected` is multiplied, and `frame` tells
-- how they came to the entity: by equal primitives (shape), or as if the frames of both models were equal (model).
DECLARE
    chosen integer := semmap.gripper_named(gripper);
BEGIN
    RETURN QUERY
    WITH found AS MATERIALIZED (
        SELECT o.entity_id AS id, o.object_id AS object, NULL::double precision AS link
        FROM semmap.entity_object o WHERE o.entity_id = ANY (entities)
      UNION ALL
        SELECT l.entity_id, l.object_id, l.confidence FROM semmap.linked_objects(entities) l WHERE of_kind IN ('grasp', 'place')
    ), best AS MATERIALIZED (
        -- apart, since the confidence of links can bring the best ones behind those of the own models
        SELECT b.* FROM semmap.best_actions(ARRAY(SELECT DISTINCT f.object FROM found f WHERE f.link IS NULL), chosen, of_kind, most) b
      UNION
        SELECT b.* FROM semmap.best_actions(ARRAY(SELECT DISTINCT f.object FROM found f WHERE f.link IS NOT NULL), chosen, of_kind, most) b
    ), placed AS MATERIALIZED (
        SELECT f.id, f.object, f.link,
               CASE WHEN f.link IS NOT NULL
                    THEN (SELECT semmap.shape_frame(t.shape, t.size, t.shape_pose, o.shape, o.size, o.shape_pose)
                          FROM semmap.entity_object h JOIN semmap.object_model t ON t.id = h.object_id, semmap.object_model o
                          WHERE h.entity_id = f.id AND o.id = f.object) END AS frame
        FROM found f WHERE f.object IN (SELECT b.object_id FROM best b)
    )
    SELECT e.name, a.id, a.object_id, a.kind, a.approach, a.family, a.expected * coalesce(f.link, 1), a.attempts, a.successes,
           semmap.pose_compose(t.there, a.pose), semmap.pose_compose(t.there, a.pre_pose), semmap.pose_compose(t.there, a.post_pose),
           a.motion, a.width, a.posture, a.pre_posture, CASE WHEN f.frame IS NULL THEN a.pose ELSE semmap.pose_compose(f.frame, a.pose) END,
           c.name, a.shift, f.link, CASE WHEN f.frame IS NOT NULL THEN 'shape' WHEN f.link IS NOT NULL THEN 'model' END
    FROM best b JOIN placed f ON f.object = b.object_id JOIN semmap.entity e ON e.id = f.id
    JOIN semmap.action a ON a.id = b.action_id
    JOIN semmap.contributor c ON c.id = a.contributor_id LEFT JOIN semmap.world w ON w.entity_id = f.id,
    LATERAL (SELECT CASE WHEN f.frame IS NULL THEN w.pose ELSE semmap.pose_compose(w.pose, f.frame) END AS there) t
    ORDER BY b.expected * coalesce(f.link, 1) DESC, b.action_id, e.name LIMIT most;
END $$;

CREATE FUNCTION entities_named(wanted text)
RETURNS bigint[] LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The entity of a name in the current map; without one, its objects of the type of that name. An error for other names.
DECLARE
    found_id bigint := (SELECT id FROM semmap.entity WHERE map_id = semmap.current_map() AND name = wanted);
BEGIN
    IF found_id IS NOT NULL THEN
        RETURN ARRAY[found_id];
    END IF;
    IF NOT EXISTS (SELECT FROM semmap.semantic_type WHERE name = wanted) THEN
        RAISE EXCEPTION 'the map has neither an entity nor a type named %', wanted
            USING ERRCODE = 'no_data_found', HINT = semmap.name_hint(wanted, semmap.current_map(), types => true);
    END IF;
    RETURN ARRAY(SELECT e.id FROM semmap.entity e WHERE e.map_id = (SELECT semmap.current_map()) AND e.kind = 'object'
                 AND e.type = ANY (semmap.subtypes(wanted)));
END $$;

CREATE FUNCTION entities_for(use text)
RETURNS bigint[] LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The objects of the current map that are used for a function: by their type, or by their object model.
DECLARE
    types text[] := semmap.types_for(use);
    map integer := semmap.current_map();
BEGIN
    IF types = '{}' AND NOT EXISTS (SELECT FROM semmap.object_model WHERE functions @> ARRAY[use]) THEN
        RAISE EXCEPTION 'no type and no object model has the function %', use
            USING ERRCODE = 'no_data_found', HINT = 'SELECT DISTINCT unnest(functions) FROM semmap.semantic_type lists those of types.';
    END IF;
    RETURN ARRAY(SELECT e.id FROM semmap.entity e WHERE e.map_id = map AND e.kind = 'object' AND e.type = ANY (types))
        || ARRAY(SELECT e.id FROM semmap.object_model o JOIN semmap.entity_object h ON h.object_id = o.id
                   JOIN semmap.entity e ON e.id = h.entity_id AND e.map_id = map AND e.kind = 'object'
                 WHERE o.functions @> ARRAY[use] AND (e.type = ANY (types)) IS NOT TRUE);
END $$;

CREATE FUNCTION entity_at(x double precision, y double precision, z double precision, tolerance double precision DEFAULT 0.05)
RETURNS bigint LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The object of the current map at a point: the smallest box that contains it, else the nearest one within the tolerance
-- (metres). An error where there is none.
DECLARE
    found_id bigint;
BEGIN
    SELECT w.entity_id INTO found_id FROM semmap.world w JOIN semmap.entity e ON e.id = w.entity_id
    WHERE w.map_id = (SELECT semmap.current_map()) AND e.kind = 'object' AND w.footprint IS NOT NULL
      AND w.box && semmap.around(x, y, z, tolerance) AND semmap.box_distance(w.box, x, y, z) <= tolerance
    ORDER BY semmap.box_distance(w.box, x, y, z),
             (ST_XMax(w.box) - ST_XMin(w.box)) * (ST_YMax(w.box) - ST_YMin(w.box)) * (ST_ZMax(w.box) - ST_ZMin(w.box)),
             w.entity_id LIMIT 1;
    IF found_id IS NULL THEN
        RAISE EXCEPTION 'the map has no object with geometry within % m of (%, %, %)', tolerance, x, y, z
            USING ERRCODE = 'no_data_found', HINT = 'Widen the tolerance, or correct the point: metres in the map''s frame.';
    END IF;
    RETURN found_id;
END $$;

CREATE FUNCTION objects_like(of_shape text, of_size double precision[], tolerance double precision DEFAULT 0.01)
RETURNS TABLE (object_id bigint, difference double precision) LANGUAGE sql STABLE ROWS 10
BEGIN ATOMIC
-- The object models of a shape whose sizes differ by at most the tolerance each, metres; the most similar first.
SELECT o.id, greatest(abs(o.size[1] - of_size[1]), abs(o.size[2] - of_size[2]), abs(o.size[3] - of_size[3])) AS difference
FROM semmap.object_model o
WHERE o.shape = of_shape AND cardinality(o.size) = cardinality(of_size)
  AND o.size[1] BETWEEN of_size[1] - tolerance AND of_size[1] + tolerance
  AND coalesce(abs(o.size[2] - of_size[2]) <= tolerance, true) AND coalesce(abs(o.size[3] - of_size[3]) <= tolerance, true)
ORDER BY difference, o.id;
END;

CREATE FUNCTION actions_by_shape(of_shape text, of_size double precision[], tolerance double precision DEFAULT 0.01,
                                 gripper text DEFAULT NULL, of_kind text DEFAULT 'grasp', most integer DEFAULT 10)
RETURNS TABLE (action_id bigint, object_id bigint, approach text, family text, expected double precision, pose double precision[],
               pre_pose double precision[], post_pose double precision[], width double precision, posture jsonb,
               pre_posture jsonb, difference double precision)
LANGUAGE plpgsql STABLE ROWS 10 COST 1000 SET search_path = semmap, public, pg_temp AS $$
-- The best stored actions on object models of a similar shape; poses are in the frame of the shape, so that they are
-- valid for an object that nobody has seen before.
DECLARE
    chosen integer := semmap.gripper_named(gripper);
BEGIN
    RETURN QUERY
    WITH alike AS MATERIALIZED (SELECT * FROM semmap.objects_like(of_shape, of_size, tolerance))
    SELECT a.id, a.object_id, a.approach, a.family, a.expected, semmap.pose_compose(f.inverse, a.pose), semmap.pose_compose(f.inverse, a.pre_pose),
           semmap.pose_compose(f.inverse, a.post_pose), a.width, a.posture, a.pre_posture, s.difference
    FROM semmap.best_actions(ARRAY(SELECT l.object_id FROM alike l), chosen, of_kind, most) b
    JOIN semmap.action a ON a.id = b.action_id JOIN alike s ON s.object_id = b.object_id
    JOIN semmap.object_model o ON o.id = b.object_id, LATERAL (SELECT semmap.pose_inverse(o.shape_pose) AS inverse) f
    ORDER BY a.expected DESC, s.difference, a.id;
END $$;

CREATE FUNCTION gripper_likeness(one integer, other integer)
RETURNS double precision LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- How much outcomes of a gripper tell of another one, 0 to 1: by the ratios of their openings, of the depths of their fingers
-- and of the edges of a cube as large as the volume that the fingers pass; 0 for another form.
SELECT CASE WHEN a.form <> b.form THEN 0
            ELSE exp(-(ln(a.opening / b.opening) ^ 2 + ln(greatest(a.depth, 0.005) / greatest(b.depth, 0.005)) ^ 2
                       + coalesce((ln(a.swept / b.swept) / 3) ^ 2, 0)) / 2) END
FROM semmap.gripper a, semmap.gripper b WHERE a.device_id = gripper_likeness.one AND b.device_id = gripper_likeness.other;
END;

CREATE FUNCTION similar_outcomes(object bigint, gripper text, of_kind text DEFAULT 'grasp')
RETURNS TABLE (family text, own boolean, attempts double precision, successes double precision, quality double precision,
               shift double precision[], pose double precision[], width double precision, size double precision[],
               up double precision[], opening double precision, depth double precision) LANGUAGE sql STABLE ROWS 100
BEGIN ATOMIC
-- How often each action succeeded on an object model (`own`) and on those of a similar shape: what was learned from one cylinder
-- is a prior for the next. Outcomes count by the likeness of sizes (their logarithms) and of the axis' uprightness, and by that
-- of the grippers. `pose` and `up`, the vertical of the model, are in the frame of the shape; `opening` and `depth` are the gripper's.
WITH meant AS MATERIALIZED (
    SELECT o.id, o.shape, o.size, abs(1 - 2 * (o.shape_pose[4] ^ 2 + o.shape_pose[5] ^ 2)) AS upright,
           semmap.gripper_named(similar_outcomes.gripper) AS hand
    FROM semmap.object_model o WHERE o.id = similar_outcomes.object
), compared AS (
    SELECT o.id,
           (SELECT sqrt(sum(ln(s.theirs / s.ours) ^ 2)) FROM unnest(o.size, m.size) s (theirs, ours))
               + abs(abs(1 - 2 * (o.shape_pose[4] ^ 2 + o.shape_pose[5] ^ 2)) - m.upright) / 0.3 AS apart
    FROM meant m JOIN semmap.object_model o ON o.shape = m.shape AND o.id <> m.id
         AND o.size[1] BETWEEN m.size[1] / 12 AND m.size[1] * 12
    WHERE EXISTS (SELECT FROM semmap.action t WHERE t.object_id = o.id AND t.kind = of_kind AND t.attempts > 0)
), alike AS (
    (SELECT c.id, exp(-c.apart ^ 2 / 2) AS likeness FROM compared c WHERE c.apart < 2.4 ORDER BY c.apart, c.id LIMIT 200)
    UNION ALL SELECT m.id, 1 FROM meant m
), hands AS MATERIALIZED (
    SELECT g.device_id, g.opening, g.depth, semmap.gripper_likeness(g.device_id, m.hand) AS likeness FROM meant m, semmap.gripper g
)
SELECT a.family, a.object_id = m.id, w.weight * a.attempts, w.weight * a.successes, a.quality, a.shift,
       semmap.pose_compose(f.inverse, a.pose), a.width, o.size,
       semmap.pose_rotate(f.inverse, 0, 0, 1), h.opening, h.depth
FROM meant m, alike l JOIN semmap.object_model o ON o.id = l.id
JOIN semmap.action a ON a.object_id = l.id AND a.attempts > 0 AND a.kind = of_kind JOIN hands h ON h.device_id = a.gripper_id AND h.likeness > 0,
LATERAL (SELECT semmap.pose_inverse(o.shape_pose) AS inverse) f, LATERAL (SELECT l.likeness * h.likeness AS weight) w;
END;

-- Capabilities ------------------------------------------------------------------------------------

CREATE FUNCTION required_capabilities(of_kind text)
RETURNS text[] LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- What an action requires of an automaton, as the ontology states it (requires).
SELECT CASE of_kind WHEN 'push' THEN ARRAY['pushing', 'reaching'] WHEN 'turn' THEN ARRAY['pushing', 'reaching']
                    ELSE ARRAY['gripping', 'reaching'] END;
END;

CREATE FUNCTION missing_capabilities(automaton_name text, of_kind text)
RETURNS text[] LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- What the components of an automaton lack for an action; empty if it is able to do it.
DECLARE
    found text[];
BEGIN
    SELECT array_agg(c) INTO found FROM semmap.automaton a
    JOIN semmap.device d ON d.id IN (a.robot_id, a.gripper_id, a.sensor_id), LATERAL unnest(d.capabilities || ''::text) c
    WHERE a.name = automaton_name;
    IF found IS NULL THEN
        RAISE EXCEPTION 'there is no automaton named %', automaton_name
            USING ERRCODE = 'no_data_found', HINT = semmap.did_you_mean(
                automaton_name, ARRAY(SELECT name FROM semmap.automaton), 'SELECT name FROM semmap.automaton lists them.');
    END IF;
    RETURN ARRAY(SELECT c FROM unnest(semmap.required_capabilities(of_kind)) c WHERE c <> ALL (found));
END $$;

-- Paths -------------------------------------------------------------------------------------------

CREATE FUNCTION path_line()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
BEGIN
    NEW.line := (SELECT ST_MakeLine(ST_MakePoint(NEW.poses[i][1], NEW.poses[i][2], NEW.poses[i][3]) ORDER BY i)
                 FROM generate_subscripts(NEW.poses, 1) i);
    RETURN NEW;
END $$;

CREATE TRIGGER path_line BEFORE INSERT OR UPDATE OF poses ON path FOR EACH ROW EXECUTE FUNCTION path_line();

CREATE FUNCTION pose_turn(a double precision[], b double precision[])
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- The angle between the orientations of two poses, radians.
SELECT 2 * acos(least(1, abs(a[4] * b[4] + a[5] * b[5] + a[6] * b[6] + a[7] * b[7])));
END;

CREATE FUNCTION pose_number(poses double precision[], number integer)
RETURNS double precision[] LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- One pose of an array (n, 7).
SELECT ARRAY(SELECT poses[number][i] FROM generate_series(1, 7) i);
END;

CREATE FUNCTION path_between(automaton_name text, start double precision[], goal double precision[],
                             of_link text DEFAULT '', tolerance double precision DEFAULT 0.01, turn double precision DEFAULT 0.05)
RETURNS bigint LANGUAGE sql STABLE
BEGIN ATOMIC
-- The newest stored path between two poses, within metres and radians. A path is not valid any more once an object has moved,
-- or was added, within its clearance, seen from above.
SELECT p.id FROM semmap.path p JOIN semmap.automaton a ON a.id = p.automaton_id AND a.name = automaton_name,
     LATERAL (SELECT semmap.pose_number(p.poses, 1) AS first, semmap.pose_number(p.poses, array_length(p.poses, 1)) AS last) e
WHERE p.map_id = (SELECT semmap.current_map()) AND p.link = of_link
  AND p.line &&& semmap.around(start[1], start[2], start[3], tolerance)
  AND ST_3DDistance(ST_MakePoint(e.first[1], e.first[2], e.first[3]), ST_MakePoint(start[1], start[2], start[3])) <= tolerance
  AND ST_3DDistance(ST_MakePoint(e.last[1], e.last[2], e.last[3]), ST_MakePoint(goal[1], goal[2], goal[3])) <= tolerance
  AND semmap.pose_turn(e.first, start) <= turn AND semmap.pose_turn(e.last, goal) <= turn
  AND NOT EXISTS (SELECT FROM semmap.world w JOIN semmap.placement m ON m.entity_id = w.entity_id AND m.since > p.at
                  WHERE w.map_id = p.map_id AND w.box && ST_Expand(p.line, p.clearance)
                    AND ST_DWithin(ST_Force2D(p.line), coalesce(w.footprint, ST_Force2D(w.box)), p.clearance))
ORDER BY p.at DESC, p.id DESC LIMIT 1;
END;

-- Outcomes ----------------------------------------------------------------------------------------

CREATE FUNCTION weigh_experience(actions bigint[])
RETURNS void LANGUAGE sql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Sums the attempts of all contributors into the actions, by their trust.
UPDATE semmap.action a SET attempts = s.attempts, successes = s.successes
FROM (SELECT i.id, coalesce(sum(c.trust * e.attempts), 0) AS attempts, coalesce(sum(c.trust * e.successes), 0) AS successes
      FROM (SELECT DISTINCT unnest(actions)) i (id) LEFT JOIN semmap.experience e ON e.action_id = i.id
      LEFT JOIN semmap.contributor c ON c.id = e.contributor_id GROUP BY i.id) s
WHERE a.id = s.id AND (a.attempts, a.successes) IS DISTINCT FROM (s.attempts, s.successes)
$$;

CREATE FUNCTION experience_changed()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    PERFORM semmap.weigh_experience(ARRAY(SELECT action_id FROM changed));
    RETURN NULL;
END $$;

CREATE TRIGGER experience_inserted AFTER INSERT ON experience REFERENCING NEW TABLE AS changed
    FOR EACH STATEMENT EXECUTE FUNCTION experience_changed();
CREATE TRIGGER experience_updated AFTER UPDATE ON experience REFERENCING NEW TABLE AS changed
    FOR EACH STATEMENT EXECUTE FUNCTION experience_changed();
CREATE TRIGGER experience_deleted AFTER DELETE ON experience REFERENCING OLD TABLE AS changed
    FOR EACH STATEMENT EXECUTE FUNCTION experience_changed();

CREATE FUNCTION trust_changed()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    PERFORM semmap.weigh_experience(ARRAY(SELECT e.action_id FROM semmap.experience e WHERE e.contributor_id = NEW.id));
    RETURN NULL;
END $$;

CREATE TRIGGER trust_changed AFTER UPDATE OF trust ON contributor
    FOR EACH ROW WHEN (OLD.trust <> NEW.trust) EXECUTE FUNCTION trust_changed();

CREATE FUNCTION task_stamp()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- An ended task has the time of its end, and stays as it ended.
BEGIN
    IF TG_OP = 'UPDATE' AND OLD.ended_at IS NOT NULL
       AND (NEW.outcome <> OLD.outcome OR NEW.action_id IS NOT NULL AND NEW.action_id IS DISTINCT FROM OLD.action_id) THEN
        RAISE EXCEPTION 'task % has ended: it was %', OLD.id, OLD.outcome
            USING ERRCODE = 'check_violation', HINT = 'Add a task for another attempt.';
    END IF;
    NEW.ended_at := CASE WHEN NEW.outcome IN ('completed', 'error') THEN coalesce(NEW.ended_at, clock_timestamp()) END;
    RETURN NEW;
END $$;

CREATE TRIGGER task_stamp BEFORE INSERT OR UPDATE ON task FOR EACH ROW EXECUTE FUNCTION task_stamp();

CREATE FUNCTION task_ended()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Counts an attempt of the task's action; a composed action that succeeded counts for its steps, too, unless these were
-- tasks of their own since it began.
BEGIN
    INSERT INTO semmap.experience (action_id, contributor_id, attempts, successes)
    SELECT i.id, NEW.contributor_id, 1, (NEW.outcome = 'completed')::integer
    FROM (SELECT NEW.action_id UNION
          SELECT s.step_id FROM semmap.action_step s WHERE s.whole_id = NEW.action_id AND NEW.outcome = 'completed'
            AND NOT EXISTS (SELECT FROM semmap.task t WHERE t.action_id = s.step_id AND t.created_at >= NEW.created_at
                            AND t.entity_id IS NOT DISTINCT FROM NEW.entity_id AND t.robot_id IS NOT DISTINCT FROM NEW.robot_id
                            AND t.ended_at IS NOT NULL)) i (id)
    ON CONFLICT (action_id, contributor_id) DO UPDATE
        SET attempts = experience.attempts + 1, successes = experience.successes + excluded.successes;
    RETURN NULL;
END $$;

CREATE TRIGGER task_inserted AFTER INSERT ON task
    FOR EACH ROW WHEN (NEW.ended_at IS NOT NULL AND NEW.action_id IS NOT NULL) EXECUTE FUNCTION task_ended();
CREATE TRIGGER task_updated AFTER UPDATE ON task
    FOR EACH ROW WHEN (OLD.ended_at IS NULL AND NEW.ended_at IS NOT NULL AND NEW.action_id IS NOT NULL) EXECUTE FUNCTION task_ended();
