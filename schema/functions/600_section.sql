-- What a floor plan shows of walls: their section at a height, in the view gis_object. Their outline has the lintels,
-- and hides doorways. Slicing takes milliseconds a mesh, so that sections are stored. Maintained by triggers.

CREATE FUNCTION section_height()
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Height of the plane that cuts the walls, metres above the floor of their storey, without one above their lowest corner.
SELECT 1.0;
END;

CREATE FUNCTION is_cut(of_type text)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan AS $$
-- Whether a floor plan shows the section of objects of a type, not their outline. In PL/pgSQL: see ceiling_of.
BEGIN
    RETURN EXISTS (SELECT FROM semmap.type_closure WHERE sub = of_type
                   AND super IN ('wall', 'building_shell', 'house', 'elevator_shaft', 'fence'));
END $$;

CREATE FUNCTION section_of(surfaces geometry[], z double precision)
RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- The section of TINs by the plane at a height, as MULTIPOLYGON; null where none reaches it. A point is inside where the
-- section goes around it more often to the left than to the right (its winding number is positive): a wall without top
-- and bottom is filled, and the room between walls is not. A sheet without an inside is shown 2 cm thick.
WITH cut AS MATERIALIZED (
    SELECT row_number() OVER () AS number, ST_ExteriorRing(t.geom) AS ring
    FROM unnest(surfaces) s (tin), ST_Dump(s.tin) t
    WHERE ST_GeometryType(s.tin) = 'ST_Tin' AND ST_ZMin(s.tin) <= z AND ST_ZMax(s.tin) > z
      AND ST_ZMin(t.geom) <= z AND ST_ZMax(t.geom) > z
), crossing AS (
    -- One edge of each triangle rises through the plane, another one falls.
    SELECT number, ST_Z(p) <= z AS rises,
           round((ST_X(p) + s.share * (ST_X(q) - ST_X(p)))::numeric, 6)::double precision AS x,
           round((ST_Y(p) + s.share * (ST_Y(q) - ST_Y(p)))::numeric, 6)::double precision AS y
    FROM cut, generate_series(1, 3) k, LATERAL (SELECT ST_PointN(ring, k), ST_PointN(ring, k + 1)) e (p, q),
         LATERAL (SELECT (z - ST_Z(p)) / (ST_Z(q) - ST_Z(p)) WHERE (ST_Z(p) <= z) <> (ST_Z(q) <= z)) s (share)
), side AS MATERIALIZED (
    -- From where the triangle falls to where it rises, the inside lies to the left.
    SELECT f.x AS x0, f.y AS y0, r.x AS x1, r.y AS y1
    FROM crossing f JOIN crossing r USING (number) WHERE NOT f.rises AND r.rises AND (f.x, f.y) <> (r.x, r.y)
), net AS MATERIALIZED (
    SELECT ST_Union(ST_MakeLine(ST_MakePoint(x0, y0), ST_MakePoint(x1, y1)), 1e-6) AS lines FROM side
), cell AS MATERIALIZED (
    SELECT f.path AS number, f.geom, ST_PointOnSurface(f.geom) AS middle FROM net, ST_Dump(ST_Polygonize(ARRAY[lines])) f
), met AS (
    -- Sides that may meet the ray from a middle to +x; the bands of a metre keep the pairs few.
    SELECT f.number, s.*, ST_X(middle) AS x, ST_Y(middle) AS y
    FROM (SELECT *, generate_series(floor(least(y0, y1))::integer, floor(greatest(y0, y1))::integer) AS band FROM side) s
    JOIN cell f ON floor(ST_Y(f.middle))::integer = s.band
), winding AS (
    SELECT number, sum(sign(y1 - y0)) AS turns FROM met
    WHERE (y0 > y) <> (y1 > y) AND x0 + (y - y0) / (y1 - y0) * (x1 - x0) > x GROUP BY number
), solid AS MATERIALIZED (
    SELECT ST_Union(geom) AS area FROM cell JOIN winding USING (number) WHERE turns > 0
)
SELECT ST_Multi(ST_Union(area, ST_Buffer(ST_Difference(lines, ST_Buffer(area, 1e-5)), 0.01, 'endcap=square')))
FROM net, LATERAL (SELECT coalesce((SELECT area FROM solid), 'POLYGON EMPTY')) s (area)
WHERE lines IS NOT NULL
$$;

CREATE FUNCTION refresh_section(ids bigint[])
RETURNS void LANGUAGE sql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Computes the sections of the given entities again.
DELETE FROM semmap.section WHERE entity_id = ANY (ids);
INSERT INTO semmap.section (entity_id, outline)
SELECT w.entity_id, s.outline
FROM semmap.entity e JOIN semmap.world w ON w.entity_id = e.id LEFT JOIN semmap.world k ON k.entity_id = w.storey_id
CROSS JOIN LATERAL (SELECT semmap.pose_compose(semmap.pose_inverse(semmap.planar_pose(w.pose[1], w.pose[2], semmap.pose_yaw(w.pose))), w.pose) OFFSET 0) l (pose)
CROSS JOIN LATERAL (
    SELECT semmap.section_of(array_agg(semmap.pose_apply(c.geom, l.pose)),
                             coalesce(k.pose[3], ST_ZMin(w.box)) + semmap.section_height())
    FROM semmap.entity_chunk ec JOIN semmap.chunk c ON c.id = ec.chunk_id WHERE ec.entity_id = e.id) s (outline)
WHERE e.id = ANY (ids) AND e.kind = 'object' AND semmap.is_cut(e.type) AND s.outline IS NOT NULL
$$;

CREATE FUNCTION placed_section(outline geometry, pose double precision[])
RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- A stored section in the map's frame, for an entity at a pose.
SELECT ST_Affine(outline, cos(y.yaw), -sin(y.yaw), sin(y.yaw), cos(y.yaw), pose[1], pose[2])
FROM (SELECT semmap.pose_yaw(pose)) y (yaw);
END;

CREATE FUNCTION section_follows()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    IF TG_TABLE_NAME = 'entity' THEN
        IF semmap.is_cut(OLD.type) OR semmap.is_cut(NEW.type) THEN
            PERFORM semmap.refresh_section(ARRAY[NEW.id]);
        END IF;
    ELSIF semmap.is_cut((SELECT type FROM semmap.entity WHERE id = NEW.entity_id)) THEN
        PERFORM semmap.refresh_section(ARRAY[NEW.entity_id]);
    END IF;
    RETURN NULL;
END $$;

-- A move on the ground changes no section; the walls of a storey that is raised have theirs as high above it.
CREATE TRIGGER section_moved AFTER UPDATE ON world FOR EACH ROW
    WHEN (OLD.pose[3:5] IS DISTINCT FROM NEW.pose[3:5] OR OLD.storey_id IS DISTINCT FROM NEW.storey_id)
    EXECUTE FUNCTION section_follows();
CREATE TRIGGER section_placed AFTER INSERT ON world FOR EACH ROW EXECUTE FUNCTION section_follows();
CREATE TRIGGER section_retyped AFTER UPDATE OF type ON entity FOR EACH ROW
    WHEN (OLD.type IS DISTINCT FROM NEW.type) EXECUTE FUNCTION section_follows();

CREATE FUNCTION section_reshaped()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    PERFORM semmap.refresh_section(ARRAY(
        SELECT DISTINCT e.id FROM changed c JOIN semmap.entity e ON e.id = c.entity_id WHERE semmap.is_cut(e.type)));
    RETURN NULL;
END $$;

-- Triggers fire in the order of their names: these after those that maintain the patches of faces.
CREATE TRIGGER section_added AFTER INSERT ON entity_model REFERENCING NEW TABLE AS changed
    FOR EACH STATEMENT EXECUTE FUNCTION section_reshaped();
CREATE TRIGGER section_exchanged AFTER UPDATE ON entity_model REFERENCING NEW TABLE AS changed
    FOR EACH STATEMENT EXECUTE FUNCTION section_reshaped();
CREATE TRIGGER section_taken AFTER DELETE ON entity_model REFERENCING OLD TABLE AS changed
    FOR EACH STATEMENT EXECUTE FUNCTION section_reshaped();

-- Maps of earlier versions have none yet.
SELECT refresh_section(ARRAY(SELECT id FROM entity WHERE kind = 'object' AND is_cut(type)));
