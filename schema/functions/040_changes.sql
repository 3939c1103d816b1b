-- What changed: one row a changing statement, one announcement a transaction, and a cursor for
-- readers who missed it.

CREATE FUNCTION record_change(kind_of_change text, ids bigint[])
RETURNS void LANGUAGE sql SECURITY DEFINER SET search_path = semmap, public AS $$
INSERT INTO change (map_id, what, entities)
    SELECT e.map_id, kind_of_change, array_agg(e.id ORDER BY e.id)
    FROM entity e WHERE e.id = ANY (ids) GROUP BY e.map_id
$$;

CREATE FUNCTION announce()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public AS $$
-- Runs at commit: the first change row of a transaction speaks for all of them, on channel `semmap`.
-- Payloads are limited to 7,999 bytes: ids up to 200, beyond that only how many.
DECLARE
    this bigint := NEW.xid;
    payload jsonb;
BEGIN
    IF current_setting('semmap.announced', true) = this::text THEN
        RETURN NULL;
    END IF;
    PERFORM set_config('semmap.announced', this::text, true);
    SELECT jsonb_object_agg(what, ids) INTO payload FROM (
        SELECT c.what, CASE WHEN sum(cardinality(c.entities)) <= 200
                            THEN (SELECT jsonb_agg(DISTINCT u) FROM change d, unnest(d.entities) u
                                  WHERE d.xid = this AND d.what = c.what)
                            ELSE to_jsonb(sum(cardinality(c.entities))) END AS ids
        FROM change c WHERE c.xid = this GROUP BY c.what) s;
    payload := jsonb_build_object('xid', this,
        'maps', (SELECT jsonb_agg(DISTINCT m.name) FROM change c JOIN map m ON m.id = c.map_id WHERE c.xid = this))
        || payload;
    IF octet_length(payload::text) > 7900 THEN
        SELECT payload || jsonb_object_agg(what, n) INTO payload FROM (
            SELECT what, sum(cardinality(entities)) AS n FROM change WHERE xid = this GROUP BY what) s;
    END IF;
    PERFORM pg_notify('semmap', payload::text);
    RETURN NULL;
END $$;

CREATE CONSTRAINT TRIGGER change_announced AFTER INSERT ON change
    DEFERRABLE INITIALLY DEFERRED FOR EACH ROW EXECUTE FUNCTION announce();

CREATE FUNCTION change_cursor()
RETURNS text LANGUAGE sql STABLE AS $$
-- A cursor that stands at now: what is committed is behind it, all else will come after it.
SELECT pg_current_snapshot()::text
$$;

CREATE FUNCTION changes_since(after_cursor text)
RETURNS TABLE (id bigint, at timestamptz, map_id integer, what text, entities bigint[], cursor text)
LANGUAGE sql STABLE SET search_path = semmap, public AS $$
-- The changes whose transactions the cursor did not see, and the cursor to ask with next time.
-- By transaction snapshot: one that began early and committed late is not skipped.
SELECT c.id, c.at, c.map_id, c.what, c.entities, pg_current_snapshot()::text
FROM change c
WHERE c.xid >= pg_snapshot_xmin(after_cursor::pg_snapshot)::text::bigint
  AND NOT pg_visible_in_snapshot(c.xid::text::xid8, after_cursor::pg_snapshot)
ORDER BY c.id
$$;
