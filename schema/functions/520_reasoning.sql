-- Inferences that change are a change of the map: standing queries look again.

CREATE FUNCTION inferences_changed()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    INSERT INTO change (map_id, what, entities) VALUES (NEW.map_id, 'statement', '{}');
    RETURN NULL;
END $$;

CREATE TRIGGER inferences_changed AFTER UPDATE OF changed ON reasoning
    FOR EACH ROW WHEN (OLD.changed IS DISTINCT FROM NEW.changed) EXECUTE FUNCTION inferences_changed();
