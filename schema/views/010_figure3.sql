-- The relations that the statement of Figure 3 (Deeken et al., section 3.5) reads, over the current map.

-- Planning takes most of its time, so the views keep relations few and estimates cheap: the map is a
-- value computed once, a face is placed by a function rather than by two more joins, and what else the
-- planner would weigh is in tables/090_planning.sql.

CREATE VIEW object AS
    SELECT id, label, type, id AS inv_id FROM object_type WHERE map_id = (SELECT current_map());

CREATE VIEW inventory AS
    SELECT holder_id AS inv_id, entity_id AS ob_id FROM placement WHERE holder_id IS NOT NULL;

CREATE VIEW fa_to_ob AS
    SELECT id AS face_id, entity_id AS ob_id FROM entity_chunk;

CREATE FUNCTION placed_chunk(of_entity bigint, of_chunk bigint)
RETURNS geometry LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- A patch of an entity's model, in world coordinates.
DECLARE
    pose double precision[];
    patch geometry;
BEGIN
    SELECT w.pose, c.geom INTO pose, patch
    FROM semmap.world w, semmap.chunk c WHERE w.entity_id = of_entity AND c.id = of_chunk;
    RETURN semmap.pose_apply(patch, pose);
END $$;

-- A patch of triangles in world coordinates: transformed on read.
CREATE VIEW face AS
    SELECT id, placed_chunk(entity_id, chunk_id) AS triangle FROM entity_chunk;

CREATE FUNCTION view_derived()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- PostgreSQL would write through such a view with the rights of its owner.
BEGIN
    RAISE EXCEPTION 'the view % is derived and cannot be written', TG_TABLE_NAME
        USING ERRCODE = 'object_not_in_prerequisite_state', HINT = 'Write the tables entity, placement and entity_model.';
END $$;

CREATE TRIGGER view_derived INSTEAD OF INSERT OR UPDATE OR DELETE ON object FOR EACH ROW EXECUTE FUNCTION view_derived();
CREATE TRIGGER view_derived INSTEAD OF INSERT OR UPDATE OR DELETE ON inventory FOR EACH ROW EXECUTE FUNCTION view_derived();
CREATE TRIGGER view_derived INSTEAD OF INSERT OR UPDATE OR DELETE ON fa_to_ob FOR EACH ROW EXECUTE FUNCTION view_derived();
CREATE TRIGGER view_derived INSTEAD OF INSERT OR UPDATE OR DELETE ON face FOR EACH ROW EXECUTE FUNCTION view_derived();
