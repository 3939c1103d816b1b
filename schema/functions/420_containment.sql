-- Containment and support: is_in, is_on.

CREATE FUNCTION ground_share(a geometry, b geometry)
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Which part (0 to 1) of the footprint a lies in the footprint b; a point: 0 or 1. To a micrometre: without a grid,
-- ST_Intersection takes rooms for the same that share an edge whose corners differ in their last digits (GEOS 3.11, 3.14).
SELECT CASE WHEN NOT a && b THEN 0
            WHEN ST_Covers(b, a) THEN 1
            WHEN ST_Dimension(a) = 0 THEN 0
            ELSE ST_Area(ST_Intersection(a, b, 1e-6)) / ST_Area(a) END;
END;

CREATE FUNCTION height_share(low double precision, high double precision, floor double precision, ceiling double precision)
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Which part of the interval [low, high] lies in [floor, ceiling]; negative where they are apart.
SELECT CASE WHEN high > low THEN (least(high, ceiling) - greatest(low, floor)) / (high - low)
            WHEN low BETWEEN floor AND ceiling THEN 1
            ELSE -1 END;
END;

CREATE FUNCTION ceiling_of(place bigint)
RETURNS double precision LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan AS $$
-- The height of a room's ceiling in the map's frame: as specified, else the top of its geometry, else that of
-- its storey, else the floor of the storey above; infinite if none of them is known. In PL/pgSQL, which keeps the plan:
-- one for each call takes ten times as long.
BEGIN
    RETURN (
        SELECT coalesce(
            w.pose[3] + r.ceiling,
            CASE WHEN ST_ZMax(w.box) > w.pose[3] + r.floor + 0.1 THEN ST_ZMax(w.box) END,
            (SELECT sw.pose[3] + s.height FROM semmap.storey s JOIN semmap.world sw ON sw.entity_id = s.entity_id
             WHERE s.entity_id = w.storey_id),
            (SELECT min(sw.pose[3]) FROM semmap.storey s JOIN semmap.world sw ON sw.entity_id = s.entity_id
             WHERE sw.map_id = w.map_id AND sw.pose[3] > w.pose[3] + r.floor + 0.1),
            'Infinity')
        FROM semmap.room r JOIN semmap.world w ON w.entity_id = r.entity_id WHERE r.entity_id = place);
END $$;

CREATE FUNCTION room_at(of_map integer, ground geometry, middle double precision, OUT room_id bigint, OUT share double precision)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp SET plan_cache_mode = force_generic_plan AS $$
-- The room of a place, and which part of the ground lies in it. Of the rooms between whose floor and ceiling the middle
-- of the height is: the one with most of the ground, if at least half of it lies in rooms, of two one above the other the
-- upper one, on whose floor what has no height stands; else the room nearest to the
-- middle of the ground, if all of the ground is at its wall (15 cm), or the middle in an opening: half a metre from it
-- and from another room on the opposite side. Null outside of rooms.
DECLARE
    contact CONSTANT double precision := 0.03;
    wall CONSTANT double precision := 0.15;
    opening CONSTANT double precision := 0.5;
    exact CONSTANT double precision := 1e-6;  -- a pose composed again differs by less: it says the same room
    centre geometry;
    total double precision;
BEGIN
    SELECT c.entity_id, c.share, sum(c.share) OVER () INTO room_id, share, total
    FROM (SELECT o.entity_id, o.footprint, o.pose[3] + r.floor AS floor, semmap.ground_share(ground, o.footprint) AS share
          FROM semmap.world o JOIN semmap.room r ON r.entity_id = o.entity_id
          WHERE o.map_id = of_map AND o.footprint && ground
            AND middle BETWEEN o.pose[3] + r.floor - contact - exact
                AND coalesce(o.pose[3] + r.ceiling, semmap.ceiling_of(o.entity_id)) + contact + exact
          OFFSET 0) c  -- else the share is computed at each mention
    ORDER BY round(c.share::numeric, 6) DESC, round(ST_Distance(c.footprint, ST_Centroid(ground))::numeric, 6),
             middle < c.floor - exact, round(c.floor::numeric, 1) DESC, round(ST_Area(c.footprint)::numeric, 6), c.entity_id
    LIMIT 1;
    IF total >= 0.5 - exact THEN
        RETURN;
    END IF;
    room_id := NULL;
    centre := ST_Centroid(ground);
    WITH close AS (
        SELECT o.entity_id, o.footprint, o.pose[3] + r.floor AS floor, ST_Distance(o.footprint, centre) AS away, ST_ClosestPoint(o.footprint, centre) AS edge
        FROM semmap.world o JOIN semmap.room r ON r.entity_id = o.entity_id
        WHERE o.map_id = of_map AND o.footprint && ST_Expand(centre, opening + exact)
          AND ST_DWithin(o.footprint, centre, opening + exact)
          AND middle BETWEEN o.pose[3] + r.floor - contact - exact
              AND coalesce(o.pose[3] + r.ceiling, semmap.ceiling_of(o.entity_id)) + contact + exact)
    SELECT c.entity_id, semmap.ground_share(ground, c.footprint) INTO room_id, share
    FROM close c
    WHERE (SELECT bool_and(ST_DWithin(p.geom, c.footprint, wall + exact)) FROM ST_DumpPoints(ground) p) OR EXISTS (
        SELECT FROM close f WHERE f.entity_id <> c.entity_id
          AND (ST_X(c.edge) - ST_X(centre)) * (ST_X(f.edge) - ST_X(centre))
            + (ST_Y(c.edge) - ST_Y(centre)) * (ST_Y(f.edge) - ST_Y(centre)) < -exact)
    ORDER BY round(c.away::numeric, 6), middle < c.floor - exact, round(c.floor::numeric, 1) DESC, c.entity_id LIMIT 1;
END $$;

CREATE FUNCTION door_reach()
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Metres from a door to the rooms that it joins, at most, where it is not in a thicker wall between them.
SELECT 0.3::double precision;
END;

CREATE FUNCTION door_reach(opening geometry, rooms bigint[])
RETURNS double precision LANGUAGE sql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- Metres from a door to the two rooms that it joins, at most: as thick as the wall between them is there, up to 1.2 m,
-- and 5 cm for outlines that are not exact. The wall is measured across the opening, a tenth of its width within both
-- posts; no other room is in it.
SELECT CASE WHEN count(gap) = 2 AND max(ST_Length(gap)) <= 1.2 AND NOT bool_or(taken)
            THEN greatest(semmap.door_reach(), max(ST_Length(gap)) + 0.05) ELSE semmap.door_reach() END
FROM semmap.world a JOIN semmap.room r ON r.entity_id = a.entity_id
JOIN semmap.world b ON b.entity_id = rooms[2] AND b.entity_id <> a.entity_id
CROSS JOIN (SELECT ST_Azimuth(ST_StartPoint(opening), ST_EndPoint(opening))) o (along)
CROSS JOIN unnest(ARRAY[0.1, 0.9]) part
CROSS JOIN LATERAL (SELECT ST_LineInterpolatePoint(opening, part), 1.25 * cos(along), -1.25 * sin(along)) p (spot, x, y)
CROSS JOIN LATERAL (SELECT ST_MakeLine(ST_Translate(spot, x, y), ST_Translate(spot, -x, -y))) c (across)
CROSS JOIN LATERAL (SELECT ST_ShortestLine(ST_Intersection(a.footprint, across), ST_Intersection(b.footprint, across))) g (gap)
CROSS JOIN LATERAL (SELECT EXISTS (
    SELECT FROM semmap.world w JOIN semmap.room f ON f.entity_id = w.entity_id
    WHERE w.map_id = a.map_id AND w.entity_id <> ALL (rooms) AND w.footprint && gap
      AND abs(w.pose[3] + f.floor - a.pose[3] - r.floor) <= 0.5 AND ST_Length(ST_Intersection(w.footprint, gap)) > 0.1)) t (taken)
WHERE a.entity_id = rooms[1]
$$;

CREATE FUNCTION exit_fault(opening geometry, room bigint)
RETURNS text LANGUAGE sql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- Why a door of one room leads nobody outside, and what to do; null if it may. The room is on both sides of it, or
-- another room is on its other side, within the 0.6 m that a robot needs to stand there.
SELECT CASE WHEN bool_and(side.within) THEN format('leads outside, but %s is on both sides of it: draw it in the outer wall', min(e.name))
            WHEN min(other.name) IS NOT NULL
            THEN format('leads outside, but %s is on its other side: join it with that room', min(other.name)) END
FROM semmap.world a JOIN semmap.entity e ON e.id = a.entity_id JOIN semmap.room r ON r.entity_id = a.entity_id
CROSS JOIN unnest(ARRAY[-1, 1]) sign
CROSS JOIN LATERAL (
    SELECT ST_Covers(a.footprint, ST_LineInterpolatePoint(ST_OffsetCurve(opening, sign * (semmap.door_reach() + 0.05)), 0.5)),
           ST_Difference(ST_MakeLine(ST_LineInterpolatePoint(opening, 0.5), ST_LineInterpolatePoint(ST_OffsetCurve(opening, sign * 0.6), 0.5)),
                         a.footprint)) side (within, way)
LEFT JOIN LATERAL (
    SELECT oe.name FROM semmap.world o JOIN semmap.room f ON f.entity_id = o.entity_id JOIN semmap.entity oe ON oe.id = o.entity_id
    WHERE NOT side.within AND o.map_id = a.map_id AND o.entity_id <> a.entity_id AND o.footprint && side.way
      AND abs(o.pose[3] + f.floor - a.pose[3] - r.floor) <= 0.5 AND ST_Length(ST_Intersection(o.footprint, side.way)) > 0.05
    ORDER BY ST_Distance(o.footprint, opening), oe.name LIMIT 1) other ON true
WHERE a.entity_id = room AND a.footprint IS NOT NULL
$$;

CREATE FUNCTION door_fault(form text, width double precision, opening geometry, rooms bigint[])
RETURNS text LANGUAGE sql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- Why a connector leads nobody from room to room, and what to do, as what follows its name; null if it may. `opening` is
-- the line from post to post. The narrowest robots are 20 cm wide.
SELECT CASE
    WHEN width < 0.2 THEN format('is %s m wide, and nobody passes less than 0.2 m: give its clear width', round(width::numeric, 3))
    WHEN form NOT IN ('door', 'elevator_door') THEN NULL
    WHEN rooms[1] = rooms[2] AND (SELECT count(*) FROM semmap.world w, unnest(ARRAY[-1, 1]) side (sign)
         WHERE w.entity_id = rooms[1] AND ST_Covers(w.footprint, ST_LineInterpolatePoint(ST_OffsetCurve(opening, sign * (semmap.door_reach() + 0.05)), 0.5))) < 2
        THEN 'joins a room with itself, and is not in it: name the room on its other side, or none for outside'
    ELSE coalesce(CASE WHEN rooms[2] IS NULL THEN semmap.exit_fault(opening, rooms[1]) END,
         (SELECT format('ends %s m beside %s, which it joins: draw it at the wall of the room, from post to post', round(away::numeric, 2), e.name)
          FROM semmap.world w JOIN semmap.entity e ON e.id = w.entity_id AND e.kind = 'room'
          CROSS JOIN LATERAL greatest(ST_Distance(w.footprint, ST_StartPoint(opening)), ST_Distance(w.footprint, ST_EndPoint(opening))) away
          WHERE w.entity_id = ANY (rooms) AND away > semmap.door_reach() + 1e-6
            AND away > semmap.door_reach(opening, rooms) + 1e-6 AND away > ST_Length(opening) / 10  -- the rest is wide
          ORDER BY away DESC LIMIT 1))
END
$$;

CREATE FUNCTION opening_of(at_pose double precision[], width double precision)
RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- The line from post to post of a connector at a world pose.
SELECT ST_MakeLine(ST_MakePoint(at_pose[1] + half * sin(yaw), at_pose[2] - half * cos(yaw)),
                   ST_MakePoint(at_pose[1] - half * sin(yaw), at_pose[2] + half * cos(yaw)))
FROM (SELECT coalesce(width, 0) / 2, semmap.pose_yaw(at_pose)) d (half, yaw);
END;

CREATE FUNCTION room_of(thing bigint)
RETURNS bigint LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- The room of an entity, which all ways to ask for it say. Of an object or agent that of its place, see room_at, also
-- where it stands on something; of a region the one with more than half of its ground and half of its height. Where
-- the place shows none, and of anything else, such as a part of the building or a door, the nearest room among its
-- holders. Of a room, itself.
DECLARE
    this semmap.entity;
    place semmap.world;
    around bigint;
BEGIN
    SELECT * INTO this FROM semmap.entity WHERE id = thing;
    SELECT * INTO place FROM semmap.world w WHERE w.entity_id = thing;
    IF place.entity_id IS NOT NULL AND semmap.has_room(this.kind, this.type) THEN
        around := (semmap.room_at(place.map_id, semmap.ground_of(place), (ST_ZMin(place.box) + ST_ZMax(place.box)) / 2)).room_id;
    ELSIF place.entity_id IS NOT NULL AND this.kind = 'region' THEN
        SELECT o.entity_id INTO around
        FROM semmap.world o JOIN semmap.room r ON r.entity_id = o.entity_id
        WHERE o.map_id = place.map_id AND o.box && place.box AND semmap.fills(thing, o.entity_id, 0.01)
        ORDER BY round(ST_Area(o.footprint)::numeric, 6), o.entity_id LIMIT 1;
    END IF;
    RETURN coalesce(around, semmap.holding_room(thing));
END $$;

CREATE FUNCTION holding_room(thing bigint)
RETURNS bigint LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- An entity if it is a room, else the nearest room among its holders.
WITH RECURSIVE up (id, depth) AS (
    SELECT thing, 0
  UNION ALL
    SELECT (SELECT p.holder_id FROM semmap.placement p WHERE p.entity_id = up.id), depth + 1 FROM up WHERE up.id IS NOT NULL)
SELECT r.entity_id FROM up JOIN semmap.room r ON r.entity_id = up.id ORDER BY depth LIMIT 1;
END;

CREATE FUNCTION level_hull(thing bigint, heading double precision)
RETURNS box3d LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- The 3D box of an entity in the map's frame turned by `heading` about z.
SELECT coalesce(
    (SELECT ST_3DExtent(ST_RotateZ(semmap.pose_apply(m.hull, w.pose), -heading))
     FROM semmap.entity_model em JOIN semmap.model m ON m.id = em.model_id WHERE em.entity_id = thing),
    Box3D(ST_RotateZ(ST_MakePoint(w.pose[1], w.pose[2], w.pose[3]), -heading)))
FROM semmap.world w WHERE w.entity_id = thing;
END;

CREATE FUNCTION is_enclosed_by(a bigint, b bigint, tolerance double precision)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- Whether the surface of b shuts a in. More than half of a's box lies in b's, both upright and along b's
-- heading; and looking from a along b's axes, b is seen on four sides, or below and above, or below and
-- on three sides. A side counts where three of five rays meet b: from a's middle and the corners of the
-- middle half of its ground; sideways at half of a's height, upwards from its top, both `tolerance` above
-- its bottom at least, downwards from `tolerance` above its bottom. So a table top bears, but does not
-- enclose, what has sunk a little into it, and its legs do not enclose what stands between them.
DECLARE
    heading double precision := (SELECT semmap.pose_yaw(w.pose) FROM semmap.world w WHERE w.entity_id = b);
    of_a box3d := semmap.level_hull(a, heading);
    of_b box3d := semmap.level_hull(b, heading);
    middle double precision := greatest((ST_ZMin(of_a) + ST_ZMax(of_a)) / 2, ST_ZMin(of_a) + tolerance);
    top double precision := greatest(ST_ZMax(of_a), ST_ZMin(of_a) + tolerance);
    rays geometry[];
    sides geometry[];
    hit boolean[];
    seen boolean[];
BEGIN
    IF least(semmap.height_share(ST_XMin(of_a), ST_XMax(of_a), ST_XMin(of_b), ST_XMax(of_b)),
             semmap.height_share(ST_YMin(of_a), ST_YMax(of_a), ST_YMin(of_b), ST_YMax(of_b)),
             semmap.height_share(ST_ZMin(of_a), ST_ZMax(of_a), ST_ZMin(of_b), ST_ZMax(of_b))) <= 0
       OR semmap.height_share(ST_XMin(of_a), ST_XMax(of_a), ST_XMin(of_b), ST_XMax(of_b))
        * semmap.height_share(ST_YMin(of_a), ST_YMax(of_a), ST_YMin(of_b), ST_YMax(of_b))
        * semmap.height_share(ST_ZMin(of_a), ST_ZMax(of_a), ST_ZMin(of_b), ST_ZMax(of_b)) <= 0.5 THEN
        RETURN false;
    END IF;

    -- Six directions (down, up, then the sides) of five rays each.
    SELECT array_agg(ST_RotateZ(ray, heading) ORDER BY direction, spot) INTO rays
    FROM (VALUES (1, 0.0, 0.0), (2, -0.25, -0.25), (3, -0.25, 0.25), (4, 0.25, -0.25), (5, 0.25, 0.25)) v (spot, u, v)
    CROSS JOIN LATERAL (SELECT (ST_XMin(of_a) + ST_XMax(of_a)) / 2 + u * (ST_XMax(of_a) - ST_XMin(of_a)),
                               (ST_YMin(of_a) + ST_YMax(of_a)) / 2 + v * (ST_YMax(of_a) - ST_YMin(of_a))) p (x, y)
    CROSS JOIN LATERAL (VALUES
        (1, ST_MakeLine(ST_MakePoint(x, y, ST_ZMin(of_a) + tolerance), ST_MakePoint(x, y, ST_ZMin(of_b) - 1))),
        (2, ST_MakeLine(ST_MakePoint(x, y, top), ST_MakePoint(x, y, ST_ZMax(of_b) + 1))),
        (3, ST_MakeLine(ST_MakePoint(x, y, middle), ST_MakePoint(ST_XMin(of_b) - 1, y, middle))),
        (4, ST_MakeLine(ST_MakePoint(x, y, middle), ST_MakePoint(ST_XMax(of_b) + 1, y, middle))),
        (5, ST_MakeLine(ST_MakePoint(x, y, middle), ST_MakePoint(x, ST_YMin(of_b) - 1, middle))),
        (6, ST_MakeLine(ST_MakePoint(x, y, middle), ST_MakePoint(x, ST_YMax(of_b) + 1, middle)))) r (direction, ray);
    sides := ARRAY(SELECT semmap.surface_within(b, ST_Collect(rays[1:10]))
                   UNION ALL SELECT semmap.surface_within(b, ST_Collect(rays[11:30])));
    SELECT array_agg(EXISTS (SELECT FROM unnest(sides) s WHERE s &&& ray AND ST_3DDWithin(s, ray, 1e-6)) ORDER BY n)
        INTO hit FROM unnest(rays) WITH ORDINALITY r (ray, n);
    SELECT array_agg(count >= 3 ORDER BY direction) INTO seen
    FROM (SELECT (n - 1) / 5 AS direction, count(*) FILTER (WHERE h)
          FROM unnest(hit) WITH ORDINALITY s (h, n) GROUP BY 1) d;
    RETURN CASE (SELECT count(*) FILTER (WHERE s) FROM unnest(seen[3:6]) s)
           WHEN 4 THEN true
           WHEN 3 THEN seen[1]
           ELSE seen[1] AND seen[2] END;
END $$;

CREATE FUNCTION fills(a bigint, b bigint, tolerance double precision)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- Whether more than half of a's footprint is in that of b, a room or region, and half of its height between b's floor
-- and ceiling (`tolerance` metres more on either end). In a region also if a's bottom is at the region's lowest height,
-- so that a flat region can contain objects.
DECLARE
    wa semmap.world;
    wb semmap.world;
    is_room boolean := EXISTS (SELECT FROM semmap.room r WHERE r.entity_id = b);
    floor double precision;
    ceiling double precision;
BEGIN
    SELECT * INTO wa FROM semmap.world w WHERE w.entity_id = a;
    SELECT * INTO wb FROM semmap.world w WHERE w.entity_id = b;
    floor := ST_ZMin(wb.box);
    ceiling := ST_ZMax(wb.box);
    IF is_room THEN
        floor := wb.pose[3] + (SELECT r.floor FROM semmap.room r WHERE r.entity_id = b);
        ceiling := semmap.ceiling_of(b);
        IF ceiling = 'Infinity' AND NOT semmap.same_storey(wa.storey_id, wb.storey_id) THEN
            RETURN false;
        END IF;
    END IF;
    RETURN (semmap.height_share(ST_ZMin(wa.box), ST_ZMax(wa.box), floor - tolerance, ceiling + tolerance) >= 0.5
            OR NOT is_room AND abs(ST_ZMin(wa.box) - floor) <= tolerance)
       AND semmap.ground_share(semmap.ground_of(wa), wb.footprint) > 0.5;
END $$;

CREATE FUNCTION is_in(a bigint, b bigint, tolerance double precision DEFAULT 0.01)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE COST 5000 SET search_path = semmap, public, pg_temp AS $$
-- b contains a, in the map's frame.
-- A room: it is the room of a, see room_of: a muffin on a desk is in the office, and the wall beside it is not. A room
-- is in another one that it fills, see fills, as what is in a region.
-- Anything else: b's surface encloses a, see is_enclosed_by.
-- Without geometry (a storey, an elevator, a room that was not measured): by placement.
DECLARE
    wa semmap.world;
    wb semmap.world;
    a_kind text := (SELECT kind FROM semmap.entity WHERE id = a);
    b_kind text := (SELECT kind FROM semmap.entity WHERE id = b);
BEGIN
    SELECT * INTO wa FROM semmap.world w WHERE w.entity_id = a;
    SELECT * INTO wb FROM semmap.world w WHERE w.entity_id = b;
    IF a = b OR wa.map_id IS DISTINCT FROM wb.map_id OR wa.map_id IS NULL THEN
        RETURN false;
    ELSIF wb.footprint IS NULL OR semmap.is_nowhere(a) THEN
        RETURN semmap.is_held_by(a, b);
    ELSIF b_kind = 'room' AND a_kind <> 'room' THEN
        RETURN (wa.box && semmap.grown(wb.box, 0.5) OR semmap.is_held_by(a, b)) AND coalesce(semmap.room_of(a) = b, false);
    ELSIF NOT wa.box && wb.box THEN
        RETURN false;
    ELSIF b_kind IN ('room', 'region') THEN
        RETURN semmap.fills(a, b, tolerance);
    END IF;
    RETURN wa.box &&& wb.box AND semmap.is_enclosed_by(a, b, tolerance);
END $$;

CREATE FUNCTION level_patch(patch geometry, low double precision, high double precision)
RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- The part of a triangle between two heights, projected to the ground; null if it has no area.
SELECT CASE WHEN ST_Area(flat) > 1e-12 THEN flat END
FROM ST_ConvexHull(ST_Force2D(ST_Points(ST_LocateBetweenElevations(patch, low, high)))) flat
WHERE ST_Dimension(patch) = 2;
END;

CREATE FUNCTION underside(thing bigint, thickness double precision)
RETURNS geometry LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- The ground that the lowest `thickness` metres of an entity's surface cover; a point or an edge on which
-- it stands, one millimetre wide.
DECLARE
    box box3d;
    bottom double precision;
    lowest geometry[];
    flat geometry;
BEGIN
    SELECT w.box INTO box FROM semmap.world w WHERE w.entity_id = thing;
    bottom := ST_ZMin(box);
    lowest := ARRAY(SELECT semmap.surface_within(thing, ST_MakeLine(
        ST_MakePoint(ST_XMin(box) - 1, ST_YMin(box) - 1, bottom - thickness),
        ST_MakePoint(ST_XMax(box) + 1, ST_YMax(box) + 1, bottom + thickness))));
    SELECT ST_Union(semmap.level_patch(p, bottom - thickness, bottom + thickness)) INTO flat FROM unnest(lowest) p;
    IF flat IS NULL OR ST_Area(flat) < 1e-8 THEN
        SELECT ST_Union(ST_Buffer(ST_Force2D(ST_Points(CASE ST_Dimension(p) WHEN 0 THEN p
                   ELSE ST_LocateBetweenElevations(p, bottom - thickness, bottom + thickness) END)), 0.001, 2))
            INTO flat FROM unnest(lowest) p;
    END IF;
    RETURN flat;
END $$;

CREATE FUNCTION is_on(a bigint, b bigint, tolerance double precision DEFAULT 0.01)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE COST 10000 SET search_path = semmap, public, pg_temp AS $$
-- a rests on b, in the map's frame: b has surface within `tolerance` metres, up or down, of a's lowest
-- height, beneath a's underside (its lowest `tolerance` metres): at least 2 % of that, or of b's surface
-- there. b reaches lower than a does, by `tolerance` or half of its own height: two objects that stand on
-- the same floor are not on each other. Of two whose bottoms are within `tolerance`, only the one that
-- reaches higher can be on the other. Of direct contact: a muffin on a tray is not on the table.
-- A room or region: a is in it and its bottom within `tolerance` of the floor (the region's heights).
-- Rooms themselves rest on nothing.
DECLARE
    wa semmap.world;
    wb semmap.world;
    b_kind text := (SELECT kind FROM semmap.entity WHERE id = b);
    bottom double precision;
    low double precision;
    high double precision;
    base geometry;
    support geometry;
    common double precision;
BEGIN
    SELECT * INTO wa FROM semmap.world w WHERE w.entity_id = a;
    SELECT * INTO wb FROM semmap.world w WHERE w.entity_id = b;
    IF a = b OR wa.map_id IS DISTINCT FROM wb.map_id OR wa.map_id IS NULL OR wb.footprint IS NULL
       OR EXISTS (SELECT FROM semmap.entity WHERE id = a AND kind IN ('storey', 'elevator', 'room'))
       OR NOT wa.box && semmap.grown(wb.box, tolerance) THEN
        RETURN false;
    END IF;
    bottom := ST_ZMin(wa.box);
    IF b_kind = 'room' THEN
        RETURN abs(bottom - wb.pose[3] - (SELECT r.floor FROM semmap.room r WHERE r.entity_id = b)) <= tolerance
           AND semmap.is_in(a, b, tolerance);
    ELSIF b_kind = 'region' THEN
        RETURN bottom BETWEEN ST_ZMin(wb.box) - tolerance AND ST_ZMax(wb.box) + tolerance
           AND semmap.ground_share(semmap.ground_of(wa), wb.footprint) > 0.5;
    END IF;
    IF bottom < ST_ZMin(wb.box) - tolerance
       OR bottom <= ST_ZMin(wb.box) + tolerance AND ST_ZMax(wa.box) <= ST_ZMax(wb.box) THEN
        RETURN false;
    END IF;
    low := greatest(bottom - tolerance,
                    ST_ZMin(wb.box) + least(tolerance, (ST_ZMax(wb.box) - ST_ZMin(wb.box)) / 2)) - 1e-6;
    high := bottom + tolerance;
    IF low > high OR ST_ZMax(wb.box) < low THEN
        RETURN false;
    END IF;
    SELECT ST_Union(semmap.level_patch(p, low, high)) INTO support
    FROM semmap.surface_within(b, ST_MakeLine(ST_MakePoint(ST_XMin(wa.box), ST_YMin(wa.box), low),
                                       ST_MakePoint(ST_XMax(wa.box), ST_YMax(wa.box), high))) p;
    IF support IS NULL THEN
        RETURN false;
    END IF;
    base := semmap.underside(a, tolerance);
    common := ST_Area(ST_Intersection(base, support, 1e-6));
    RETURN coalesce(common > 1e-7 AND common >= 0.02 * least(ST_Area(base), ST_Area(support)), false);
END $$;
