-- The topology as edges between approach poses, for pgr_dijkstra, SQL and QGIS. An approach pose is the pose before
-- a connector on one of its sides: its id is twice that of the connector, plus 1 on the side of place_b. Costs are
-- seconds, -1 where this class of robots cannot go. Filter on map_id and robot_class.

CREATE VIEW approach_pose AS
    SELECT 2 * c.entity_id + s.side AS id, m.name AS map, e.map_id, c.entity_id AS connector_id, e.name AS connector,
           s.side, s.place_id, coalesce(p.name, 'outside') AS place, pose_compose(w.pose, s.pose) AS pose
    FROM connector c JOIN entity e ON e.id = c.entity_id JOIN map m ON m.id = e.map_id
    JOIN world w ON w.entity_id = e.id
    CROSS JOIN LATERAL (VALUES (0, c.place_a, c.pose_a), (1, c.place_b, c.pose_b)) s (side, place_id, pose)
    LEFT JOIN entity p ON p.id = s.place_id;

CREATE FUNCTION is_at_its_rooms(c connector, at_pose double precision[])
RETURNS boolean LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp
BEGIN ATOMIC
-- Whether a connector with this world pose is at the rooms that it joins: its opening in their wall, or the ends of
-- stairs and ramps, door_reach() beside them and half a metre above or below their floors at most. In a thick wall, who
-- faces it stands in the room (5 cm). No route leads through others.
SELECT NOT EXISTS (
    SELECT FROM (VALUES (c.place_a, pose_compose(at_pose, c.pose_a)), (c.place_b, pose_compose(at_pose, c.pose_b))) s (place, stand)
    JOIN world w ON w.entity_id = s.place JOIN room r ON r.entity_id = s.place
    CROSS JOIN LATERAL (SELECT c.form IN ('stairs', 'ramp') AS climbs) d
    CROSS JOIN LATERAL (SELECT CASE WHEN climbs THEN ST_MakePoint(stand[1], stand[2]) ELSE opening_of(at_pose, c.width) END AS at,
                               CASE WHEN climbs THEN stand[3] ELSE at_pose[3] END AS z) o
    WHERE w.footprint IS NOT NULL
      AND (abs(o.z - w.pose[3] - r.floor) > 0.5 + 1e-6
           OR ST_Distance(w.footprint, o.at) > door_reach() + 1e-6
          AND (climbs OR ST_Distance(w.footprint, ST_MakePoint(stand[1], stand[2])) > 0.05 + 1e-6
               OR ST_Distance(w.footprint, o.at) > door_reach(o.at, ARRAY[c.place_a, c.place_b]) + 1e-6)));
END;

CREATE VIEW gis_approach_pose AS
    SELECT id AS fid, map, connector, side, place, pose_yaw(pose) AS heading,
           ST_MakePoint(pose[1], pose[2])::geometry(Point, 0) AS geom
    FROM semmap.approach_pose;

-- Mean seconds of executions that succeeded; rides without the part that depends on their height.
CREATE VIEW mean_duration AS
    SELECT x.robot_class_id, x.behaviour, x.entity_id, count(*) AS executions,
           avg(CASE x.behaviour WHEN 'use_elevator'
               THEN greatest(x.seconds - r.ride_seconds_per_metre * abs(x.height), 0) ELSE x.seconds END) AS seconds
    FROM execution x JOIN robot_class r ON r.id = x.robot_class_id
    WHERE x.succeeded GROUP BY x.robot_class_id, x.behaviour, x.entity_id;

CREATE FUNCTION has_ramp(c connector, low double precision, high double precision)
RETURNS boolean LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
-- Whether an object that is a ramp leads from one height to another, to 2 cm, before an opening.
SELECT EXISTS (
    SELECT FROM semmap.world o JOIN semmap.world t ON t.map_id = o.map_id AND t.footprint && ST_Expand(semmap.opening_of(o.pose, c.width), semmap.door_reach())
    JOIN semmap.entity e ON e.id = t.entity_id AND e.kind = 'object'
    WHERE o.entity_id = c.entity_id AND ST_DWithin(t.footprint, semmap.opening_of(o.pose, c.width), semmap.door_reach())
      AND EXISTS (SELECT FROM semmap.type_closure y WHERE y.sub = e.type AND y.super IN ('ramp_flight', 'ramp'))
      AND ST_ZMin(t.box) <= low + 0.02 AND abs(ST_ZMax(t.box) - high) <= 0.02);
$$;

CREATE FUNCTION step_of(c connector)
RETURNS double precision LANGUAGE sql STABLE
BEGIN ATOMIC
-- The step in a connector: its threshold, or that between the floors of its rooms where neither it nor a ramp climbs.
SELECT greatest(c.step, CASE WHEN c.form NOT IN ('stairs', 'ramp') AND NOT (high > low AND semmap.has_ramp(c, low, high)) THEN high - low END)
FROM (SELECT min(o.pose[3] + r.floor), max(o.pose[3] + r.floor) FROM semmap.room r
      JOIN semmap.world o ON o.entity_id = r.entity_id WHERE r.entity_id IN (c.place_a, c.place_b)) f (low, high);
END;

CREATE FUNCTION way_of(c connector, at_pose double precision[], OUT line geometry, OUT foot double precision, OUT rise double precision)
LANGUAGE sql IMMUTABLE
BEGIN ATOMIC
-- The line from end to end of stairs or a ramp at a world pose, the z of its beginning, and how far it rises to its end.
-- Null of others, and of those that rise by more than they are long: they turn, and their line is not the way.
SELECT ST_MakeLine(ST_MakePoint(a[1], a[2]), ST_MakePoint(b[1], b[2])), a[3], b[3] - a[3]
FROM (SELECT semmap.pose_compose(at_pose, c.pose_a), semmap.pose_compose(at_pose, c.pose_b)) e (a, b)
WHERE c.form IN ('stairs', 'ramp') AND (b[1] - a[1]) ^ 2 + (b[2] - a[2]) ^ 2 >= greatest((b[3] - a[3]) ^ 2, 0.01);
END;

CREATE FUNCTION things_on(c connector)
RETURNS TABLE (entity_id bigint, ground geometry) LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The objects on stairs or a ramp, or through their steps, and their ground there. The steps are taken to rise evenly,
-- to 0.4 m. Higher than 1.5 m above them, and below them, nothing is in the way; parts of the building, carpets, thin
-- things and what an agent carries are not, either. An object without a type that is on most of the way from its foot
-- to its head is the stairs.
WITH RECURSIVE strip AS (
    SELECT o.map_id, y.line, y.foot, y.rise, ST_Buffer(y.line, coalesce(c.width, 0.9) / 2, 'endcap=flat') AS area
    FROM semmap.world o CROSS JOIN LATERAL semmap.way_of(c, o.pose) y WHERE o.entity_id = c.entity_id AND y.line IS NOT NULL
), near AS (
    SELECT t.entity_id, ST_Intersection(t.footprint, s.area, 1e-6) AS ground, ST_ZMin(t.box) AS low, ST_ZMax(t.box) AS high,
           coalesce(e.type, 'object') = 'object' AND ST_Length(ST_Intersection(s.line, t.footprint)) >= ST_Length(s.line) / 2
           AND ST_ZMin(t.box) <= least(s.foot, s.foot + s.rise) + 0.3
           AND ST_ZMax(t.box) >= greatest(s.foot, s.foot + s.rise) - 0.5 AS is_flight
    FROM strip s JOIN semmap.world t ON t.footprint && s.area AND ST_Intersects(t.footprint, s.area) AND t.map_id = s.map_id
    JOIN semmap.entity e ON e.id = t.entity_id AND e.kind = 'object'
    WHERE NOT EXISTS (SELECT FROM semmap.type_closure y WHERE y.sub = e.type AND y.super IN ('building_element', 'ground', 'carpet', 'ramp'))
), holder AS (
    SELECT n.entity_id, p.holder_id FROM near n JOIN semmap.placement p ON p.entity_id = n.entity_id
    UNION SELECT h.entity_id, p.holder_id FROM holder h JOIN semmap.placement p ON p.entity_id = h.holder_id
)
SELECT n.entity_id, n.ground FROM near n CROSS JOIN strip s
CROSS JOIN LATERAL (
    SELECT s.foot + least(s.rise * min(at), s.rise * max(at)), s.foot + greatest(s.rise * min(at), s.rise * max(at))
    FROM ST_DumpPoints(n.ground) p CROSS JOIN LATERAL ST_LineLocatePoint(s.line, p.geom) at) z (lowest, highest)
WHERE NOT n.is_flight AND n.high - n.low > 0.02 AND n.low < z.highest + 1.5
  AND (n.low >= z.lowest - 0.4 OR n.high > z.highest + 0.02)
  AND NOT EXISTS (SELECT FROM holder h JOIN semmap.entity a ON a.id = h.holder_id AND a.kind = 'agent' WHERE h.entity_id = n.entity_id);
$$;

CREATE FUNCTION clear_width(c connector)
RETURNS double precision LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The width of the widest robot that gets from end to end of stairs or a ramp past the objects on it, metres, to 1 mm; 0
-- below 5 cm. Null where nothing is on it. A robot is a disc, whose middle stays half a width within the sides, taken
-- as 0.9 m apart where the map does not say it, and begins and ends within 0.3 m of the ends.
DECLARE
    way geometry;
    taken geometry;
    width double precision := coalesce(c.width, 0.9);
    low double precision := 0;
    high double precision := width;
    half double precision;
BEGIN
    IF c.form NOT IN ('stairs', 'ramp') THEN
        RETURN NULL;
    END IF;
    SELECT ST_Union(t.ground) INTO taken FROM semmap.things_on(c) t;
    IF taken IS NULL THEN
        RETURN NULL;
    END IF;
    SELECT y.line INTO way FROM semmap.world o CROSS JOIN LATERAL semmap.way_of(c, o.pose) y WHERE o.entity_id = c.entity_id;
    WHILE high - low > 0.001 LOOP
        half := (low + high) / 4;
        IF EXISTS (
            SELECT FROM ST_Dump(ST_Difference(ST_Buffer(way, width / 2 - half, 'endcap=flat'), ST_Buffer(taken, half))) free
            WHERE ST_DWithin(free.geom, ST_StartPoint(way), semmap.door_reach()) AND ST_DWithin(free.geom, ST_EndPoint(way), semmap.door_reach()))
        THEN
            low := 2 * half;
        ELSE
            high := 2 * half;
        END IF;
    END LOOP;
    RETURN CASE WHEN low < 0.05 THEN 0 ELSE round(low::numeric, 3) END;
END;
$$;

CREATE FUNCTION is_blocked_for(r robot_class, c connector, there integer)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
-- Whether a class of robots cannot pass a connector towards place_b (there is 1) or place_a (0). On stairs and ramps
-- with things on them, one without a shape counts as 0.6 m wide.
SELECT c.state = 'locked' AND NOT r.unlocks
    OR c.state = 'closed' AND c.form <> 'elevator_door' AND NOT r.opens
    OR c.direction = CASE there WHEN 1 THEN 'backward' ELSE 'forward' END
    OR r.behaviours IS NOT NULL AND c.behaviour <> ALL (r.behaviours)
    OR c.permissions <> '{}' AND NOT c.permissions && r.permissions
    OR c.form IN ('stairs', 'ramp') AND coalesce(coalesce(r.width, 0.6) > semmap.clear_width(c) + 0.002, false)
    OR r.width IS NOT NULL AND (coalesce(r.width > c.width, false) OR coalesce(r.height > c.height, false)
       OR semmap.step_of(c) > r.max_step + 0.001 OR c.form = 'stairs'
       OR c.form = 'ramp' AND atan2(abs(c.pose_a[3] - c.pose_b[3]),
                                    sqrt((c.pose_a[1] - c.pose_b[1]) ^ 2 + (c.pose_a[2] - c.pose_b[2]) ^ 2)) > r.max_slope);
END;

CREATE VIEW route_edge AS
    WITH room_of AS (SELECT entity_id, elevator_id FROM room)
    -- passages
    SELECT 'passage' AS kind, 2 * c.entity_id AS source, 2 * c.entity_id + 1 AS target,
           CASE WHEN NOT at.rooms OR is_blocked_for(r, c, 1) THEN -1
                ELSE t.seconds + CASE WHEN b.elevator_id IS DISTINCT FROM a.elevator_id AND b.elevator_id IS NOT NULL
                                      THEN coalesce(lb.seconds, r.call_seconds) ELSE 0 END END AS cost,
           CASE WHEN NOT at.rooms OR is_blocked_for(r, c, 0) THEN -1
                ELSE t.seconds + CASE WHEN b.elevator_id IS DISTINCT FROM a.elevator_id AND a.elevator_id IS NOT NULL
                                      THEN coalesce(la.seconds, r.call_seconds) ELSE 0 END END AS reverse_cost,
           through AS metres, e.name, e.map_id, r.id AS robot_class_id, r.name AS robot_class
    FROM robot_class r CROSS JOIN connector c JOIN entity e ON e.id = c.entity_id
    JOIN world w ON w.entity_id = c.entity_id
    CROSS JOIN LATERAL (SELECT is_at_its_rooms(c, w.pose)) at (rooms)
    LEFT JOIN room_of a ON a.entity_id = c.place_a LEFT JOIN room_of b ON b.entity_id = c.place_b
    CROSS JOIN LATERAL (SELECT sqrt((c.pose_a[1] - c.pose_b[1]) ^ 2 + (c.pose_a[2] - c.pose_b[2]) ^ 2
                                    + (c.pose_a[3] - c.pose_b[3]) ^ 2) AS through) d
    LEFT JOIN mean_duration lo ON lo.robot_class_id = r.id AND lo.entity_id = c.entity_id
         AND lo.behaviour = CASE c.state WHEN 'closed' THEN 'open_door' WHEN 'locked' THEN 'unlock_door' END
    LEFT JOIN mean_duration lp ON lp.robot_class_id = r.id AND lp.entity_id = c.entity_id AND lp.behaviour = c.behaviour
    LEFT JOIN mean_duration la ON la.robot_class_id = r.id AND la.entity_id = a.elevator_id AND la.behaviour = 'call_elevator'
    LEFT JOIN mean_duration lb ON lb.robot_class_id = r.id AND lb.entity_id = b.elevator_id AND lb.behaviour = 'call_elevator'
    CROSS JOIN LATERAL (SELECT coalesce(lp.seconds, through / r.speed)
        + CASE WHEN c.state = 'closed' AND c.form <> 'elevator_door' THEN coalesce(lo.seconds, r.open_seconds)
               WHEN c.state = 'locked' THEN coalesce(lo.seconds, r.unlock_seconds) ELSE 0 END AS seconds) t
    UNION ALL
    -- travel inside places
    SELECT 'travel', 2 * k.from_id + (a.place_a <> k.place_id)::int, 2 * k.to_id + (b.place_a <> k.place_id)::int,
           CASE WHEN k.seconds = 'Infinity' THEN -1 ELSE k.seconds END,
           CASE WHEN k.seconds = 'Infinity' THEN -1 ELSE k.seconds END,
           k.metres, e.name, e.map_id, r.id, r.name
    FROM travel_time k JOIN robot_class r ON r.id = k.robot_class_id JOIN entity e ON e.id = k.place_id
    JOIN connector a ON a.entity_id = k.from_id JOIN connector b ON b.entity_id = k.to_id
    UNION ALL
    -- travel through the outside, along straight lines
    SELECT 'travel', a.id, b.id, s.seconds, s.seconds, s.metres, 'outside', a.map_id, r.id, r.name
    FROM robot_class r JOIN approach_pose a ON r.outside AND a.place_id IS NULL
    JOIN approach_pose b ON b.place_id IS NULL AND b.map_id = a.map_id AND b.id > a.id
    CROSS JOIN LATERAL (SELECT m AS metres, m / r.speed AS seconds FROM (SELECT sqrt(
        (a.pose[1] - b.pose[1]) ^ 2 + (a.pose[2] - b.pose[2]) ^ 2 + (a.pose[3] - b.pose[3]) ^ 2) AS m) f) s
    UNION ALL
    -- rides from cabin to cabin of an elevator
    SELECT 'ride', a.id, b.id, s.seconds, s.seconds, across, l.name, a.map_id, r.id, r.name
    FROM robot_class r CROSS JOIN room_of ra JOIN approach_pose a ON a.place_id = ra.entity_id
    JOIN room_of rb ON rb.elevator_id = ra.elevator_id AND rb.entity_id <> ra.entity_id
    JOIN approach_pose b ON b.place_id = rb.entity_id AND b.id > a.id
    JOIN entity l ON l.id = ra.elevator_id
    LEFT JOIN mean_duration lr ON lr.robot_class_id = r.id AND lr.entity_id = l.id AND lr.behaviour = 'use_elevator'
    CROSS JOIN LATERAL (SELECT sqrt((a.pose[1] - b.pose[1]) ^ 2 + (a.pose[2] - b.pose[2]) ^ 2) AS across) d
    CROSS JOIN LATERAL (SELECT coalesce(lr.seconds, r.ride_seconds) + across / r.speed
        + r.ride_seconds_per_metre * abs(a.pose[3] - b.pose[3]) AS seconds) s
    WHERE r.behaviours IS NULL OR 'use_elevator' = ANY (r.behaviours);
