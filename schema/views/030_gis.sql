-- Layers for QGIS, GDAL and other GIS clients: an integer key, one footprint per entity, editable. Every
-- map is shown: filter on `map` and `storey`.

-- Floor and ceiling are above the storey of the room, wherever its own frame is.
CREATE VIEW gis_room AS
    SELECT e.id AS fid, m.name AS map, s.name AS storey, e.name, e.type, e.label,
           round((r.floor + a.height)::numeric, 9)::double precision AS floor,
           round((r.ceiling + a.height)::numeric, 9)::double precision AS ceiling,
           e.properties::text AS properties, w.footprint AS geom
    FROM entity e JOIN map m ON m.id = e.map_id JOIN room r ON r.entity_id = e.id
    LEFT JOIN world w ON w.entity_id = e.id LEFT JOIN entity s ON s.id = w.storey_id LEFT JOIN world sw ON sw.entity_id = s.id
    CROSS JOIN LATERAL (SELECT coalesce(w.pose[3], 0) - coalesce(sw.pose[3], 0)) a (height)
    WHERE e.kind = 'room';

-- Walls by their section. heading_deg, as in map features, is that of the object's x axis, degrees counterclockwise from
-- the map's x axis.
CREATE VIEW gis_object AS
    SELECT e.id AS fid, m.name AS map, s.name AS storey, h.name AS holder, e.name, e.type, e.label,
           ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high,
           round(degrees(pose_yaw(w.pose))::numeric, 6)::double precision AS heading_deg,
           EXISTS (SELECT FROM type_closure t WHERE t.sub = e.type AND t.super = 'building_element') AS structure,
           e.properties::text AS properties,
           coalesce(placed_section(c.outline, w.pose), w.footprint)::geometry(MultiPolygon, 0) AS geom
    FROM entity e JOIN map m ON m.id = e.map_id
    LEFT JOIN world w ON w.entity_id = e.id LEFT JOIN entity s ON s.id = w.storey_id
    LEFT JOIN placement p ON p.entity_id = e.id LEFT JOIN entity h ON h.id = p.holder_id
    LEFT JOIN section c ON c.entity_id = e.id
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
    LEFT JOIN world w ON w.entity_id = e.id LEFT JOIN world aw ON aw.entity_id = a.id
    LEFT JOIN entity s ON s.id = coalesce(w.storey_id, aw.storey_id)
    LEFT JOIN LATERAL (SELECT pose_compose(w.pose, c.pose_a)) pa (pose) ON true
    LEFT JOIN LATERAL (SELECT pose_compose(w.pose, c.pose_b)) pb (pose) ON true;

-- The connectors through which nobody gets from room to room, as what follows their names.
CREATE VIEW door_faults AS
    SELECT e.id, e.map_id, e.name, f.fault
    FROM connector c JOIN entity e ON e.id = c.entity_id JOIN world w ON w.entity_id = e.id
    CROSS JOIN LATERAL door_fault(c.form, c.width, opening_of(w.pose, c.width), ARRAY[c.place_a, c.place_b]) f (fault)
    WHERE f.fault IS NOT NULL;

-- A storey as the union of its rooms, else of all that is on it.
CREATE VIEW gis_storey AS
    SELECT e.id AS fid, m.name AS map, e.name, e.type, e.label, s.elevation, s.height, e.properties::text AS properties,
           o.outline::geometry(MultiPolygon, 0) AS geom
    FROM entity e JOIN map m ON m.id = e.map_id JOIN storey s ON s.entity_id = e.id
    CROSS JOIN LATERAL (
        SELECT ST_Multi(coalesce(ST_Union(w.footprint, 1e-6) FILTER (WHERE i.kind = 'room'), ST_ConvexHull(ST_Collect(w.footprint))))
        FROM world w JOIN entity i ON i.id = w.entity_id WHERE w.storey_id = e.id) o (outline);

-- The types that an entity of a kind may have: the value list of a GIS client.
CREATE VIEW gis_type AS
    SELECT row_number() OVER (ORDER BY k.kind, t.name) AS fid, k.kind, t.name, coalesce(t.label, t.name) AS label
    FROM (VALUES ('room', 'room'), ('object', 'object'), ('region', 'region'), ('connector', 'connector'), ('storey', 'storey')) k (kind, top)
    JOIN type_closure c ON c.super = k.top JOIN semantic_type t ON t.name = c.sub;

CREATE FUNCTION map_named(called text)
RETURNS integer LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The map of a name; the current one without a name.
DECLARE
    of_map integer := CASE WHEN called IS NULL THEN semmap.current_map() ELSE (SELECT id FROM semmap.map WHERE name = called) END;
BEGIN
    IF of_map IS NULL THEN
        RAISE EXCEPTION 'there is no map %', coalesce(called, '')
            USING ERRCODE = 'foreign_key_violation', HINT = semmap.map_hint(called);
    END IF;
    RETURN of_map;
END $$;

CREATE FUNCTION storey_named(of_map integer, called text)
RETURNS bigint LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The storey of a name; null without a name.
DECLARE
    below bigint := (SELECT id FROM semmap.entity WHERE map_id = of_map AND kind = 'storey' AND name = called);
BEGIN
    IF below IS NULL AND called IS NOT NULL THEN
        RAISE EXCEPTION 'the map has no storey %', called
            USING ERRCODE = 'foreign_key_violation', HINT = 'Leave it empty, or name one of the map''s storeys.';
    END IF;
    RETURN below;
END $$;

CREATE FUNCTION turned_by(former geometry, outline geometry)
RETURNS double precision LANGUAGE sql IMMUTABLE
BEGIN ATOMIC
-- The angle by which an outline was turned about its middle, and otherwise only shifted; null if its shape changed. A
-- client that moves a feature keeps the order of its corners.
SELECT t.angle
FROM (SELECT ST_Azimuth(ST_Centroid(outline), ST_PointN(ST_ExteriorRing(ST_GeometryN(outline, 1)), 1))
           - ST_Azimuth(ST_Centroid(former), ST_PointN(ST_ExteriorRing(ST_GeometryN(former, 1)), 1))) c (clockwise),
     -- first as the corners show it: a square looks the same when it is turned by a right angle
     LATERAL (VALUES (1, CASE WHEN abs(sin(c.clockwise / 2)) < 1e-6 THEN 0.0 ELSE -c.clockwise END), (2, 0.0)) t (rank, angle)
WHERE ST_HausdorffDistance(
    ST_Translate(ST_Rotate(former, t.angle, ST_Centroid(former)), ST_X(ST_Centroid(outline)) - ST_X(ST_Centroid(former)),
                 ST_Y(ST_Centroid(outline)) - ST_Y(ST_Centroid(former))), outline) < 1e-3
ORDER BY t.rank LIMIT 1;
END;

CREATE FUNCTION put_door(thing bigint, of_map integer, on_storey bigint, whose text, line geometry)
RETURNS void LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Puts a door where a line is drawn: from where a robot faces it in its first room to where it does in its second, or
-- outside. Makes its row where there is none.
DECLARE
    half double precision := ST_Length(line) / 2;
    middle geometry := ST_LineInterpolatePoint(line, 0.5);
    heading double precision := pi() / 2 - ST_Azimuth(ST_StartPoint(line), ST_EndPoint(line));
    rooms bigint[];
    storey_of bigint;
    height double precision;
    wide double precision;
    away double precision;
BEGIN
    IF ST_NumPoints(line) <> 2 OR NOT 2 * half BETWEEN 0.2 AND 5 THEN
        RAISE EXCEPTION 'the line of % is not one straight line of 0.2 to 5 m', whose
            USING ERRCODE = 'check_violation', HINT = 'Draw it through the door, from one room to the other.';
    END IF;
    SELECT array_agg((SELECT r.entity_id FROM semmap.room r JOIN semmap.world w ON w.entity_id = r.entity_id
                      WHERE w.map_id = of_map AND ST_Covers(w.footprint, e.geom) AND (on_storey IS NULL OR w.storey_id = on_storey)
                      ORDER BY w.pose[3] + r.floor, r.entity_id LIMIT 1) ORDER BY e.path) INTO rooms
        FROM ST_DumpPoints(line) e;
    IF rooms[1] IS NULL THEN
        rooms := ARRAY[rooms[2], rooms[1]];
        heading := heading + pi();
    END IF;
    IF rooms[1] IS NULL OR rooms[1] IS NOT DISTINCT FROM rooms[2] THEN
        RAISE EXCEPTION '% does not join two rooms', whose
            USING ERRCODE = 'check_violation', HINT = 'Draw its line from one room into another of the storey, or outside.';
    END IF;
    SELECT max(ST_Distance(w.footprint, middle)) INTO away FROM semmap.world w WHERE w.entity_id = ANY (rooms);
    IF away > semmap.door_reach(semmap.opening_of(semmap.planar_pose(ST_X(middle), ST_Y(middle), heading), 0.2), rooms) THEN
        RAISE EXCEPTION 'the middle of % is % m beside a room that it joins', whose, round(away::numeric, 2)
            USING ERRCODE = 'check_violation', HINT = 'Draw its line as far into the one room as into the other, so that the door is in their wall.';
    END IF;
    SELECT w.storey_id, w.pose[3] + r.floor INTO storey_of, height
        FROM semmap.world w JOIN semmap.room r ON r.entity_id = w.entity_id WHERE w.entity_id = rooms[1];
    INSERT INTO semmap.connector (entity_id, place_a, place_b, pose_a, pose_b)
        VALUES (thing, rooms[1], rooms[2], semmap.planar_pose(-half, 0), semmap.planar_pose(half, 0, pi()))
        ON CONFLICT (entity_id) DO UPDATE
        SET place_a = excluded.place_a, place_b = excluded.place_b, pose_a = excluded.pose_a, pose_b = excluded.pose_b;
    IF EXISTS (SELECT FROM semmap.placement WHERE entity_id = thing) THEN
        PERFORM semmap.move_to(thing, ST_X(middle), ST_Y(middle), height, heading);
    ELSE
        INSERT INTO semmap.placement (entity_id, holder_id, pose)
            SELECT thing, storey_of, CASE WHEN storey_of IS NULL THEN d.pose
                ELSE semmap.pose_compose(semmap.pose_inverse((SELECT w.pose FROM semmap.world w WHERE w.entity_id = storey_of)), d.pose) END
            FROM (SELECT semmap.planar_pose(ST_X(middle), ST_Y(middle), heading, height)) d (pose);
    END IF;
END $$;

CREATE FUNCTION refuse_derived(layer text, whose text, edited text[])
RETURNS void LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- An error for the first edited attribute that is derived: the edit would change nothing.
DECLARE
    attribute text;
BEGIN
    FOREACH attribute IN ARRAY edited LOOP
        RAISE EXCEPTION '% of % is not changed here: %', attribute, whose, CASE
                WHEN attribute IN ('fid', 'map') THEN 'a feature keeps its key and its map'
                WHEN attribute IN ('storey', 'holder', 'place_a', 'place_b') THEN 'it follows from where the feature is'
                WHEN attribute = 'structure' THEN 'it follows from the type'
                WHEN attribute IN ('low', 'high') THEN 'it follows from the mesh'
                ELSE 'the map derives it' END
            USING ERRCODE = 'feature_not_supported', HINT = CASE
                WHEN attribute IN ('fid', 'map') THEN 'Draw it in the other map.'
                WHEN attribute IN ('storey', 'holder', 'place_a', 'place_b') THEN 'Move the feature.'
                WHEN attribute = 'structure' THEN 'Change the type.'
                ELSE 'Leave it as it is.' END;
    END LOOP;
END $$;

CREATE FUNCTION broken_rule(rule text, whose text, told text)
RETURNS text LANGUAGE sql IMMUTABLE
BEGIN ATOMIC
-- A constraint of the tables that an edit breaks, as a sentence.
SELECT CASE rule
    WHEN 'entity_map_id_name_key' THEN format('the map already has something named %s', whose)
    WHEN 'entity_properties_check' THEN format('the properties of %s are not an object', whose)
    WHEN 'connector_state_check' THEN format('the state of %s is not open, closed or locked', whose)
    WHEN 'connector_direction_check' THEN format('the direction of %s is not both, forward or backward', whose)
    WHEN 'connector_width_check' THEN format('the width of %s is not above 0', whose)
    WHEN 'connector_height_check' THEN format('the height of %s is not above 0', whose)
    WHEN 'connector_step_check' THEN format('the step of %s is below 0', whose)
    WHEN 'storey_height_check' THEN format('the height of %s is not above 0', whose)
    WHEN 'placement_pose_is_within_ten_thousand_kilometres'
        THEN format('%s would be more than 10,000 km from the map''s origin', whose)
    WHEN 'placement_pose_has_seven_finite_numbers' THEN format('the place of %s is not finite', whose)
    ELSE format('%s: %s', whose, told) END;
END;

CREATE FUNCTION turn_to(thing bigint, angle double precision, middle geometry, target geometry)
RETURNS void LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Turns an entity about a point of the ground, counterclockwise in radians, and shifts that point to another one. Its
-- height and tilt stay; its contents move along.
DECLARE
    moved double precision[];
    holder double precision[];
BEGIN
    PERFORM semmap.hold_still(thing, NULL);
    SELECT semmap.pose_compose(semmap.planar_pose(ST_X(target), ST_Y(target), angle),
                               semmap.pose_compose(semmap.planar_pose(-ST_X(middle), -ST_Y(middle)), w.pose)), h.pose
        INTO moved, holder
        FROM semmap.world w JOIN semmap.placement p ON p.entity_id = w.entity_id LEFT JOIN semmap.world h ON h.entity_id = p.holder_id
        WHERE w.entity_id = thing;
    UPDATE semmap.placement p SET pose = CASE WHEN holder IS NULL THEN moved
                                              ELSE semmap.pose_compose(semmap.pose_inverse(holder), moved) END
        WHERE p.entity_id = thing;
    IF NOT FOUND THEN
        RAISE EXCEPTION 'entity % is not moved: it has no placement, or you may not move it', thing
            USING ERRCODE = 'insufficient_privilege', HINT = 'A robot moves objects, regions and agents.';
    END IF;
END $$;

CREATE FUNCTION fit_shape(thing bigint, there double precision[], top double precision, rise double precision)
RETURNS void LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Before an entity gets another shape: its pose is where the shape is now. Its contents stay, and those on its top rise
-- or sink with that.
DECLARE
    contact CONSTANT double precision := 0.03;
    deriving text := coalesce(current_setting('semmap.deriving', true), '');
BEGIN
    PERFORM semmap.hold_still(thing, NULL);
    PERFORM set_config('semmap.deriving', 'off', true);  -- the shape comes next, and then the holders
    UPDATE semmap.placement p
        SET pose = CASE WHEN p.entity_id <> thing THEN semmap.pose_compose(semmap.pose_inverse(there), semmap.pose_compose(ARRAY[
                             0, 0, CASE WHEN p.relation = 'on' AND abs(ST_ZMin(w.box) - top) <= contact THEN coalesce(rise, 0) ELSE 0 END, 0, 0, 0, 1], w.pose))
                        WHEN h.pose IS NULL THEN there
                        ELSE semmap.pose_compose(semmap.pose_inverse(h.pose), there) END
        FROM semmap.world w LEFT JOIN semmap.placement q ON q.entity_id = w.entity_id LEFT JOIN semmap.world h ON h.entity_id = q.holder_id
        WHERE w.entity_id = p.entity_id AND (p.entity_id = thing OR p.holder_id = thing);
    PERFORM set_config('semmap.deriving', deriving, true);
END $$;

CREATE FUNCTION gis_changed()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Writes the edits of a GIS client to the map. Derived attributes (map, storey, holder, low and high of a mesh) are taken
-- for a new feature; afterwards an edit of them is refused, because it would change nothing.
DECLARE
    layer text := substr(TG_TABLE_NAME, 5);
    of_kind text;
    thing bigint;
    of_map integer;
    below bigint;
    pose double precision[];
    outline geometry;
    shape bigint;
    low double precision := 0;
    high double precision := 0.01;
    ground double precision := 0;  -- of the storey, in the map's frame
    drawn boolean;
    reshaped boolean;
    given jsonb;
    rule text;
    told text;
    angle double precision;
BEGIN
    IF layer = 'storey' AND TG_OP <> 'UPDATE' THEN
        RAISE EXCEPTION 'storeys are neither drawn nor deleted here'
            USING ERRCODE = 'feature_not_supported', HINT = 'Import a floor plan, or add one in Python: map.add_storey(name, elevation=3).';
    END IF;
    IF TG_OP = 'DELETE' THEN
        DELETE FROM semmap.entity WHERE id = OLD.fid;
        RETURN OLD;
    END IF;

    IF NEW.name IS NULL OR NEW.name = '' THEN
        RAISE EXCEPTION 'a % needs a name', layer USING ERRCODE = 'check_violation', HINT = 'Fill in the attribute name.';
    END IF;
    IF NEW.type IS NOT NULL AND NOT EXISTS (SELECT FROM semmap.semantic_type WHERE name = NEW.type) THEN
        RAISE EXCEPTION 'the T-Box has no type %', NEW.type
            USING ERRCODE = 'foreign_key_violation', HINT = semmap.type_hint(NEW.type);
    END IF;
    of_kind := coalesce((SELECT kind FROM semmap.entity WHERE id = OLD.fid), layer);
    IF NOT semmap.fits_kind(NEW.type, of_kind) AND (TG_OP = 'INSERT' OR NEW.type IS DISTINCT FROM OLD.type) THEN
        RAISE EXCEPTION '% is not a type of %s', NEW.type, of_kind
            USING ERRCODE = 'check_violation', HINT = format('SELECT name FROM semmap.gis_type WHERE kind = ''%s'' lists types.', of_kind);
    END IF;
    BEGIN
        given := coalesce(NULLIF(NEW.properties, ''), '{}')::jsonb;
    EXCEPTION WHEN invalid_text_representation THEN
        RAISE EXCEPTION 'the properties of % are not JSON', NEW.name
            USING ERRCODE = 'check_violation', HINT = 'Write them as an object: {"key": "value"}.';
    END;

    IF TG_OP = 'UPDATE' THEN
        thing := OLD.fid;
        SELECT bool_and(m.kind = 'polygon') INTO drawn
            FROM semmap.entity_model em JOIN semmap.model m ON m.id = em.model_id WHERE em.entity_id = thing;
        PERFORM semmap.refuse_derived(layer, OLD.name, ARRAY(
            SELECT n.key FROM jsonb_each_text(to_jsonb(NEW) - 'geom') n JOIN jsonb_each_text(to_jsonb(OLD) - 'geom') o USING (key)
            WHERE n.value IS DISTINCT FROM o.value AND (n.key IN ('fid', 'map', 'storey', 'holder', 'structure', 'form', 'place_a', 'place_b', 'origin')
                  OR n.key IN ('low', 'high') AND drawn IS FALSE)));
    END IF;

    IF layer = 'storey' THEN
        IF ST_AsBinary(NEW.geom) IS DISTINCT FROM ST_AsBinary(OLD.geom) THEN
            RAISE EXCEPTION 'the outline of % is not changed here: it follows from its rooms', NEW.name
                USING ERRCODE = 'feature_not_supported', HINT = 'Reshape its rooms.';
        END IF;
        UPDATE semmap.entity SET name = NEW.name, type = NEW.type, label = NEW.label, properties = given
            WHERE id = thing AND (name, type, label, properties) IS DISTINCT FROM (NEW.name, NEW.type, NEW.label, given);
        UPDATE semmap.storey SET height = NEW.height WHERE entity_id = thing AND height IS DISTINCT FROM NEW.height;
        IF NEW.elevation IS DISTINCT FROM OLD.elevation THEN
            UPDATE semmap.storey SET elevation = NEW.elevation WHERE entity_id = thing;
            PERFORM semmap.move_to(thing, w.pose[1], w.pose[2], w.pose[3] + NEW.elevation - OLD.elevation)
                FROM semmap.world w WHERE w.entity_id = thing;
        END IF;
        RETURN NEW;
    END IF;

    IF layer = 'connector' THEN
        IF coalesce(OLD.form, NEW.form, 'door') <> 'door' AND (TG_OP = 'INSERT' OR NOT ST_OrderingEquals(NEW.geom, OLD.geom)) THEN
            RAISE EXCEPTION '% is no door: the line of stairs, ramps and elevator doors follows from their poses', NEW.name
                USING ERRCODE = 'feature_not_supported', HINT = 'Change its attributes here, its place by an import.';
        END IF;
        IF TG_OP = 'INSERT' THEN
            of_map := semmap.map_named(NEW.map);
            below := semmap.storey_named(of_map, NEW.storey);
            INSERT INTO semmap.entity (map_id, kind, name, type, properties)
                VALUES (of_map, layer, NEW.name, coalesce(NEW.type, (SELECT name FROM semmap.semantic_type WHERE name = 'door')), given) RETURNING id INTO thing;
            NEW.fid := thing;
            NEW.width := coalesce(NEW.width, 0.9);
            PERFORM semmap.put_door(thing, of_map, below, NEW.name, NEW.geom);
            INSERT INTO semmap.entity_model (entity_id, model_id)
                VALUES (thing, semmap.drawn_model(ST_Multi(ST_MakeEnvelope(-0.025, -NEW.width / 2, 0.025, NEW.width / 2)), 0, 2.1));
        ELSE
            UPDATE semmap.entity SET name = NEW.name, type = NEW.type, properties = given
                WHERE id = thing AND (name, type, properties) IS DISTINCT FROM (NEW.name, NEW.type, given);
            IF NOT ST_OrderingEquals(NEW.geom, OLD.geom) THEN
                PERFORM semmap.put_door(thing, e.map_id, w.storey_id, NEW.name, NEW.geom)
                    FROM semmap.entity e JOIN semmap.world w ON w.entity_id = e.id WHERE e.id = thing;
            END IF;
        END IF;
        UPDATE semmap.connector SET state = coalesce(NEW.state, state), direction = coalesce(NEW.direction, direction),
               behaviour = coalesce(NEW.behaviour, behaviour), width = NEW.width,
               height = NEW.height, step = coalesce(NEW.step, 0),
               permissions = coalesce(regexp_split_to_array(NULLIF(trim(NEW.permissions), ''), '\s*,\s*'), '{}')
            WHERE entity_id = thing AND (TG_OP = 'INSERT'
                  OR (NEW.state, NEW.direction, NEW.behaviour, NEW.width, NEW.height, NEW.step, NEW.permissions)
                  IS DISTINCT FROM (OLD.state, OLD.direction, OLD.behaviour, OLD.width, OLD.height, OLD.step, OLD.permissions));
        IF TG_OP = 'INSERT' OR NEW.width IS DISTINCT FROM OLD.width OR NOT ST_OrderingEquals(NEW.geom, OLD.geom) THEN
            SELECT f.fault INTO told FROM semmap.door_faults f WHERE f.id = thing;
            IF told IS NOT NULL THEN
                RAISE EXCEPTION '% %', NEW.name, told USING ERRCODE = 'check_violation', HINT = 'Correct it, or undo the edit.';
            END IF;
        END IF;
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
        of_map := semmap.map_named(NEW.map);
        below := semmap.storey_named(of_map, NEW.storey);
        ground := coalesce((SELECT w.pose[3] FROM semmap.world w WHERE w.entity_id = below), 0);
        IF layer <> 'room' THEN
            low := coalesce(NEW.low, ground);
            high := coalesce(NEW.high, low + 0.01);
            IF high < low THEN
                RAISE EXCEPTION 'the top of % is below its bottom', NEW.name
                    USING ERRCODE = 'check_violation', HINT = 'low and high are heights in the map''s frame, metres.';
            END IF;
            high := greatest(high, low + 0.001);
        END IF;
        IF layer = 'object' THEN
            angle := radians(NEW.heading_deg);
        END IF;
        pose := semmap.planar_pose(ST_X(ST_PointOnSurface(outline)), ST_Y(ST_PointOnSurface(outline)), coalesce(angle, 0),
                            CASE layer WHEN 'room' THEN ground ELSE low END);
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
            VALUES (thing, semmap.drawn_model(ST_Force2D(semmap.pose_apply(ST_Force3D(outline), semmap.pose_inverse(ARRAY[pose[1], pose[2], 0] || pose[4:7]))), low, high));
        IF below IS NOT NULL THEN
            pose := semmap.pose_compose(semmap.pose_inverse((SELECT w.pose FROM semmap.world w WHERE w.entity_id = below)), pose);
        END IF;
        INSERT INTO semmap.placement (entity_id, holder_id, pose) VALUES (thing, below, pose);
        NEW.fid := thing;
        RETURN NEW;
    END IF;

    UPDATE semmap.entity SET name = NEW.name, type = NEW.type, label = NEW.label, properties = given
        WHERE id = thing AND (name, type, label, properties) IS DISTINCT FROM (NEW.name, NEW.type, NEW.label, given);
    reshaped := ST_AsBinary(NEW.geom) IS DISTINCT FROM ST_AsBinary(OLD.geom);
    outline := NEW.geom;
    IF reshaped THEN
        outline := semmap.check_outline(NEW.geom, NEW.name);
        IF layer <> 'room' AND OLD.geom IS NOT NULL THEN
            angle := semmap.turned_by(OLD.geom, outline);
        END IF;
        IF angle IS NOT NULL THEN
            PERFORM semmap.turn_to(thing, angle, ST_Centroid(OLD.geom), ST_Centroid(outline));
            reshaped := false;
        END IF;
    END IF;
    SELECT w.pose INTO pose FROM semmap.world w WHERE w.entity_id = thing;
    IF layer = 'room' THEN
        ground := coalesce((SELECT s.pose[3] FROM semmap.world w JOIN semmap.world s ON s.entity_id = w.storey_id WHERE w.entity_id = thing), 0)
                  - coalesce(pose[3], 0);  -- in the room's frame
        low := low + ground;
        high := high + ground;
        IF (NEW.floor, NEW.ceiling) IS DISTINCT FROM (OLD.floor, OLD.ceiling) THEN
            UPDATE semmap.room SET floor = low, ceiling = NEW.ceiling + ground WHERE entity_id = thing;
            reshaped := true;
        END IF;
    ELSE
        SELECT coalesce(min(ST_ZMin(m.hull)), 0), max(ST_ZMax(m.hull)) INTO low, high
            FROM semmap.entity_model em JOIN semmap.model m ON m.id = em.model_id WHERE em.entity_id = thing;
        IF (NEW.low, NEW.high) IS DISTINCT FROM (OLD.low, OLD.high) THEN
            pose[3] := pose[3] + coalesce(NEW.low - OLD.low, 0);  -- the pose rises with the bottom
            low := NEW.low - coalesce(pose[3], 0);
            high := NEW.high - coalesce(pose[3], 0);
            reshaped := true;
            IF (low < high) IS NOT TRUE THEN
                RAISE EXCEPTION 'the top of % is not above its bottom', NEW.name
                    USING ERRCODE = 'check_violation', HINT = 'low and high are heights in the map''s frame, metres.';
            END IF;
        END IF;
        high := greatest(coalesce(high, low + 0.01), low + 0.001);
    END IF;
    IF reshaped AND NOT drawn THEN
        RAISE EXCEPTION 'the shape of % follows from its mesh', NEW.name
            USING ERRCODE = 'feature_not_supported', HINT = 'Move or turn the whole feature; its shape changes with its mesh.';
    ELSIF reshaped THEN
        IF pose IS NULL THEN
            pose := semmap.planar_pose(ST_X(ST_PointOnSurface(outline)), ST_Y(ST_PointOnSurface(outline)));
            INSERT INTO semmap.placement (entity_id, pose) VALUES (thing, pose);
        ELSIF layer <> 'room' THEN
            IF ST_AsBinary(NEW.geom) IS DISTINCT FROM ST_AsBinary(OLD.geom) THEN
                pose := semmap.planar_pose(ST_X(ST_PointOnSurface(outline)), ST_Y(ST_PointOnSurface(outline)), semmap.pose_yaw(pose), pose[3]);
            END IF;
            PERFORM semmap.fit_shape(thing, pose, OLD.high, NEW.high - OLD.high);
        END IF;
        shape := semmap.drawn_model(ST_Force2D(semmap.pose_apply(ST_Force3D(outline), semmap.pose_inverse(ARRAY[pose[1], pose[2], 0] || pose[4:7]))), low, high);
        DELETE FROM semmap.entity_model WHERE entity_id = thing AND model_id <> shape;
        INSERT INTO semmap.entity_model (entity_id, model_id) VALUES (thing, shape) ON CONFLICT DO NOTHING;
    END IF;
    IF layer = 'object' THEN
        IF NEW.heading_deg IS DISTINCT FROM OLD.heading_deg THEN
            IF NEW.heading_deg IS NULL OR pose IS NULL OR NEW.heading_deg IN ('NaN', 'Infinity', '-Infinity') THEN
                RAISE EXCEPTION '% has no heading %', NEW.name, coalesce(NEW.heading_deg::text, '')
                    USING ERRCODE = 'check_violation', HINT = 'Give degrees, counterclockwise from the map''s x axis, of an object that has a place.';
            END IF;
            PERFORM semmap.turn_to(thing, radians(NEW.heading_deg) - semmap.pose_yaw(pose), o.middle, o.middle)
                FROM (SELECT coalesce(ST_Centroid(outline), ST_MakePoint(pose[1], pose[2]))) o (middle);
        END IF;
    END IF;
    RETURN NEW;
EXCEPTION WHEN integrity_constraint_violation THEN
    GET STACKED DIAGNOSTICS rule = CONSTRAINT_NAME, told = MESSAGE_TEXT;
    IF rule = '' THEN
        RAISE;
    END IF;
    RAISE EXCEPTION '%', semmap.broken_rule(rule, NEW.name, told)
        USING ERRCODE = 'check_violation', HINT = CASE rule WHEN 'entity_map_id_name_key' THEN 'Choose another name.' ELSE 'Correct it, or undo the edit.' END;
END $$;

CREATE TRIGGER gis_changed INSTEAD OF INSERT OR UPDATE OR DELETE ON gis_room FOR EACH ROW EXECUTE FUNCTION gis_changed();
CREATE TRIGGER gis_changed INSTEAD OF INSERT OR UPDATE OR DELETE ON gis_object FOR EACH ROW EXECUTE FUNCTION gis_changed();
CREATE TRIGGER gis_changed INSTEAD OF INSERT OR UPDATE OR DELETE ON gis_region FOR EACH ROW EXECUTE FUNCTION gis_changed();
CREATE TRIGGER gis_changed INSTEAD OF INSERT OR UPDATE OR DELETE ON gis_connector FOR EACH ROW EXECUTE FUNCTION gis_changed();
CREATE TRIGGER gis_changed INSTEAD OF INSERT OR UPDATE OR DELETE ON gis_storey FOR EACH ROW EXECUTE FUNCTION gis_changed();
