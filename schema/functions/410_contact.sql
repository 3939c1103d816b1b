-- How near surfaces come: is_touching, is_near. Distances in metres between surfaces, not boxes.

CREATE FUNCTION along_longest_side(patches geometry[], whole box3d)
RETURNS geometry[] LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Triangles in the order of their middles along the longest side of their box `whole`.
SELECT array_agg(p ORDER BY CASE greatest(ST_XMax(whole) - ST_XMin(whole), ST_YMax(whole) - ST_YMin(whole),
                                          ST_ZMax(whole) - ST_ZMin(whole))
                            WHEN ST_XMax(whole) - ST_XMin(whole) THEN ST_XMin(p) + ST_XMax(p)
                            WHEN ST_YMax(whole) - ST_YMin(whole) THEN ST_YMin(p) + ST_YMax(p)
                            ELSE ST_ZMin(p) + ST_ZMax(p) END)
FROM unnest(patches) p;
END;

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
    of_a := semmap.along_longest_side(of_a, box_a);
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
-- that one is unpacked alone. Without patches, of what is drawn, else the point where it is.
DECLARE
    at_pose double precision[];
    local geometry;
    patch geometry;
BEGIN
    SELECT w.pose INTO at_pose FROM semmap.world w WHERE w.entity_id = thing;
    local := semmap.pose_apply(goal, semmap.pose_inverse(at_pose));
    SELECT c.geom INTO patch FROM semmap.entity_chunk ec JOIN semmap.chunk c ON c.id = ec.chunk_id
        WHERE ec.entity_id = thing ORDER BY c.geom <#> local LIMIT 1;
    IF patch IS NULL THEN
        patch := coalesce((SELECT semmap.drawn_surface(em.model_id) FROM semmap.entity_model em
                           WHERE em.entity_id = thing ORDER BY em.role DESC, em.model_id LIMIT 1), ST_MakePoint(0, 0, 0));
    END IF;
    RETURN semmap.pose_apply(ST_3DClosestPoint(patch, local), at_pose);
END $$;

CREATE FUNCTION corners_of(thing bigint)
RETURNS geometry LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- The points of an entity's surface that are corners of its hulls; without geometry, the point where it is.
SELECT semmap.pose_apply(coalesce((
    SELECT ST_CollectionExtract(ST_Collect(m.hull), 1) FROM semmap.entity_model em JOIN semmap.model m ON m.id = em.model_id
    WHERE em.entity_id = thing AND (em.role = 'visual' OR NOT EXISTS (
        SELECT FROM semmap.entity_model v WHERE v.entity_id = thing AND v.role = 'visual'))), ST_MakePoint(0, 0, 0)), w.pose)
FROM semmap.world w WHERE w.entity_id = thing;
END;

CREATE FUNCTION hull_gap(corners_a geometry, corners_b geometry, look double precision[])
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Metres between the hulls of two sets of corners, at least: between their boxes, turned by the pose `look`.
SELECT semmap.box_gap(semmap.pose_apply(corners_a, look)::box3d, semmap.pose_apply(corners_b, look)::box3d);
END;

CREATE FUNCTION surfaces_meet(a bigint, b bigint, reach double precision)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE COST 10000 SET search_path = semmap, public, pg_temp AS $$
-- Whether the surfaces of two entities come within `reach` metres of each other.
DECLARE
    box_a box3d;
    box_b box3d;
    corners_a geometry;
    corners_b geometry;
    line geometry;
    at_a geometry;
    of_a geometry[];
    of_b geometry[];
BEGIN
    SELECT wa.box, wb.box INTO box_a, box_b FROM semmap.world wa JOIN semmap.world wb ON wb.map_id = wa.map_id
        WHERE wa.entity_id = a AND wb.entity_id = b AND a <> b
          AND NOT (wa.footprint IS NULL AND semmap.is_nowhere(a)) AND NOT (wb.footprint IS NULL AND semmap.is_nowhere(b));
    IF NOT FOUND OR semmap.box_gap(box_a, box_b) > reach THEN
        RETURN false;
    ELSIF semmap.box_reach(box_a, box_b) <= reach THEN
        RETURN true;
    END IF;
    -- Two points that are near decide most pairs that meet: corners, else from one surface to the other and back. Hulls
    -- that are apart, seen along the line between them, decide most others.
    corners_a := semmap.corners_of(a);
    corners_b := semmap.corners_of(b);
    line := ST_3DShortestLine(corners_a, corners_b);
    IF ST_3DLength(line) <= reach THEN
        RETURN true;
    END IF;
    FOR attempt IN 1..2 LOOP
        IF semmap.hull_gap(corners_a, corners_b, semmap.turn_to_x(line)) > reach THEN
            RETURN false;
        END IF;
        at_a := semmap.near_point(a, ST_EndPoint(line));
        line := ST_MakeLine(at_a, semmap.near_point(b, at_a));
        IF ST_3DLength(line) <= reach THEN
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

CREATE FUNCTION is_nearer(a bigint, b bigint, distance double precision, or_equal boolean)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE COST 10000 SET search_path = semmap, public, pg_temp AS $$
-- Whether the `surface_distance` of a and b is less than `distance` metres, `or_equal`; null if it has no value.
DECLARE
    gap double precision;
    nowhere boolean;
    slack double precision := 1e-9 * (1 + abs(distance));  -- within it, the distance itself is compared
BEGIN
    SELECT semmap.box_gap(wa.box, wb.box), wa.footprint IS NULL AND semmap.is_nowhere(a)
            OR wb.footprint IS NULL AND semmap.is_nowhere(b)
        INTO gap, nowhere
        FROM semmap.world wa JOIN semmap.world wb ON wb.map_id = wa.map_id WHERE wa.entity_id = a AND wb.entity_id = b;
    IF NOT FOUND OR nowhere OR distance IS NULL OR distance = 'NaN' THEN
        RETURN NULL;
    ELSIF distance < 0 OR gap > distance + slack THEN
        RETURN false;
    ELSIF distance > slack AND (a = b OR semmap.is_near(a, b, distance - slack)) THEN
        RETURN true;
    ELSIF NOT (a = b OR semmap.is_near(a, b, distance + slack)) THEN
        RETURN false;
    END IF;
    RETURN CASE WHEN or_equal THEN semmap.surface_distance(a, b) <= distance ELSE semmap.surface_distance(a, b) < distance END;
END $$;

CREATE FUNCTION nearest_patches(of_a geometry[], of_b geometry[], reach double precision)
RETURNS double precision LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- Metres between the nearest triangles of `of_a` and `of_b`, or `reach` if they are not nearer. Divides and leaves out
-- as `patches_meet` does, the nearer half first.
DECLARE
    n integer := cardinality(of_a);
    m integer := cardinality(of_b);
    box_a box3d;
    box_b box3d;
    half geometry[];
BEGIN
    IF n = 0 OR m = 0 THEN
        RETURN reach;
    ELSIF n < m THEN
        RETURN semmap.nearest_patches(of_b, of_a, reach);
    ELSIF n::bigint * m <= 400 THEN
        RETURN least(reach, (
            SELECT min(ST_3DDistance(p, q)) FROM unnest(of_b) q
            CROSS JOIN LATERAL (SELECT semmap.grown(q, reach) OFFSET 0) near (zone)
            CROSS JOIN unnest(of_a) p WHERE p &&& near.zone));
    END IF;
    SELECT ST_3DExtent(p) INTO box_a FROM unnest(of_a) p;
    SELECT ST_3DExtent(p) INTO box_b FROM unnest(of_b) p;
    of_a := semmap.along_longest_side(of_a, box_a);
    FOR half, box_a IN
        SELECT part, whole FROM (VALUES (of_a[:n / 2]), (of_a[n / 2 + 1:])) v (part)
        CROSS JOIN LATERAL (SELECT ST_3DExtent(p) AS whole FROM unnest(part) p) e
        ORDER BY semmap.box_gap(whole, box_b)
    LOOP
        IF semmap.box_gap(box_a, box_b) < reach THEN
            reach := semmap.nearest_patches(
                half, ARRAY(SELECT q FROM unnest(of_b) q WHERE q &&& semmap.grown(box_a, reach)), reach);
        END IF;
    END LOOP;
    RETURN reach;
END $$;

CREATE FUNCTION surface_distance(a bigint, b bigint)
RETURNS double precision LANGUAGE plpgsql STABLE PARALLEL SAFE COST 100000 SET search_path = semmap, public, pg_temp AS $$
-- Metres between the surfaces of two entities: 0 where they meet, for an entity and itself, and where one of them is a
-- room or region that the other is in. Null without a place.
DECLARE
    corners_a geometry := semmap.corners_of(a);
    corners_b geometry := semmap.corners_of(b);
    line geometry;  -- from one surface to the other
    shorter geometry := ST_3DShortestLine(corners_a, corners_b);
    look double precision[];
    back double precision[];
    reach double precision;
    at_a geometry;
BEGIN
    IF NOT EXISTS (SELECT FROM semmap.world wa JOIN semmap.world wb ON wb.map_id = wa.map_id
                   WHERE wa.entity_id = a AND wb.entity_id = b) OR semmap.is_nowhere(a) OR semmap.is_nowhere(b) THEN
        RETURN NULL;
    ELSIF a = b OR semmap.is_space(b) AND semmap.is_in(a, b) OR semmap.is_space(a) AND semmap.is_in(b, a) THEN
        RETURN 0;
    END IF;
    FOR attempt IN 1..4 LOOP
        EXIT WHEN ST_3DLength(shorter) >= reach;
        line := shorter;
        reach := ST_3DLength(line);
        look := semmap.turn_to_x(line);
        IF semmap.hull_gap(corners_a, corners_b, look) >= reach - 1e-9 THEN
            RETURN reach;  -- seen along the line, nothing lies between the hulls
        END IF;
        at_a := semmap.near_point(a, ST_EndPoint(line));
        shorter := ST_MakeLine(at_a, semmap.near_point(b, at_a));
    END LOOP;
    -- Turned back, as boxes fit the triangles of most things best in the map's frame.
    back := semmap.pose_inverse(look);
    RETURN semmap.nearest_patches(
        ARRAY(SELECT semmap.pose_apply(p, back) FROM semmap.surface_within(
            a, semmap.grown(semmap.pose_apply(corners_b, look)::box3d, reach), look) p),
        ARRAY(SELECT semmap.pose_apply(q, back) FROM semmap.surface_within(
            b, semmap.grown(semmap.pose_apply(corners_a, look)::box3d, reach), look) q),
        reach);
END $$;
