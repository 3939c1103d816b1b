-- How far a point is from the shape of an entity: from its triangles, not from its box.

CREATE FUNCTION crossings(triangles geometry[], ray geometry)
RETURNS bigint LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- How many triangles a ray (a line of two points) passes through, after Moeller and Trumbore.
SELECT count(*)
FROM unnest(triangles) triangle
CROSS JOIN LATERAL (SELECT ST_ExteriorRing(triangle) AS ring, ST_StartPoint(ray) AS o, ST_EndPoint(ray) AS e) r
CROSS JOIN LATERAL (SELECT ST_PointN(r.ring, 1) AS a, ST_PointN(r.ring, 2) AS b, ST_PointN(r.ring, 3) AS c) v
CROSS JOIN LATERAL (SELECT
    ST_X(v.b) - ST_X(v.a) AS ux, ST_Y(v.b) - ST_Y(v.a) AS uy, ST_Z(v.b) - ST_Z(v.a) AS uz,
    ST_X(v.c) - ST_X(v.a) AS vx, ST_Y(v.c) - ST_Y(v.a) AS vy, ST_Z(v.c) - ST_Z(v.a) AS vz,
    ST_X(r.e) - ST_X(r.o) AS dx, ST_Y(r.e) - ST_Y(r.o) AS dy, ST_Z(r.e) - ST_Z(r.o) AS dz,
    ST_X(r.o) - ST_X(v.a) AS sx, ST_Y(r.o) - ST_Y(v.a) AS sy, ST_Z(r.o) - ST_Z(v.a) AS sz) k
CROSS JOIN LATERAL (SELECT dy * vz - dz * vy AS px, dz * vx - dx * vz AS py, dx * vy - dy * vx AS pz,
                           sy * uz - sz * uy AS qx, sz * ux - sx * uz AS qy, sx * uy - sy * ux AS qz) w
CROSS JOIN LATERAL (SELECT ux * px + uy * py + uz * pz AS det) m
CROSS JOIN LATERAL (SELECT (sx * px + sy * py + sz * pz) * sign(det), (dx * qx + dy * qy + dz * qz) * sign(det),
                           (vx * qx + vy * qy + vz * qz) * sign(det)) h (to_b, to_c, ahead)
WHERE triangle &&& ray AND det <> 0 AND to_b >= 0 AND to_c >= 0 AND to_b + to_c <= abs(det) AND ahead > 0;
END;

CREATE FUNCTION is_inside_solid(of_model bigint, here geometry)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- Whether a point of a closed model's frame lies inside: two of three rays, which avoid the axes, leave it through an
-- odd number of triangles. A ray that meets an edge is outvoted.
DECLARE
    whole geometry := (SELECT semmap.diagonal(hull) FROM semmap.model WHERE id = of_model AND closed);
    far double precision := 2 * ST_3DLength(whole) + 1;
BEGIN
    RETURN coalesce(here &&& whole AND (
        SELECT count(*) FILTER (WHERE semmap.crossings(ARRAY(
                   SELECT part.geom FROM semmap.chunk c CROSS JOIN LATERAL ST_Dump(c.geom) part
                   WHERE c.model_id = of_model AND c.geom &&& ray), ray) % 2 = 1) >= 2
        FROM (VALUES (0.0137, 0.0291, 1.0), (0.0173, -1.0, -0.0213), (1.0, 0.0119, 0.0271)) d (dx, dy, dz)
        CROSS JOIN LATERAL ST_MakeLine(here, ST_Translate(here, dx * far, dy * far, dz * far)) ray), false);
END $$;

CREATE FUNCTION shape_distance(thing bigint, x double precision, y double precision, z double precision)
RETURNS double precision LANGUAGE plpgsql STABLE PARALLEL SAFE COST 10000 SET search_path = semmap, public, pg_temp AS $$
-- Metres from a point of the map's frame to an entity: to its triangles (drawn outline, points of a cloud), to its
-- pose where it has no geometry. 0 inside of a room, a region or a closed mesh. Null without a placement.
-- The point is taken into the entity's frame. Patches are read from near to far, chosen by their stored boxes.
DECLARE
    place semmap.world;
    local geometry;
    low double precision;
    reach double precision;
    most double precision;
    least_found double precision;
BEGIN
    SELECT * INTO place FROM semmap.world w WHERE w.entity_id = thing;
    IF place.footprint IS NULL THEN
        RETURN ST_3DDistance(ST_MakePoint(place.pose[1], place.pose[2], place.pose[3]), ST_MakePoint(x, y, z));
    ELSIF ST_Covers(place.footprint, ST_MakePoint(x, y)) AND EXISTS (
        SELECT FROM semmap.entity e LEFT JOIN semmap.room r ON r.entity_id = e.id
        WHERE e.id = thing AND CASE e.kind
            WHEN 'room' THEN z BETWEEN place.pose[3] + r.floor AND semmap.ceiling_of(thing)
            WHEN 'region' THEN z BETWEEN ST_ZMin(place.box) AND ST_ZMax(place.box) END) THEN
        RETURN 0;
    END IF;
    local := semmap.pose_apply(ST_MakePoint(x, y, z), semmap.pose_inverse(place.pose));
    low := semmap.box_distance(place.box, x, y, z);
    most := low + ST_3DLength(place.box);
    reach := low + greatest(ST_3DLength(place.box) / 16, 0.05);
    LOOP
        SELECT min(ST_3DDistance(c.geom, local)) INTO least_found
            FROM semmap.entity_chunk ec JOIN semmap.chunk c ON c.id = ec.chunk_id
            WHERE ec.entity_id = thing AND c.geom &&& semmap.around(ST_X(local), ST_Y(local), ST_Z(local), reach);
        EXIT WHEN least_found <= reach OR reach > most;
        reach := 2 * reach;
    END LOOP;
    least_found := least(least_found, (
        SELECT min(ST_3DDistance(semmap.drawn_surface(em.model_id), local)) FROM semmap.entity_model em
        WHERE em.entity_id = thing AND NOT EXISTS (SELECT FROM semmap.chunk c WHERE c.model_id = em.model_id)));
    IF least_found > 0 AND low = 0 AND EXISTS (
        SELECT FROM semmap.entity_model em WHERE em.entity_id = thing AND semmap.is_inside_solid(em.model_id, local)) THEN
        RETURN 0;
    END IF;
    RETURN least_found;
END $$;
