-- Layers for QGIS, GDAL and other GIS clients: an integer key, one footprint per entity, editable. Every
-- map is shown: filter on `map` and `storey`.

CREATE VIEW gis_room AS
    SELECT e.id AS fid, m.name AS map, s.name AS storey, e.name, e.type, e.label, r.floor, r.ceiling,
           e.properties::text AS properties, w.footprint AS geom
    FROM entity e JOIN map m ON m.id = e.map_id JOIN room r ON r.entity_id = e.id
    LEFT JOIN world w ON w.entity_id = e.id LEFT JOIN entity s ON s.id = w.storey_id
    WHERE e.kind = 'room';

CREATE VIEW gis_object AS
    SELECT e.id AS fid, m.name AS map, s.name AS storey, h.name AS holder, e.name, e.type, e.label,
           ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high,
           e.properties::text AS properties, w.footprint AS geom
    FROM entity e JOIN map m ON m.id = e.map_id
    LEFT JOIN world w ON w.entity_id = e.id LEFT JOIN entity s ON s.id = w.storey_id
    LEFT JOIN placement p ON p.entity_id = e.id LEFT JOIN entity h ON h.id = p.holder_id
    WHERE e.kind IN ('object', 'agent');

CREATE VIEW gis_region AS
    SELECT e.id AS fid, m.name AS map, s.name AS storey, h.name AS holder, e.name, e.type, e.label,
           ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high, r.origin,
           e.properties::text AS properties, w.footprint AS geom
    FROM entity e JOIN map m ON m.id = e.map_id JOIN region r ON r.entity_id = e.id
    LEFT JOIN world w ON w.entity_id = e.id LEFT JOIN entity s ON s.id = w.storey_id
    LEFT JOIN placement p ON p.entity_id = e.id LEFT JOIN entity h ON h.id = p.holder_id;

-- A connector as the line between its two poses.
CREATE VIEW gis_connector AS
    SELECT e.id AS fid, m.name AS map, s.name AS storey, e.name, e.type, c.form, a.name AS place_a,
           coalesce(b.name, 'outside') AS place_b, c.direction, c.state, c.behaviour, c.width, c.height, c.step,
           array_to_string(c.permissions, ',') AS permissions,
           e.properties::text AS properties,
           ST_MakeLine(ST_MakePoint(pa.pose[1], pa.pose[2]), ST_MakePoint(pb.pose[1], pb.pose[2]))::geometry(LineString, 0) AS geom
    FROM entity e JOIN map m ON m.id = e.map_id JOIN connector c ON c.entity_id = e.id
    JOIN entity a ON a.id = c.place_a LEFT JOIN entity b ON b.id = c.place_b
    LEFT JOIN world w ON w.entity_id = e.id LEFT JOIN entity s ON s.id = w.storey_id
    LEFT JOIN LATERAL (SELECT pose_compose(w.pose, c.pose_a)) pa (pose) ON true
    LEFT JOIN LATERAL (SELECT pose_compose(w.pose, c.pose_b)) pb (pose) ON true;

CREATE FUNCTION gis_changed()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Writes the edits of a GIS client to the map. Attributes that are derived (map, storey,
-- holder, low, high of a mesh) are taken for a new feature and left alone afterwards.
DECLARE
    layer text := substr(TG_TABLE_NAME, 5);
    thing bigint;
    of_map integer;
    below bigint;
    pose double precision[];
    outline geometry;
    shape bigint;
    low double precision := 0;
    high double precision := 0.01;
    drawn boolean;
    reshaped boolean;
    given jsonb;
    old_geom geometry;
BEGIN
    IF TG_OP = 'DELETE' THEN
        DELETE FROM semmap.entity WHERE id = OLD.fid;
        RETURN OLD;
    END IF;

    IF NEW.name IS NULL OR NEW.name = '' THEN
        RAISE EXCEPTION 'a % needs a name', layer USING ERRCODE = 'check_violation', HINT = 'Fill in the attribute name.';
    END IF;
    IF NEW.type IS NOT NULL AND NOT EXISTS (SELECT FROM semmap.semantic_type WHERE name = NEW.type) THEN
        RAISE EXCEPTION 'the T-Box has no type %', NEW.type
            USING ERRCODE = 'foreign_key_violation', HINT = 'SELECT name FROM semmap.semantic_type lists them.';
    END IF;
    BEGIN
        given := coalesce(NULLIF(NEW.properties, ''), '{}')::jsonb;
    EXCEPTION WHEN invalid_text_representation THEN
        RAISE EXCEPTION 'the properties of % are not JSON', NEW.name
            USING ERRCODE = 'check_violation', HINT = 'Write them as an object: {"key": "value"}.';
    END;

    IF layer = 'connector' THEN
        IF TG_OP = 'INSERT' THEN
            RAISE EXCEPTION 'connectors are not drawn in this layer'
                USING ERRCODE = 'feature_not_supported', HINT = 'Draw doors in a GeoPackage or GeoJSON and import it.';
        END IF;
        IF ST_AsBinary(NEW.geom) IS DISTINCT FROM ST_AsBinary(OLD.geom) THEN
            RAISE EXCEPTION 'the line of % follows from its poses', NEW.name
                USING ERRCODE = 'feature_not_supported', HINT = 'Change its attributes here, its place by an import.';
        END IF;
        UPDATE semmap.entity SET name = NEW.name, type = NEW.type, properties = given
            WHERE id = OLD.fid AND (name, type, properties) IS DISTINCT FROM (NEW.name, NEW.type, given);
        UPDATE semmap.connector SET state = NEW.state, direction = NEW.direction, behaviour = NEW.behaviour, width = NEW.width,
               height = NEW.height, step = coalesce(NEW.step, 0),
               permissions = coalesce(regexp_split_to_array(NULLIF(trim(NEW.permissions), ''), '\s*,\s*'), '{}')
            WHERE entity_id = OLD.fid AND (NEW.state, NEW.direction, NEW.behaviour, NEW.width, NEW.height, NEW.step, NEW.permissions)
                  IS DISTINCT FROM (OLD.state, OLD.direction, OLD.behaviour, OLD.width, OLD.height, OLD.step, OLD.permissions);
        RETURN NEW;
    END IF;

    IF layer = 'room' THEN
        low := coalesce(NEW.floor, 0);
        high := coalesce(NEW.ceiling, low + 2.5);
        IF high <= low THEN
            RAISE EXCEPTION 'the ceiling of % is not above its floor', NEW.name
                USING ERRCODE = 'check_violation', HINT = 'Both are heights above the storey, in metres.';
        END IF;
    END IF;

    IF TG_OP = 'INSERT' THEN
        outline := semmap.check_outline(NEW.geom, NEW.name);
        IF NEW.map IS NULL THEN
            of_map := semmap.current_map();
        ELSE
            SELECT id INTO of_map FROM semmap.map WHERE name = NEW.map;
        END IF;
        IF of_map IS NULL THEN
            RAISE EXCEPTION 'there is no map %', coalesce(NEW.map, '')
                USING ERRCODE = 'foreign_key_violation', HINT = 'SELECT name FROM semmap.map lists them.';
        END IF;
        IF NEW.storey IS NOT NULL THEN
            SELECT id INTO below FROM semmap.entity WHERE map_id = of_map AND kind = 'storey' AND name = NEW.storey;
            IF below IS NULL THEN
                RAISE EXCEPTION 'the map has no storey %', NEW.storey
                    USING ERRCODE = 'foreign_key_violation', HINT = 'Leave it empty, or name one of the map''s storeys.';
            END IF;
        END IF;
        IF layer <> 'room' THEN
            IF NEW.high > NEW.low THEN
                low := NEW.low;
                high := NEW.high;
            END IF;
        END IF;
        pose := semmap.planar_pose(ST_X(ST_PointOnSurface(outline)), ST_Y(ST_PointOnSurface(outline)), 0,
                            CASE layer WHEN 'room' THEN 0 ELSE low END);
        INSERT INTO semmap.entity (map_id, kind, name, label, type, properties)
            VALUES (of_map, layer, NEW.name, NEW.label, NEW.type, given) RETURNING id INTO thing;
        IF layer = 'room' THEN
            INSERT INTO semmap.room (entity_id, floor, ceiling) VALUES (thing, low, NEW.ceiling);
        ELSIF layer = 'region' THEN
            INSERT INTO semmap.region (entity_id) VALUES (thing);
        END IF;
        IF layer <> 'room' THEN
            high := high - low;
            low := 0;
        END IF;
        INSERT INTO semmap.entity_model (entity_id, model_id)
            VALUES (thing, semmap.drawn_model(ST_Translate(outline, -pose[1], -pose[2]), low, high));
        IF below IS NOT NULL THEN
            pose := semmap.pose_compose(semmap.pose_inverse((SELECT w.pose FROM semmap.world w WHERE w.entity_id = below)),
                                 ARRAY[pose[1], pose[2], pose[3] + (SELECT w.pose[3] FROM semmap.world w WHERE w.entity_id = below), 0, 0, 0, 1]);
        END IF;
        INSERT INTO semmap.placement (entity_id, holder_id, pose) VALUES (thing, below, pose);
        NEW.fid := thing;
        RETURN NEW;
    END IF;

    thing := OLD.fid;
    UPDATE semmap.entity SET name = NEW.name, type = NEW.type, label = NEW.label, properties = given
        WHERE id = thing AND (name, type, label, properties) IS DISTINCT FROM (NEW.name, NEW.type, NEW.label, given);
    reshaped := ST_AsBinary(NEW.geom) IS DISTINCT FROM ST_AsBinary(OLD.geom);
    IF layer = 'room' THEN
        IF (NEW.floor, NEW.ceiling) IS DISTINCT FROM (OLD.floor, OLD.ceiling) THEN
            UPDATE semmap.room SET floor = low, ceiling = NEW.ceiling WHERE entity_id = thing;
            reshaped := true;
        END IF;
    END IF;
    IF reshaped THEN
        SELECT w.pose, w.footprint INTO pose, old_geom FROM semmap.world w WHERE w.entity_id = thing;
        outline := semmap.check_outline(NEW.geom, NEW.name);
        SELECT bool_and(m.kind = 'polygon') INTO drawn
            FROM semmap.entity_model em JOIN semmap.model m ON m.id = em.model_id WHERE em.entity_id = thing;
        IF drawn OR drawn IS NULL THEN
            IF layer <> 'room' THEN
                SELECT min(ST_ZMin(m.hull)), max(ST_ZMax(m.hull)) INTO low, high
                    FROM semmap.entity_model em JOIN semmap.model m ON m.id = em.model_id WHERE em.entity_id = thing;
                low := coalesce(low, 0);
                high := greatest(coalesce(high, 0.01), low + 0.001);
            END IF;
            IF pose IS NULL THEN
                pose := semmap.planar_pose(ST_X(ST_PointOnSurface(outline)), ST_Y(ST_PointOnSurface(outline)));
                INSERT INTO semmap.placement (entity_id, pose) VALUES (thing, pose);
            END IF;
            shape := semmap.drawn_model(ST_Force2D(semmap.pose_apply(ST_Force3D(outline), semmap.pose_inverse(ARRAY[pose[1], pose[2], 0] || pose[4:7]))), low, high);
            DELETE FROM semmap.entity_model WHERE entity_id = thing AND model_id <> shape;
            INSERT INTO semmap.entity_model (entity_id, model_id) VALUES (thing, shape) ON CONFLICT DO NOTHING;
        ELSIF ST_HausdorffDistance(ST_Translate(old_geom, ST_X(ST_Centroid(outline)) - ST_X(ST_Centroid(old_geom)),
                                                ST_Y(ST_Centroid(outline)) - ST_Y(ST_Centroid(old_geom))), outline) < 1e-3 THEN
            PERFORM semmap.move_to(thing, pose[1] + ST_X(ST_Centroid(outline)) - ST_X(ST_Centroid(old_geom)),
                            pose[2] + ST_Y(ST_Centroid(outline)) - ST_Y(ST_Centroid(old_geom)), pose[3]);
        ELSE
            RAISE EXCEPTION 'the footprint of % follows from its mesh', NEW.name
                USING ERRCODE = 'feature_not_supported', HINT = 'Move the whole feature; its shape changes with its mesh.';
        END IF;
    END IF;
    RETURN NEW;
END $$;

CREATE TRIGGER gis_changed INSTEAD OF INSERT OR UPDATE OR DELETE ON gis_room FOR EACH ROW EXECUTE FUNCTION gis_changed();
CREATE TRIGGER gis_changed INSTEAD OF INSERT OR UPDATE OR DELETE ON gis_object FOR EACH ROW EXECUTE FUNCTION gis_changed();
CREATE TRIGGER gis_changed INSTEAD OF INSERT OR UPDATE OR DELETE ON gis_region FOR EACH ROW EXECUTE FUNCTION gis_changed();
CREATE TRIGGER gis_changed INSTEAD OF INSERT OR UPDATE OR DELETE ON gis_connector FOR EACH ROW EXECUTE FUNCTION gis_changed();
