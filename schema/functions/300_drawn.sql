-- Polygons drawn in a GIS, as models: the same checks as the API makes.

CREATE FUNCTION check_outline(outline geometry, whose text)
RETURNS geometry LANGUAGE plpgsql IMMUTABLE SET search_path = semmap, public, pg_temp AS $$
-- The outline as a valid MULTIPOLYGON without SRID, or an error that says what to fix.
BEGIN
    IF outline IS NULL OR ST_IsEmpty(outline) OR ST_Dimension(outline) <> 2 THEN
        RAISE EXCEPTION 'the footprint of % is not a polygon', whose
            USING ERRCODE = 'check_violation', HINT = 'Draw a polygon with an area.';
    END IF;
    IF NOT ST_IsValid(outline) THEN
        RAISE EXCEPTION 'the footprint of % is not valid: %', whose, ST_IsValidReason(outline)
            USING ERRCODE = 'check_violation', HINT = 'Redraw it without crossing its own border.';
    END IF;
    IF ST_Area(outline) < 1e-4 THEN
        RAISE EXCEPTION 'the footprint of % has no area', whose
            USING ERRCODE = 'check_violation', HINT = 'Draw at least a square centimetre.';
    END IF;
    RETURN ST_SetSRID(ST_Multi(ST_Force2D(outline)), 0);
END $$;

CREATE FUNCTION prism_tin(outline geometry, low double precision, high double precision)
RETURNS geometry LANGUAGE plpgsql IMMUTABLE SET search_path = semmap, public, pg_temp AS $$
-- The closed surface of a polygon from z `low` to `high`: floor and ceiling triangulated, walls upright,
-- normals outward.
DECLARE
    cap geometry;
    tin geometry;
BEGIN
    IF to_regprocedure('ST_TriangulatePolygon(geometry)') IS NOT NULL THEN
        EXECUTE 'SELECT ST_TriangulatePolygon($1)' INTO cap USING outline;   -- PostGIS >= 3.3
    ELSE
        cap := ST_DelaunayTriangles(ST_Segmentize(outline, 0.25));
    END IF;
    WITH caps AS (
        SELECT ST_ForcePolygonCCW(d.geom) AS ring
        FROM ST_Dump(cap) d WHERE ST_Contains(ST_Buffer(outline, 1e-6), d.geom)
    ), corner AS (
        SELECT ring, ST_PointN(ST_ExteriorRing(ring), 1) a, ST_PointN(ST_ExteriorRing(ring), 2) b,
               ST_PointN(ST_ExteriorRing(ring), 3) c FROM caps
    ), wall AS (
        SELECT ST_StartPoint(s.geom) a, ST_EndPoint(s.geom) b
        FROM ST_DumpSegments(ST_Boundary(ST_ForcePolygonCCW(outline))) s
    ), triangle (a, az, b, bz, c, cz) AS (
        SELECT a, high, b, high, c, high FROM corner
        UNION ALL SELECT a, low, c, low, b, low FROM corner
        UNION ALL SELECT a, low, b, low, b, high FROM wall
        UNION ALL SELECT a, low, b, high, a, high FROM wall
    )
    SELECT ST_GeomFromText('TIN Z(' || string_agg(format('((%s %s %s,%s %s %s,%s %s %s,%s %s %s))',
               ST_X(a), ST_Y(a), az, ST_X(b), ST_Y(b), bz, ST_X(c), ST_Y(c), cz, ST_X(a), ST_Y(a), az), ',') || ')', 0)
    INTO tin FROM triangle;
    RETURN tin;
END $$;

CREATE FUNCTION kept_digest(digest text)
RETURNS text LANGUAGE sql STABLE
BEGIN ATOMIC
-- The digest under which a model of the current role is stored. Equal digests share one model, so a
-- robot's mesh must not replace one that an admin imports: a robot's models are stored under its own name.
SELECT CASE WHEN pg_has_role((SELECT relowner FROM pg_catalog.pg_class WHERE oid = 'semmap.model'::regclass), 'MEMBER')
              OR pg_has_role('semmap_admin', 'MEMBER') THEN digest
            ELSE current_user || '/' || digest END;
END;

CREATE FUNCTION model_digest()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
BEGIN
    NEW.digest := semmap.kept_digest(NEW.digest);
    RETURN NEW;
END $$;

CREATE TRIGGER model_digest BEFORE INSERT OR UPDATE OF digest ON model
    FOR EACH ROW EXECUTE FUNCTION model_digest();

CREATE FUNCTION drawn_model(outline geometry, low double precision, high double precision)
RETURNS bigint LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- The model of a polygon between two heights, in its own frame; made if it is not there.
DECLARE
    made bigint;
    mark text := 'drawn:' || md5(ST_AsBinary(outline)) || ':' || low || ':' || high;
    tin geometry;
BEGIN
    SELECT id INTO made FROM semmap.model WHERE digest IN (mark, semmap.kept_digest(mark)) LIMIT 1;
    IF made IS NULL THEN
        tin := semmap.prism_tin(outline, low, high);
        INSERT INTO semmap.model (digest, kind, triangles, closed, hull, outline)
            VALUES (mark, 'polygon', ST_NumGeometries(tin), true,
                    (SELECT ST_Collect(ST_Translate(ST_Force3D(p.geom), 0, 0, h.z))
                     FROM ST_DumpPoints(ST_ConvexHull(outline)) p, (VALUES (low), (high)) h (z)), outline)
            RETURNING id INTO made;
        INSERT INTO semmap.chunk (model_id, number, geom) VALUES (made, 0, tin);
    END IF;
    RETURN made;
END $$;
