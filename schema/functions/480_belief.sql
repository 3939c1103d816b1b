-- Where things probably are: the places at which they can be, priors, and the belief after observations (O'Neill,
-- sections 4.2 and 4.4). All is computed for many things at once; a place of null is elsewhere.

CREATE FUNCTION belief_model_of(of_map integer)
RETURNS belief_model LANGUAGE sql STABLE
BEGIN ATOMIC
-- How sightings of a map are judged: its row, else the defaults of the table.
SELECT m FROM semmap.belief_model m WHERE m.map_id = of_map
UNION ALL SELECT ROW (of_map, 0.9, 0.000001, 0, 10, 86400, 0.95, 0.1, 0.5, 4, 'UTC')::semmap.belief_model LIMIT 1;
END;

CREATE FUNCTION property_of(thing bigint, key text)
RETURNS double precision LANGUAGE sql STABLE
BEGIN ATOMIC
-- A number among the properties of an entity, else among those of the nearest type that has it.
SELECT CASE WHEN jsonb_typeof(e.properties -> key) = 'number' THEN (e.properties ->> key)::double precision
            ELSE (SELECT (t.properties ->> key)::double precision
                  FROM semmap.type_closure c JOIN semmap.semantic_type t ON t.name = c.super
                  WHERE c.sub = e.type AND jsonb_typeof(t.properties -> key) = 'number'
                  ORDER BY (SELECT count(*) FROM semmap.type_closure n WHERE n.sub = c.super) DESC, c.super LIMIT 1) END
FROM semmap.entity e WHERE e.id = thing;
END;

CREATE FUNCTION require_mobile(thing semmap.entity)
RETURNS void LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- Refuses what has no belief, as it is where the map has it: what is no object or agent, and parts of the building.
BEGIN
    IF thing.kind NOT IN ('object', 'agent') THEN
        RAISE EXCEPTION '% is a %: it does not move', thing.name, thing.kind
            USING ERRCODE = 'check_violation', HINT = 'Ask for an object or an agent.';
    ELSIF EXISTS (SELECT FROM semmap.type_closure c WHERE c.sub = thing.type AND c.super = 'building_element') THEN
        RAISE EXCEPTION '% is a part of the building, of the type %: it does not move', thing.name, thing.type
            USING ERRCODE = 'check_violation', HINT = 'Its pose says where it is. Is the type wrong? Then change it.';
    END IF;
END $$;

CREATE FUNCTION sides_of(area geometry)
RETURNS double precision[] LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- The shorter and the longer side of the smallest rectangle around an area.
SELECT ARRAY[least(a, b), greatest(a, b)]
FROM ST_ExteriorRing(CASE WHEN ST_Dimension(ST_OrientedEnvelope(area)) = 2 THEN ST_OrientedEnvelope(area)
                          ELSE ST_Envelope(ST_Buffer(area, 1e-6)) END) ring,
     LATERAL (SELECT ST_Distance(ST_PointN(ring, 1), ST_PointN(ring, 2)), ST_Distance(ST_PointN(ring, 2), ST_PointN(ring, 3))) s (a, b);
END;

CREATE FUNCTION least_width(area geometry)
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Metres between the two nearest parallel lines that have an area between them: one lies along a side of its hull.
SELECT coalesce(min(side.width), 0)
FROM ST_ExteriorRing(ST_ConvexHull(area)) ring
CROSS JOIN generate_series(1, ST_NPoints(ring) - 1) i
CROSS JOIN LATERAL (SELECT ST_PointN(ring, i) AS a, ST_PointN(ring, i + 1) AS b) edge
CROSS JOIN LATERAL (
    SELECT max(abs((ST_X(b) - ST_X(a)) * (ST_Y(p.geom) - ST_Y(a)) - (ST_Y(b) - ST_Y(a)) * (ST_X(p.geom) - ST_X(a))))
        / nullif(ST_Distance(a, b), 0) AS width FROM ST_DumpPoints(ring) p) side;
END;

CREATE FUNCTION size_of(thing bigint, OUT sides double precision[], OUT height double precision, OUT base double precision)
LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The sides of the rectangle in which an entity stands (the shorter one first), its height and the area of its base:
-- by its geometry, of its models where it has no pose, else by the taught base_area and volume of a square base, else by
-- the typical size of its type.
SELECT CASE WHEN own.ground IS NOT NULL THEN semmap.sides_of(own.ground)
            WHEN taught.base > 0 THEN ARRAY[sqrt(taught.base), sqrt(taught.base)]
            ELSE typical.size[1:2] END,
       CASE WHEN own.ground IS NOT NULL THEN own.height
            WHEN taught.base > 0 THEN coalesce(taught.volume / taught.base, 0) ELSE typical.size[3] END,
       CASE WHEN own.ground IS NOT NULL THEN ST_Area(own.ground)
            WHEN taught.base > 0 THEN taught.base ELSE typical.size[1] * typical.size[2] END
FROM semmap.entity e LEFT JOIN semmap.world w ON w.entity_id = e.id
     LEFT JOIN LATERAL (
         SELECT ST_ConvexHull(ST_Collect(ST_Force2D(m.hull))) AS ground, max(ST_ZMax(m.hull)) - min(ST_ZMin(m.hull)) AS height
         FROM semmap.entity_model em JOIN semmap.model m ON m.id = em.model_id
         WHERE em.entity_id = e.id AND w.footprint IS NULL) models ON true
     CROSS JOIN LATERAL (SELECT coalesce(w.footprint, models.ground),
                                CASE WHEN w.footprint IS NULL THEN models.height ELSE ST_ZMax(w.box) - ST_ZMin(w.box) END) own (ground, height)
     CROSS JOIN LATERAL (SELECT semmap.property_of(e.id, 'base_area'), semmap.property_of(e.id, 'volume')) taught (base, volume)
     LEFT JOIN LATERAL (
         SELECT ARRAY[least(t.typical_size[1], t.typical_size[2]), greatest(t.typical_size[1], t.typical_size[2]), t.typical_size[3]]
         FROM semmap.type_closure c JOIN semmap.semantic_type t ON t.name = c.super AND t.typical_size IS NOT NULL WHERE c.sub = e.type
         ORDER BY (SELECT count(*) FROM semmap.type_closure n WHERE n.sub = c.super) DESC, c.super LIMIT 1) typical (size) ON true
WHERE e.id = thing
$$;

CREATE FUNCTION fits(sides double precision[], height double precision, base double precision,
                     into_sides double precision[], into_height double precision, into_base double precision)
RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Whether an upright object has room on an area below a height; an unknown size fits, an unknown height is open.
SELECT coalesce(sides[1] <= into_sides[1] + 1e-9 AND sides[2] <= into_sides[2] + 1e-9 AND base <= into_base + 1e-9, true)
       AND coalesce(height <= into_height + 1e-9, true);
END;

CREATE FUNCTION kept_at(height double precision)
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- How readily things are kept at a height above the floor, in metres, per area, to a table's.
    SELECT CASE WHEN height < 0.15 THEN 0.2 WHEN height < 1.7 THEN 1 WHEN height < 2.1 THEN 0.3 ELSE 0.02 END;
END;

CREATE FUNCTION places_for(things bigint[])
RETURNS TABLE (entity_id bigint, place_id bigint, weight double precision) LANGUAGE plpgsql STABLE ROWS 1000 COST 10000
SET search_path = semmap, public, pg_temp SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- The places of the map at which each of the given objects or agents is or has room: furniture, fixtures, appliances and
-- objects with a support surface of which no supertype says what they are; containers and storage furniture; rooms.
-- Furniture, fixtures and robots are in rooms only; others who move by themselves are on seats and beds, too. A place weighs as much as the area that it offers, in square metres, times how readily a place
-- of its type and height keeps things.
DECLARE
    small CONSTANT double precision := 0.02;    -- base of a container that is a place, square metres: a mug is not
    untyped CONSTANT double precision := 0.1;   -- surface of an object without a type that is a place, square metres
    bearing text[] := ARRAY(SELECT DISTINCT sub FROM semmap.type_closure WHERE super IN ('furniture', 'fixture', 'appliance', 'container'));
    standing text[] := ARRAY(SELECT DISTINCT sub FROM semmap.type_closure WHERE super IN ('furniture', 'fixture'));
    storing text[] := ARRAY(SELECT DISTINCT sub FROM semmap.type_closure WHERE super IN ('storage_furniture', 'container'));
    resting text[] := ARRAY(SELECT DISTINCT sub FROM semmap.type_closure WHERE super IN ('seat', 'bed'));
    robots text[] := ARRAY(SELECT sub FROM semmap.type_closure WHERE super = 'robot');
    unknown text[] := ARRAY(SELECT sub FROM semmap.type_closure WHERE sub <> 'building_element'
                            GROUP BY sub HAVING bool_and(super IN (sub, 'object', 'entity')));
BEGIN
    RETURN QUERY
    WITH thing AS MATERIALIZED (
        SELECT e.id, e.map_id, e.kind = 'agent' OR coalesce(e.type = ANY (standing), false) AS stands,
               e.kind = 'agent' AND coalesce(e.type <> ALL (robots), false) AS rests, s.sides, s.height, s.base,
               EXISTS (SELECT FROM semmap.placement p WHERE p.holder_id = e.id) AS holds,
               (SELECT p.holder_id FROM semmap.placement p WHERE p.entity_id = e.id) AS holder_id
        FROM unnest(things) given (id) JOIN semmap.entity e ON e.id = given.id AND e.kind IN ('object', 'agent'),
             LATERAL semmap.size_of(e.id) s
    ), candidate AS MATERIALIZED (
        SELECT e.id, e.map_id, e.kind, e.type, w.footprint, w.box, ST_Area(w.footprint) AS area, w.pose[3] - coalesce(y.pose[3], 0) AS foot
        FROM semmap.entity e LEFT JOIN semmap.world w ON w.entity_id = e.id LEFT JOIN semmap.world y ON y.entity_id = w.storey_id
        WHERE e.map_id IN (SELECT t.map_id FROM thing t)
          AND (e.kind = 'room' OR e.kind = 'object' AND w.footprint IS NOT NULL
               AND (e.type IN (SELECT unnest(bearing)) OR coalesce(e.type, 'object') = ANY (unknown)))  -- IN: hashed
    ), board AS MATERIALIZED (  -- the surfaces of each model, and the height to the next one above
        SELECT s.model_id, s.height, semmap.sides_of(s.outline) AS sides, ST_Area(s.outline) AS area,
               (SELECT min(u.height) - s.height FROM semmap.support_surface u
                WHERE u.model_id = s.model_id AND u.height > s.height + 0.02
                  AND ST_Intersects(u.outline, ST_PointOnSurface(s.outline))) AS clear
        FROM semmap.support_surface s
        WHERE s.height IS NOT NULL AND s.model_id IN (SELECT m.model_id FROM candidate c JOIN semmap.entity_model m ON m.entity_id = c.id)
    ), keeping AS MATERIALIZED (  -- of each type, as of its nearest supertype that says so
        SELECT c.type, (SELECT t.keeps FROM semmap.type_closure s JOIN semmap.semantic_type t ON t.name = s.super AND t.keeps IS NOT NULL
                        WHERE s.sub = c.type ORDER BY (SELECT count(*) FROM semmap.type_closure n WHERE n.sub = s.super) DESC, t.keeps LIMIT 1) AS share
        FROM (SELECT DISTINCT coalesce(a.type, a.kind) AS type FROM candidate a) c
    ), space AS MATERIALIZED (  -- with its height above the floor
        SELECT c.id, c.map_id, c.kind, c.type, b.sides, b.clear AS height, b.area, c.foot + b.height AS z
        FROM candidate c JOIN semmap.entity_model m ON m.entity_id = c.id JOIN board b ON b.model_id = m.model_id
        WHERE c.kind = 'object'
          AND CASE WHEN c.type = ANY (bearing) THEN c.type <> ALL (storing) OR c.area >= small ELSE b.area >= untyped END
      UNION ALL
        SELECT c.id, c.map_id, c.kind, c.type, semmap.sides_of(c.footprint), ST_ZMax(c.box) - ST_ZMin(c.box), c.area,
               c.foot + (ST_ZMax(c.box) - ST_ZMin(c.box)) / 2
        FROM candidate c WHERE c.kind = 'object' AND c.type = ANY (storing) AND c.area >= small
      UNION ALL
        SELECT c.id, c.map_id, c.kind, c.type, CASE WHEN c.footprint IS NOT NULL THEN semmap.sides_of(c.footprint) END, NULL, c.area, 0.5
        FROM candidate c WHERE c.kind = 'room'
    )
    SELECT t.id, s.id, sum(greatest(coalesce(s.area, 1), 0.0001) * coalesce(k.share, 1)
                           * semmap.kept_at(s.z))
    FROM thing t JOIN space s ON s.map_id = t.map_id AND s.id <> t.id
     AND (s.kind = 'room' OR NOT t.stands OR t.rests AND s.type = ANY (resting))
     AND (s.id = t.holder_id OR t.rests OR semmap.fits(t.sides, t.height, t.base, s.sides, s.height, s.area))
     AND NOT (t.holds AND semmap.is_held_by(s.id, t.id))
    JOIN keeping k ON k.type = coalesce(s.type, s.kind)
    GROUP BY t.id, s.id;
END $$;

CREATE FUNCTION place_words(places bigint[])
RETURNS TABLE (place_id bigint, about text, word text, word_id bigint) LANGUAGE sql STABLE ROWS 1000
SET search_path = semmap, public, pg_temp AS $$
-- What lifts are about, the general words first: the type of a place's room, the room, the type of the place, and the place.
SELECT p.id, w.* FROM unnest(places) p (id) JOIN semmap.entity e ON e.id = p.id
     LEFT JOIN semmap.entity r ON r.id = semmap.holding_room(p.id),
     LATERAL (VALUES ('room_type', coalesce(r.type, r.kind), NULL::bigint), ('room', NULL, r.id),
                     ('place_type', coalesce(e.type, e.kind), NULL), ('place', NULL, e.id)) w (about, word, word_id)
WHERE w.word IS NOT NULL OR w.word_id IS NOT NULL
$$;

CREATE FUNCTION lifts_of(thing bigint)
RETURNS SETOF learned_lift LANGUAGE sql STABLE ROWS 100
BEGIN ATOMIC
-- What was learned about an object: of itself and of its types.
SELECT l.* FROM semmap.learned_lift l JOIN semmap.entity e ON e.id = l.entity_id WHERE l.entity_id = thing AND e.kind = 'object'
UNION ALL
SELECT l.* FROM semmap.entity e JOIN semmap.learned_lift l ON l.map_id = e.map_id
 AND l.type = ANY (ARRAY(SELECT c.super FROM semmap.type_closure c WHERE c.sub = coalesce(e.type, e.kind)))
WHERE e.id = thing AND e.kind = 'object';
END;

CREATE FUNCTION lift_of_moves(thing bigint)
RETURNS double precision LANGUAGE sql STABLE
BEGIN ATOMIC
-- How many times as often as by its mobility a thing moves, as far as was learned.
SELECT coalesce(exp(sum(ln(l.lift))), 1) FROM semmap.lifts_of(thing) l WHERE l.about = 'moves';
END;

CREATE FUNCTION habits_of(things bigint[], places bigint[], priors double precision[])
RETURNS TABLE (entity_id bigint, moves double precision[], by_part double precision[]) LANGUAGE plpgsql STABLE ROWS 100 COST 10000
SET search_path = semmap, public, pg_temp SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- Of the things whose hours were learned: how many times as often as in the whole day each moves in the parts of the day, and
-- the priors of its places, in their order, one part after the other. Things, places and priors are triples.
BEGIN
    RETURN QUERY
    WITH lifted AS MATERIALIZED (
        SELECT t.id, l.about, coalesce(l.word, l.word_id::text) AS word, u.n, sum(ln(u.lift)) AS lift
        FROM (SELECT DISTINCT g.id FROM unnest(things) g (id)) t, LATERAL semmap.lifts_of(t.id) l,
             unnest(l.by_part) WITH ORDINALITY u (lift, n) GROUP BY 1, 2, 3, 4
    ), pair AS MATERIALIZED (
        SELECT p.* FROM unnest(things, places, priors) p (id, place, prior) WHERE EXISTS (SELECT FROM lifted l WHERE l.id = p.id)
    ), word AS MATERIALIZED (
        SELECT w.place_id, w.about, coalesce(w.word, w.word_id::text) AS word
        FROM semmap.place_words(ARRAY(SELECT DISTINCT p.place FROM pair p WHERE p.place IS NOT NULL)) w
    ), lift AS MATERIALIZED (
        SELECT l.id, w.place_id, l.n, exp(sum(l.lift)) AS lift
        FROM word w JOIN lifted l ON l.about = w.about AND l.word = w.word GROUP BY 1, 2, 3
    ), weighed AS (
        SELECT p.id, n.n, p.place, p.prior, p.prior * coalesce(l.lift, 1) AS weight
        FROM pair p JOIN (SELECT DISTINCT l.id, l.n FROM lifted l) n ON n.id = p.id
        LEFT JOIN lift l ON l.id = p.id AND l.place_id = p.place AND l.n = n.n
    ), summed AS (
        SELECT w.*, sum(w.prior) FILTER (WHERE w.place IS NOT NULL) OVER (PARTITION BY w.id, w.n) AS known,
               sum(w.weight) FILTER (WHERE w.place IS NOT NULL) OVER (PARTITION BY w.id, w.n) AS total FROM weighed w
    ), share AS (
        SELECT s.id, array_agg(CASE WHEN s.place IS NULL THEN s.prior ELSE coalesce(s.weight * s.known / nullif(s.total, 0), 0) END
                               ORDER BY s.n, s.place) AS of_places
        FROM summed s GROUP BY 1
    )
    SELECT s.id, m.lifts, s.of_places
    FROM share s LEFT JOIN (SELECT l.id, array_agg(exp(l.lift) ORDER BY l.n) AS lifts FROM lifted l WHERE l.about = 'moves' GROUP BY 1) m
    USING (id);
END $$;

CREATE FUNCTION prior_of(things bigint[], learned boolean DEFAULT true)
RETURNS TABLE (entity_id bigint, place_id bigint, prior double precision) LANGUAGE plpgsql STABLE ROWS 1000 COST 10000
SET search_path = semmap, public, pg_temp SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- Where each thing is before any evidence: by the weights of its places; one where the T-Box or a teaching says that it is found weighs
-- `prior_typical` times as much, and all are lifted by what was learned. Where nothing was, of the placements that the map
-- has had, each counts half of its successor. Without `learned`, neither counts.
BEGIN
    RETURN QUERY
    WITH RECURSIVE thing AS MATERIALIZED (
        SELECT e.id, e.name, coalesce(e.type, e.kind) AS type, e.map_id, m.prior_elsewhere, m.prior_history, m.prior_typical
        FROM unnest(things) given (id) JOIN semmap.entity e ON e.id = given.id AND e.kind IN ('object', 'agent'),
             LATERAL semmap.belief_model_of(e.map_id) m
    ), place AS MATERIALIZED (
        SELECT p.entity_id AS id, p.place_id AS at, p.weight FROM semmap.places_for(things) p
    ), word AS MATERIALIZED (  -- names of places, or of their types
        SELECT t.id, w.word FROM thing t JOIN semmap.type_closure c ON c.sub = t.type JOIN semmap.semantic_type s ON s.name = c.super,
             LATERAL unnest(s.found_in) w (word)
      UNION
        SELECT t.id, r.object FROM thing t JOIN semmap.taught_relation r ON r.map_id = t.map_id AND r.relation = 'found_in'
         AND (r.subject = t.name OR r.subject IN (SELECT c.super FROM semmap.type_closure c WHERE c.sub = t.type))
    ), stay AS MATERIALIZED (
        SELECT p.entity_id AS id, p.holder_id, p.since AS begun FROM semmap.placement p WHERE learned AND p.entity_id = ANY (things)
      UNION ALL
        SELECT h.entity_id, h.holder_id, lower(h.during) FROM semmap.placement_history h WHERE learned AND h.entity_id = ANY (things)
    ), above (start, id, depth) AS (  -- places and holders, and what holds them
        SELECT s.id, s.id, 0 FROM (SELECT p.at AS id FROM place p UNION SELECT s.holder_id FROM stay s) s WHERE s.id IS NOT NULL
      UNION ALL
        SELECT a.start, p.holder_id, a.depth + 1 FROM above a JOIN semmap.placement p ON p.entity_id = a.id WHERE p.holder_id IS NOT NULL
    ), known AS (  -- the words that are true of a place
        SELECT a.start AS at, w.word
        FROM above a, LATERAL (SELECT e.name, e.label, e.type FROM semmap.entity e WHERE e.id = a.id OFFSET 0) e,  -- by index
             LATERAL (SELECT e.name UNION SELECT e.label UNION SELECT c.super FROM semmap.type_closure c WHERE c.sub = e.type) w (word)
        WHERE EXISTS (SELECT FROM word)
    ), typical AS (
        SELECT DISTINCT p.id, p.at FROM place p JOIN word w ON w.id = p.id JOIN known k ON k.at = p.at AND k.word = w.word
    ), stayed AS (  -- the place of each stay: the nearest one that holds the holder
        SELECT DISTINCT ON (s.id, s.begun) s.id, s.begun, p.at
        FROM stay s JOIN above a ON a.start = s.holder_id JOIN place p ON p.id = s.id AND p.at = a.id
        ORDER BY s.id, s.begun, a.depth
    ), ranked AS (
        SELECT m.id, m.at, row_number() OVER (PARTITION BY m.id ORDER BY m.begun DESC) AS age
        FROM (SELECT s.*, lag(s.at) OVER (PARTITION BY s.id ORDER BY s.begun) AS former FROM stayed s) m
        WHERE m.at IS DISTINCT FROM m.former
    ), history AS (
        SELECT r.id, r.at, sum(power(0.5, r.age)) / sum(sum(power(0.5, r.age))) OVER (PARTITION BY r.id) AS share
        FROM ranked r WHERE r.age <= 50 GROUP BY r.id, r.at
    ), lifted AS MATERIALIZED (
        SELECT t.id, l.about, coalesce(l.word, l.word_id::text) AS word, exp(sum(ln(l.lift))) AS lift
        FROM thing t, LATERAL semmap.lifts_of(t.id) l WHERE learned AND l.about <> 'moves' GROUP BY 1, 2, 3
    ), lift AS (
        SELECT l.id, w.place_id AS at, exp(sum(ln(l.lift))) AS lift
        FROM semmap.place_words(ARRAY(SELECT DISTINCT p.at FROM place p WHERE EXISTS (SELECT FROM lifted))) w
        JOIN lifted l ON l.about = w.about AND l.word = coalesce(w.word, w.word_id::text) GROUP BY 1, 2
    ), weighed AS (
        SELECT p.id, p.at, p.weight * coalesce(l.lift, 1) * CASE WHEN y.id IS NULL THEN 1 ELSE t.prior_typical END AS weight, t.prior_elsewhere,
               CASE WHEN k.id IS NULL OR EXISTS (SELECT FROM lifted n WHERE n.id = t.id) THEN 0 ELSE t.prior_history END AS known
        FROM thing t JOIN place p ON p.id = t.id LEFT JOIN typical y ON y.id = p.id AND y.at = p.at
        LEFT JOIN lift l ON l.id = p.id AND l.at = p.at
        LEFT JOIN (SELECT DISTINCT h.id FROM history h) k ON k.id = t.id
    )
    SELECT w.id, w.at, (1 - w.prior_elsewhere)
           * ((1 - w.known) * w.weight / sum(w.weight) OVER (PARTITION BY w.id) + w.known * coalesce(h.share, 0))
    FROM weighed w LEFT JOIN history h ON h.id = w.id AND h.at = w.at
  UNION ALL
    SELECT t.id, NULL, CASE WHEN p.id IS NULL THEN 1 ELSE t.prior_elsewhere END
    FROM thing t LEFT JOIN (SELECT DISTINCT p.id FROM place p) p ON p.id = t.id;
END $$;

CREATE FUNCTION statements_about(things bigint[], places bigint[], moment timestamptz, latest boolean DEFAULT true)
RETURNS TABLE (entity_id bigint, at timestamptz, place_ids bigint[]) LANGUAGE plpgsql STABLE ROWS 1000 COST 10000
SET search_path = semmap, public, pg_temp SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- Where the map has put things until a moment, as far as it still knows: the last time at each of up to 20 places, one
-- after the other, or each time. Things and places are pairs. Of a stay in a holder that is no place, such as a storey, the
-- place of the pose, else elsewhere, which is null; without a pose any of the places in it. Of agents, what is below them
-- comes first.
BEGIN
    RETURN QUERY
    WITH RECURSIVE pair AS MATERIALIZED (
        SELECT p.id, p.place FROM unnest(things, places) p (id, place)
    ), stay AS MATERIALIZED (
        SELECT p.entity_id AS id, p.holder_id, p.since AS begun, true AS last FROM semmap.placement p
        WHERE p.entity_id = ANY (things) AND p.since <= moment
      UNION ALL
        SELECT h.entity_id, h.holder_id, lower(h.during), false FROM semmap.placement_history h
        WHERE h.entity_id = ANY (things) AND lower(h.during) <= moment
    ), above (start, id, depth) AS (
        SELECT DISTINCT s.holder_id, s.holder_id, 0 FROM stay s WHERE s.holder_id IS NOT NULL
      UNION ALL
        SELECT a.start, p.holder_id, a.depth + 1 FROM above a JOIN semmap.placement p ON p.entity_id = a.id WHERE p.holder_id IS NOT NULL
    ), known AS MATERIALIZED (  -- a thing and a holder
        SELECT DISTINCT s.id, s.holder_id FROM stay s
    ), up AS (
        SELECT DISTINCT ON (k.id, k.holder_id) k.id, k.holder_id, ARRAY[p.place] AS place_ids
        FROM known k JOIN above a ON a.start = k.holder_id JOIN pair p ON p.id = k.id AND p.place = a.id
        ORDER BY k.id, k.holder_id, a.depth
    ), down AS (
        SELECT k.id, k.holder_id, array_agg(p.place) AS place_ids
        FROM known k JOIN pair p ON p.id = k.id AND semmap.is_held_by(p.place, k.holder_id)
        WHERE NOT EXISTS (SELECT FROM up WHERE up.id = k.id AND up.holder_id = k.holder_id) GROUP BY 1, 2
    ), placed AS (
        SELECT s.id, s.begun, s.last,
               coalesce(CASE WHEN s.last AND e.kind = 'agent' THEN NULLIF(ARRAY[semmap.place_of(s.id, t.places)], ARRAY[NULL::bigint]) END, u.place_ids,
                        CASE WHEN s.last AND (w.pose IS NOT NULL OR d.place_ids IS NULL) THEN ARRAY[semmap.place_of(s.id, t.places)]
                             ELSE d.place_ids END) AS place_ids
        FROM stay s JOIN semmap.entity e ON e.id = s.id LEFT JOIN semmap.world w ON w.entity_id = s.id
        JOIN (SELECT p.id, array_agg(p.place) AS places FROM pair p GROUP BY p.id) t ON t.id = s.id
        LEFT JOIN up u ON u.id = s.id AND u.holder_id = s.holder_id LEFT JOIN down d ON d.id = s.id AND d.holder_id = s.holder_id
    ), ended AS (
        SELECT p.*, lead(p.place_ids) OVER (PARTITION BY p.id ORDER BY p.begun) AS next FROM placed p WHERE p.place_ids IS NOT NULL
    ), ranked AS (
        SELECT e.*, row_number() OVER (PARTITION BY e.id ORDER BY e.begun DESC) AS age
        FROM ended e WHERE NOT latest OR e.place_ids IS DISTINCT FROM e.next
    )
    SELECT r.id, r.begun, r.place_ids FROM ranked r WHERE NOT latest OR r.age <= 20;
END $$;

CREATE FUNCTION place_of(thing bigint, places bigint[])
RETURNS bigint LANGUAGE sql STABLE
BEGIN ATOMIC
-- That of some places at which an entity is by its pose: the surface below it, else the container or the room around it.
SELECT w.entity_id
FROM semmap.world t, LATERAL (SELECT ST_MakePoint(t.pose[1], t.pose[2]), ST_ZMin(t.box)) foot (point, z),
     unnest(places) p (id) JOIN semmap.world w ON w.entity_id = p.id JOIN semmap.entity e ON e.id = p.id
     LEFT JOIN semmap.room r ON r.entity_id = p.id
     LEFT JOIN LATERAL (SELECT max(s.height) AS height FROM semmap.entity_model m JOIN semmap.support_surface s ON s.model_id = m.model_id
                        WHERE m.entity_id = p.id AND foot.z - w.pose[3] - s.height BETWEEN -0.05 AND 0.5) board ON e.kind = 'object'
WHERE t.entity_id = thing AND ST_DWithin(w.footprint, foot.point, 0.03)
  AND CASE WHEN e.kind = 'room' THEN foot.z BETWEEN w.pose[3] + coalesce(r.floor, 0) - 0.05 AND greatest(w.pose[3] + coalesce(r.ceiling, 2.5), ST_ZMax(w.box))
           ELSE board.height IS NOT NULL OR EXISTS (SELECT FROM semmap.type_closure c WHERE c.sub = e.type AND c.super IN ('storage_furniture', 'container')) AND foot.z BETWEEN ST_ZMin(w.box) AND ST_ZMax(w.box) END
ORDER BY e.kind = 'room', w.pose[3] + board.height DESC NULLS LAST, ST_Area(w.footprint) LIMIT 1;
END;

CREATE FUNCTION look_within(distance double precision)
RETURNS double precision LANGUAGE sql IMMUTABLE
BEGIN ATOMIC
-- The distance within which looks have rates of their own, metres, of a look from so far; null beyond all.
SELECT min(w.within) FROM unnest('{1, 2, 4, 8, 100}'::double precision[]) w (within) WHERE distance < w.within;
END;

CREATE FUNCTION learned_rate(of_map integer, observer bigint, distance double precision)
RETURNS SETOF detector_rate LANGUAGE sql STABLE ROWS 1
BEGIN ATOMIC
-- What was learned of an agent's looks from about so far, else from anywhere, else of all agents' looks, as of an agent that
-- is gone; no row for people's words.
SELECT d.* FROM semmap.detector_rate d
WHERE d.map_id = of_map AND (observer IS NOT NULL OR distance IS NOT NULL) AND (d.observer_id = observer OR d.observer_id IS NULL)
  AND (d.within IS NULL OR d.within = semmap.look_within(distance))
ORDER BY d.observer_id IS NULL, d.within NULLS LAST LIMIT 1;
END;

CREATE FUNCTION put_until(rates double precision[], by_part double precision[], clock double precision, seconds double precision)
RETURNS double precision[] LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp AS $$
-- Where a thing is that moved in the seconds until a time on the clock of the building, by the part of the day in which it moved
-- last, and, as one number more, how probable it did not move. It moves at `rates`, a second, to places by the priors of the part.
DECLARE
    parts CONSTANT integer := cardinality(rates);
    places CONSTANT integer := cardinality(by_part) / cardinality(rates);
    length CONSTANT double precision := 86400.0 / cardinality(rates);
    least_rate CONSTANT double precision := 1e-14;  -- else the parts of a thing that never moves have no share
    hour double precision := clock - 86400 * floor(clock / 86400);  -- seconds since midnight
    days double precision := floor(least(seconds, 1e11) / 86400);
    remaining double precision := CASE WHEN days > 0 THEN 86400 ELSE seconds END;
    last double precision[] := array_fill(0::double precision, ARRAY[parts]);  -- of moves, by part
    put double precision[] := array_fill(0::double precision, ARRAY[places + 1]);
    due double precision := 0;  -- moves since then
    kept double precision := 1;  -- of the chance that they leave, with the least rate
    factor double precision;
    piece double precision;
    part integer;
BEGIN
    LOOP
        IF remaining <= 0 THEN
            EXIT WHEN days = 0;
            factor := exp(greatest(days * ln(greatest(kept, 1e-26)), -60));  -- of all the days, of which this was the last
            FOR part IN 1 .. parts LOOP
                last[part] := last[part] * CASE WHEN 1 - kept > 1e-9 THEN (1 - factor) / (1 - kept) ELSE days END;
            END LOOP;
            kept := factor;
            due := due * days;
            remaining := least(seconds, 1e11) - 86400 * days;
            days := 0;
            CONTINUE;
        END IF;
        IF hour <= 0 THEN
            hour := 86400;
        END IF;
        part := least(ceil(hour / length), parts);
        piece := least(remaining, greatest(hour - (part - 1) * length, 1e-6));
        factor := exp(-least(piece * greatest(rates[part], least_rate), 60));
        last[part] := last[part] + kept * (1 - factor);
        kept := kept * factor;
        due := due + piece * rates[part];
        hour := hour - piece;
        remaining := remaining - piece;
    END LOOP;
    IF seconds <= 0 THEN
        last[least(floor((clock - 86400 * floor(clock / 86400)) / length) + 1, parts)] := 1;
    END IF;
    factor := (SELECT sum(l) FROM unnest(last) l);
    FOR part IN 1 .. parts LOOP
        CONTINUE WHEN last[part] <= factor * 1e-30;
        FOR i IN 1 .. places LOOP
            put[i] := put[i] + last[part] / factor * by_part[(part - 1) * places + i];
        END LOOP;
    END LOOP;
    put[places + 1] := exp(-least(due, 60));
    RETURN put;
END $$;

CREATE FUNCTION belief_given(things bigint[], places bigint[], priors double precision[], moment timestamptz,
                             moves double precision DEFAULT NULL, looks boolean DEFAULT true)
RETURNS TABLE (entity_id bigint, place_id bigint, prior double precision, probability double precision)
LANGUAGE plpgsql STABLE ROWS 1000 COST 10000
SET search_path = semmap, public, pg_temp SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- Where things were at a moment, by their priors (a thing, a place and a probability each) and all that was stated and
-- observed until then, one after the other:
--   in t seconds, a thing of mobility M stays with k = exp(-t M / moves), else it is put anywhere: p' = k p + (1 - k) prior;
--   M is lifted by what was learned, unless the caller says how often things move; as far as the map knows, the parts of the
--   day have rates and priors of their own;
--   before a sighting, k is at most 0.99: what is seen may just have been moved;
--   where the map puts it, it is with the probability `stated`, else where it was before;
--   an observation multiplies its place by P(seen | there) / P(seen | not there), and so for "not seen". Of a place that is
--   in view to a share v, both rates are v times as large.
DECLARE
    step record;
    last record;  -- the step before
    thing bigint;  -- of that step
    at_place double precision[];
    total double precision;  -- of at_place
    since timestamptz;
    rates double precision[];  -- in the parts of the day, where the map knows of them
    by_part double precision[];  -- priors, one part after the other
    parts integer;
    first integer;  -- index before those of the part
    put double precision[];  -- where it is if it moved in several parts
    gap double precision;  -- seconds since then
    hour double precision;  -- seconds since midnight
    part integer;
    keep double precision;
    unmoved CONSTANT double precision := 0.99;  -- what is seen may just have been moved: people use it
    i integer;
BEGIN
    FOR step IN
        WITH pair AS MATERIALIZED (
            SELECT p.id, p.place, p.prior, row_number() OVER (PARTITION BY p.id ORDER BY p.place)::integer AS n
            FROM unnest(things, places, priors) p (id, place, prior)
        ), thing AS MATERIALIZED (
            SELECT g.*, e.map_id, greatest(coalesce(semmap.property_of(g.id, 'mobility'), 1), 0) AS mobility,
                   CASE WHEN belief_given.moves IS NULL THEN semmap.lift_of_moves(g.id) ELSE 1 END AS lift,
                   CASE WHEN belief_given.moves IS NULL THEN h.moves END AS lifts, h.by_part
            FROM (SELECT p.id, array_agg(p.place ORDER BY p.n) AS places, array_agg(p.prior ORDER BY p.n) AS priors FROM pair p GROUP BY p.id) g
            JOIN semmap.entity e ON e.id = g.id LEFT JOIN semmap.habits_of(belief_given.things, belief_given.places, belief_given.priors) h ON h.entity_id = g.id
        ), spot AS MATERIALIZED (
            SELECT o.entity_id, o.place_id, o.inside, array_agg(p.n) AS hits
            FROM (SELECT DISTINCT o.entity_id, o.place_id, o.inside FROM thing t JOIN semmap.observation o ON o.entity_id = t.id
                  WHERE looks AND o.at <= moment) o
            JOIN pair p ON p.id = o.entity_id AND (p.place = o.place_id OR o.inside AND semmap.is_held_by(p.place, o.place_id)) GROUP BY 1, 2, 3
        ), look AS (
            SELECT o.entity_id, o.at, o.id AS number, s.hits, o.seen, o.visible,
                   coalesce(o.hit, d.hit, m.there + m.change * f.fresh) AS a,
                   coalesce(o.false_alarm, d.false_alarm, m.elsewhere - m.change * f.fresh) AS b
            FROM thing t JOIN semmap.observation o ON o.entity_id = t.id AND o.at <= moment
            JOIN spot s ON s.entity_id = o.entity_id AND s.place_id = o.place_id AND s.inside = o.inside
            CROSS JOIN LATERAL semmap.belief_model_of(t.map_id) m
            LEFT JOIN LATERAL semmap.learned_rate(t.map_id, o.observer_id, o.distance) d ON o.hit IS NULL AND o.false_alarm IS NULL
            CROSS JOIN LATERAL (SELECT exp(-least(extract(epoch FROM moment - o.at)::double precision * t.mobility / m.seconds, 700))) f (fresh)
        ), evidence AS (
            SELECT l.entity_id, l.at, l.number, l.hits, CASE WHEN l.seen THEN l.a / l.b ELSE (1 - l.visible * l.a) / (1 - l.visible * l.b) END AS ratio
            FROM look l
          UNION ALL
            SELECT s.entity_id, s.at, 0, array_agg(p.n), NULL
            FROM semmap.statements_about(things, places, moment) s JOIN pair p ON p.id = s.entity_id
             AND (p.place = ANY (s.place_ids) OR p.place IS NULL AND s.place_ids = ARRAY[NULL::bigint]) GROUP BY 1, 2
        )
        SELECT t.id, t.places, t.priors, t.mobility * t.lift / coalesce(belief_given.moves, m.moves) AS rate, t.lifts, t.by_part,
               m.stated, m.time_zone, v.at, extract(epoch FROM v.at AT TIME ZONE m.time_zone)::double precision AS clock, v.hits, v.ratio
        FROM thing t LEFT JOIN evidence v ON v.entity_id = t.id, LATERAL semmap.belief_model_of(t.map_id) m
        ORDER BY t.id, v.at, v.number
    LOOP
        IF thing IS DISTINCT FROM step.id THEN
            IF thing IS NOT NULL THEN
                RETURN QUERY SELECT * FROM semmap.belief_after(last.id, last.places, last.priors, at_place, last.rate, moment - since,
                                                               rates, by_part, moment AT TIME ZONE last.time_zone);
            END IF;
            thing := step.id;
            by_part := coalesce(step.by_part, step.priors);
            parts := cardinality(by_part) / cardinality(step.places);
            rates := CASE WHEN step.by_part IS NOT NULL THEN
                ARRAY(SELECT coalesce(step.lifts[n], 1) * step.rate FROM generate_series(1, parts) n ORDER BY n) END;
            at_place := step.priors;
            IF step.at IS NOT NULL AND rates IS NOT NULL THEN
                at_place := trim_array(semmap.put_until(rates, by_part, step.clock, 86400), 1);
            END IF;
            total := 1;
            since := step.at;
        END IF;
        last := step;
        CONTINUE WHEN step.at IS NULL;
        gap := extract(epoch FROM step.at - since);
        put := NULL;
        first := 0;
        IF rates IS NULL THEN
            keep := exp(-least(gap * step.rate, 60));
        ELSE
            hour := step.clock - 86400 * floor(step.clock / 86400);
            part := floor(hour * parts / 86400.0);
            IF hour - gap >= part * 86400.0 / parts THEN  -- all of the time is in one part
                first := part * cardinality(at_place);
                keep := exp(-least(gap * rates[part + 1], 60));
            ELSE
                put := semmap.put_until(rates, by_part, step.clock, gap);
                keep := put[cardinality(put)];
            END IF;
        END IF;
        IF step.ratio > 1 AND step.rate > 0 AND step.at > since THEN
            keep := least(keep, unmoved);
        END IF;
        since := step.at;
        IF keep < 1 AND put IS NULL THEN
            FOR i IN 1 .. cardinality(at_place) LOOP
                at_place[i] := keep * at_place[i] / total + (1 - keep) * by_part[first + i];
            END LOOP;
            total := 1;
        ELSIF keep < 1 THEN
            FOR i IN 1 .. cardinality(at_place) LOOP
                at_place[i] := keep * at_place[i] / total + (1 - keep) * put[i];
            END LOOP;
            total := 1;
        END IF;
        IF step.ratio IS NULL THEN
            keep := 0;  -- what is at the stated places already
            FOREACH i IN ARRAY step.hits LOOP
                keep := keep + at_place[i];
            END LOOP;
            CONTINUE WHEN keep = 0;
            FOREACH i IN ARRAY step.hits LOOP  -- the others stay as they are, and the total grows
                at_place[i] := at_place[i] * (1 + step.stated / (1 - step.stated) * total / keep);
            END LOOP;
            total := total / (1 - step.stated);
        ELSE
            FOREACH i IN ARRAY step.hits LOOP
                keep := at_place[i];
                at_place[i] := greatest(keep * step.ratio, least(keep, 1e-200));
                total := total + at_place[i] - keep;
            END LOOP;
        END IF;
        IF total NOT BETWEEN 0.01 AND 1e9 THEN
            total := (SELECT sum(p) FROM unnest(at_place) p);
            at_place := ARRAY(SELECT CASE WHEN p > 0 AND ln(p) - ln(total) < -460 THEN 1e-200 ELSE p / total END  -- else it underflows
                              FROM unnest(at_place) WITH ORDINALITY a (p, n) ORDER BY n);
            total := 1;
        END IF;
    END LOOP;
    IF thing IS NOT NULL THEN
        RETURN QUERY SELECT * FROM semmap.belief_after(last.id, last.places, last.priors, at_place, last.rate, moment - since,
                                                       rates, by_part, moment AT TIME ZONE last.time_zone);
    END IF;
END $$;

CREATE FUNCTION belief_after(thing bigint, places bigint[], priors double precision[], at_place double precision[],
                             rate double precision, since interval, rates double precision[], by_part double precision[], clock timestamp)
RETURNS TABLE (entity_id bigint, place_id bigint, prior double precision, probability double precision)
LANGUAGE sql IMMUTABLE
BEGIN ATOMIC
-- The belief some time after it was as some weights, if things are moved at a rate; with rates of the parts of the day, at a
-- time on the clock of the building, and null for a thing of which nothing is known.
WITH put AS MATERIALIZED (
    SELECT semmap.put_until(rates, by_part, extract(epoch FROM clock)::double precision,
                            coalesce(extract(epoch FROM since)::double precision, 86400)) AS at
    WHERE rates IS NOT NULL
)
SELECT thing, p.place, p.prior, k.keep * p.weight / sum(p.weight) OVER () + (1 - k.keep) * coalesce(u.at[p.n], p.prior)
FROM unnest(places, priors, at_place) WITH ORDINALITY p (place, prior, weight, n) LEFT JOIN put u ON true,
     LATERAL (SELECT CASE WHEN since IS NULL THEN CASE WHEN rates IS NULL THEN 1 ELSE 0 END
                          WHEN rates IS NULL THEN exp(-least(extract(epoch FROM since)::double precision * rate, 60))
                          ELSE u.at[cardinality(u.at)] END) k (keep);
END;

CREATE FUNCTION belief_at(things bigint[], moment timestamptz, moves double precision DEFAULT NULL, looks boolean DEFAULT true)
RETURNS TABLE (entity_id bigint, place_id bigint, prior double precision, probability double precision)
LANGUAGE sql STABLE ROWS 1000 COST 20000 SET search_path = semmap, public, pg_temp AS $$
-- Where each thing was at a moment: at the places that the map has now, by what was stated and observed until then.
SELECT b.* FROM (SELECT array_agg(p.entity_id), array_agg(p.place_id), array_agg(p.prior) FROM semmap.prior_of(things) p) p (ids, places, priors),
    LATERAL semmap.belief_given(p.ids, p.places, p.priors, moment, moves, looks) b
$$;

CREATE FUNCTION where_is(thing text, moment timestamptz DEFAULT statement_timestamp(), moves double precision DEFAULT NULL)
RETURNS TABLE (place text, probability double precision, prior double precision, holder text, last_seen timestamptz, last_missed timestamptz)
LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- Where an object or agent of the current map probably is at a moment, the most probable place first; "elsewhere" is
-- no place of the map. With what holds the place, and when the thing was last seen there, or looked for and not seen.
DECLARE
    of_thing bigint := semmap.entity_id(thing);
BEGIN
    PERFORM semmap.require_mobile(e) FROM semmap.entity e WHERE e.id = of_thing;
    RETURN QUERY
        SELECT coalesce(e.name, 'elsewhere'), b.probability, b.prior, h.name,
               (SELECT max(o.at) FROM semmap.observation o WHERE o.entity_id = of_thing AND o.place_id = b.place_id AND o.seen AND o.at <= moment),
               (SELECT max(o.at) FROM semmap.observation o WHERE o.entity_id = of_thing AND o.place_id = b.place_id AND NOT o.seen AND o.at <= moment)
        FROM semmap.belief_at(ARRAY[of_thing], moment, moves) b LEFT JOIN semmap.entity e ON e.id = b.place_id
        LEFT JOIN semmap.placement p ON p.entity_id = b.place_id LEFT JOIN semmap.entity h ON h.id = p.holder_id
        ORDER BY b.probability DESC, b.place_id IS NULL, e.name;
END $$;

CREATE FUNCTION refresh_belief(things bigint[], keep_priors boolean DEFAULT false)
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- Writes the belief about the given things for this moment, and records that it changed. Another transaction that
-- observes one of them waits, and then sees these observations.
DECLARE
    ids bigint[] := ARRAY(SELECT e.id FROM semmap.entity e WHERE e.id = ANY (things) AND e.kind IN ('object', 'agent') ORDER BY e.id
                          FOR NO KEY UPDATE);
    moment timestamptz := clock_timestamp();
    portion CONSTANT integer := 200;  -- the joins of many things take more than linear time
    given record;
    wanted record;
BEGIN
    IF cardinality(ids) > portion THEN
        FOR i IN 1 .. cardinality(ids) BY portion LOOP
            PERFORM semmap.refresh_belief(ids[i:i + portion - 1], keep_priors);
        END LOOP;
        RETURN;
    ELSIF ids = '{}' THEN
        RETURN;
    END IF;
    IF keep_priors THEN
        SELECT array_agg(b.entity_id) AS ids, array_agg(b.place_id) AS places, array_agg(b.prior) AS priors
            INTO given FROM semmap.belief b WHERE b.entity_id = ANY (ids);
    ELSE
        SELECT array_agg(p.entity_id) AS ids, array_agg(p.place_id) AS places, array_agg(p.prior) AS priors
            INTO given FROM semmap.prior_of(ids) p;
    END IF;
    SELECT array_agg(b.entity_id) AS ids, array_agg(b.place_id) AS places, array_agg(b.prior) AS priors,
           array_agg(b.probability) AS probabilities
        INTO wanted FROM semmap.belief_given(given.ids, given.places, given.priors, moment) b;
    UPDATE semmap.belief b SET prior = w.prior, probability = w.probability, at = moment
        FROM unnest(wanted.ids, wanted.places, wanted.priors, wanted.probabilities) w (id, place, prior, probability)
        WHERE b.entity_id = w.id AND coalesce(b.place_id, 0) = coalesce(w.place, 0);
    IF NOT keep_priors THEN
        PERFORM set_config('semmap.believing', 'on', true);
        DELETE FROM semmap.belief b WHERE b.entity_id = ANY (ids) AND b.at <> moment;
        PERFORM set_config('semmap.believing', '', true);
        INSERT INTO semmap.belief (entity_id, place_id, prior, probability, at)
            SELECT w.id, w.place, w.prior, w.probability, moment
            FROM unnest(wanted.ids, wanted.places, wanted.priors, wanted.probabilities) w (id, place, prior, probability)
            LEFT JOIN semmap.belief b ON b.entity_id = w.id AND coalesce(b.place_id, 0) = coalesce(w.place, 0)
            WHERE b.id IS NULL;
    END IF;
    PERFORM semmap.record_change('belief', ids);
END $$;

CREATE FUNCTION refresh_beliefs()
RETURNS bigint LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Writes the table `belief` of the current map again, such as after furniture was added; returns how many things it has.
DECLARE
    ids bigint[] := ARRAY(SELECT DISTINCT b.entity_id FROM semmap.belief b JOIN semmap.entity e ON e.id = b.entity_id
                          WHERE e.map_id = semmap.current_map());
BEGIN
    PERFORM semmap.refresh_belief(ids);
    RETURN cardinality(ids);
END $$;

-- What changes a belief.

CREATE FUNCTION distance_outside(place bigint, spot double precision[])
RETURNS double precision LANGUAGE sql STABLE STRICT
BEGIN ATOMIC
-- How far a position in the frame of a place is outside of it, metres: from its footprint and its height, above which
-- what stands on it may be a metre high. Null without a footprint.
SELECT greatest(ST_Distance(w.footprint, ST_MakePoint(p.at[1], p.at[2])), ST_ZMin(w.box) - p.at[3],
                p.at[3] - greatest(ST_ZMax(w.box) + 1, w.pose[3] + coalesce(r.ceiling, 0)))
FROM semmap.world w LEFT JOIN semmap.room r ON r.entity_id = w.entity_id,
     LATERAL (SELECT semmap.pose_compose(w.pose, spot || ARRAY[0, 0, 0, 1]::double precision[])) p (at)
WHERE w.entity_id = place AND w.footprint IS NOT NULL;
END;

CREATE FUNCTION look_distance(observer bigint, moment timestamptz, place bigint)
RETURNS double precision LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
-- Metres along the floor from where an agent was at a moment to the middle of a piece of furniture, which is the same whatever
-- the look shows; null if one of them is unknown, and of rooms.
SELECT sqrt((o.pose[1] - ST_X(c.middle)) ^ 2 + (o.pose[2] - ST_Y(c.middle)) ^ 2)
FROM semmap.world w JOIN semmap.entity e ON e.id = w.entity_id AND e.kind = 'object',
     LATERAL semmap.pose_at(observer, moment) o (pose), LATERAL (SELECT ST_Centroid(w.footprint)) c (middle)
WHERE w.entity_id = place
$$;

CREATE FUNCTION observation_stamp()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- What is observed is an object or agent, at another entity of its map and within it, not in the future, and by a
-- detector that reports what is there more often than what is not.
DECLARE
    thing semmap.entity := (SELECT e FROM semmap.entity e WHERE e.id = NEW.entity_id);
    place semmap.entity := (SELECT e FROM semmap.entity e WHERE e.id = NEW.place_id);
    model semmap.belief_model := semmap.belief_model_of(thing.map_id);
    away double precision := semmap.distance_outside(NEW.place_id, NEW.position);
BEGIN
    PERFORM semmap.require_mobile(thing);
    IF thing.map_id <> place.map_id THEN
        RAISE EXCEPTION '% and % are in different maps', thing.name, place.name
            USING ERRCODE = 'check_violation', HINT = 'Observe an object at a place of its own map.';
    ELSIF NEW.at > clock_timestamp() THEN
        RAISE EXCEPTION '% at %: the time of the observation, %, is in the future', thing.name, place.name, NEW.at
            USING ERRCODE = 'check_violation', HINT = 'Give the time in UTC, or with its time zone; compare the clocks.';
    ELSIF coalesce(NEW.hit, model.there + model.change) <= coalesce(NEW.false_alarm, model.elsewhere - model.change) THEN
        RAISE EXCEPTION '% at %: hit, %, is not above false_alarm, %', thing.name, place.name,
                coalesce(NEW.hit, model.there + model.change), coalesce(NEW.false_alarm, model.elsewhere - model.change)
            USING ERRCODE = 'check_violation', HINT = 'Exchange them, or state both: hit is P(seen | there). Equal rates say nothing.';
    ELSIF away > 0.5 THEN
        RAISE EXCEPTION '% at %: its position is % m outside of %', thing.name, place.name, round(away::numeric, 2)::double precision, place.name
            USING ERRCODE = 'check_violation', HINT = 'Positions are x, y, z in the frame of the place, in metres.';
    END IF;
    IF TG_OP = 'INSERT' AND coalesce(current_setting('semmap.deriving', true), '') = '' THEN
        NEW.distance := semmap.look_distance(NEW.observer_id, NEW.at, NEW.place_id);
    END IF;
    RETURN NEW;
END $$;

CREATE FUNCTION has_place(thing bigint, place bigint, inside boolean)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
-- Whether the belief about a thing has a place, or with `inside` any in it.
SELECT EXISTS (SELECT FROM semmap.belief b WHERE b.entity_id = thing AND b.place_id = place)
    OR inside AND EXISTS (SELECT FROM semmap.belief b WHERE b.entity_id = thing AND semmap.is_held_by(b.place_id, place));
END;

CREATE FUNCTION observation_added()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- The places of a thing and their priors are found at its first observation, and at one of a place that is new.
-- Of repeated looks of an agent within `keep_every`, the last is kept: they are not independent.
DECLARE
    every interval := (SELECT keep_every FROM semmap.retention WHERE kind = 'observation');
    ids bigint[] := ARRAY(SELECT DISTINCT entity_id FROM fresh);
    unknown bigint[] := ARRAY(SELECT DISTINCT entity_id FROM fresh f WHERE NOT semmap.has_place(f.entity_id, f.place_id, f.inside));
    wrong record;
BEGIN
    IF every IS NOT NULL THEN
        PERFORM set_config('semmap.believing', 'on', true);
        DELETE FROM semmap.observation o USING fresh f
            WHERE o.entity_id = f.entity_id AND o.place_id = f.place_id AND o.observer_id = f.observer_id
              AND o.seen = f.seen AND o.inside = f.inside AND (o.at, o.id) < (f.at, f.id)
              AND floor(extract(epoch FROM o.at) / extract(epoch FROM every)) = floor(extract(epoch FROM f.at) / extract(epoch FROM every));
        PERFORM set_config('semmap.believing', '', true);
    END IF;
    PERFORM semmap.refresh_belief(unknown);
    PERFORM semmap.refresh_belief(ARRAY(SELECT unnest(ids) EXCEPT SELECT unnest(unknown)), true);
    SELECT t.name, p.name AS place INTO wrong
        FROM fresh f JOIN semmap.entity t ON t.id = f.entity_id JOIN semmap.entity p ON p.id = f.place_id
        WHERE f.entity_id = ANY (unknown) AND NOT semmap.has_place(f.entity_id, f.place_id, f.inside) LIMIT 1;
    IF wrong IS NOT NULL THEN
        RAISE EXCEPTION '% cannot be on or in %: it has no room there', wrong.name, wrong.place
            USING ERRCODE = 'check_violation',
                  HINT = 'Places are rooms, containers, and surfaces of furniture that are large enough: see semmap.places_for().';
    END IF;
    SELECT t.name, p.name AS place, q.name AS other, f.at INTO wrong
        FROM fresh f JOIN semmap.observation o ON o.entity_id = f.entity_id AND o.at = f.at AND o.seen AND o.place_id <> f.place_id
         AND NOT (o.inside AND semmap.is_held_by(f.place_id, o.place_id)) AND NOT (f.inside AND semmap.is_held_by(o.place_id, f.place_id))
        JOIN semmap.entity t ON t.id = f.entity_id JOIN semmap.entity p ON p.id = f.place_id JOIN semmap.entity q ON q.id = o.place_id
        WHERE f.seen ORDER BY f.id LIMIT 1;
    IF wrong IS NOT NULL THEN
        RAISE EXCEPTION '% cannot be at % and at % at the same time, %', wrong.name, wrong.place, wrong.other, wrong.at
            USING ERRCODE = 'check_violation', HINT = 'State where it was seen at last, or observe another object of its type.';
    END IF;
    PERFORM semmap.follow_sighting(id) FROM unnest(ids) i (id);
    RETURN NULL;
END $$;

CREATE FUNCTION seen_pose(thing bigint, place bigint, spot double precision[])
RETURNS double precision[] LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The pose in the map's frame of an entity whose middle was seen at a position in the frame of a place: turned as it
-- was, with its foot on the surface below, or on the floor; in a container, where it was seen. Null in the air. What was
-- seen beside the surface, as cameras err, is moved onto it. The middle of an agent of unknown height is up to 1.8 m
-- above the floor.
SELECT ARRAY[coalesce(ST_X(snapped.point), seen.at[1]) - own.x, coalesce(ST_Y(snapped.point), seen.at[2]) - own.y,
             CASE WHEN e.kind <> 'room' THEN coalesce(k.pose[3] + board.height - own.foot, seen.at[3] - own.middle)
                  ELSE coalesce(k.pose[3] + r.floor - own.foot, seen.at[3] - own.middle) END] || own.turn
FROM semmap.world k JOIN semmap.entity e ON e.id = k.entity_id LEFT JOIN semmap.room r ON r.entity_id = k.entity_id,
     LATERAL (SELECT semmap.pose_compose(k.pose, spot || ARRAY[0, 0, 0, 1]::double precision[])) seen (at),
     LATERAL (SELECT (ST_XMin(b.box) + ST_XMax(b.box)) / 2, (ST_YMin(b.box) + ST_YMax(b.box)) / 2, ST_ZMin(b.box),
                     (ST_ZMin(b.box) + ST_ZMax(b.box)) / 2, ST_ZMax(b.box) - ST_ZMin(b.box), b.turn,
                     least(ST_XMax(b.box) - ST_XMin(b.box), ST_YMax(b.box) - ST_YMin(b.box)) / 2
              FROM (SELECT ST_Translate(w.box, -w.pose[1], -w.pose[2], -w.pose[3]) AS box, w.pose[4:7] AS turn, 1 AS rank
                    FROM semmap.world w WHERE w.entity_id = thing
                  UNION ALL
                    SELECT semmap.diagonal(ST_Collect(o.hull)), '{0,0,0,1}', 2
                    FROM semmap.entity_model m JOIN semmap.model o ON o.id = m.model_id WHERE m.entity_id = thing HAVING count(*) > 0
                  UNION ALL
                    SELECT ST_MakeLine(ST_MakePoint(0, 0, 0), ST_MakePoint(0, 0, 0)), '{0,0,0,1}', 3) b
              ORDER BY b.rank LIMIT 1) own (x, y, foot, middle, height, turn, half)
     LEFT JOIN LATERAL (SELECT s.height, ST_Collect(ST_Translate(ST_Rotate(s.outline, semmap.pose_yaw(k.pose), 0, 0), k.pose[1], k.pose[2])) AS area
                        FROM semmap.entity_model m JOIN semmap.support_surface s ON s.model_id = m.model_id
                        WHERE m.entity_id = place AND seen.at[3] - k.pose[3] - s.height BETWEEN -0.05 AND greatest(0.5, own.height / 2)
                        GROUP BY s.height ORDER BY s.height DESC LIMIT 1) board ON true
     LEFT JOIN LATERAL (SELECT ST_ClosestPoint(CASE WHEN ST_IsEmpty(i.inside) THEN ST_Centroid(board.area) ELSE i.inside END, i.at) AS point
                        FROM (SELECT ST_Buffer(board.area, -own.half), ST_MakePoint(seen.at[1], seen.at[2])) i (inside, at)
                        WHERE abs(k.pose[4]) < 1e-3 AND abs(k.pose[5]) < 1e-3 AND NOT ST_Intersects(board.area, i.at)) snapped ON true
     LEFT JOIN LATERAL (SELECT 1.8 FROM semmap.entity a WHERE a.id = thing AND a.kind = 'agent' AND own.height = 0) t (tall) ON true
WHERE k.entity_id = place
  AND CASE WHEN e.kind = 'room' THEN coalesce(seen.at[3] - k.pose[3] - r.floor <= greatest(0.5, own.height, t.tall), true)
           ELSE board.height IS NOT NULL OR seen.at[3] <= ST_ZMax(k.box) + 0.05 END
$$;

CREATE FUNCTION follow_sighting(thing bigint)
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Lets the map follow what is sure. An object or agent is moved to where it was seen last, if that is newer than its
-- placement and nearly all belief is there; it has no place any more, if it was looked for in vain until nearly none is where it is.
-- A robot that logs in by a role of its own knows best where it is: sightings of it by others do not move it.
DECLARE
    sure CONSTANT double precision := 0.9;
    gone CONSTANT double precision := 0.01;
    placed semmap.placement := (SELECT p FROM semmap.placement p WHERE p.entity_id = thing);
    seen semmap.observation := (SELECT o FROM semmap.observation o WHERE o.entity_id = thing AND o.seen AND o.position IS NOT NULL
                                ORDER BY o.at DESC, o.id DESC LIMIT 1);
    believed double precision := (SELECT b.probability FROM semmap.belief b WHERE b.entity_id = thing AND b.place_id = seen.place_id);
    there double precision[];
    former double precision[] := (SELECT w.pose FROM semmap.world w WHERE w.entity_id = thing);
    stay record;
BEGIN
    IF EXISTS (SELECT FROM semmap.entity e JOIN pg_catalog.pg_roles r ON r.rolname = e.name WHERE e.id = thing AND e.kind = 'agent') THEN
        RETURN;
    ELSIF believed >= sure AND (placed.entity_id IS NULL OR seen.at > placed.since) THEN
        there := semmap.seen_pose(thing, seen.place_id, seen.position);
        IF there IS NULL THEN
            RETURN;
        ELSIF placed.entity_id IS NULL THEN
            INSERT INTO semmap.placement (entity_id, pose, confidence) VALUES (thing, there, believed);
        ELSIF abs(there[1] - former[1]) > 0.01 OR abs(there[2] - former[2]) > 0.01 OR abs(there[3] - former[3]) > 0.01 THEN
            UPDATE semmap.placement p SET holder_id = NULL, relation = 'in', confidence = believed, pose = there WHERE p.entity_id = thing;
        END IF;
    ELSIF placed.entity_id IS NOT NULL AND NOT EXISTS (SELECT FROM semmap.placement p WHERE p.holder_id = thing) THEN
        SELECT s.place_ids, s.at INTO stay
            FROM semmap.statements_about(ARRAY(SELECT b.entity_id FROM semmap.belief b WHERE b.entity_id = thing ORDER BY b.id),
                                         ARRAY(SELECT b.place_id FROM semmap.belief b WHERE b.entity_id = thing ORDER BY b.id), clock_timestamp()) s
            ORDER BY s.at DESC LIMIT 1;
        IF EXISTS (SELECT FROM semmap.observation o WHERE o.entity_id = thing AND NOT o.seen AND o.at > placed.since)
           AND gone > (SELECT sum(b.probability) FROM semmap.belief b WHERE b.entity_id = thing AND b.place_id = ANY (stay.place_ids)) THEN
            DELETE FROM semmap.placement p WHERE p.entity_id = thing;
        END IF;
    END IF;
END $$;

CREATE FUNCTION observation_gone()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Observations were deleted, or a place with its rows.
BEGIN
    IF coalesce(current_setting('semmap.dropping', true), '') = '' AND coalesce(current_setting('semmap.believing', true), '') = '' THEN
        PERFORM semmap.refresh_belief(ARRAY(SELECT DISTINCT f.entity_id FROM former f JOIN semmap.belief b ON b.entity_id = f.entity_id));
    END IF;
    RETURN NULL;
END $$;

CREATE FUNCTION belief_moved()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- A placement by the map is evidence. An agent moves all the time: it counts once in each holder.
DECLARE
    moved bigint[] := ARRAY(
        SELECT n.entity_id FROM former o FULL JOIN fresh n USING (entity_id)  -- full: as in placement_updated
        WHERE coalesce(o.entity_id = n.entity_id, false)
          AND (o.holder_id IS DISTINCT FROM n.holder_id
               OR o.pose <> n.pose AND EXISTS (SELECT FROM semmap.entity e WHERE e.id = n.entity_id AND e.kind = 'object')));
BEGIN
    PERFORM semmap.refresh_belief(ARRAY(SELECT DISTINCT b.entity_id FROM semmap.belief b WHERE b.entity_id = ANY (moved)));
    RETURN NULL;
END $$;

CREATE FUNCTION belief_described()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- Size, mobility and usual places follow from the type and the properties.
DECLARE
    described bigint[] := ARRAY(
        SELECT n.id FROM former o FULL JOIN fresh n USING (id)
        WHERE coalesce(o.id = n.id, false) AND (o.type, o.properties) IS DISTINCT FROM (n.type, n.properties));
BEGIN
    PERFORM semmap.refresh_belief(ARRAY(SELECT DISTINCT b.entity_id FROM semmap.belief b WHERE b.entity_id = ANY (described)));
    RETURN NULL;
END $$;

CREATE FUNCTION belief_judged()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
BEGIN
    PERFORM semmap.refresh_belief(ARRAY(SELECT DISTINCT b.entity_id FROM semmap.belief b JOIN semmap.entity e ON e.id = b.entity_id
                                 WHERE e.map_id = coalesce(NEW.map_id, OLD.map_id)));
    RETURN NULL;
END $$;

CREATE TRIGGER observation_stamp BEFORE INSERT OR UPDATE ON observation
    FOR EACH ROW EXECUTE FUNCTION observation_stamp();
CREATE TRIGGER observation_added AFTER INSERT ON observation REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION observation_added();
CREATE TRIGGER observation_corrected AFTER UPDATE ON observation REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION observation_added();
CREATE TRIGGER observation_gone AFTER DELETE ON observation REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION observation_gone();
CREATE TRIGGER belief_gone AFTER DELETE ON belief REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION observation_gone();
CREATE TRIGGER belief_moved AFTER UPDATE ON placement REFERENCING OLD TABLE AS former NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION belief_moved();
CREATE TRIGGER belief_described AFTER UPDATE ON entity REFERENCING OLD TABLE AS former NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION belief_described();
CREATE TRIGGER belief_judged AFTER INSERT OR UPDATE OR DELETE ON belief_model
    FOR EACH ROW EXECUTE FUNCTION belief_judged();
