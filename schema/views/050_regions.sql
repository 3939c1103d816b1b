-- Regions that are a subset of a model's faces (section 3.4): just these triangles, in world coordinates,
-- as one TIN. They are where the model's owner is, even while the region itself is put elsewhere.

CREATE VIEW region_face AS
    SELECT e.id, m.name AS map, e.name, e.type, o.name AS of, r.model_id, cardinality(r.faces) AS triangles,
           pose_apply(model_faces(r.model_id, r.faces), w.pose) AS geom
    FROM region r JOIN entity e ON e.id = r.entity_id JOIN map m ON m.id = e.map_id
    LEFT JOIN entity o ON o.id = r.of_id
    JOIN world w ON w.entity_id = coalesce(r.of_id, r.entity_id)
    WHERE r.model_id IS NOT NULL;
