-- Sides of an entity: is_left_of, is_right_of, is_in_front_of, is_behind, is_between. Horizontal, on one storey.
--
-- The frame says where the front of b is:
--   'object'   where b itself faces: along its x axis, turned by entity.front; its left is its own left hand's
--   'map'      along the map's x axis; left is along its y axis (REP 103)
--   observer   an entity or a pose of the map, looking at the middle of b from where it stands: what is in
--              front of b is on the observer's side of it, and left is the observer's left

CREATE FUNCTION middle(thing bigint)
RETURNS geometry LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- The centroid of an entity's footprint; without geometry, the point where it is.
SELECT ST_Centroid(semmap.ground_of(w))
FROM semmap.world w WHERE w.entity_id = thing;
END;

CREATE FUNCTION is_outside(ahead double precision, left_out double precision, side text)
RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Whether a spot that is so many metres out of a rectangle, to the front and to the left, is on the named side of it.
SELECT CASE side WHEN 'front' THEN ahead > 0 AND ahead >= abs(left_out)
                 WHEN 'behind' THEN ahead < 0 AND -ahead >= abs(left_out)
                 WHEN 'left' THEN left_out > 0 AND left_out >= abs(ahead)
                 WHEN 'right' THEN left_out < 0 AND -left_out >= abs(ahead) END;
END;

CREATE FUNCTION things_to_side(b bigint, among bigint[], front double precision, leftward double precision, side text)
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 10
BEGIN ATOMIC
-- Those whose middle is to the named side of b, whose front and left have these headings in the map.
-- Measured from the sides of the rectangle around b's footprint along these headings: the side on which
-- a middle is furthest out is its side, and both are on a diagonal. So all along a table's left side is left of it,
-- further out it is the quarter between the diagonals. Above or within the rectangle it is none.
SELECT wa.entity_id
FROM semmap.world wb CROSS JOIN LATERAL (SELECT ST_Rotate(semmap.ground_of(wb), -front) OFFSET 0) f (ground)
CROSS JOIN unnest(among) a (id)
JOIN semmap.world wa ON wa.entity_id = a.id AND wa.map_id = wb.map_id AND semmap.same_storey(wa.storey_id, wb.storey_id)
CROSS JOIN LATERAL (SELECT ST_Rotate(ST_Centroid(semmap.ground_of(wa)), -front) OFFSET 0) t (spot)
CROSS JOIN LATERAL (SELECT ST_X(t.spot) - least(greatest(ST_X(t.spot), ST_XMin(f.ground)), ST_XMax(f.ground)),
                           sign(sin(leftward - front)) * (ST_Y(t.spot) - least(
                               greatest(ST_Y(t.spot), ST_YMin(f.ground)), ST_YMax(f.ground)))) o (ahead, left_out)
WHERE wb.entity_id = b
  AND NOT (wa.footprint IS NULL AND semmap.is_nowhere(wa.entity_id)) AND NOT (wb.footprint IS NULL AND semmap.is_nowhere(b))
  AND semmap.is_outside(ahead, left_out, side);
END;

CREATE FUNCTION pairs_to_side(of_map integer, side text)
RETURNS TABLE (a bigint, b bigint) LANGUAGE sql STABLE PARALLEL SAFE ROWS 10000
BEGIN ATOMIC
-- All (a, b) of a map such that a is to the named side of b in the frame 'object': see things_to_side. Each middle and
-- each rectangle is computed once.
WITH placed AS MATERIALIZED (
    SELECT w.entity_id, w.storey_id, semmap.pose_yaw(w.pose) + e.front AS heading, semmap.ground_of(w) AS ground,
           ST_Centroid(semmap.ground_of(w)) AS middle
    FROM semmap.world w JOIN semmap.entity e ON e.id = w.entity_id
    WHERE w.map_id = of_map AND NOT (w.footprint IS NULL AND e.kind IN ('storey', 'elevator', 'room'))
), turned AS MATERIALIZED (
    SELECT entity_id, storey_id, heading, ST_XMin(r.ground) AS x, ST_XMax(r.ground) AS to_x, ST_YMin(r.ground) AS y, ST_YMax(r.ground) AS to_y
    FROM placed CROSS JOIN LATERAL (SELECT ST_Rotate(placed.ground, -heading) OFFSET 0) r (ground)
)
SELECT p.entity_id, t.entity_id
FROM turned t JOIN placed p ON p.entity_id <> t.entity_id AND semmap.same_storey(p.storey_id, t.storey_id)
CROSS JOIN LATERAL (SELECT ST_Rotate(p.middle, -t.heading) OFFSET 0) m (spot)
CROSS JOIN LATERAL (SELECT ST_X(m.spot), ST_Y(m.spot) OFFSET 0) s (x, y)
WHERE semmap.is_outside(s.x - least(greatest(s.x, t.x), t.to_x),
                        s.y - least(greatest(s.y, t.y), t.to_y), side);
END;

CREATE FUNCTION side_in_frame(b bigint, among bigint[], frame text, side text)
RETURNS SETOF bigint LANGUAGE plpgsql STABLE PARALLEL SAFE ROWS 10 SET search_path = semmap, public, pg_temp AS $$
-- things_to_side in the frame 'map' or 'object'.
DECLARE
    heading double precision;
BEGIN
    IF frame = 'map' THEN
        heading := 0;
    ELSIF frame = 'object' THEN
        SELECT semmap.pose_yaw(w.pose) + e.front INTO heading
            FROM semmap.world w JOIN semmap.entity e ON e.id = w.entity_id WHERE w.entity_id = b;
    ELSE
        RAISE EXCEPTION 'there is no frame ''%''', frame
            USING ERRCODE = 'invalid_parameter_value',
                  HINT = 'It is ''map'', ''object'', or an observer: the id of an entity, or a pose.';
    END IF;
    RETURN QUERY SELECT semmap.things_to_side(b, among, heading, heading + pi() / 2, side);
END $$;

CREATE FUNCTION side_as_seen(a bigint, b bigint, observer double precision[], side text)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- Whether a is to a side of b as seen by an observer whose pose (of which x and y count) is given.
DECLARE
    target geometry := semmap.middle(b);
    gaze double precision := atan2(ST_Y(target) - observer[2], ST_X(target) - observer[1]);
BEGIN
    IF ST_DWithin(target, ST_MakePoint(observer[1], observer[2]), 1e-6) THEN
        RETURN false;                                          -- no direction of view
    END IF;
    RETURN EXISTS (SELECT semmap.things_to_side(b, ARRAY[a], gaze + pi(), gaze + pi() / 2, side));
END $$;

DO $$
-- Four relations, each in a frame ('object', which is b, or 'map'), as an entity sees it that looks at b from where it is
-- (false where it is not placed in their map), and from a pose of the map (x, y, ...). See above and
-- things_to_side. No contact tolerance. And all that are on this side of b.
DECLARE
    relation text;
    things text;
    side text;
BEGIN
    FOR relation, things, side IN VALUES
        ('is_left_of', 'things_left_of', 'left'), ('is_right_of', 'things_right_of', 'right'),
        ('is_in_front_of', 'things_in_front_of', 'front'), ('is_behind', 'things_behind', 'behind')
    LOOP
        EXECUTE format($def$
CREATE FUNCTION %1$I(a bigint, b bigint, frame text DEFAULT 'object')
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE COST 1000
BEGIN ATOMIC
SELECT EXISTS (SELECT semmap.side_in_frame(b, ARRAY[a], frame, %2$L));
END;

CREATE FUNCTION %3$I(thing bigint, frame text DEFAULT 'object')
RETURNS SETOF bigint LANGUAGE sql STABLE PARALLEL SAFE ROWS 10 COST 10000
BEGIN ATOMIC
SELECT semmap.side_in_frame(thing, ARRAY(
    SELECT wa.entity_id FROM semmap.world wb JOIN semmap.world wa ON wa.map_id = wb.map_id WHERE wb.entity_id = thing),
    frame, %2$L);
END;

CREATE FUNCTION %1$I(a bigint, b bigint, observer bigint)
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE COST 1000
BEGIN ATOMIC
SELECT coalesce(semmap.side_as_seen(a, b, (SELECT o.pose FROM semmap.world o JOIN semmap.world w ON w.map_id = o.map_id
                                    WHERE o.entity_id = observer AND w.entity_id = b), %2$L), false);
END;

CREATE FUNCTION %1$I(a bigint, b bigint, observer double precision[])
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE COST 1000
BEGIN ATOMIC
SELECT semmap.side_as_seen(a, b, observer, %2$L);
END;
$def$, relation, side, things);
    END LOOP;
END $$;

CREATE FUNCTION is_between(a bigint, b bigint, c bigint, tolerance double precision DEFAULT 0.01)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE COST 10000 SET search_path = semmap, public, pg_temp AS $$
-- a is between b and c, in the map's frame, on one storey. Side by side: the middle of a lies within the
-- convex hull of both footprints (`tolerance` metres more), but in neither of them, and a's heights
-- meet theirs. Or stacked: a is above one and under the other.
DECLARE
    wa semmap.world;
    wb semmap.world;
    wc semmap.world;
    spot geometry := semmap.middle(a);
    of_b geometry;
    of_c geometry;
BEGIN
    SELECT * INTO wa FROM semmap.world w WHERE w.entity_id = a;
    SELECT * INTO wb FROM semmap.world w WHERE w.entity_id = b;
    SELECT * INTO wc FROM semmap.world w WHERE w.entity_id = c;
    IF a IN (b, c) OR b = c OR semmap.is_nowhere(a) OR semmap.is_nowhere(b) OR semmap.is_nowhere(c)
       OR wa.map_id IS NULL OR wa.map_id IS DISTINCT FROM wb.map_id
       OR wa.map_id IS DISTINCT FROM wc.map_id OR NOT semmap.same_storey(wa.storey_id, wb.storey_id)
       OR NOT semmap.same_storey(wa.storey_id, wc.storey_id) OR NOT semmap.same_storey(wb.storey_id, wc.storey_id) THEN
        RETURN false;
    END IF;
    of_b := semmap.ground_of(wb);
    of_c := semmap.ground_of(wc);
    RETURN ST_DWithin(ST_ConvexHull(ST_Collect(of_b, of_c)), spot, tolerance)
           AND NOT ST_Intersects(of_b, spot) AND NOT ST_Intersects(of_c, spot)
           AND ST_ZMax(wa.box) >= least(ST_ZMin(wb.box), ST_ZMin(wc.box)) - tolerance
           AND ST_ZMin(wa.box) <= greatest(ST_ZMax(wb.box), ST_ZMax(wc.box)) + tolerance
        OR semmap.is_above(a, b, tolerance) AND semmap.is_under(a, c, tolerance)
        OR semmap.is_above(a, c, tolerance) AND semmap.is_under(a, b, tolerance);
END $$;
