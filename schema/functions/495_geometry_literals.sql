-- Geometry literals of GeoSPARQL, in the map's frame or in a reference system, and measures on the earth.
--
-- A geometry in the map's frame has the SRID 0; of any other, x is to the east and y to the north. Null is an error of
-- SPARQL. PROJ and GEOS have one error for all that they refuse; a function that catches it is not PARALLEL SAFE.

CREATE FUNCTION reference_system(iri text, OUT srid integer, OUT north_first boolean)
LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- The EPSG code of a coordinate reference system (4326 for CRS84, 0 for the map's own frame), and whether the first
-- coordinate of a literal is the northern one. Null for those whose axes are not known.
DECLARE
    code integer := CASE WHEN iri ~ '[/:]CRS84$' THEN 4326
        ELSE substring(iri from '(?:/EPSG/[^/]*/|^urn:ogc:def:crs:EPSG:[^:]*:|^EPSG:)([0-9]{1,5})$')::integer END;
    known text := (SELECT s.srtext FROM public.spatial_ref_sys s WHERE s.srid = code);
BEGIN
    IF code = 0 OR iri ~ '[/:]CRS84$' OR known LIKE 'GEOGCS%lon-lat%'
        OR known ~ '^PROJCS.*AXIS\["[^"]*",EAST\],AXIS\["[^"]*",NORTH\]' THEN
        srid := code;
        north_first := false;
    ELSIF known LIKE 'GEOGCS%' OR known ~ '^PROJCS.*AXIS\["[^"]*",NORTH\],AXIS\["[^"]*",EAST\]' THEN
        srid := code;
        north_first := true;
    END IF;
END $$;

CREATE FUNCTION literal_system(written text, tag text)
RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- The reference system that a geometry literal of GeoSPARQL names; null where it names none.
SELECT CASE substring(tag from '#(wkt|gml|geoJSON)Literal$')
    WHEN 'wkt' THEN substring(written from '^\s*<([^>]*)>')
    WHEN 'gml' THEN substring(written from 'srsName\s*=\s*["'']([^"'']*)["'']')
    WHEN 'geoJSON' THEN nullif(btrim(written, E' \t\r\n'), '')::jsonb #>> '{crs,properties,name}' END;
END;

CREATE FUNCTION text_geometry(written text, tag text)
RETURNS geometry LANGUAGE plpgsql IMMUTABLE STRICT SET search_path = semmap, public, pg_temp AS $$
-- A geometry literal of GeoSPARQL (WKT, GML or GeoJSON), x to the east and y to the north; null for any other text, and in
-- a reference system that is not known. Without a system, in the map's frame, whose SRID is 0; so is GeoJSON that
-- names none. An empty text is an empty geometry.
DECLARE
    form text := substring(tag from '^http://www\.opengis\.net/ont/geosparql#(wkt|gml|geoJSON)Literal$');
    named text;
    found geometry;
    its record;
BEGIN
    IF form IS NULL THEN
        RETURN NULL;
    ELSIF written ~ (CASE form WHEN 'wkt' THEN '^\s*(<[^>]*>)?\s*$' ELSE '^\s*$' END) THEN
        found := 'GEOMETRYCOLLECTION EMPTY';
    ELSIF form = 'wkt' THEN
        found := ST_GeomFromText(regexp_replace(written, '^\s*<[^>]*>', ''));
    ELSIF form = 'gml' THEN
        found := ST_GeomFromGML(regexp_replace(written, '\ssrsName\s*=\s*("[^"]*"|''[^'']*'')', '', 'g'));
    ELSE
        found := ST_GeomFromGeoJSON((written::jsonb - 'crs')::text);
    END IF;
    named := semmap.literal_system(written, tag);
    IF named IS NULL THEN
        RETURN ST_SetSRID(found, 0);
    END IF;
    its := semmap.reference_system(named);
    found := ST_SetSRID(found, its.srid);
    RETURN CASE WHEN its.north_first AND form <> 'geoJSON' THEN ST_FlipCoordinates(found) ELSE found END;
EXCEPTION WHEN OTHERS THEN
    RETURN NULL;
END $$;

CREATE FUNCTION transformed(geom geometry, to_srid integer)
RETURNS geometry LANGUAGE plpgsql STABLE STRICT COST 5000 SET search_path = semmap, public, pg_temp AS $$
-- A geometry in another reference system; null where it has no place in it.
BEGIN
    RETURN ST_Transform(geom, to_srid);
EXCEPTION WHEN OTHERS THEN  -- PROJ has one error for all that it refuses
    RETURN NULL;
END $$;

CREATE FUNCTION geometry_text(geom geometry)
RETURNS text LANGUAGE plpgsql STABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- A geometry as a WKT literal: with the reference system and in the order of its axes, unless it is in the map's frame.
DECLARE
    iri text := 'http://www.opengis.net/def/crs/' ||
        CASE ST_SRID(geom) WHEN 4326 THEN 'OGC/1.3/CRS84' ELSE 'EPSG/0/' || ST_SRID(geom) END;
BEGIN
    IF ST_SRID(geom) = 0 THEN
        RETURN ST_AsText(geom);
    END IF;
    RETURN format('<%s> %s', iri, ST_AsText(
        CASE WHEN (semmap.reference_system(iri)).north_first THEN ST_FlipCoordinates(geom) ELSE geom END));
END $$;

CREATE FUNCTION geometry_gml(geom geometry)
RETURNS text LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- A geometry as GML 3: with the reference system and in the order of its axes, unless it is in the map's frame.
SELECT CASE WHEN ST_SRID(geom) = 0 THEN ST_AsGML(3, geom)
            WHEN (semmap.reference_system('EPSG:' || ST_SRID(geom))).north_first
            THEN ST_AsGML(3, ST_FlipCoordinates(geom), 15, 1) ELSE ST_AsGML(3, geom, 15, 1) END;
END;

CREATE FUNCTION geometry_json(geom geometry)
RETURNS text LANGUAGE sql STABLE
BEGIN ATOMIC
-- A geometry as GeoJSON: in longitude and latitude, which it says, unless it is in the map's frame.
SELECT CASE WHEN ST_SRID(geom) = 0 THEN ST_AsGeoJSON(geom) ELSE ST_AsGeoJSON(semmap.transformed(geom, 4326), 9, 2) END;
END;

CREATE FUNCTION is_metric(geom geometry)
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- Whether coordinates are metres on a plane; null without a geometry.
SELECT CASE WHEN geom IS NOT NULL THEN ST_SRID(geom) = 0 OR EXISTS (
    SELECT FROM public.spatial_ref_sys s
    WHERE s.srid = ST_SRID(geom) AND s.srtext LIKE 'PROJCS%' AND s.proj4text LIKE '%+units=m %') END;
END;

CREATE FUNCTION in_map_frame(geom geometry, of_map integer)
RETURNS geometry LANGUAGE sql STABLE
BEGIN ATOMIC
-- A geometry in the frame of a map; null for one in a reference system where the map has no georeference in metres.
SELECT CASE WHEN ST_SRID(geom) = 0 THEN geom ELSE (
    SELECT ST_SetSRID(ST_Rotate(ST_Translate(semmap.transformed(geom, m.crs), -m.easting, -m.northing, -m.height), -m.rotation), 0)
    FROM semmap.map m WHERE m.id = of_map AND semmap.is_metric(ST_SetSRID('POINT EMPTY'::geometry, m.crs))) END;
END;

CREATE FUNCTION on_earth(geom geometry, of_map integer)
RETURNS geometry LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
-- A geometry of the map's frame in WGS 84; null where the map has no georeference in metres.
SELECT ST_Transform(ST_SetSRID(ST_Translate(ST_Rotate(geom, m.rotation), m.easting, m.northing, m.height), m.crs), 4326)
FROM semmap.map m WHERE m.id = of_map AND semmap.is_metric(ST_SetSRID('POINT EMPTY'::geometry, m.crs))
$$;

CREATE FUNCTION alike(geom geometry, other geometry, of_map integer)
RETURNS geometry LANGUAGE sql STABLE
BEGIN ATOMIC
-- A geometry in the reference system, or the frame, of another; null where a frame without a georeference is one of them.
SELECT CASE WHEN ST_SRID(geom) = ST_SRID(other) THEN geom
            WHEN ST_SRID(other) = 0 THEN semmap.in_map_frame(geom, of_map)
            WHEN ST_SRID(geom) = 0 THEN semmap.transformed(semmap.on_earth(geom, of_map), ST_SRID(other))
            ELSE semmap.transformed(geom, ST_SRID(other)) END;
END;

CREATE FUNCTION in_system(geom geometry, iri text, of_map integer)
RETURNS geometry LANGUAGE sql STABLE
BEGIN ATOMIC
-- A geometry in another reference system; null from a frame without a georeference, and for a system that is not known.
SELECT semmap.alike(geom, ST_SetSRID('POINT EMPTY'::geometry, its.srid), of_map) FROM semmap.reference_system(iri) its;
END;

CREATE FUNCTION put_together(parts geometry[], of_map integer)
RETURNS geometry LANGUAGE sql STABLE
BEGIN ATOMIC
-- A collection of geometries, in the reference system of the first; null where one has no place in it.
SELECT CASE WHEN count(*) = count(each.geom) THEN ST_Collect(each.geom) END
FROM (SELECT semmap.alike(p, first_value(p) OVER (ORDER BY n), of_map) AS geom
      FROM unnest(parts) WITH ORDINALITY u (p, n) WHERE p IS NOT NULL) each;
END;

CREATE FUNCTION ground_measure(geom geometry, what text, other geometry DEFAULT NULL, of_map integer DEFAULT NULL)
RETURNS double precision LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The area, length, perimeter, or distance to another geometry, in metres: on the plane where coordinates are metres of
-- one system, else on the ellipsoid; null for what has no place there.
DECLARE
    ground geography;
BEGIN
    IF ST_SRID(geom) = coalesce(ST_SRID(other), ST_SRID(geom)) AND semmap.is_metric(geom) THEN
        RETURN CASE what WHEN 'area' THEN ST_Area(geom) WHEN 'length' THEN ST_Length(geom)
            WHEN 'perimeter' THEN ST_Perimeter(geom) ELSE ST_Distance(geom, other) END;
    ELSIF ST_SRID(geom) = 0 OR ST_SRID(other) = 0 THEN
        RETURN ST_Distance(semmap.in_map_frame(geom, of_map), semmap.in_map_frame(other, of_map));
    END IF;
    ground := ST_CurveToLine(ST_Force2D(ST_Transform(geom, 4326)))::geography;
    RETURN CASE what WHEN 'area' THEN ST_Area(ground) WHEN 'length' THEN ST_Length(ground)
        WHEN 'perimeter' THEN ST_Perimeter(ground)
        ELSE ST_Distance(ground, ST_CurveToLine(ST_Force2D(ST_Transform(other, 4326)))::geography) END;
EXCEPTION WHEN OTHERS THEN  -- PROJ and the type have one error for all that they refuse
    RETURN NULL;
END $$;

CREATE FUNCTION ground_buffer(geom geometry, metres double precision)
RETURNS geometry LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- What lies within some metres of a geometry, in its reference system.
BEGIN
    IF semmap.is_metric(geom) THEN
        RETURN ST_Buffer(geom, metres);
    END IF;
    RETURN ST_Transform(ST_Buffer(ST_CurveToLine(ST_Force2D(ST_Transform(geom, 4326)))::geography, metres)::geometry,
                        ST_SRID(geom));
EXCEPTION WHEN OTHERS THEN
    RETURN NULL;
END $$;
