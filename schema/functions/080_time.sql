-- Past poses, and how long they are kept.

CREATE FUNCTION is_latest(since timestamptz, moment timestamptz)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
-- Whether a version that begins at `since` and has no successor is valid at a moment. After the server's clock
-- was set back, the latest version can begin in the future: it is valid from now on.
SELECT since <= moment OR since > statement_timestamp() AND moment >= now();
END;

CREATE FUNCTION placement_at(thing bigint, moment timestamptz, OUT holder_id bigint, OUT pose double precision[])
LANGUAGE sql STABLE SET search_path = semmap, public, pg_temp AS $$
SELECT p.holder_id, p.pose FROM semmap.placement p WHERE p.entity_id = thing AND semmap.is_latest(p.since, moment)
UNION ALL
(SELECT h.holder_id, h.pose FROM semmap.placement_history h
 WHERE h.entity_id = thing AND lower(h.during) <= moment AND upper(h.during) > moment
 ORDER BY lower(h.during) DESC LIMIT 1)
LIMIT 1
$$;

CREATE FUNCTION pose_at(thing bigint, moment timestamptz)
RETURNS double precision[] LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The pose of an entity in the map's frame at a moment; null if it was not in the map then.
DECLARE
    at_pose double precision[] := NULL;
    next bigint := thing;
    step record;
BEGIN
    FOR depth IN 1..64 LOOP
        SELECT * INTO step FROM semmap.placement_at(next, moment);
        IF step.pose IS NULL THEN
            RETURN NULL;
        END IF;
        at_pose := CASE WHEN at_pose IS NULL THEN step.pose ELSE semmap.pose_compose(step.pose, at_pose) END;
        EXIT WHEN step.holder_id IS NULL;
        next := step.holder_id;
    END LOOP;
    RETURN at_pose;
END $$;

CREATE FUNCTION prune_history(most bigint DEFAULT NULL)
RETURNS bigint LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Deletes past placements and versions that are older than their kind's `keep_for`, at most so many
-- (all if null); returns how many. Moves and changes do the same for the entities that they change, so this is
-- for entities that were deleted or do not change.
DECLARE
    n bigint;
    deleted bigint;
BEGIN
    DELETE FROM semmap.placement_history WHERE ctid IN (
        SELECT h.ctid FROM semmap.placement_history h
        JOIN (SELECT id, kind FROM semmap.entity
              UNION ALL SELECT entity_id, kind FROM semmap.entity_history WHERE ended) e ON e.id = h.entity_id
        JOIN semmap.retention r ON r.kind = e.kind AND upper(h.during) < now() - r.keep_for LIMIT most);
    GET DIAGNOSTICS n = ROW_COUNT;
    DELETE FROM semmap.entity_history WHERE ctid IN (
        SELECT h.ctid FROM semmap.entity_history h
        JOIN semmap.retention r ON r.kind = h.kind AND upper(h.during) < now() - r.keep_for
        WHERE NOT EXISTS (SELECT FROM semmap.placement_history p WHERE p.entity_id = h.entity_id AND h.ended) LIMIT most - n);
    GET DIAGNOSTICS deleted = ROW_COUNT;
    RETURN n + deleted;
END $$;

CREATE FUNCTION prune_changes(most bigint DEFAULT NULL)
RETURNS bigint LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Deletes changes that are older than the `keep_for` of the retention 'change', at most so many (all if
-- null); returns how many.
DECLARE
    n bigint;
BEGIN
    DELETE FROM semmap.change c USING (SELECT id FROM semmap.change WHERE at <= now() ORDER BY id LIMIT most) oldest
        WHERE c.id = oldest.id AND c.at < now() - (SELECT keep_for FROM semmap.retention WHERE kind = 'change');
    GET DIAGNOSTICS n = ROW_COUNT;
    RETURN n;
END $$;

CREATE FUNCTION prune_observations(most bigint DEFAULT NULL)
RETURNS bigint LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Deletes what agents observed longer ago than the `keep_for` of the retention 'observation', at most so many (all if
-- null); returns how many. The beliefs follow.
DECLARE
    n bigint;
BEGIN
    DELETE FROM semmap.observation o
        USING (SELECT id FROM semmap.observation WHERE observer_id IS NOT NULL AND at <= now() ORDER BY id LIMIT most) oldest
        WHERE o.id = oldest.id AND o.at < now() - (SELECT keep_for FROM semmap.retention WHERE kind = 'observation');
    GET DIAGNOSTICS n = ROW_COUNT;
    RETURN n;
END $$;

CREATE FUNCTION change_deleted()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Stores the number of the newest transaction of which a change was pruned; changes of a dropped map do not
-- count.
DECLARE
    newest bigint;
BEGIN
    IF TG_OP = 'TRUNCATE' THEN
        newest := pg_current_xact_id()::text::bigint;
    ELSIF coalesce(current_setting('semmap.dropping', true), '') = '' THEN
        SELECT max(xid) INTO newest FROM former;
    END IF;
    IF newest IS NOT NULL THEN
        INSERT INTO semmap.change_pruned (xid) VALUES (newest)
            ON CONFLICT (id) DO UPDATE SET xid = greatest(change_pruned.xid, excluded.xid);
    END IF;
    RETURN NULL;
END $$;

CREATE TRIGGER change_deleted AFTER DELETE ON change REFERENCING OLD TABLE AS former
    FOR EACH STATEMENT EXECUTE FUNCTION change_deleted();
CREATE TRIGGER change_truncated AFTER TRUNCATE ON change
    FOR EACH STATEMENT EXECUTE FUNCTION change_deleted();

CREATE FUNCTION note_write(write_key uuid)
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Stores the key of this transaction, by which `was_written` tells whether it was committed.
BEGIN
    INSERT INTO semmap.written (key, done) VALUES (write_key, true);
    IF random() < 0.001 THEN
        PERFORM semmap.prune_written();
    END IF;
END $$;

CREATE FUNCTION was_written(write_key uuid)
RETURNS boolean LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Whether the transaction that noted a key was committed. One that is being committed is waited for, and one that was not
-- cannot be any more: its key is taken. The answer holds once this transaction is committed: the message lets that wait
-- for the standbys as the write did.
BEGIN
    INSERT INTO semmap.written (key, done) VALUES (write_key, false) ON CONFLICT DO NOTHING;
    PERFORM pg_logical_emit_message(true, 'semmap', '');
    RETURN (SELECT w.done FROM semmap.written w WHERE w.key = write_key);
END $$;

CREATE FUNCTION prune_written()
RETURNS void LANGUAGE sql SECURITY DEFINER SET search_path = semmap, public, pg_temp
BEGIN ATOMIC
-- Deletes the keys of transactions of some time ago: a client asks within a minute.
DELETE FROM semmap.written WHERE at < now() - interval '1 hour';
END;

CREATE FUNCTION apply_retention()
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Prunes a bounded number of rows, in one transaction at a time.
DECLARE
    ended record;
BEGIN
    IF NOT pg_try_advisory_xact_lock(hashtext('semmap.retention')) THEN
        RETURN;
    END IF;
    PERFORM set_config('semmap.dropping', '', true), set_config('semmap.believing', '', true);  -- of a robot
    PERFORM semmap.prune_changes(5000);
    PERFORM semmap.prune_observations(1000);
    IF (SELECT t.reltuples > 1000 + 2 * s.reltuples FROM pg_class t, pg_class s
        WHERE t.oid = 'semmap.term'::regclass AND s.oid = 'semmap.triple'::regclass) THEN
        PERFORM semmap.prune_terms();
    END IF;
    FOR ended IN
        SELECT h.entity_id FROM semmap.entity_history h JOIN semmap.retention r ON r.kind = h.kind
        WHERE h.ended AND upper(h.during) < now() - r.keep_for ORDER BY upper(h.during) LIMIT 100
    LOOP
        DELETE FROM semmap.placement_history WHERE entity_id = ended.entity_id;
        DELETE FROM semmap.entity_history WHERE entity_id = ended.entity_id;
    END LOOP;
END $$;
