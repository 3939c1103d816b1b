-- The relations that the statement of Figure 3 (Deeken et al., section 3.5) asks, over the current map.

CREATE VIEW object AS
    SELECT id, label, type, id AS inv_id FROM object_type WHERE map_id = current_map();

CREATE VIEW inventory AS
    SELECT holder_id AS inv_id, entity_id AS ob_id FROM placement WHERE holder_id IS NOT NULL;

CREATE VIEW fa_to_ob AS
    SELECT id AS face_id, entity_id AS ob_id FROM entity_chunk;

-- A patch of triangles in world coordinates: transformed on read.
CREATE VIEW face AS
    SELECT ec.id,
           pose_apply(c.geom, coalesce((SELECT w.pose FROM world w WHERE w.entity_id = ec.entity_id),
                                       '{0,0,0,0,0,0,1}')) AS triangle
    FROM entity_chunk ec JOIN chunk c ON c.id = ec.chunk_id;
