-- Over and under: is_above, is_under.

CREATE FUNCTION probes(ground geometry)
RETURNS SETOF geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE ROWS 20
BEGIN ATOMIC
-- Up to 26 points spread over a piece of ground: the middles of a 5 x 5 grid that lie on it, and one that does.
SELECT ST_PointOnSurface(ground)
UNION ALL
SELECT p FROM generate_series(0, 4) i, generate_series(0, 4) j,
    ST_MakePoint(ST_XMin(ground) + (i + 0.5) / 5 * (ST_XMax(ground) - ST_XMin(ground)),
                 ST_YMin(ground) + (j + 0.5) / 5 * (ST_YMax(ground) - ST_YMin(ground))) p
WHERE ST_Dimension(ground) = 2 AND ST_Intersects(ground, p);
END;

CREATE FUNCTION plumb(thing bigint, spots geometry[])
RETURNS TABLE (spot integer, low double precision, high double precision) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- The lowest and the highest point of an entity's surface on the vertical line through each of the spots
-- that has any.
DECLARE
    box box3d := (SELECT w.box FROM semmap.world w WHERE w.entity_id = thing);
    bottom double precision := ST_ZMin(box) - 1;
    top double precision := ST_ZMax(box) + 1;
    extent box3d := (SELECT ST_3DExtent(s) FROM unnest(spots) s);
    patches geometry[] := ARRAY(SELECT semmap.surface_within(thing, ST_MakeLine(
        ST_MakePoint(ST_XMin(extent), ST_YMin(extent), bottom), ST_MakePoint(ST_XMax(extent), ST_YMax(extent), top))));
BEGIN
    RETURN QUERY
        SELECT s.n::integer, min(ST_Z(ST_3DClosestPoint(l.line, p))), max(ST_Z(ST_3DClosestPoint(l.line, p)))
        FROM unnest(spots) WITH ORDINALITY s (at, n)
        CROSS JOIN LATERAL (SELECT ST_MakeLine(ST_MakePoint(ST_X(s.at), ST_Y(s.at), bottom),
                                               ST_MakePoint(ST_X(s.at), ST_Y(s.at), top)) OFFSET 0) l (line)
        CROSS JOIN unnest(patches) p
        WHERE p && s.at AND ST_3DDWithin(l.line, p, 1e-6)
        GROUP BY s.n;
END $$;

CREATE FUNCTION is_above(a bigint, b bigint, tolerance double precision DEFAULT 0.01)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE COST 10000 SET search_path = semmap, public, pg_temp AS $$
-- a is over b, in the map's frame (z up), on the same storey, at any height: their footprints share ground
-- (2 % of the smaller one at least), and on the plumb lines there (up to 26) on which both have surface,
-- all of a is higher than all of b, or `tolerance` metres lower at most, and a reaches higher on average (as
-- high: begins higher). What is on b is above it too, but nothing is above or under what it is in.
DECLARE
    wa semmap.world;
    wb semmap.world;
    ground geometry;
    spots geometry[];
BEGIN
    SELECT * INTO wa FROM semmap.world w WHERE w.entity_id = a;
    SELECT * INTO wb FROM semmap.world w WHERE w.entity_id = b;
    IF a = b OR wa.map_id IS DISTINCT FROM wb.map_id OR wa.map_id IS NULL
       OR NOT semmap.same_storey(wa.storey_id, wb.storey_id)
       OR NOT wa.box && wb.box OR ST_ZMax(wa.box) < ST_ZMin(wb.box) - tolerance
       OR semmap.is_in(a, b, tolerance) OR semmap.is_in(b, a, tolerance) THEN
        RETURN false;
    END IF;
    ground := ST_Intersection(semmap.ground_of(wa), semmap.ground_of(wb), 1e-6);
    IF ST_IsEmpty(ground) OR ST_Area(ground) < 0.02 * least(ST_Area(semmap.ground_of(wa)), ST_Area(semmap.ground_of(wb))) THEN
        RETURN false;
    END IF;
    spots := ARRAY(SELECT semmap.probes(ground));
    RETURN coalesce((SELECT bool_and(pa.low >= pb.high - tolerance)
                            AND (round(avg(pa.high)::numeric, 6), avg(pa.low)) > (round(avg(pb.high)::numeric, 6), avg(pb.low))
                     FROM semmap.plumb(a, spots) pa JOIN semmap.plumb(b, spots) pb USING (spot)), false);
END $$;

CREATE FUNCTION is_under(a bigint, b bigint, tolerance double precision DEFAULT 0.01)
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE COST 10000
BEGIN ATOMIC
-- b is over a: see is_above. A ball between the legs of a table is under it, and so is the floor.
SELECT semmap.is_above(b, a, tolerance);
END;
