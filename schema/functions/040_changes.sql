-- The change log: one row per changing statement, one notification per transaction, and a cursor with which
-- Why: docs/decisions/one_notify_for_each_transaction.md
-- readers catch up.

CREATE FUNCTION record_change(kind_of_change text, ids bigint[])
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
BEGIN
    INSERT INTO semmap.change (map_id, what, entities)
        SELECT e.map_id, kind_of_change, array_agg(e.id ORDER BY e.id)
        FROM semmap.entity e WHERE e.id = ANY (ids) GROUP BY e.map_id;
END $$;

CREATE FUNCTION announce()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan SET enable_seqscan = off AS $$
-- Runs at commit: the first change row of a transaction sends one notification for all of them, on channel `semmap`.
-- Payloads are limited to 7,999 bytes: up to 200 ids, otherwise only how many. Every thousandth change
-- applies the retention.
DECLARE
    this bigint := NEW.xid;
    payload jsonb;
BEGIN
    IF NEW.id % 1000 = 0 THEN
        PERFORM semmap.apply_retention();
    END IF;
    IF EXISTS (SELECT FROM semmap.change WHERE xid = this AND id < NEW.id) THEN
        RETURN NULL;
    END IF;
    SELECT jsonb_object_agg(what, ids) INTO payload FROM (
        SELECT c.what, CASE WHEN sum(cardinality(c.entities)) <= 200
                            THEN (SELECT jsonb_agg(DISTINCT u) FROM semmap.change d, unnest(d.entities) u
                                  WHERE d.xid = this AND d.what = c.what)
                            ELSE to_jsonb(sum(cardinality(c.entities))) END AS ids
        FROM semmap.change c WHERE c.xid = this GROUP BY c.what) s;
    payload := jsonb_build_object('xid', this,
        'maps', (SELECT jsonb_agg(DISTINCT m.name) FROM semmap.change c JOIN semmap.map m ON m.id = c.map_id WHERE c.xid = this))
        || payload;
    IF octet_length(payload::text) > 7900 THEN
        SELECT jsonb_build_object('xid', this) || jsonb_object_agg(what, n) INTO payload FROM (
            SELECT what, sum(cardinality(entities)) AS n FROM semmap.change WHERE xid = this GROUP BY what) s;
    END IF;
    PERFORM pg_notify('semmap', payload::text);
    RETURN NULL;
END $$;

CREATE CONSTRAINT TRIGGER change_announced AFTER INSERT ON change
    DEFERRABLE INITIALLY DEFERRED FOR EACH ROW EXECUTE FUNCTION announce();

CREATE FUNCTION next_version(since timestamptz)
RETURNS timestamptz LANGUAGE sql STABLE
BEGIN ATOMIC
-- When the version begins that follows the one since `since`: after it, even if its transaction began earlier. If that is
-- in the future, the server's clock was set back: now.
SELECT CASE WHEN since > clock_timestamp() THEN clock_timestamp()
            ELSE greatest(statement_timestamp(), since + interval '1 microsecond') END;
END;

CREATE FUNCTION former_span(history regclass, thing bigint, since timestamptz, ends timestamptz)
RETURNS tstzrange LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- The time of a former version. If it began after its end, the clock was set back: it has the last microsecond, and the
-- moments that come again are removed from the history.
DECLARE
    begins timestamptz := ends - interval '1 microsecond';
BEGIN
    IF since < ends THEN
        RETURN tstzrange(since, ends);
    END IF;
    EXECUTE format('DELETE FROM %s WHERE entity_id = $1 AND lower(during) >= $2', history) USING thing, begins;
    EXECUTE format('UPDATE %s SET during = tstzrange(lower(during), $2) WHERE entity_id = $1 AND upper(during) > $2', history)
        USING thing, begins;
    RETURN tstzrange(begins, ends);
END $$;

CREATE FUNCTION change_cursor()
RETURNS text LANGUAGE sql STABLE
BEGIN ATOMIC
-- A cursor at this statement: committed changes are before it, all others after it, those of this transaction too. A
-- snapshot does not list its own transaction as running: a cursor that is taken after a write would skip the next ones.
SELECT CASE WHEN own < pg_snapshot_xmax(now)
            THEN concat_ws(':', least(pg_snapshot_xmin(now), own), pg_snapshot_xmax(now), (
                SELECT string_agg(x::text, ',' ORDER BY x) FROM (SELECT pg_snapshot_xip(now) UNION SELECT own) running (x)))
            ELSE now::text END
FROM (SELECT pg_current_snapshot(), pg_current_xact_id_if_assigned()) s (now, own);
END;

CREATE FUNCTION settle()
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Lets the commit of a transaction that only read wait for the disk: a cursor that is stored elsewhere must not
-- name transactions that a crash undoes. Once a transaction, so that no login fills the log.
BEGIN
    IF NOT pg_is_in_recovery() AND pg_current_xact_id_if_assigned() IS NULL THEN
        PERFORM pg_logical_emit_message(true, 'semmap', '');
    END IF;
END $$;

CREATE FUNCTION reaches_back(cursor text)
RETURNS boolean LANGUAGE sql STABLE STRICT
BEGIN ATOMIC
-- Whether every change after a cursor is still stored: the newest change that was pruned is older than all transactions that
-- were open then.
SELECT NOT EXISTS (SELECT FROM semmap.change_pruned p WHERE p.xid >= pg_snapshot_xmin(cursor::pg_snapshot)::text::bigint);
END;

CREATE FUNCTION changes_since(after_cursor text)
RETURNS TABLE (id bigint, at timestamptz, map_id integer, what text, entities bigint[], cursor text, facts jsonb)
LANGUAGE plpgsql STABLE SET search_path = semmap, public, pg_temp AS $$
-- The changes of transactions that the cursor did not see, and the cursor of this statement. They are compared by
-- transaction snapshot, so a transaction that began early and committed late is not skipped. A null cursor
-- returns all stored changes. A result without rows has no cursor: select change_cursor() in the same statement.
BEGIN
    IF NOT semmap.reaches_back(after_cursor) THEN
        RAISE EXCEPTION 'the changes after the cursor % are not all kept', after_cursor
            USING ERRCODE = 'object_not_in_prerequisite_state',
                  HINT = 'Read the map again and go on from semmap.change_cursor(); the table retention says how long changes are kept.';
    END IF;
    RETURN QUERY
        SELECT c.id, c.at, c.map_id, c.what, c.entities, semmap.change_cursor(), c.facts
        FROM semmap.change c
        WHERE c.xid >= coalesce(pg_snapshot_xmin(after_cursor::pg_snapshot)::text::bigint, 0)
          AND (after_cursor IS NULL OR NOT pg_visible_in_snapshot(c.xid::text::xid8, after_cursor::pg_snapshot))
        ORDER BY c.id;
END $$;
