-- Teachings that are taken back.
-- Why: docs/decisions/the_names_in_functions_are_bound_or_their_search_path_is_fixed.md

CREATE FUNCTION is_used(of_table text, key jsonb)
RETURNS boolean LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
-- Whether a row that was taught is used by others: a type by entities,
-- types or teachings, an entity by what was seen of it, numbers of beliefs beside a time zone.
SELECT CASE of_table
    WHEN 'semantic_type' THEN
        EXISTS (SELECT FROM semmap.entity e WHERE e.type = key ->> 'name')
        OR EXISTS (SELECT FROM semmap.type_parent p WHERE p.parent = key ->> 'name')
        OR EXISTS (SELECT FROM semmap.taught_relation r WHERE key ->> 'name' IN (r.subject, r.object))
        OR EXISTS (SELECT FROM semmap.taught_action a WHERE key ->> 'name' IN (a.cause, a.effect))
    WHEN 'entity' THEN
        EXISTS (SELECT FROM semmap.observation o WHERE (key ->> 'id')::bigint IN (o.entity_id, o.place_id))
        OR EXISTS (SELECT FROM semmap.placement p WHERE (key ->> 'id')::bigint IN (p.entity_id, p.holder_id))
    WHEN 'belief_model' THEN
        EXISTS (SELECT FROM semmap.belief_model m WHERE m.map_id = (key ->> 'map_id')::integer AND m.time_zone <> 'UTC')
    ELSE false END
$$;

CREATE FUNCTION undo_teaching(taken bigint)
RETURNS text[] LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Takes a teaching back, row by row, those first that it changed last: each value is again what it was before. What a later
-- teaching states, too, is that one's from now on. A value that was changed since stays, and so does a row that others use:
-- these are returned.
DECLARE
    changed record;          -- a row, by its table and key
    fact record;             -- of the row: what was there before the teaching, and since
    same text;               -- the condition that a row t has the key k
    there jsonb;             -- the row as it is
    held jsonb;              -- of it what was taught
    gone boolean;            -- the teaching added the row
    restored jsonb;          -- columns with their former values
    described jsonb;         -- properties with their former values
    unknown text[];          -- properties that it had or did not have before
    kept text[] := '{}';
BEGIN
    FOR changed IN SELECT f.of_table, f.key FROM semmap.taught_fact f WHERE f.teaching_id = taken
                   GROUP BY f.of_table, f.key ORDER BY min(f.id) DESC LOOP
        same := (SELECT string_agg(format('t.%1$I = k.%1$I', name), ' AND ') FROM jsonb_object_keys(changed.key) name);
        EXECUTE format('SELECT to_jsonb(t) FROM semmap.%1$I t, jsonb_populate_record(NULL::semmap.%1$I, $1) k WHERE %2$s',
                       changed.of_table, same) INTO there USING changed.key;
        gone := false;
        restored := '{}';
        described := '{}';
        unknown := '{}';
        FOR fact IN SELECT f.what, (array_agg(f.former ORDER BY f.id))[1] AS former, (array_agg(f.taught ORDER BY f.id DESC))[1] AS taught
                    FROM semmap.taught_fact f WHERE f.teaching_id = taken AND (f.of_table, f.key) = (changed.of_table, changed.key)
                    GROUP BY f.what LOOP
            UPDATE semmap.taught_fact f SET former = fact.former WHERE f.id = (
                SELECT n.id FROM semmap.taught_fact n WHERE n.teaching_id > taken
                AND (n.of_table, n.key, n.what) = (changed.of_table, changed.key, fact.what) ORDER BY n.teaching_id, n.id LIMIT 1);
            CONTINUE WHEN FOUND OR fact.former = fact.taught;
            held := CASE WHEN there IS NOT NULL THEN (
                SELECT coalesce(jsonb_object_agg(name, coalesce(CASE WHEN fact.what LIKE 'properties.%' THEN there -> 'properties' ELSE there END -> name, 'null')), '{}')
                FROM jsonb_object_keys(coalesce(fact.taught, fact.former)) name) END;
            IF held IS DISTINCT FROM fact.taught OR fact.what = '' AND semmap.is_used(changed.of_table, changed.key) THEN
                kept := kept || concat_ws(' ', changed.of_table, coalesce(there ->> 'name', changed.key::text), nullif(fact.what, ''));
            ELSIF fact.former IS NULL THEN
                gone := true;
            ELSIF fact.what LIKE 'properties.%' THEN
                unknown := unknown || substr(fact.what, length('properties.') + 1);
                described := described || fact.former;
            ELSE
                restored := restored || fact.former;
            END IF;
        END LOOP;
        IF gone THEN
            EXECUTE format('DELETE FROM semmap.%1$I t USING jsonb_populate_record(NULL::semmap.%1$I, $1) k WHERE %2$s',
                           changed.of_table, same) USING changed.key;
        ELSIF there IS NULL AND restored <> '{}' THEN
            EXECUTE format('INSERT INTO semmap.%1$I (%2$s) SELECT %2$s FROM jsonb_populate_record(NULL::semmap.%1$I, $1)', changed.of_table,
                           (SELECT string_agg(format('%I', name), ', ') FROM jsonb_object_keys(changed.key || restored) name))
                USING changed.key || restored;
        ELSIF restored <> '{}' THEN
            EXECUTE format('UPDATE semmap.%1$I t SET %3$s FROM jsonb_populate_record(NULL::semmap.%1$I, $1) k,
                            jsonb_populate_record(NULL::semmap.%1$I, $2) n WHERE %2$s', changed.of_table, same,
                           (SELECT string_agg(format('%1$I = n.%1$I', name), ', ') FROM jsonb_object_keys(restored) name))
                USING changed.key, restored;
        END IF;
        IF unknown <> '{}' AND NOT gone THEN
            EXECUTE format('UPDATE semmap.%1$I t SET properties = (t.properties - $2) || $3
                            FROM jsonb_populate_record(NULL::semmap.%1$I, $1) k WHERE %2$s', changed.of_table, same)
                USING changed.key, unknown, described;
        END IF;
    END LOOP;
    DELETE FROM semmap.teaching WHERE id = taken;
    RETURN kept;
END $$;

-- Changes are noted while the setting semmap.teaching has the id of a teaching that this login began in this transaction.
CREATE FUNCTION note_taught()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Notes a change of a row; the arguments are the columns of its key, and those that teachings change. A placement is noted as a
-- whole: what it was at first, and what it is now.
DECLARE
    own bigint := (SELECT t.id FROM semmap.teaching t WHERE t.id::text = current_setting('semmap.teaching', true)
                   AND t.at >= now() AND t.by = semmap.caller());
    columns text[] := string_to_array(TG_ARGV[1], ',');
    was jsonb := CASE WHEN TG_OP <> 'INSERT' THEN to_jsonb(OLD) END;
    fresh jsonb := CASE WHEN TG_OP <> 'DELETE' THEN to_jsonb(NEW) END;
    row_key jsonb := (SELECT jsonb_object_agg(name, coalesce(fresh, was) -> name) FROM unnest(string_to_array(TG_ARGV[0], ',')) name);
BEGIN
    IF own IS NULL THEN
        RETURN NULL;
    ELSIF TG_OP = 'UPDATE' AND TG_TABLE_NAME <> 'placement' THEN
        INSERT INTO semmap.taught_fact (teaching_id, of_table, key, what, former, taught)
            SELECT own, TG_TABLE_NAME, row_key, name, jsonb_build_object(name, was -> name), jsonb_build_object(name, fresh -> name)
            FROM unnest(columns) name WHERE name <> 'properties' AND was -> name <> fresh -> name
          UNION ALL
            SELECT own, TG_TABLE_NAME, row_key, 'properties.' || p.key,
                   CASE WHEN was -> 'properties' ? p.key THEN jsonb_build_object(p.key, was -> 'properties' -> p.key) ELSE '{}' END,
                   jsonb_build_object(p.key, p.value)
            FROM jsonb_each(fresh -> 'properties') p
            WHERE 'properties' = ANY (columns) AND was -> 'properties' -> p.key IS DISTINCT FROM p.value;
        RETURN NULL;
    END IF;
    was := (SELECT jsonb_object_agg(name, was -> name) FROM unnest(columns) name WHERE was IS NOT NULL);
    fresh := CASE WHEN TG_TABLE_NAME <> 'placement' AND fresh IS NOT NULL THEN '{}'
             ELSE (SELECT jsonb_object_agg(name, fresh -> name) FROM unnest(columns) name WHERE fresh IS NOT NULL) END;
    UPDATE semmap.taught_fact f SET taught = fresh
        WHERE f.teaching_id = own AND (f.of_table, f.key, f.what) = (TG_TABLE_NAME, row_key, '') AND f.former IS DISTINCT FROM f.taught;
    IF NOT FOUND THEN
        INSERT INTO semmap.taught_fact (teaching_id, of_table, key, what, former, taught) VALUES (own, TG_TABLE_NAME, row_key, '', was, fresh);
    END IF;
    RETURN NULL;
END $$;

DO $$
DECLARE
    noted record;
BEGIN
    FOR noted IN VALUES
        ('semantic_type', 'name', 'properties'),
        ('type_parent', 'type,parent', 'type,parent'),
        ('entity', 'id', 'type,properties'),
        ('link', 'from_id,relation,to_id', 'properties'),
        ('placement', 'entity_id', 'holder_id,pose,relation,confidence'),
        ('observation', 'id', 'entity_id,place_id,at,seen,inside,position,visible,hit,false_alarm,observer_id'),
        ('taught_relation', 'map_id,subject,relation,object', 'map_id'),
        ('taught_action', 'map_id,action,cause,effect', 'map_id'),
        ('belief_model', 'map_id', 'there,elsewhere,change,seconds,moves,stated,prior_elsewhere,prior_history,prior_typical') LOOP
        EXECUTE format($trigger$
            CREATE TRIGGER note_taught AFTER INSERT OR UPDATE OR DELETE ON semmap.%I FOR EACH ROW
            WHEN (current_setting('semmap.teaching', true) <> '') EXECUTE FUNCTION semmap.note_taught(%L, %L)
            $trigger$, noted.column1, noted.column2, noted.column3);
    END LOOP;
END $$;
