-- How near surfaces come: is_touching, is_near. Distances in metres between surfaces, not boxes.

CREATE FUNCTION patches_meet(of_a geometry[], of_b geometry[], reach double precision)
RETURNS boolean LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- Whether some triangle of `of_a` comes within `reach` of one of `of_b`. Boxes decide whole sets where
-- they can; else the larger set is halved along its longest side, so that large meshes cost
-- about n log n, and small ones are compared triangle by triangle.
DECLARE
    n integer := cardinality(of_a);
    m integer := cardinality(of_b);
    box_a box3d;
    box_b box3d;
    zone geometry;
    half geometry[];
BEGIN
    IF n = 0 OR m = 0 THEN
        RETURN false;
    END IF;
    IF n < m THEN
        RETURN semmap.patches_meet(of_b, of_a, reach);
    END IF;
    SELECT ST_3DExtent(p) INTO box_a FROM unnest(of_a) p;
    SELECT ST_3DExtent(p) INTO box_b FROM unnest(of_b) p;
    IF semmap.box_gap(box_a, box_b) > reach THEN
        RETURN false;
    ELSIF semmap.box_reach(box_a, box_b) <= reach THEN
        RETURN true;
    ELSIF n::bigint * m <= 400 OR n <= 16 THEN
        RETURN EXISTS (
            SELECT FROM unnest(of_b) q CROSS JOIN LATERAL (SELECT semmap.grown(q, reach) OFFSET 0) near (zone)
            CROSS JOIN unnest(of_a) p
            WHERE p &&& near.zone AND ST_3DDWithin(p, q, reach));
    END IF;
    SELECT array_agg(p ORDER BY CASE greatest(ST_XMax(box_a) - ST_XMin(box_a), ST_YMax(box_a) - ST_YMin(box_a),
                                              ST_ZMax(box_a) - ST_ZMin(box_a))
                                WHEN ST_XMax(box_a) - ST_XMin(box_a) THEN ST_XMin(p) + ST_XMax(p)
                                WHEN ST_YMax(box_a) - ST_YMin(box_a) THEN ST_YMin(p) + ST_YMax(p)
                                ELSE ST_ZMin(p) + ST_ZMax(p) END)
        INTO of_a FROM unnest(of_a) p;
    FOR side IN 0..1 LOOP
        half := CASE side WHEN 0 THEN of_a[:n / 2] ELSE of_a[n / 2 + 1:] END;
        SELECT semmap.grown(ST_3DExtent(p), reach) INTO zone FROM unnest(half) p;
        IF semmap.patches_meet(half, ARRAY(SELECT q FROM unnest(of_b) q WHERE q &&& zone), reach) THEN
            RETURN true;
        END IF;
    END LOOP;
    RETURN false;
END $$;

CREATE FUNCTION near_point(thing bigint, goal geometry)
RETURNS geometry LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- The point of one patch of an entity that is nearest to a point: of the patch whose box is nearest on the ground, so
-- that one is unpacked alone. Null without patches.
DECLARE
    at_pose double precision[];
    local geometry;
    patch geometry;
BEGIN
    SELECT w.pose INTO at_pose FROM semmap.world w WHERE w.entity_id = thing;
    local := semmap.pose_apply(goal, semmap.pose_inverse(at_pose));
    SELECT c.geom INTO patch FROM semmap.entity_chunk ec JOIN semmap.chunk c ON c.id = ec.chunk_id
        WHERE ec.entity_id = thing ORDER BY c.geom <#> local LIMIT 1;
    RETURN semmap.pose_apply(ST_3DClosestPoint(patch, local), at_pose);
END $$;

CREATE FUNCTION surfaces_meet(a bigint, b bigint, reach double precision)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE COST 10000 SET search_path = semmap, public, pg_temp AS $$
-- Whether the surfaces of two entities come within `reach` metres of each other.
DECLARE
    box_a box3d;
    box_b box3d;
    at_a geometry;
    at_b geometry;
    of_a geometry[];
    of_b geometry[];
BEGIN
    SELECT wa.box, wb.box INTO box_a, box_b FROM semmap.world wa JOIN semmap.world wb ON wb.map_id = wa.map_id
        WHERE wa.entity_id = a AND wb.entity_id = b AND a <> b;
    IF NOT FOUND OR semmap.box_gap(box_a, box_b) > reach THEN
        RETURN false;
    ELSIF semmap.box_reach(box_a, box_b) <= reach AND NOT semmap.is_nowhere(a) AND NOT semmap.is_nowhere(b) THEN
        RETURN true;
    END IF;
    -- Two points that are near decide most pairs that meet: from one surface to the other and back.
    at_b := ST_PointN(semmap.grown(box_b, 0), 1);
    FOR attempt IN 1..2 LOOP
        at_a := semmap.near_point(a, at_b);
        at_b := semmap.near_point(b, at_a);
        IF ST_3DDWithin(at_a, at_b, reach) THEN
            RETURN true;
        END IF;
    END LOOP;
    of_a := ARRAY(SELECT semmap.surface_within(a, semmap.grown(box_b, reach)));
    IF of_a = '{}' THEN
        RETURN false;
    END IF;
    SELECT ST_3DExtent(p) INTO box_a FROM unnest(of_a) p;
    of_b := ARRAY(SELECT semmap.surface_within(b, semmap.grown(box_a, reach)));
    RETURN semmap.patches_meet(of_a, of_b, reach);
END $$;

CREATE FUNCTION is_touching(a bigint, b bigint, tolerance double precision DEFAULT 0.01)
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE COST 10000
BEGIN ATOMIC
-- The surfaces of a and b are at most `tolerance` metres apart, anywhere, or pass through each other.
-- An entity that lies inside another one without contact does not touch it. Symmetric; needs no frame.
SELECT semmap.surfaces_meet(a, b, tolerance);
END;

CREATE FUNCTION is_space(thing bigint)
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- Whether an entity is a room or a region: a piece of space rather than a body.
SELECT EXISTS (SELECT FROM semmap.entity WHERE id = thing AND kind IN ('room', 'region'));
END;

CREATE FUNCTION is_near(a bigint, b bigint, distance double precision)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE COST 10000 SET search_path = semmap, public, pg_temp AS $$
-- The surfaces of a and b are at most `distance` metres apart, straight through whatever is between
-- them, walls too; or one of them is a room or region that the other is in. Symmetric; needs no frame.
BEGIN
    RETURN semmap.surfaces_meet(a, b, distance)
        OR semmap.is_space(b) AND semmap.is_in(a, b) OR semmap.is_space(a) AND semmap.is_in(b, a);
END $$;
