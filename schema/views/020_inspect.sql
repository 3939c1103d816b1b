-- Views for a first look at a map.

-- Every entity of the current map, with its position.
CREATE VIEW entry AS
    SELECT e.id, e.kind, e.type, e.name, e.label, h.name AS holder, p.relation, p.confidence, s.name AS storey,
           w.pose[1] AS x, w.pose[2] AS y, w.pose[3] AS z, pose_yaw(w.pose) AS yaw, e.properties
    FROM entity e
    LEFT JOIN placement p ON p.entity_id = e.id
    LEFT JOIN entity h ON h.id = p.holder_id
    LEFT JOIN world w ON w.entity_id = e.id
    LEFT JOIN entity s ON s.id = w.storey_id
    WHERE e.map_id = current_map();

-- Entities of which a part is still empty (section 3.3): what a robot could observe.
CREATE VIEW incomplete AS
    SELECT * FROM (
        SELECT e.id, e.name, e.kind, array_remove(ARRAY[
            CASE WHEN e.kind IN ('room', 'object', 'region', 'agent')
                  AND NOT EXISTS (SELECT FROM entity_model m WHERE m.entity_id = e.id)
                  AND NOT EXISTS (SELECT FROM region r WHERE r.entity_id = e.id AND r.model_id IS NOT NULL)
                 THEN 'geometry' END,
            CASE WHEN e.type IS NULL AND e.kind NOT IN ('storey', 'elevator') THEN 'type' END,
            CASE WHEN p.entity_id IS NULL THEN 'placement' END,
            CASE WHEN e.kind = 'room'
                  AND NOT EXISTS (SELECT FROM connector c WHERE e.id IN (c.place_a, c.place_b))
                 OR e.kind IN ('object', 'region') AND p.holder_id IS NULL
                  AND NOT EXISTS (SELECT FROM link l WHERE e.id IN (l.from_id, l.to_id))
                 THEN 'topology' END], NULL) AS missing
        FROM entity e LEFT JOIN placement p ON p.entity_id = e.id
        WHERE e.map_id = current_map()) parts
    WHERE missing <> '{}';

-- Entities whose type an import guessed from a name. A corrected type is not a guess any more.
CREATE VIEW guessed_type AS
    SELECT e.id, e.name, e.kind, e.type, CAST(e.properties -> 'type_guess' ->> 'confidence' AS real) AS confidence,
           e.properties ->> 'model' AS model
    FROM entity e
    WHERE e.map_id = current_map() AND e.type = e.properties -> 'type_guess' ->> 'type';
CREATE TRIGGER view_derived INSTEAD OF INSERT OR UPDATE OR DELETE ON guessed_type FOR EACH ROW EXECUTE FUNCTION view_derived();
