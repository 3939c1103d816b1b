-- Where things were.

CREATE FUNCTION placement_at(thing bigint, moment timestamptz, OUT holder_id bigint, OUT pose double precision[])
LANGUAGE sql STABLE SET search_path = semmap, public AS $$
SELECT p.holder_id, p.pose FROM placement p WHERE p.entity_id = thing AND p.since <= moment
UNION ALL
(SELECT h.holder_id, h.pose FROM placement_history h
 WHERE h.entity_id = thing AND lower(h.during) <= moment AND upper(h.during) > moment
 ORDER BY lower(h.during) DESC LIMIT 1)
LIMIT 1
$$;

CREATE FUNCTION pose_at(thing bigint, moment timestamptz)
RETURNS double precision[] LANGUAGE plpgsql STABLE SET search_path = semmap, public AS $$
-- Where a thing was in the map's frame at a moment; null where it was not in the map then.
DECLARE
    at_pose double precision[] := NULL;
    next bigint := thing;
    step record;
BEGIN
    FOR depth IN 1..64 LOOP
        SELECT * INTO step FROM placement_at(next, moment);
        IF step.pose IS NULL THEN
            RETURN NULL;
        END IF;
        at_pose := CASE WHEN at_pose IS NULL THEN step.pose ELSE pose_compose(step.pose, at_pose) END;
        EXIT WHEN step.holder_id IS NULL;
        next := step.holder_id;
    END LOOP;
    RETURN at_pose;
END $$;

CREATE FUNCTION prune_history()
RETURNS bigint LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public AS $$
-- Drops former placements beyond their kind's `keep_for`; returns how many.
DECLARE
    n bigint;
BEGIN
    DELETE FROM placement_history h
    USING retention r
    WHERE r.keep_for IS NOT NULL AND upper(h.during) < now() - r.keep_for
      AND r.kind = coalesce((SELECT kind FROM entity e WHERE e.id = h.entity_id),
                            (SELECT kind FROM entity_history e WHERE e.entity_id = h.entity_id LIMIT 1));
    GET DIAGNOSTICS n = ROW_COUNT;
    RETURN n;
END $$;
