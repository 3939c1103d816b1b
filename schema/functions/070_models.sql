-- Triggers on an entity's models: they maintain its patches of faces, its world box and footprint.

CREATE FUNCTION models_given()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    INSERT INTO semmap.entity_chunk (entity_id, chunk_id)
        SELECT n.entity_id, c.id FROM fresh n JOIN semmap.chunk c ON c.model_id = n.model_id
        WHERE n.role = 'visual'
           OR NOT EXISTS (SELECT FROM semmap.entity_model v WHERE v.entity_id = n.entity_id AND v.role = 'visual');
    PERFORM semmap.reshape(ARRAY(SELECT DISTINCT entity_id FROM fresh));
    RETURN NULL;
END $$;

CREATE FUNCTION models_taken()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    DELETE FROM semmap.entity_chunk e USING former o, semmap.chunk c
        WHERE e.entity_id = o.entity_id AND c.id = e.chunk_id AND c.model_id = o.model_id;
    PERFORM semmap.reshape(ARRAY(SELECT DISTINCT entity_id FROM former));
    RETURN NULL;
END $$;

CREATE FUNCTION models_exchanged()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
DECLARE
    ids bigint[] := ARRAY(SELECT entity_id FROM former UNION SELECT entity_id FROM fresh);
BEGIN
    DELETE FROM semmap.entity_chunk WHERE entity_id = ANY (ids);
    INSERT INTO semmap.entity_chunk (entity_id, chunk_id)
        SELECT em.entity_id, c.id FROM semmap.entity_model em JOIN semmap.chunk c ON c.model_id = em.model_id
        WHERE em.entity_id = ANY (ids)
          AND (em.role = 'visual'
               OR NOT EXISTS (SELECT FROM semmap.entity_model v WHERE v.entity_id = em.entity_id AND v.role = 'visual'));
    PERFORM semmap.reshape(ids);
    RETURN NULL;
END $$;

CREATE FUNCTION reshape(ids bigint[])
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Updates the world box and footprint of placed entities whose models changed.
DECLARE
    placed bigint[];
    holders bigint[];
BEGIN
    IF current_setting('semmap.deriving', true) IS DISTINCT FROM 'off'
       AND EXISTS (SELECT FROM semmap.placement WHERE holder_id = ANY (ids)) THEN
        -- The contents can get other holders: they are locked before what holds them.
        PERFORM semmap.queue_writer();
        PERFORM FROM semmap.placement WHERE holder_id = ANY (ids) ORDER BY entity_id FOR NO KEY UPDATE;
    END IF;
    SELECT array_agg(entity_id), array_agg(DISTINCT holder_id) INTO placed, holders
        FROM (SELECT entity_id, holder_id FROM semmap.placement WHERE entity_id = ANY (ids)
              ORDER BY entity_id FOR NO KEY UPDATE) locked;
    PERFORM semmap.lock_holders(holders);
    IF placed IS NOT NULL THEN
        PERFORM semmap.refresh_world(placed);
        PERFORM semmap.record_change('reshaped', placed);
        PERFORM semmap.follow_change(placed);
    END IF;
END $$;

CREATE TRIGGER models_given AFTER INSERT ON entity_model REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION models_given();
CREATE TRIGGER models_exchanged AFTER UPDATE ON entity_model REFERENCING OLD TABLE AS former NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION models_exchanged();
CREATE TRIGGER models_taken AFTER DELETE ON entity_model REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION models_taken();

CREATE FUNCTION models_edited()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- A model that entities have is edited by hand: they are reshaped.
BEGIN
    IF TG_TABLE_NAME = 'model' THEN
        PERFORM semmap.reshape(ARRAY(SELECT DISTINCT em.entity_id FROM former o JOIN semmap.entity_model em ON em.model_id = o.id));
    ELSE
        PERFORM semmap.reshape(ARRAY(SELECT DISTINCT em.entity_id FROM former o JOIN semmap.entity_model em ON em.model_id = o.model_id));
    END IF;
    RETURN NULL;
END $$;

CREATE TRIGGER models_edited AFTER UPDATE ON model REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION models_edited();
CREATE TRIGGER patches_edited AFTER UPDATE ON chunk REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION models_edited();
CREATE TRIGGER patches_taken AFTER DELETE ON chunk REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION models_edited();

CREATE FUNCTION surfaces_found()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- What lies on a level patch stands on it.
BEGIN
    PERFORM semmap.follow_change(ARRAY(SELECT DISTINCT em.entity_id FROM fresh JOIN semmap.entity_model em USING (model_id)));
    RETURN NULL;
END $$;

CREATE TRIGGER surfaces_found AFTER INSERT ON support_surface REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION surfaces_found();
