-- Triggers on entities: they maintain the supertypes, the history and the change log.
-- Why: docs/decisions/transition_tables_are_joined_with_full_join.md

CREATE FUNCTION entity_stamp()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
BEGIN
    NEW.since := semmap.next_version(OLD.since);
    RETURN NEW;
END $$;

CREATE FUNCTION entity_typed()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- The foreign key would refuse an unknown type, too, but not say which one was meant.
BEGIN
    IF NOT EXISTS (SELECT FROM semmap.semantic_type WHERE name = NEW.type) THEN
        RAISE EXCEPTION 'the T-Box has no type %', NEW.type
            USING ERRCODE = 'foreign_key_violation', HINT = semmap.type_hint(NEW.type);
    END IF;
    IF NOT semmap.fits_kind(NEW.type, NEW.kind) THEN
        RAISE EXCEPTION '% is of the kind %, and % is a type of another kind', NEW.name, NEW.kind, NEW.type
            USING ERRCODE = 'check_violation', HINT = format('Give a type below %s, or make a new entity.', NEW.kind);
    END IF;
    RETURN NEW;
END $$;

CREATE FUNCTION entity_inserted()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    INSERT INTO semmap.object_type (map_id, type, id, label)
        SELECT n.map_id, s.super, n.id, n.name
        FROM fresh n
        JOIN (SELECT k.type, k.kind, semmap.supertypes(k.type, k.kind) AS super
              FROM (SELECT DISTINCT type, kind FROM fresh) k) s
          ON s.kind = n.kind AND coalesce(s.type, '') = coalesce(n.type, '');
    INSERT INTO semmap.change (map_id, what, entities)
        SELECT map_id, 'added', array_agg(id ORDER BY id) FROM fresh GROUP BY map_id;
    RETURN NULL;
END $$;

CREATE FUNCTION entity_updated()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
DECLARE
    changed bigint[];
    retyped bigint[];
BEGIN
    SELECT array_agg(n.id), array_agg(n.id) FILTER (
               WHERE (o.map_id, o.kind, o.name, o.type) IS DISTINCT FROM (n.map_id, n.kind, n.name, n.type))
        INTO changed, retyped
        FROM former o FULL JOIN fresh n USING (id)  -- full: a cached nested loop would be quadratic
        WHERE coalesce(o.id = n.id, false)
          AND (o.map_id, o.kind, o.name, o.label, o.type, o.properties, o.front)
              IS DISTINCT FROM (n.map_id, n.kind, n.name, n.label, n.type, n.properties, n.front);
    IF changed IS NULL THEN
        RETURN NULL;
    END IF;
    IF EXISTS (SELECT FROM former o FULL JOIN fresh n USING (id)
               WHERE (o.map_id, o.kind) IS DISTINCT FROM (n.map_id, n.kind)) THEN
        RAISE EXCEPTION 'an entity keeps its map and its kind'
            USING ERRCODE = 'check_violation', HINT = 'Delete it and make a new one.';
    END IF;
    INSERT INTO semmap.entity_history (entity_id, map_id, kind, name, label, type, properties, front, during)
        SELECT o.id, o.map_id, o.kind, o.name, o.label, o.type, o.properties, o.front,
               semmap.former_span('semmap.entity_history', o.id, o.since, n.since)
        FROM former o FULL JOIN fresh n USING (id)
        WHERE (o.map_id, o.kind, o.name, o.label, o.type, o.properties, o.front)
              IS DISTINCT FROM (n.map_id, n.kind, n.name, n.label, n.type, n.properties, n.front);
    DELETE FROM semmap.entity_history h USING former o JOIN semmap.retention r ON r.kind = o.kind
        WHERE h.entity_id = o.id AND lower(h.during) < now() - r.keep_for AND upper(h.during) < now() - r.keep_for;
    IF retyped IS NOT NULL THEN
        PERFORM semmap.refresh_object_type(retyped);
        PERFORM semmap.follow_change(ARRAY(
            SELECT n.id FROM former o FULL JOIN fresh n USING (id)
            WHERE o.type IS DISTINCT FROM n.type AND semmap.is_building_part(o.type) <> semmap.is_building_part(n.type)));
    END IF;
    INSERT INTO semmap.change (map_id, what, entities, facts)
        SELECT n.map_id, 'changed', array_agg(n.id ORDER BY n.id), jsonb_build_object('values', jsonb_object_agg(n.id,
               CASE WHEN o.name <> n.name THEN jsonb_build_object('name', jsonb_build_array(o.name, n.name)) ELSE '{}' END
               || CASE WHEN o.type IS DISTINCT FROM n.type THEN jsonb_build_object('type', jsonb_build_array(o.type, n.type)) ELSE '{}' END
               || CASE WHEN o.label IS DISTINCT FROM n.label THEN jsonb_build_object('label', jsonb_build_array(o.label, n.label)) ELSE '{}' END
               || CASE WHEN o.front <> n.front THEN jsonb_build_object('front', jsonb_build_array(o.front, n.front)) ELSE '{}' END
               || CASE WHEN o.properties <> n.properties
                       THEN jsonb_build_object('properties', jsonb_build_array(o.properties, n.properties)) ELSE '{}' END))
        FROM former o FULL JOIN fresh n USING (id) WHERE n.id = ANY (changed) GROUP BY n.map_id;
    RETURN NULL;
END $$;

CREATE FUNCTION entity_deleted()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
DECLARE
    emptied bigint[] := string_to_array(nullif(current_setting('semmap.emptied', true), ''), ',')::bigint[];
BEGIN
    DELETE FROM semmap.object_type t USING former o WHERE t.id = o.id;
    INSERT INTO semmap.entity_history (entity_id, map_id, kind, name, label, type, properties, front, during, ended)
        SELECT id, map_id, kind, name, label, type, properties, front,
               semmap.former_span('semmap.entity_history', id, since, semmap.next_version(since)), true
        FROM former;
    INSERT INTO semmap.change (map_id, what, entities, facts)
        SELECT o.map_id, 'removed', array_agg(o.id ORDER BY o.id), jsonb_build_object('poses', jsonb_agg(
                   jsonb_build_array(o.id, w.pose, NULL, NULL)) FILTER (WHERE w.pose IS NOT NULL))
        -- The foreign key has deleted the placement, not yet what depends on that; placement_deleted adds the holder.
        FROM former o LEFT JOIN semmap.world w ON w.entity_id = o.id GROUP BY o.map_id;
    IF emptied IS NOT NULL THEN
        PERFORM set_config('semmap.emptied', '', true);
        IF current_setting('semmap.deriving', true) IS DISTINCT FROM 'off' THEN
            PERFORM semmap.derive_again(emptied);
        END IF;
    END IF;
    RETURN NULL;
END $$;

CREATE FUNCTION entity_empties()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- When an entity is deleted, its contents get its holder and keep their world poses. Their holders are derived
-- by entity_deleted: here the entity is still there, and the geometry would show it as their holder.
DECLARE
    deriving text := coalesce(current_setting('semmap.deriving', true), '');
    emptied bigint[];
BEGIN
    IF coalesce(current_setting('semmap.dropping', true), '') = '' THEN
        PERFORM set_config('semmap.deriving', 'off', true);
        WITH contents AS (
            UPDATE semmap.placement p
            SET holder_id = h.holder_id, pose = semmap.pose_compose(h.pose, p.pose), relation = 'in'
            FROM semmap.placement h
            WHERE p.holder_id = OLD.id AND h.entity_id = OLD.id
            RETURNING p.entity_id)
        SELECT array_agg(entity_id) INTO emptied FROM contents;
        PERFORM set_config('semmap.deriving', deriving, true);
        PERFORM set_config('semmap.emptied',
            concat_ws(',', nullif(current_setting('semmap.emptied', true), ''), array_to_string(emptied, ',')), true);
    END IF;
    RETURN OLD;
END $$;

CREATE FUNCTION part_gone()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- A connector is deleted with a place that it joins, a region with the room or object that it is a part of: its row by
-- the foreign key, its entity here.
BEGIN
    DELETE FROM semmap.entity e USING former o WHERE e.id = o.entity_id;
    RETURN NULL;
END $$;

CREATE FUNCTION properties_changed()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- A room's heights and a connector's state belong to the entity: record a change of the entity.
BEGIN
    PERFORM semmap.record_change('changed', ARRAY(SELECT entity_id FROM fresh));
    RETURN NULL;
END $$;

CREATE FUNCTION connector_changed()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- As properties_changed, with the former state.
BEGIN
    INSERT INTO semmap.change (map_id, what, entities, facts)
        SELECT e.map_id, 'changed', array_agg(e.id ORDER BY e.id), jsonb_build_object('values', jsonb_object_agg(e.id,
               CASE WHEN o.state = n.state THEN '{}'::jsonb
                    ELSE jsonb_build_object('state', jsonb_build_array(o.state, n.state)) END))
        FROM former o FULL JOIN fresh n USING (entity_id) JOIN semmap.entity e ON e.id = entity_id GROUP BY e.map_id;
    RETURN NULL;
END $$;

CREATE FUNCTION heights_changed()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- A room's floor and ceiling, and which storeys there are, decide what holds an object.
BEGIN
    PERFORM semmap.follow_change(ARRAY(SELECT entity_id FROM fresh));
    RETURN NULL;
END $$;

CREATE FUNCTION details_changed()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- A detail that an entity gets or loses after it was added is a change of the entity.
BEGIN
    PERFORM semmap.record_change('changed', ARRAY(
        SELECT entity_id FROM touched
      EXCEPT
        SELECT unnest(c.entities) FROM semmap.change c WHERE c.xid = pg_current_xact_id()::text::bigint AND c.what = 'added'));
    RETURN NULL;
END $$;

CREATE FUNCTION links_changed()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- A link is a change of the entities that it joins.
BEGIN
    IF coalesce(current_setting('semmap.dropping', true), '') = '' THEN
        PERFORM semmap.record_change('linked', ARRAY(SELECT from_id FROM touched UNION SELECT to_id FROM touched));
    END IF;
    RETURN NULL;
END $$;

CREATE TRIGGER entity_stamp BEFORE UPDATE ON entity
    FOR EACH ROW WHEN (OLD IS DISTINCT FROM NEW) EXECUTE FUNCTION entity_stamp();
CREATE TRIGGER entity_typed BEFORE INSERT OR UPDATE OF type ON entity
    FOR EACH ROW WHEN (NEW.type IS NOT NULL) EXECUTE FUNCTION entity_typed();
CREATE TRIGGER entity_inserted AFTER INSERT ON entity REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION entity_inserted();
CREATE TRIGGER entity_updated AFTER UPDATE ON entity REFERENCING OLD TABLE AS former NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION entity_updated();
CREATE TRIGGER entity_deleted AFTER DELETE ON entity REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION entity_deleted();
CREATE TRIGGER entity_empties BEFORE DELETE ON entity
    FOR EACH ROW EXECUTE FUNCTION entity_empties();
CREATE TRIGGER room_changed AFTER UPDATE ON room REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION properties_changed();
CREATE TRIGGER room_heights_changed AFTER UPDATE ON room REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION heights_changed();
CREATE TRIGGER room_added AFTER INSERT ON room REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION heights_changed();
CREATE TRIGGER storey_added AFTER INSERT ON storey REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION heights_changed();
CREATE TRIGGER room_given AFTER INSERT ON room REFERENCING NEW TABLE AS touched
    FOR EACH STATEMENT EXECUTE FUNCTION details_changed();
CREATE TRIGGER room_taken AFTER DELETE ON room REFERENCING OLD TABLE AS touched
    FOR EACH STATEMENT EXECUTE FUNCTION details_changed();
CREATE TRIGGER storey_given AFTER INSERT ON storey REFERENCING NEW TABLE AS touched
    FOR EACH STATEMENT EXECUTE FUNCTION details_changed();
CREATE TRIGGER storey_taken AFTER DELETE ON storey REFERENCING OLD TABLE AS touched
    FOR EACH STATEMENT EXECUTE FUNCTION details_changed();
CREATE TRIGGER storey_changed AFTER UPDATE ON storey REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION properties_changed();
CREATE TRIGGER region_changed AFTER UPDATE ON region REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION properties_changed();
CREATE TRIGGER connector_changed AFTER UPDATE ON connector REFERENCING OLD TABLE AS former NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION connector_changed();
CREATE TRIGGER link_added AFTER INSERT ON link REFERENCING NEW TABLE AS touched
    FOR EACH STATEMENT EXECUTE FUNCTION links_changed();
CREATE TRIGGER link_removed AFTER DELETE ON link REFERENCING OLD TABLE AS touched
    FOR EACH STATEMENT EXECUTE FUNCTION links_changed();
CREATE TRIGGER connector_gone AFTER DELETE ON connector REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION part_gone();
CREATE TRIGGER region_gone AFTER DELETE ON region REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION part_gone();
