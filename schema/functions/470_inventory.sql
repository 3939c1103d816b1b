-- Inventories that follow the geometry (Deeken et al., section 3.4: objects are "already implicitly bound by
-- their pose"). The holder of an object is stated (its confidence is null) or derived. A move derives the
-- holders of what moved again; a stated holder stays until the geometry contradicts it.

CREATE FUNCTION kinds_of_building_part()
RETURNS text[] LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
SELECT ARRAY['wall', 'floor', 'ceiling', 'window', 'door_leaf', 'roof', 'building_shell'];
END;

CREATE FUNCTION building_parts()
RETURNS text[] LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- The types that are parts of the building.
SELECT ARRAY(SELECT DISTINCT sub FROM semmap.type_closure WHERE super = ANY (semmap.kinds_of_building_part()));
END;

CREATE FUNCTION is_building_part(of_type text)
RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan AS $$
-- Whether a type is a part of the building: its holder is its storey, and it is not a holder. In PL/pgSQL: see ceiling_of.
BEGIN
    RETURN EXISTS (SELECT FROM semmap.type_closure WHERE sub = of_type AND super = ANY (semmap.kinds_of_building_part()));
END $$;

CREATE FUNCTION has_room(of_kind text, of_type text)
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- Whether an entity is in the room of its place: an agent, and an object that is no part of the building.
SELECT of_kind = 'agent' OR of_kind = 'object' AND NOT semmap.is_building_part(of_type);
END;

CREATE FUNCTION is_flush(thing bigint)
RETURNS boolean LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- Whether an object lies in the floor of a room or of the opening beside it, as tiles and planks do: its top is at the
-- floor, and its middle 5 mm below it.
DECLARE
    beside CONSTANT double precision := 0.3;
BEGIN
    RETURN EXISTS (
        SELECT FROM semmap.world w JOIN semmap.world o ON o.map_id = w.map_id AND o.footprint && ST_Expand(w.footprint, beside)
        JOIN semmap.room r ON r.entity_id = o.entity_id
        WHERE w.entity_id = thing AND abs(o.pose[3] + r.floor - ST_ZMax(w.box)) <= 0.01
          AND (ST_ZMin(w.box) + ST_ZMax(w.box)) / 2 <= o.pose[3] + r.floor - 0.005 AND ST_DWithin(o.footprint, w.footprint, beside));
END $$;

CREATE FUNCTION part_by_shape(thing bigint, named boolean)
RETURNS text LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The part of the building that an object is by its shape and place, whatever its name; null if it is none.
-- No furniture covers four fifths of a room: a flat object (half a metre) that does is a floor at the room's floor, and
-- a ceiling above headroom; a higher one is a roof, and from the floor up a building in one piece. What is flat, a metre
-- wide and lies below the floor of the room above it is a part of the floor. If its name does not suggest a type: where
-- no room is known, what is flat and larger than 12 square metres is a floor or ceiling; what is upright, thin, at the
-- edge of rooms and inside of none is a wall, if it is long or reaches up to the ceiling. So is what reaches up to it and
-- divides: the borders of rooms on both of its sides run within it, or along it, or it leads from a border into the room;
-- the latter two if it is at most 20 cm thick: a shelf is thicker, and stands along the border of one room. A piece that
-- reaches up to the ceiling and is wholly outside of the outlines of rooms is a wall under any name. Small ones that are
-- flush with the floor, beside others like them, are its tiles or planks.
DECLARE
    flat CONSTANT double precision := 0.5;
    tile CONSTANT double precision := 0.1;
    exact CONSTANT double precision := 1e-6;
    headroom CONSTANT double precision := 1.8;
    partition CONSTANT double precision := 0.2;
    beside_wall CONSTANT double precision := 0.3;
    w semmap.world;
    half double precision;
    thick double precision;
    long double precision;
    low double precision;
    high double precision;
    narrow double precision;
    at_floor double precision;
    part text;
BEGIN
    SELECT * INTO w FROM semmap.world o WHERE o.entity_id = thing AND o.footprint IS NOT NULL;
    low := ST_ZMin(w.box);
    high := ST_ZMax(w.box);
    narrow := least(ST_XMax(w.box) - ST_XMin(w.box), ST_YMax(w.box) - ST_YMin(w.box));
    IF high - low <= flat AND narrow >= 1 OR narrow >= 1 AND high - low >= 1 THEN
        SELECT c.part INTO part
        FROM (SELECT CASE WHEN high - low <= flat AND (covered AND high BETWEEN floor - 0.1 AND floor + flat
                               OR NOT named AND share >= 0.5 AND high - low > 0.03 AND (low + high) / 2 < floor
                                  AND abs(high - floor) <= 0.05) THEN 'floor'
                          WHEN covered AND low <= floor + flat AND high >= floor + headroom THEN 'building_shell'
                          WHEN covered AND low >= floor + headroom THEN CASE WHEN high - low <= flat THEN 'ceiling' ELSE 'roof' END
                          WHEN covered AND high - low <= flat AND high BETWEEN floor - flat AND floor THEN 'subfloor'
                     END AS part
              FROM (SELECT o.pose[3] + r.floor AS floor, semmap.ground_share(w.footprint, o.footprint) AS share,
                           semmap.ground_share(o.footprint, w.footprint) >= 0.8 AS covered
                    FROM semmap.world o JOIN semmap.room r ON r.entity_id = o.entity_id
                    WHERE o.map_id = w.map_id AND o.footprint && w.footprint) r) c
        WHERE c.part IS NOT NULL
        ORDER BY array_position(ARRAY['floor', 'building_shell', 'ceiling', 'roof', 'subfloor'], c.part) LIMIT 1;
        part := replace(part, 'subfloor', 'floor');
        IF part IS NULL AND NOT named AND high - low <= flat AND narrow >= 2 AND ST_Area(w.footprint) >= 12 AND NOT EXISTS (
            SELECT FROM semmap.world o JOIN semmap.room r ON r.entity_id = o.entity_id
            WHERE o.map_id = w.map_id AND o.footprint && w.footprint) THEN
            at_floor := coalesce((SELECT s.pose[3] FROM semmap.world s WHERE s.entity_id = w.storey_id), 0);
            part := CASE WHEN abs(high - at_floor) <= flat THEN 'floor' WHEN low >= at_floor + headroom THEN 'ceiling' END;
        END IF;
    END IF;
    IF part IS NULL AND high - low >= 1.5 AND 2 * ST_Area(w.footprint) <= 0.4 * ST_Perimeter(w.footprint) THEN
        half := ST_Perimeter(w.footprint) / 2;  -- thickness and length are those of a strip of this border and area
        thick := (half - sqrt(greatest(half ^ 2 - 4 * ST_Area(w.footprint), 0))) / 2;
        long := half - thick;
        SELECT 'wall' INTO part
        FROM (SELECT semmap.ground_share(w.footprint, o.footprint) AS share, ST_Distance(w.footprint, o.footprint) AS away,
                     high >= least(semmap.ceiling_of(o.entity_id) - 0.3, o.pose[3] + r.floor + 2.5) - exact AS to_ceiling,
                     ST_Length(ST_Intersection(ST_Boundary(o.footprint), ST_Buffer(w.footprint, CASE WHEN thick <= partition + exact THEN 0.03 ELSE -0.01 END))) AS along,
                     NOT ST_Covers(ST_Buffer(ST_Boundary(o.footprint), beside_wall), w.footprint) AS into_room
              FROM semmap.world o JOIN semmap.room r ON r.entity_id = o.entity_id
              WHERE o.map_id = w.map_id AND o.footprint && ST_Expand(w.footprint, 0.5) AND ST_DWithin(o.footprint, w.footprint, 0.5)
                AND low <= o.pose[3] + r.floor + flat AND high >= o.pose[3] + r.floor + 1.5) beside
        HAVING CASE WHEN named THEN sum(share) <= 0.01 ELSE max(share) <= 0.6 END
           AND (NOT named AND ST_Perimeter(w.footprint) >= 3.2 - exact OR bool_or(to_ceiling AND away <= 0.3 + exact))
            OR NOT named AND bool_or(to_ceiling) AND (
                sum(along) >= 1.5 * CASE WHEN long < 1.5 * thick THEN thick ELSE long END  -- a wall may be thicker than it is long
                OR thick <= partition + exact AND long >= 0.5 - exact AND bool_or(to_ceiling AND into_room AND share > 0.5));
    END IF;
    IF part IS NULL AND NOT named AND high - low <= tile AND semmap.is_flush(thing) AND EXISTS (
        SELECT FROM semmap.world o JOIN semmap.entity e ON e.id = o.entity_id AND e.kind = 'object'
        WHERE o.map_id = w.map_id AND o.entity_id <> thing AND o.box && semmap.grown(w.box, 0.05)
          AND abs(ST_ZMax(o.box) - high) <= 0.005 AND abs(ST_ZMin(o.box) - low) <= 0.005) THEN
        part := 'floor';
    END IF;
    RETURN part;
END $$;

CREATE FUNCTION recognise_parts(ids bigint[])
RETURNS bigint LANGUAGE plpgsql SET search_path = semmap, public, pg_temp SET plan_cache_mode = force_generic_plan AS $$
-- Gives those of the given objects that are parts of the building by their shape this type; returns how many change. A
-- stated type stays; a type that a name suggests yields to what covers a room, and comes back where nothing does. What
-- is named as a part or fixture of a building, such as a column or curtain, is no wall. In PL/pgSQL: see ceiling_of.
DECLARE
    n bigint;
BEGIN
WITH judged AS (
    SELECT o.id, o.type, o.properties, CASE guess ->> 'from' WHEN 'shape' THEN guess -> 'named' ELSE guess END AS named,
           guess ->> 'from' = 'shape' AS shaped
    FROM semmap.entity o JOIN semmap.world w ON w.entity_id = o.id
    CROSS JOIN LATERAL (SELECT o.properties -> 'type_guess') g (guess)
    WHERE o.id = ANY (ids) AND o.kind = 'object' AND (coalesce(o.type, 'object') = 'object' OR o.type = guess ->> 'type')
      -- none is smaller, see part_by_shape
      AND (least(ST_XMax(w.box) - ST_XMin(w.box), ST_YMax(w.box) - ST_YMin(w.box)) >= 1
           OR ST_ZMax(w.box) - ST_ZMin(w.box) NOT BETWEEN 0.1 AND 1.5 OR guess ->> 'from' = 'shape')
), found AS (
    SELECT j.id, j.named, j.shaped, s.part  -- judged is joined no second time: its plan is made for few rows
    FROM judged j CROSS JOIN LATERAL (
        SELECT nullif(semmap.part_by_shape(j.id, j.named IS NOT NULL), CASE
            WHEN j.named ->> 'type' = ANY (semmap.subtypes('building_element') || semmap.subtypes('fixture')) THEN 'wall' END)
        OFFSET 0) s (part)
    WHERE j.named IS NULL OR NOT (semmap.is_building_part(j.named ->> 'type')
                                  OR (j.named ->> 'type' = ANY (semmap.subtypes('ground') || semmap.subtypes('ramp_flight'))) IS TRUE)
), recognised AS (
    UPDATE semmap.entity e
    SET type = coalesce(f.part, f.named ->> 'type', 'object'),
        properties = e.properties - 'type_guess' || CASE
            WHEN f.part IS NOT NULL THEN jsonb_build_object('type_guess', jsonb_strip_nulls(jsonb_build_object(
                'type', f.part, 'confidence', 0.7, 'from', 'shape', 'named', f.named)))
            WHEN f.named IS NOT NULL THEN jsonb_build_object('type_guess', f.named)
            ELSE '{}' END
    FROM found f
    WHERE e.id = f.id AND (f.part IS NOT NULL OR f.shaped) AND coalesce(f.part, f.named ->> 'type', 'object') IS DISTINCT FROM e.type
    RETURNING e.id)
SELECT count(*) INTO n FROM recognised;
RETURN n;
END $$;

CREATE FUNCTION is_stated_in(a bigint, b bigint)
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- Whether b is above a in the chain of holders, and one of those between them is stated.
WITH RECURSIVE up (id, stated) AS (
    SELECT holder_id, confidence IS NULL FROM semmap.placement WHERE entity_id = a
  UNION
    SELECT p.holder_id, up.stated OR p.confidence IS NULL FROM up JOIN semmap.placement p ON p.entity_id = up.id)
SELECT EXISTS (SELECT FROM up WHERE id = b AND stated);
END;

CREATE FUNCTION hangs(thing bigint)
RETURNS boolean LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- Whether nothing is under an object, such as a lamp below a cupboard: neither the floor of its room or storey, nor an
-- object beneath a quarter of it. Walls are beside it.
DECLARE
    contact CONSTANT double precision := 0.03;
    w semmap.world;
BEGIN
    SELECT * INTO w FROM semmap.world o WHERE o.entity_id = thing;
    RETURN w.footprint IS NOT NULL AND NOT EXISTS (
        SELECT FROM semmap.world o JOIN semmap.entity e ON e.id = o.entity_id AND e.kind = 'object'
        WHERE o.map_id = w.map_id AND o.box && semmap.grown(w.box, contact) AND o.entity_id <> thing
          AND ST_ZMin(o.box) < ST_ZMin(w.box) - 1e-6 AND ST_ZMax(o.box) >= ST_ZMin(w.box) - contact
          AND semmap.ground_share(w.footprint, o.footprint) >= 0.25
    ) AND ST_ZMin(w.box) > contact + coalesce(
        (SELECT max(o.pose[3] + r.floor) FROM semmap.world o JOIN semmap.room r ON r.entity_id = o.entity_id
         WHERE o.map_id = w.map_id AND o.footprint && w.footprint AND ST_Intersects(o.footprint, ST_Centroid(w.footprint))
           AND o.pose[3] + r.floor <= ST_ZMax(w.box)),
        (SELECT max(o.pose[3]) FROM semmap.storey s JOIN semmap.world o ON o.entity_id = s.entity_id
         WHERE o.map_id = w.map_id AND o.pose[3] <= ST_ZMax(w.box)), 0);
END $$;

CREATE FUNCTION derived_holders(ids bigint[])
RETURNS TABLE (entity_id bigint, holder_id bigint, relation text, confidence double precision)
LANGUAGE plpgsql STABLE ROWS 10 SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- The holder that the geometry gives to each of the given objects and agents, with a confidence (0 to 1):
-- 1. on an object: a support surface within 3 cm of its bottom bears at least half of its footprint, the highest one;
--    else objects whose tops it touches, around its middle: a tray on a mug, a board on two trestles. What is flatter
--    than 3 cm and larger than half a square metre, such as a carpet, is not a holder, nor what is flush with the floor.
--    The holder's bottom is below that of its contents. What hangs bears nothing larger: a lamp no cupboard above it.
--    For a model without known support surfaces: is_on.
-- 2. in an object of less than 4 square metres that encloses it, is larger and does not begin above it: is_in.
-- 3. in the room of its place: room_at.
-- 4. in the highest storey whose floor is at most half a metre above its bottom, else the lowest; of several at one height,
--    as of two buildings, in one whose outline it meets, and stay in its own.
-- Agents are in rooms and storeys alone, parts of the building in storeys. Null: none of them.
-- A holder begins lower, or as low and is larger: derived holders are no cycle.
-- Equal holders are told apart by their places, which an export and import keep, and not the last digits and numbers.
-- The rules meet in a sort, and NOT IN becomes a lookup in a hash table: the plan is made for few entities, where joins
-- would be nested loops, which are quadratic when a file is imported.
DECLARE
    contact CONSTANT double precision := 0.03;
    tile CONSTANT double precision := 0.1;
    parts CONSTANT text[] := semmap.building_parts();
BEGIN
    RETURN QUERY
    WITH item AS MATERIALIZED (
        SELECT e.id, w.map_id, w.box, semmap.ground_of(w) AS ground, ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high,
               e.kind = 'object' AND (e.type = ANY (parts)) IS NOT TRUE AS movable,
               e.kind = 'agent' OR (e.type = ANY (parts)) IS NOT TRUE AS inside
        FROM (SELECT DISTINCT unnest(ids)) given (id) JOIN semmap.entity e ON e.id = given.id AND e.kind IN ('object', 'agent')
        JOIN semmap.world w ON w.entity_id = e.id
    ), near AS MATERIALIZED (
        -- objects over or under an item that begin no higher and reach up to it: one look into the index for both rules
        SELECT i.id, i.low, i.high, i.ground, o.entity_id AS owner, o.pose, o.footprint,
               ST_ZMin(o.box) AS owner_low, ST_ZMax(o.box) AS owner_high
        FROM item i
        JOIN semmap.world o ON o.map_id = i.map_id AND o.box && i.box AND o.entity_id <> i.id
        JOIN semmap.entity oe ON oe.id = o.entity_id AND oe.kind = 'object' AND (oe.type = ANY (parts)) IS NOT TRUE
        WHERE i.movable AND o.footprint IS NOT NULL
          AND ST_ZMin(o.box) <= i.low + 2e-6 AND ST_ZMax(o.box) >= i.low - contact
    ), below AS MATERIALIZED (
        -- objects that reach beneath an item
        SELECT n.id, n.low, n.ground, n.owner, n.pose, n.footprint, n.owner_high, abs(n.pose[4]) < 1e-3 AND abs(n.pose[5]) < 1e-3 AS upright
        FROM near n
        WHERE n.owner_low < n.low - 1e-6 AND (n.owner_high - n.owner_low > contact OR ST_Area(n.footprint) < 0.5)
          AND NOT (n.owner_high - n.owner_low <= tile AND semmap.is_flush(n.owner))
          AND CASE WHEN abs(n.owner_high - n.low) <= contact AND ST_Area(n.footprint) < ST_Area(n.ground) - 1e-9
                   THEN NOT semmap.hangs(n.owner) ELSE true END
    ), laid AS MATERIALIZED (
        SELECT b.id, b.owner, b.ground, b.pose[3] + s.height - b.low AS rise,
               ST_Rotate(s.outline, semmap.pose_yaw(b.pose), 0, 0) AS outline, b.pose[1] AS x, b.pose[2] AS y
        FROM below b JOIN semmap.entity_model em ON em.entity_id = b.owner
        JOIN semmap.support_surface s ON s.model_id = em.model_id AND abs(b.pose[3] + s.height - b.low) <= contact
        WHERE b.upright
    ), placed AS MATERIALIZED (
        SELECT l.id, l.owner, l.rise, l.x, l.y, l.ground, ST_Translate(l.outline, l.x, l.y) AS outline FROM laid l
    ), surface AS (
        SELECT l.id, l.owner, l.rise, l.x, l.y, semmap.ground_share(l.ground, l.outline) AS share FROM placed l
      UNION ALL
        SELECT b.id, b.owner, -contact / 3, b.pose[1], b.pose[2], CASE WHEN semmap.is_on(b.id, b.owner, contact) THEN 1 ELSE 0 END
        FROM below b
        WHERE NOT EXISTS (SELECT FROM semmap.entity_model em JOIN semmap.support_surface s ON s.model_id = em.model_id
                          WHERE em.entity_id = b.owner)
    ), borne AS (
        -- the highest surface, unless it has sunk more than a third of a contact into that
        SELECT DISTINCT ON (s.id) s.id, s.owner, s.share, abs(s.rise) AS gap
        FROM (SELECT id, owner, x, y, least(sum(share), 1) AS share, (array_agg(rise ORDER BY abs(rise)))[1] AS rise
              FROM surface GROUP BY 1, 2, 3, 4) s
        WHERE s.share >= 0.5 - 1e-9
          AND NOT (EXISTS (SELECT FROM semmap.placement p WHERE p.holder_id = s.id) AND semmap.is_stated_in(s.owner, s.id))
        ORDER BY s.id, s.rise > contact / 3, round(s.rise::numeric, 3) DESC, round(s.share::numeric, 3) DESC,
                 round(s.x::numeric, 2), round(s.y::numeric, 2), s.owner
    ), propped AS (
        SELECT t.id, t.owner, t.ground, ST_Intersection(t.ground, t.footprint, 1e-6) AS common
        FROM below t
        WHERE abs(t.owner_high - t.low) <= contact / 3 AND t.id NOT IN (SELECT id FROM borne)
          AND semmap.is_on(t.id, t.owner) AND NOT semmap.is_stated_in(t.owner, t.id)
    ), resting AS (
        SELECT b.id, b.owner, b.share, b.gap FROM borne b
      UNION ALL
        (SELECT DISTINCT ON (t.id) t.id, t.owner, 0.5, 0
         FROM propped t JOIN (SELECT p.id, ST_ConvexHull(ST_Collect(p.common)) AS base FROM propped p GROUP BY 1) a ON a.id = t.id
         WHERE ST_DWithin(a.base, ST_Centroid(t.ground), 1e-6)
         ORDER BY t.id, round(ST_Area(t.common)::numeric, 4) DESC, round(ST_X(ST_Centroid(t.common))::numeric, 2),
                  round(ST_Y(ST_Centroid(t.common))::numeric, 2), t.owner)
    ), enclosed AS (
        SELECT DISTINCT ON (n.id) n.id, n.owner
        FROM near n
        WHERE ST_Area(n.footprint) < 4 AND ST_Area(n.footprint) > ST_Area(n.ground) + 1e-9
          AND (n.low + n.high) / 2 BETWEEN n.owner_low AND n.owner_high
          AND round(n.owner_low::numeric, 6) <= round(n.low::numeric, 6)
          AND ST_Intersects(n.footprint, ST_Centroid(n.ground))
          AND n.id NOT IN (SELECT id FROM resting)
          AND semmap.is_in(n.id, n.owner) AND NOT semmap.is_stated_in(n.owner, n.id)
        ORDER BY n.id, ST_Area(n.footprint), n.owner
    ), loose AS MATERIALIZED (
        SELECT i.id, i.map_id, i.ground, (i.low + i.high) / 2 AS middle
        FROM item i WHERE i.inside AND i.id NOT IN (SELECT id FROM resting)
    ), around AS MATERIALIZED (
        SELECT o.map_id, o.entity_id AS room_id, o.footprint, o.pose[3] + r.floor AS floor,
               coalesce(o.pose[3] + r.ceiling, semmap.ceiling_of(o.entity_id)) AS ceiling
        FROM (SELECT l.map_id, ST_Extent(l.ground) AS zone FROM loose l GROUP BY 1) a
        JOIN semmap.world o ON o.map_id = a.map_id AND o.footprint && a.zone JOIN semmap.room r ON r.entity_id = o.entity_id
    ), heights AS MATERIALIZED (
        SELECT jsonb_object_agg(a.room_id, jsonb_build_array(a.floor, a.ceiling)) AS of_rooms FROM around a
    ), amid AS (
        -- what the only room there covers: most of the things, and room_at for each would take as long as all the rest; the
        -- rooms are found by the index, and their heights in one value: a join with `around` would be quadratic
        SELECT l.id, min(o.entity_id) AS owner
        FROM heights h CROSS JOIN loose l JOIN semmap.world o ON o.map_id = l.map_id AND o.footprint && l.ground
        WHERE l.middle BETWEEN (h.of_rooms -> o.entity_id::text ->> 0)::double precision - contact
                           AND (h.of_rooms -> o.entity_id::text ->> 1)::double precision + contact
        GROUP BY l.id HAVING count(*) = 1 AND bool_and(ST_Covers(o.footprint, l.ground))
    ), within AS (
        SELECT a.id, a.owner, 1::double precision AS share FROM amid a
      UNION ALL
        SELECT l.id, r.room_id, r.share
        FROM loose l CROSS JOIN LATERAL (SELECT * FROM semmap.room_at(l.map_id, l.ground, l.middle) OFFSET 0) r (room_id, share)
        WHERE l.id NOT IN (SELECT id FROM amid) AND r.room_id IS NOT NULL
    ), ranked (id, rank, owner, relation, confidence, map_id, low, ground) AS (
        SELECT r.id, 1, r.owner, 'on', CASE WHEN r.share >= 0.95 AND r.gap <= contact / 3 THEN 1
                                            ELSE round((r.share * (1 - r.gap / (2 * contact)))::numeric, 3) END,
               NULL::integer, NULL::double precision, NULL::geometry
        FROM resting r
      UNION ALL
        SELECT e.id, 2, e.owner, 'in', 1, NULL, NULL, NULL FROM enclosed e
      UNION ALL
        SELECT w.id, 3, w.owner, 'in', CASE WHEN w.share < 0.95 THEN round(w.share::numeric, 3) ELSE 1 END, NULL, NULL, NULL
        FROM within w
      UNION ALL
        SELECT i.id, 4, NULL, 'in', 1, i.map_id, i.low, i.ground FROM item i
    ), first AS (
        SELECT DISTINCT ON (id) * FROM ranked ORDER BY id, rank
    )
    SELECT f.id, coalesce(f.owner, (
               -- storeys first, which are few: a plan that begins with world is quadratic
               SELECT s.entity_id FROM semmap.storey s CROSS JOIN LATERAL (
                   SELECT w.pose, w.footprint FROM semmap.world w WHERE w.entity_id = s.entity_id AND w.map_id = f.map_id OFFSET 0) o
               ORDER BY o.pose[3] > f.low + 0.5, round(abs(o.pose[3] - f.low - 0.5)::numeric, 3),
                        ST_Intersects(o.footprint, f.ground) IS NOT TRUE, s.entity_id IS DISTINCT FROM (
                            SELECT p.holder_id FROM semmap.placement p WHERE p.entity_id = f.id), s.entity_id LIMIT 1)),
           f.relation, f.confidence::double precision
    FROM first f;
END $$;

CREATE FUNCTION is_apart(thing bigint, holder bigint)
RETURNS boolean LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- Whether an entity is clearly elsewhere than a holder would have it: more than 5 cm from an object, 2 m from
-- an agent, half a metre from a room or region (the thickness of a doorway), below or above a storey. What has
-- no geometry contradicts nothing.
DECLARE
    wt semmap.world;
    wh semmap.world;
    holder_kind text := (SELECT kind FROM semmap.entity WHERE id = holder);
BEGIN
    SELECT * INTO wt FROM semmap.world w WHERE w.entity_id = thing;
    SELECT * INTO wh FROM semmap.world w WHERE w.entity_id = holder;
    IF holder_kind = 'agent' THEN
        RETURN semmap.box_gap(wt.box, wh.box) > 2;
    ELSIF holder_kind = 'storey' THEN
        RETURN ST_ZMax(wt.box) < wh.pose[3] - 0.5
            OR ST_ZMin(wt.box) > (SELECT min(o.pose[3]) FROM semmap.storey s JOIN semmap.world o ON o.entity_id = s.entity_id
                                  WHERE o.map_id = wh.map_id AND o.pose[3] > wh.pose[3] + 0.1);
    ELSIF wh.footprint IS NULL THEN
        RETURN false;
    ELSIF holder_kind IN ('room', 'region') THEN
        RETURN ST_Distance(semmap.ground_of(wt), wh.footprint) > 0.5 OR ST_ZMax(wt.box) < ST_ZMin(wh.box) - 0.5
            OR ST_ZMin(wt.box) > CASE holder_kind WHEN 'room' THEN semmap.ceiling_of(holder) ELSE ST_ZMax(wh.box) END + 0.5;
    END IF;
    RETURN semmap.box_gap(wt.box, wh.box) > 0.05;
END $$;

CREATE FUNCTION contradicts(thing bigint, stated bigint, derived bigint, sure double precision)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
-- Whether the geometry contradicts a stated holder: the entity is clearly elsewhere, or on or in another
-- object that the stated one does not hold, or in another room.
SELECT semmap.is_apart(thing, stated)
    OR derived <> stated
       AND CASE (SELECT kind FROM semmap.entity WHERE id = derived) || ' ' || (SELECT kind FROM semmap.entity WHERE id = stated)
           WHEN 'object object' THEN sure >= 0.5 AND NOT semmap.is_held_by(derived, stated)
           WHEN 'room room' THEN true
           ELSE false END;
END;

CREATE FUNCTION placed_here(ids bigint[])
RETURNS boolean LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
-- Whether this transaction placed the given entities and all above them, as an import does: no other can move them.
SELECT NOT EXISTS (SELECT FROM semmap.placement p WHERE p.xmin <> pg_current_xact_id()::xid
                   AND p.entity_id IN (SELECT unnest(ids) UNION SELECT semmap.holders_of(ids)))
$$;

CREATE FUNCTION derive_again(ids bigint[])
RETURNS bigint LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- Gives the given entities the holders that the geometry shows, except where it does not contradict a stated
-- holder; world poses do not change. Returns how many have another holder.
DECLARE
    locked bigint[] := '{}';
    needed bigint[];
    wanted record;
    circular bigint[];
    n bigint;
BEGIN
    LOOP
        SELECT array_agg(d.entity_id ORDER BY d.entity_id) AS ids, array_agg(d.holder_id ORDER BY d.entity_id) AS holders,
               array_agg(d.relation ORDER BY d.entity_id) AS relations, array_agg(d.confidence ORDER BY d.entity_id) AS confidences
            INTO wanted
            FROM semmap.derived_holders(ids) d JOIN semmap.placement p ON p.entity_id = d.entity_id LEFT JOIN semmap.entity h ON h.id = p.holder_id
            WHERE (p.holder_id, p.relation) IS DISTINCT FROM (d.holder_id, d.relation)
              AND (p.holder_id IS NULL OR p.confidence IS NOT NULL OR h.kind = 'storey'
                   OR semmap.contradicts(p.entity_id, p.holder_id, d.holder_id, d.confidence));
        needed := ARRAY(SELECT DISTINCT holder FROM unnest(wanted.holders) holder WHERE holder IS NOT NULL ORDER BY 1);
        EXIT WHEN wanted.ids IS NULL OR needed <@ locked OR semmap.placed_here(needed);
        locked := needed;
        PERFORM semmap.lock_holders(locked);  -- then once more: another transaction may have moved one of them
    END LOOP;
    IF wanted.ids IS NULL THEN
        RETURN 0;
    END IF;
    -- An entity that would become its own holder, through others that are derived with it, is not changed.
    circular := ARRAY(
        WITH RECURSIVE chosen (id, holder) AS (
            SELECT * FROM unnest(wanted.ids, wanted.holders)
        ), up (start, id) AS (
            SELECT id, holder FROM chosen WHERE holder IS NOT NULL
          UNION
            SELECT up.start, CASE WHEN c.id IS NULL THEN p.holder_id ELSE c.holder END
            FROM up JOIN semmap.placement p ON p.entity_id = up.id LEFT JOIN chosen c ON c.id = up.id
            WHERE up.id <> up.start)
        SELECT start FROM up WHERE id = start);
    PERFORM set_config('semmap.deriving', 'on', true);
    UPDATE semmap.placement p
    SET holder_id = d.holder, relation = d.relation, confidence = CASE WHEN d.holder IS NOT NULL THEN d.confidence END,
        pose = CASE WHEN d.holder IS NULL THEN w.pose ELSE semmap.pose_compose(semmap.pose_inverse(h.pose), w.pose) END
    FROM unnest(wanted.ids, wanted.holders, wanted.relations, wanted.confidences) d (id, holder, relation, confidence)
    JOIN semmap.world w ON w.entity_id = d.id LEFT JOIN semmap.world h ON h.entity_id = d.holder
    WHERE p.entity_id = d.id AND NOT d.id = ANY (circular);
    GET DIAGNOSTICS n = ROW_COUNT;
    PERFORM set_config('semmap.deriving', '', true);
    RETURN n;
END $$;

CREATE FUNCTION neighbours_of(moved bigint[])
RETURNS bigint[] LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- The entities whose holders a move of the given ones can change: the moved entities, those at the place to or
-- from which a possible holder moved, the contents of a holder that is tilted now, and what no room or object
-- holds where a storey moved.
BEGIN
    RETURN ARRAY(
        WITH holding AS MATERIALIZED (
            SELECT w.entity_id, w.map_id, ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high,
                   CASE e.kind WHEN 'room' THEN semmap.grown(w.box, 0.5) ELSE w.box END AS box  -- walls and openings are around rooms
            FROM unnest(moved) given (id) JOIN semmap.entity e ON e.id = given.id
            JOIN semmap.world w ON w.entity_id = e.id AND w.footprint IS NOT NULL
            WHERE e.kind = 'room' OR e.kind = 'object' AND EXISTS (
                SELECT FROM semmap.entity_model em LEFT JOIN semmap.support_surface s ON s.model_id = em.model_id
                WHERE em.entity_id = e.id AND (s.model_id IS NULL OR s.height IS NOT NULL))
        )
        SELECT unnest(moved)
      UNION
        SELECT n.entity_id FROM holding h
        JOIN semmap.world n ON n.map_id = h.map_id AND n.box && h.box AND n.entity_id <> h.entity_id
             AND ST_ZMin(n.box) <= h.high + 0.03 AND ST_ZMax(n.box) >= h.low - 0.03
        JOIN semmap.placement p ON p.entity_id = n.entity_id AND p.holder_id IS DISTINCT FROM h.entity_id
      UNION
        SELECT p.entity_id FROM unnest(moved) given (id) JOIN semmap.world w ON w.entity_id = given.id
        JOIN semmap.placement p ON p.holder_id = given.id
        WHERE abs(w.pose[4]) >= 1e-3 OR abs(w.pose[5]) >= 1e-3
      UNION
        SELECT p.entity_id FROM semmap.entity s JOIN semmap.entity e ON e.map_id = s.map_id AND e.kind IN ('object', 'agent')
        JOIN semmap.placement p ON p.entity_id = e.id
        WHERE s.id = ANY (moved) AND s.kind = 'storey'
          AND (p.holder_id IS NULL OR EXISTS (SELECT FROM semmap.storey WHERE entity_id = p.holder_id)));
END $$;

CREATE FUNCTION follow_change(changed bigint[])
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- After a change of the shape, the heights or the type of entities: recognises the parts of the building among those
-- whose holders it changes, and derives these holders, those of their contents too. Does nothing if the setting
-- `semmap.deriving` is off.
DECLARE
    around bigint[];
BEGIN
    IF current_setting('semmap.deriving', true) IS DISTINCT FROM 'off' THEN
        around := semmap.neighbours_of(changed) || ARRAY(SELECT entity_id FROM semmap.placement WHERE holder_id = ANY (changed));
        PERFORM semmap.recognise_parts(around);
        PERFORM semmap.derive_again(around);
    END IF;
END $$;
