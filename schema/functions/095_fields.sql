-- Changes of fields: rows of the change log without entities, so that followers of a map read fields again.

CREATE FUNCTION field_stored()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- The state of a mirror is not a field.
BEGIN
    INSERT INTO semmap.change (map_id, what, entities)
        SELECT DISTINCT f.map_id, 'field', '{}'::bigint[]
        FROM stored s JOIN semmap.field f ON f.id = s.field_id WHERE s.state IS NULL;
    RETURN NULL;
END $$;

CREATE TRIGGER field_stored AFTER INSERT ON field_version REFERENCING NEW TABLE AS stored
    FOR EACH STATEMENT EXECUTE FUNCTION field_stored();

CREATE FUNCTION field_forgotten()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    INSERT INTO semmap.change (map_id, what, entities)
        SELECT DISTINCT m.id, 'field', '{}'::bigint[] FROM forgotten f JOIN semmap.map m ON m.id = f.map_id;
    RETURN NULL;
END $$;

CREATE TRIGGER field_forgotten AFTER DELETE ON field REFERENCING OLD TABLE AS forgotten
    FOR EACH STATEMENT EXECUTE FUNCTION field_forgotten();
