-- Which map the views show.
-- Why: docs/decisions/the_names_in_functions_are_bound_or_their_search_path_is_fixed.md

CREATE FUNCTION did_you_mean(called text, known text[], otherwise text)
RETURNS text LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The hint of an error about an unknown name: up to three known ones that are spelt like it, the most similar first, with
-- half of their pairs of letters in common; `otherwise` without one.
WITH own AS (
    SELECT DISTINCT substr(lower(called), k, 2) AS pair FROM generate_series(1, length(called) - 1) k
), of_known AS (
    SELECT DISTINCT name, substr(lower(name), k, 2) AS pair FROM unnest(known) name, generate_series(1, length(name) - 1) k
), score AS (
    SELECT name, 2.0 * count(own.pair) / (count(*) + (SELECT count(*) FROM own)) AS likeness
    FROM of_known LEFT JOIN own USING (pair) GROUP BY name
)
SELECT coalesce('Did you mean ' || string_agg(name, ' or ' ORDER BY likeness DESC, name) || '?', otherwise)
FROM (SELECT * FROM score WHERE likeness >= 0.5 ORDER BY likeness DESC, name LIMIT 3) s
$$;

CREATE FUNCTION map_hint(called text)
RETURNS text LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
SELECT semmap.did_you_mean(called, ARRAY(SELECT name FROM semmap.map), 'SELECT name FROM semmap.map lists them.')
$$;

CREATE FUNCTION type_hint(called text)
RETURNS text LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
SELECT semmap.did_you_mean(called, ARRAY(SELECT name FROM semmap.semantic_type), 'SELECT name FROM semmap.semantic_type lists them.')
$$;

CREATE FUNCTION name_hint(called text, map integer, types boolean DEFAULT false)
RETURNS text LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
-- Names of entities, of the first ten thousand, and of types if these are asked for.
SELECT semmap.did_you_mean(called,
    ARRAY(SELECT e.name FROM semmap.entity e WHERE e.map_id = name_hint.map LIMIT 10000)
    || ARRAY(SELECT t.name FROM semmap.semantic_type t WHERE types),
    CASE WHEN types THEN '`semmap ls` and `semmap types` list the names.'
         ELSE '`semmap ls` lists the names; SET semmap.map chooses the map.' END)
$$;

CREATE FUNCTION current_map()
RETURNS integer LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- The map named by the setting `semmap.map` (SET semmap.map = 'office'), else the only one, apart from copies; NULL
-- without maps. Nearly every statement calls it: PL/pgSQL keeps its plan.
DECLARE
    chosen text := current_setting('semmap.map', true);
    found integer;
    maps bigint;
BEGIN
    IF coalesce(chosen, '') <> '' THEN
        SELECT id INTO found FROM semmap.map WHERE name = chosen;
        IF found IS NULL THEN
            RAISE EXCEPTION 'there is no map %', chosen
                USING ERRCODE = 'no_data_found', HINT = semmap.map_hint(chosen);
        END IF;
        RETURN found;
    END IF;
    SELECT count(*), max(id) INTO maps, found FROM (SELECT id FROM semmap.map WHERE copy_of IS NULL LIMIT 2) m;
    IF maps > 1 THEN
        RAISE EXCEPTION 'there are several maps, and none is chosen'
            USING ERRCODE = 'no_data_found', HINT = 'Choose one: SET semmap.map = ''office''.';
    END IF;
    RETURN found;
END $$;

CREATE FUNCTION entity_id(entity_name text)
RETURNS bigint LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- The id of the entity of that name in the current map; an error if there is none, so that a misspelt name
-- does not read as false or as an empty list.
DECLARE
    found_id bigint := (SELECT id FROM semmap.entity WHERE map_id = semmap.current_map() AND name = entity_name);
BEGIN
    IF found_id IS NULL AND entity_name IS NOT NULL THEN
        RAISE EXCEPTION 'the map has no entity named %', entity_name
            USING ERRCODE = 'no_data_found', HINT = semmap.name_hint(entity_name, semmap.current_map());
    END IF;
    RETURN found_id;
END $$;

CREATE FUNCTION copy_map(map_name text, copy_name text)
RETURNS integer LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Copies a map without its history and missions, for a simulated run; returns the id of the copy. Of the fields, it
-- copies the newest versions of those that users stored, and of those that sources provided in the last minute: in
-- the copy they stay. Copies share the meshes. They are deleted with their map.
-- For admins (roles.sql).
DECLARE
    original semmap.map := (SELECT m FROM semmap.map m WHERE name = map_name);
    copied integer;
BEGIN
    IF original.id IS NULL THEN
        RAISE EXCEPTION 'there is no map named %', map_name
            USING ERRCODE = 'no_data_found', HINT = semmap.map_hint(map_name);
    END IF;
    PERFORM set_config('semmap.deriving', 'off', true);
    INSERT INTO semmap.map (name, crs, easting, northing, height, rotation, copy_of)
        VALUES (copy_name, original.crs, original.easting, original.northing, original.height, original.rotation,
                original.id)
        RETURNING id INTO copied;
    INSERT INTO semmap.entity (map_id, kind, name, label, type, properties, front)
        SELECT copied, kind, name, label, type, properties, front FROM semmap.entity WHERE map_id = original.id;
    CREATE TABLE pg_temp.twin AS
        SELECT o.id AS old, n.id AS new FROM semmap.entity o JOIN semmap.entity n ON n.map_id = copied AND n.name = o.name
        WHERE o.map_id = original.id;
    CREATE UNIQUE INDEX ON pg_temp.twin (old);
    ANALYZE pg_temp.twin;
    INSERT INTO semmap.storey (entity_id, elevation, height)
        SELECT t.new, s.elevation, s.height FROM semmap.storey s JOIN pg_temp.twin t ON t.old = s.entity_id;
    INSERT INTO semmap.elevator (entity_id) SELECT t.new FROM semmap.elevator e JOIN pg_temp.twin t ON t.old = e.entity_id;
    INSERT INTO semmap.room (entity_id, floor, ceiling, elevator_id)
        SELECT t.new, r.floor, r.ceiling, l.new
        FROM semmap.room r JOIN pg_temp.twin t ON t.old = r.entity_id LEFT JOIN pg_temp.twin l ON l.old = r.elevator_id;
    INSERT INTO semmap.connector (entity_id, form, place_a, place_b, pose_a, pose_b, direction, state, behaviour, width,
                           height, step, permissions, seen_at)
        SELECT t.new, c.form, a.new, b.new, c.pose_a, c.pose_b, c.direction, c.state, c.behaviour, c.width,
               c.height, c.step, c.permissions, c.seen_at
        FROM semmap.connector c JOIN pg_temp.twin t ON t.old = c.entity_id JOIN pg_temp.twin a ON a.old = c.place_a
        LEFT JOIN pg_temp.twin b ON b.old = c.place_b;
    INSERT INTO semmap.link (from_id, relation, to_id, properties)
        SELECT a.new, l.relation, b.new, l.properties
        FROM semmap.link l JOIN pg_temp.twin a ON a.old = l.from_id JOIN pg_temp.twin b ON b.old = l.to_id;
    INSERT INTO semmap.field (map_id, name, property, about, value_type, voxel_size, edge, version)
        SELECT copied, f.name, f.property, f.about, f.value_type, f.voxel_size, f.edge, 1
        FROM semmap.field f JOIN semmap.field_version v ON v.field_id = f.id AND v.version = f.version
        WHERE f.map_id = original.id AND (v.state IS NULL OR v.state ->> 'of' = 'source' AND EXISTS (
            SELECT FROM semmap.field s JOIN semmap.field_version r ON r.field_id = s.id AND r.version = s.version
            WHERE s.map_id = original.id AND s.property = 'urn:semmap:ontology#provides'
              AND r.state -> 'maps' ? f.name AND r.at >= now() - interval '60 s'));
    INSERT INTO semmap.field_version (field_id, version, at, background, placement, legend, answer)
        SELECT n.id, 1, v.at, v.background, v.placement, v.legend, v.answer
        FROM semmap.field n JOIN semmap.field f ON f.map_id = original.id AND f.name = n.name
        JOIN semmap.field_version v ON v.field_id = f.id AND v.version = f.version WHERE n.map_id = copied;
    INSERT INTO semmap.field_block (field_id, x, y, z, since, digest, bytes)
        SELECT n.id, b.x, b.y, b.z, 1, b.digest, b.bytes
        FROM semmap.field n JOIN semmap.field f ON f.map_id = original.id AND f.name = n.name
        JOIN semmap.field_block b ON b.field_id = f.id AND b.until IS NULL WHERE n.map_id = copied;
    INSERT INTO semmap.placement (entity_id, holder_id, pose, relation, confidence, since)
        SELECT t.new, h.new, p.pose, p.relation, p.confidence, p.since
        FROM semmap.placement p JOIN pg_temp.twin t ON t.old = p.entity_id LEFT JOIN pg_temp.twin h ON h.old = p.holder_id;
    INSERT INTO semmap.entity_model (entity_id, model_id, role)
        SELECT t.new, m.model_id, m.role FROM semmap.entity_model m JOIN pg_temp.twin t ON t.old = m.entity_id;
    INSERT INTO semmap.region (entity_id, of_id, model_id, faces, origin, valid)
        SELECT t.new, o.new, r.model_id, r.faces, r.origin, r.valid
        FROM semmap.region r JOIN pg_temp.twin t ON t.old = r.entity_id LEFT JOIN pg_temp.twin o ON o.old = r.of_id;
    INSERT INTO semmap.triple (map_id, graph, subject, predicate, object, since, until, stated_by)
        SELECT copied, s.graph, CASE WHEN s.subject > 0 THEN a.new ELSE s.subject END, s.predicate,
               CASE WHEN s.object > 0 THEN b.new ELSE s.object END, s.since, s.until, s.stated_by
        FROM semmap.triple s LEFT JOIN pg_temp.twin a ON a.old = s.subject LEFT JOIN pg_temp.twin b ON b.old = s.object
        WHERE s.map_id = original.id;
    INSERT INTO semmap.taught_relation SELECT copied, subject, relation, object FROM semmap.taught_relation WHERE map_id = original.id;
    INSERT INTO semmap.taught_action SELECT copied, action, cause, effect FROM semmap.taught_action WHERE map_id = original.id;
    INSERT INTO semmap.belief_model SELECT copied, there, elsewhere, change, seconds, moves, stated, prior_elsewhere, prior_history, prior_typical, time_zone
        FROM semmap.belief_model WHERE map_id = original.id;
    INSERT INTO semmap.learned_lift (map_id, type, entity_id, about, word, word_id, lift, seen, expected, by_part)
        SELECT copied, l.type, t.new, l.about, l.word, w.new, l.lift, l.seen, l.expected, l.by_part
        FROM semmap.learned_lift l LEFT JOIN pg_temp.twin t ON t.old = l.entity_id LEFT JOIN pg_temp.twin w ON w.old = l.word_id
        WHERE l.map_id = original.id;
    INSERT INTO semmap.detector_rate (map_id, observer_id, within, hit, false_alarm, there, elsewhere)
        SELECT copied, w.new, d.within, d.hit, d.false_alarm, d.there, d.elsewhere
        FROM semmap.detector_rate d LEFT JOIN pg_temp.twin w ON w.old = d.observer_id WHERE d.map_id = original.id;
    INSERT INTO semmap.observation (entity_id, place_id, at, seen, inside, position, visible, hit, false_alarm, observer_id, distance)
        SELECT t.new, p.new, o.at, o.seen, o.inside, o.position, o.visible, o.hit, o.false_alarm, w.new, o.distance
        FROM semmap.observation o JOIN pg_temp.twin t ON t.old = o.entity_id JOIN pg_temp.twin p ON p.old = o.place_id
        LEFT JOIN pg_temp.twin w ON w.old = o.observer_id;
    DROP TABLE pg_temp.twin;
    PERFORM set_config('semmap.deriving', '', true);
    RETURN copied;
END $$;

CREATE FUNCTION drop_map(map_name text)
RETURNS bigint LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Deletes a map and all its rows, table by table, including those that triggers maintain; returns the number
-- of entities. Also deletes the meshes that no entity of another map uses. For admins (roles.sql).
DECLARE
    gone integer;
    n bigint;
BEGIN
    -- An import into another map may use these meshes. As imports do, it takes this lock before all others.
    PERFORM pg_advisory_xact_lock(hashtext('semmap.import'));
    SELECT id INTO gone FROM semmap.map WHERE name = map_name FOR UPDATE;
    IF gone IS NULL THEN
        RAISE EXCEPTION 'there is no map named %', map_name
            USING ERRCODE = 'no_data_found', HINT = semmap.map_hint(map_name);
    END IF;
    PERFORM semmap.drop_map(c.name) FROM semmap.map c WHERE c.copy_of = gone;
    PERFORM set_config('semmap.dropping', 'on', true);
    DELETE FROM semmap.belief b USING semmap.entity e WHERE e.id = b.entity_id AND e.map_id = gone;
    DELETE FROM semmap.observation o USING semmap.entity e WHERE e.id = o.entity_id AND e.map_id = gone;
    DELETE FROM semmap.world WHERE map_id = gone;
    DELETE FROM semmap.placement p USING semmap.entity e WHERE e.id = p.entity_id AND e.map_id = gone;
    DELETE FROM semmap.entity_chunk c USING semmap.entity e WHERE e.id = c.entity_id AND e.map_id = gone;
    DELETE FROM semmap.entity_model m USING semmap.entity e WHERE e.id = m.entity_id AND e.map_id = gone;
    DELETE FROM semmap.object_type WHERE map_id = gone;
    DELETE FROM semmap.entity WHERE map_id = gone;
    GET DIAGNOSTICS n = ROW_COUNT;
    DELETE FROM semmap.placement_history h USING semmap.entity_history e WHERE e.entity_id = h.entity_id AND e.map_id = gone;
    DELETE FROM semmap.entity_history WHERE map_id = gone;
    DELETE FROM semmap.change WHERE map_id = gone;
    DELETE FROM semmap.map WHERE id = gone;
    PERFORM semmap.drop_unused_models();
    PERFORM set_config('semmap.dropping', '', true);
    RETURN n;
END $$;

CREATE FUNCTION drop_unused_models()
RETURNS bigint LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Deletes the meshes that no entity uses; returns how many.
DECLARE
    n bigint;
BEGIN
    DELETE FROM semmap.model m
    WHERE NOT EXISTS (SELECT FROM semmap.entity_model e WHERE e.model_id = m.id)
      AND NOT EXISTS (SELECT FROM semmap.region r WHERE r.model_id = m.id);
    GET DIAGNOSTICS n = ROW_COUNT;
    RETURN n;
END $$;
