-- The triangles of a region that is a set of faces.

CREATE FUNCTION model_faces(of_model bigint, wanted integer[])
RETURNS geometry LANGUAGE sql STABLE STRICT PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- Triangles of a model, in its own frame, by their numbers in the order of its chunks, from 0.
WITH patch AS (
    SELECT id, sum(ST_NumGeometries(geom)) OVER (ORDER BY number) AS upto, ST_NumGeometries(geom) AS n
    FROM semmap.chunk WHERE model_id = of_model
), asked AS (
    SELECT p.id, f - (p.upto - p.n) + 1 AS at
    FROM unnest(wanted) AS f JOIN patch p ON f >= p.upto - p.n AND f < p.upto
)
SELECT ST_Collect(part.geom)
FROM (SELECT id, array_agg(at) AS places FROM asked GROUP BY id) a
JOIN semmap.chunk c ON c.id = a.id
CROSS JOIN LATERAL ST_Dump(c.geom) part
WHERE part.path[1] = ANY (a.places)
$$;
