-- Which map the views show.

CREATE FUNCTION current_map()
RETURNS integer LANGUAGE plpgsql STABLE PARALLEL SAFE AS $$
-- The map named by the setting `semmap.map` (SET semmap.map = 'office'), else the newest one. Nearly
-- every statement calls it: PL/pgSQL keeps its plan, and full names need no search_path.
DECLARE
    chosen text := current_setting('semmap.map', true);
BEGIN
    IF coalesce(chosen, '') = '' THEN
        RETURN (SELECT max(id) FROM semmap.map);
    END IF;
    RETURN (SELECT id FROM semmap.map WHERE name = chosen);
END $$;

CREATE FUNCTION entity_id(entity_name text)
RETURNS bigint LANGUAGE plpgsql STABLE PARALLEL SAFE AS $$
-- The id of the entity of that name in the current map; an error if there is none, so that a misspelt name
-- does not read as false or as an empty list.
DECLARE
    found_id bigint := (SELECT id FROM semmap.entity WHERE map_id = semmap.current_map() AND name = entity_name);
BEGIN
    IF found_id IS NULL AND entity_name IS NOT NULL THEN
        RAISE EXCEPTION 'the map has no entity named %', entity_name
            USING ERRCODE = 'no_data_found', HINT = 'SELECT name FROM entity lists them; SET semmap.map chooses the map.';
    END IF;
    RETURN found_id;
END $$;

CREATE FUNCTION drop_map(map_name text)
RETURNS bigint LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Deletes a map and all its rows, table by table, including those that triggers maintain; returns the number
-- of entities. Also deletes the meshes that no entity of another map uses. For admins (roles.sql).
DECLARE
    gone integer;
    n bigint;
BEGIN
    SELECT id INTO gone FROM map WHERE name = map_name FOR UPDATE;
    IF gone IS NULL THEN
        RAISE EXCEPTION 'there is no map named %', map_name
            USING ERRCODE = 'no_data_found', HINT = 'SELECT name FROM map lists them.';
    END IF;
    PERFORM set_config('semmap.dropping', 'on', true);
    DELETE FROM world WHERE map_id = gone;
    DELETE FROM placement p USING entity e WHERE e.id = p.entity_id AND e.map_id = gone;
    DELETE FROM entity_chunk c USING entity e WHERE e.id = c.entity_id AND e.map_id = gone;
    DELETE FROM entity_model m USING entity e WHERE e.id = m.entity_id AND e.map_id = gone;
    DELETE FROM object_type WHERE map_id = gone;
    DELETE FROM entity WHERE map_id = gone;
    GET DIAGNOSTICS n = ROW_COUNT;
    DELETE FROM placement_history h USING entity_history e WHERE e.entity_id = h.entity_id AND e.map_id = gone;
    DELETE FROM entity_history WHERE map_id = gone;
    DELETE FROM change WHERE map_id = gone;
    DELETE FROM map WHERE id = gone;
    PERFORM drop_unused_models();
    PERFORM set_config('semmap.dropping', '', true);
    RETURN n;
END $$;

CREATE FUNCTION drop_unused_models()
RETURNS bigint LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Deletes the meshes that no entity uses; returns how many.
DECLARE
    n bigint;
BEGIN
    DELETE FROM model m
    WHERE NOT EXISTS (SELECT FROM entity_model e WHERE e.model_id = m.id)
      AND NOT EXISTS (SELECT FROM region r WHERE r.model_id = m.id);
    GET DIAGNOSTICS n = ROW_COUNT;
    RETURN n;
END $$;
