-- All pairs of a map in a relation: pairs_near, pairs_on ... Pairs that were decided before are kept, and read while
-- neither entity changed since. What changed is read from the change log: a move writes nothing here, and whoever may not
-- write decides the pairs of changed entities, too.
-- Why: docs/decisions/a_kept_pair_is_read_while_neither_entity_changed.md

CREATE FUNCTION kept_basis()
RETURNS text LANGUAGE sql STABLE
BEGIN ATOMIC
-- What kept pairs follow from besides the entities: these functions, the types of building parts, and the server, whose
-- transactions the cursor counts.
SELECT concat_ws(' ', (SELECT system_identifier FROM pg_control_system()),
    obj_description('semmap'::regnamespace, 'pg_namespace'),
    (SELECT md5(string_agg(type, ' ' ORDER BY type)) FROM unnest(semmap.building_parts()) type));
END;

CREATE FUNCTION changed_for_relation(of_map integer, of_relation text)
RETURNS bigint[] LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = semmap, public, pg_temp
SET plan_cache_mode = force_generic_plan AS $$
-- The entities whose kept pairs are not valid any more; null if no kept pair is. A room, a storey or an elevator decides
-- in which room all others are. Names, labels and properties decide nothing.
DECLARE
    kept semmap.kept_relation;
    ids bigint[];
    everywhere boolean;
BEGIN
    SELECT * INTO kept FROM semmap.kept_relation WHERE map_id = of_map AND relation = of_relation;
    IF NOT FOUND OR kept.basis <> semmap.kept_basis() OR NOT semmap.reaches_back(kept.cursor) THEN
        RETURN NULL;
    END IF;
    SELECT coalesce(array_agg(DISTINCT t.id), '{}'),
           coalesce(bool_or(coalesce(e.kind, (SELECT min(h.kind) FROM semmap.entity_history h WHERE h.entity_id = t.id), 'room')
                            IN ('room', 'storey', 'elevator')), false)
        INTO ids, everywhere
        FROM semmap.change c CROSS JOIN LATERAL unnest(c.entities) t (id) LEFT JOIN semmap.entity e ON e.id = t.id
        WHERE c.map_id = of_map AND c.xid >= pg_snapshot_xmin(kept.cursor::pg_snapshot)::text::bigint
          AND NOT pg_visible_in_snapshot(c.xid::text::xid8, kept.cursor::pg_snapshot)
          AND c.what NOT IN ('field', 'belief', 'statement', 'linked', 'inferred')
          AND NOT (c.what = 'changed' AND coalesce(NOT c.facts -> 'values' -> t.id::text ? 'type', false));
    IF everywhere THEN
        RETURN NULL;
    END IF;
    RETURN ids;
END $$;

DO $$
-- pairs_R(map): all (a, b) of which is_R(a, b) is true. decided_R(map, ids): those with one of the ids, all without ids,
-- decided now.
DECLARE
    relation text;
    members text;
    converse text;
BEGIN
    FOR relation, members, converse IN VALUES
        ('on', 'things_on(%s, 0.01)', 'supports_of(%s, 0.01)'),
        ('in', 'things_in(%s, 0.01)', 'containers_of(%s, 0.01)'),
        ('above', 'things_above(%s, 0.01)', 'things_under(%s, 0.01)'),
        ('touching', 'things_touching(%s, 0.01)', 'things_touching(%s, 0.01)'),
        ('near', 'things_near(%s, 1)', 'things_near(%s, 1)')
    LOOP
        EXECUTE format($def$
CREATE FUNCTION decided_%1$s(of_map integer, ids bigint[])
RETURNS TABLE (a bigint, b bigint) LANGUAGE plpgsql STABLE PARALLEL SAFE ROWS 1000 SET search_path = semmap, public, pg_temp AS $body$
BEGIN
    IF ids IS NULL THEN
        RETURN QUERY SELECT m.id, w.entity_id FROM semmap.world w CROSS JOIN LATERAL semmap.%2$s m (id) WHERE w.map_id = of_map;
    ELSIF ids <> '{}' THEN
        RETURN QUERY
            SELECT m.id, t.id FROM unnest(ids) t (id) CROSS JOIN LATERAL semmap.%3$s m (id)
          UNION
            SELECT t.id, m.id FROM unnest(ids) t (id) CROSS JOIN LATERAL semmap.%4$s m (id);
    END IF;
END $body$;

CREATE FUNCTION pairs_%1$s(of_map integer)
RETURNS TABLE (a bigint, b bigint) LANGUAGE sql STABLE PARALLEL SAFE ROWS 10000
BEGIN ATOMIC
WITH changed AS MATERIALIZED (SELECT semmap.changed_for_relation(of_map, %1$L) AS ids),
     one AS MATERIALIZED (SELECT unnest(ids) AS id FROM changed)
SELECT p.a, p.b FROM semmap.kept_pair p
WHERE p.relation_id = (SELECT k.id FROM changed c JOIN semmap.kept_relation k
                       ON c.ids IS NOT NULL AND k.map_id = of_map AND k.relation = %1$L)
  AND p.a NOT IN (SELECT id FROM one) AND p.b NOT IN (SELECT id FROM one)
UNION ALL
SELECT d.a, d.b FROM semmap.decided_%1$s(of_map, (SELECT ids FROM changed)) d;
END;
$def$, relation, format(members, 'w.entity_id'), format(members, 't.id'), format(converse, 't.id'));
    END LOOP;
END $$;

CREATE FUNCTION share_to_decide(of_map integer, of_relation text)
RETURNS double precision LANGUAGE sql STABLE
BEGIN ATOMIC
-- Which part of the work of deciding all pairs it is to decide those of the entities that changed since the relation was
-- kept: 1 if nothing is kept, 0 for a few entities, which are decided faster than kept, unless their many changes make the
-- log long to read.
SELECT CASE WHEN c.number <= 5 AND NOT EXISTS (
                SELECT FROM semmap.kept_relation k JOIN semmap.change x ON x.map_id = k.map_id
                WHERE k.map_id = of_map AND k.relation = of_relation AND x.xid >= pg_snapshot_xmax(k.cursor::pg_snapshot)::text::bigint
                OFFSET 5000) THEN 0
            ELSE coalesce(least(1, (0.01 + 2.0 * c.number) / (SELECT greatest(count(*), 1) FROM semmap.world w WHERE w.map_id = of_map)), 1) END
FROM (SELECT cardinality(semmap.changed_for_relation(of_map, of_relation)) OFFSET 0) c (number);
END;

CREATE FUNCTION keep_relation(of_map integer, of_relation text)
RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Decides the pairs of entities that changed since a relation was kept, and keeps them, if they are more than a few, the
-- transaction may write, and no other one keeps a relation of the map. Whatever commits meanwhile is after the
-- cursor. So are the transactions after this one, committed or not: a crash could give their numbers to others.
DECLARE
    share double precision;
    changed bigint[];
    current_basis text := semmap.kept_basis();  -- before all else: pairs of former types must not count as of newer ones
    now pg_snapshot;
    own xid8;
    kept bigint;
BEGIN
    IF current_setting('transaction_read_only')::boolean OR current_setting('transaction_isolation') <> 'read committed'
       OR NOT pg_try_advisory_xact_lock(hashtext('semmap.kept_relation'), of_map) THEN
        RETURN;
    END IF;
    share := semmap.share_to_decide(of_map, of_relation);
    IF share = 0 THEN
        RETURN;
    END IF;
    own := pg_current_xact_id();
    now := pg_current_snapshot();
    changed := CASE WHEN share < 1 THEN semmap.changed_for_relation(of_map, of_relation) END;
    INSERT INTO semmap.kept_relation AS k (map_id, relation, basis, cursor)
        VALUES (of_map, of_relation, current_basis, concat_ws(':', least(pg_snapshot_xmin(now), own), least(pg_snapshot_xmax(now), own), (
            SELECT coalesce(string_agg(x::text, ',' ORDER BY x), '') FROM pg_snapshot_xip(now) x WHERE x < own)))
        ON CONFLICT (map_id, relation) DO UPDATE SET basis = excluded.basis, cursor = excluded.cursor
        RETURNING k.id INTO kept;
    DELETE FROM semmap.kept_pair p
        WHERE p.relation_id = kept AND (changed IS NULL OR p.a = ANY (changed) OR p.b = ANY (changed));
    EXECUTE format('INSERT INTO semmap.kept_pair SELECT $1, d.a, d.b FROM semmap.%I($2, $3) d ON CONFLICT DO NOTHING',
                   'decided_' || of_relation) USING kept, of_map, changed;
END $$;
