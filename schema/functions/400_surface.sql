-- The surfaces that relations measure, in world coordinates; only the required part of each is read.
--
-- A relation is between two entities of one map. It is false, never null, if one of them is not placed, and
-- between an entity and itself. An entity without geometry is a point at its position. A storey, elevator or
-- room without geometry has no position: only the placements tell what is in it.

CREATE FUNCTION grown(box box3d, reach double precision)
RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- The diagonal of a 3D box that reaches `reach` metres further to each side.
SELECT ST_MakeLine(ST_MakePoint(ST_XMin(box) - reach, ST_YMin(box) - reach, ST_ZMin(box) - reach),
                   ST_MakePoint(ST_XMax(box) + reach, ST_YMax(box) + reach, ST_ZMax(box) + reach));
END;

CREATE FUNCTION box_corners(box box3d)
RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- The eight corners of a 3D box.
SELECT ST_Collect(ST_MakePoint(x, y, z))
FROM unnest(ARRAY[ST_XMin(box), ST_XMax(box)]) x, unnest(ARRAY[ST_YMin(box), ST_YMax(box)]) y,
     unnest(ARRAY[ST_ZMin(box), ST_ZMax(box)]) z;
END;

CREATE FUNCTION box_gap(a box3d, b box3d)
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Metres between two 3D boxes; 0 where they meet.
SELECT sqrt(power(greatest(ST_XMin(a) - ST_XMax(b), ST_XMin(b) - ST_XMax(a), 0), 2)
          + power(greatest(ST_YMin(a) - ST_YMax(b), ST_YMin(b) - ST_YMax(a), 0), 2)
          + power(greatest(ST_ZMin(a) - ST_ZMax(b), ST_ZMin(b) - ST_ZMax(a), 0), 2));
END;

CREATE FUNCTION box_reach(a box3d, b box3d)
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Metres that a point of one 3D box and a point of the other can be apart at most.
SELECT sqrt(power(greatest(ST_XMax(a) - ST_XMin(b), ST_XMax(b) - ST_XMin(a)), 2)
          + power(greatest(ST_YMax(a) - ST_YMin(b), ST_YMax(b) - ST_YMin(a)), 2)
          + power(greatest(ST_ZMax(a) - ST_ZMin(b), ST_ZMax(b) - ST_ZMin(a)), 2));
END;

CREATE FUNCTION drawn_surface(of_model bigint)
RETURNS geometry LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- The surface of a model without faces, in its own frame: its outline from the lowest to the highest
-- point of its hull, else the corners of the hull.
SELECT CASE WHEN outline IS NULL THEN hull
            WHEN ST_ZMax(hull) > ST_ZMin(hull) THEN semmap.prism_tin(outline, ST_ZMin(hull), ST_ZMax(hull))
            ELSE ST_Force3DZ(outline, ST_ZMin(hull)) END
FROM semmap.model WHERE id = of_model;
END;

CREATE FUNCTION is_nowhere(thing bigint)
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- Whether an entity is a storey, elevator or room without geometry: its pose is a frame, not a place.
SELECT EXISTS (SELECT FROM semmap.entity e JOIN semmap.world w ON w.entity_id = e.id
               WHERE e.id = thing AND e.kind IN ('storey', 'elevator', 'room') AND w.footprint IS NULL);
END;

CREATE FUNCTION ground_of(place world)
RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- The footprint; without geometry, the point.
SELECT coalesce(place.footprint, ST_MakePoint(place.pose[1], place.pose[2]));
END;

CREATE FUNCTION surface_within(thing bigint, zone geometry, look double precision[] DEFAULT ARRAY[0, 0, 0, 0, 0, 0, 1])
RETURNS SETOF geometry LANGUAGE plpgsql STABLE PARALLEL SAFE ROWS 100 COST 1000 SET search_path = semmap, public, pg_temp AS $$
-- The triangles (or drawn polygons, points of a cloud) of an entity, in coordinates of the map turned by the pose
-- `look`, whose 3D boxes meet that of `zone`. The zone is taken into the model's frame, so that patches of triangles
-- are sorted out by their stored boxes, before any of them is unpacked.
DECLARE
    at_pose double precision[];
    local geometry;
    shaped boolean;
BEGIN
    SELECT semmap.pose_compose(look, w.pose), w.footprint IS NOT NULL INTO at_pose, shaped
        FROM semmap.world w WHERE w.entity_id = thing;
    IF NOT shaped THEN
        RETURN QUERY SELECT p FROM ST_MakePoint(at_pose[1], at_pose[2], at_pose[3]) p
            WHERE p &&& zone AND NOT semmap.is_nowhere(thing);
        RETURN;
    END IF;
    local := semmap.pose_apply(semmap.box_corners(zone), semmap.pose_inverse(at_pose));
    RETURN QUERY
        WITH patch AS (
            SELECT c.geom FROM semmap.entity_chunk ec JOIN semmap.chunk c ON c.id = ec.chunk_id
            WHERE ec.entity_id = thing AND c.geom &&& local
          UNION ALL
            SELECT semmap.drawn_surface(em.model_id) FROM semmap.entity_model em
            WHERE em.entity_id = thing AND NOT EXISTS (SELECT FROM semmap.chunk c WHERE c.model_id = em.model_id)
        )
        SELECT placed.geom
        FROM patch CROSS JOIN LATERAL ST_Dump(patch.geom) part
        CROSS JOIN LATERAL (SELECT semmap.pose_apply(part.geom, at_pose) OFFSET 0) placed (geom)
        WHERE part.geom &&& local AND placed.geom &&& zone;
END $$;

CREATE FUNCTION same_storey(a bigint, b bigint)
RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Whether two storeys (world.storey_id) can be the same: they are, or one is not known.
SELECT coalesce(a = b, true);
END;

CREATE FUNCTION is_held_by(a bigint, b bigint)
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- b is the holder of a, or the holder of its holder, and so on: by placement, not by geometry.
WITH RECURSIVE up (id) AS (
    SELECT holder_id FROM semmap.placement WHERE entity_id = a
  UNION
    SELECT (SELECT p.holder_id FROM semmap.placement p WHERE p.entity_id = up.id) FROM up)
SELECT EXISTS (SELECT FROM up WHERE id = b);
END;
