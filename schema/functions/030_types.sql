-- Subsumption: the closure of the T-Box, and the row an entity and supertype that queries probe.

CREATE FUNCTION supertypes(of_type text, of_kind text)
RETURNS SETOF text LANGUAGE sql STABLE AS $$
SELECT super FROM semmap.type_closure WHERE sub = of_type
UNION SELECT super FROM semmap.type_closure WHERE sub = of_kind
$$;

CREATE FUNCTION subtypes(of_type text)
RETURNS text[] LANGUAGE sql STABLE PARALLEL SAFE AS $$
-- A type and all that it subsumes, as an array: e.type = ANY (subtypes('table')).
SELECT array_agg(sub) FROM semmap.type_closure WHERE super = of_type
$$;

CREATE FUNCTION refresh_type_closure()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public AS $$
DECLARE
    touched text[];
BEGIN
    CREATE TEMP TABLE fresh_closure ON COMMIT DROP AS
    WITH RECURSIVE up (sub, super) AS (
        SELECT name, name FROM semantic_type
        UNION
        SELECT up.sub, p.parent FROM up JOIN type_parent p ON p.type = up.super)
    SELECT sub, super FROM up;

    IF EXISTS (SELECT FROM fresh_closure a JOIN fresh_closure b ON a.sub = b.super AND a.super = b.sub
               WHERE a.sub <> a.super) THEN
        RAISE EXCEPTION 'the types % subsume each other', (
            SELECT string_agg(DISTINCT a.sub, ', ') FROM fresh_closure a
            JOIN fresh_closure b ON a.sub = b.super AND a.super = b.sub WHERE a.sub <> a.super)
            USING ERRCODE = 'check_violation', HINT = 'Take one of the rdfs:subClassOf statements out.';
    END IF;

    WITH gone AS (DELETE FROM type_closure c
                  WHERE NOT EXISTS (SELECT FROM fresh_closure f WHERE (f.sub, f.super) = (c.sub, c.super))
                  RETURNING sub),
         come AS (INSERT INTO type_closure SELECT sub, super FROM fresh_closure
                  ON CONFLICT DO NOTHING RETURNING sub)
    SELECT array_agg(sub) INTO touched FROM (SELECT sub FROM gone UNION SELECT sub FROM come) s;
    DROP TABLE fresh_closure;

    IF touched IS NOT NULL THEN
        PERFORM refresh_object_type(ARRAY(
            SELECT id FROM entity WHERE type = ANY (touched) OR kind = ANY (touched)));
    END IF;
    RETURN NULL;
END $$;

CREATE FUNCTION refresh_object_type(ids bigint[])
RETURNS void LANGUAGE sql SECURITY DEFINER SET search_path = semmap, public AS $$
DELETE FROM object_type WHERE id = ANY (ids);
INSERT INTO object_type (map_id, type, id, label)
    SELECT e.map_id, c.super, e.id, e.name
    FROM unnest(ids) AS given (id) JOIN entity e ON e.id = given.id
    JOIN type_closure c ON c.sub IN (e.type, e.kind)
    GROUP BY e.map_id, c.super, e.id, e.name;
$$;

CREATE TRIGGER type_added AFTER INSERT OR DELETE ON semantic_type
    FOR EACH STATEMENT EXECUTE FUNCTION refresh_type_closure();
CREATE TRIGGER type_renamed AFTER UPDATE OF name ON semantic_type
    FOR EACH STATEMENT EXECUTE FUNCTION refresh_type_closure();
CREATE TRIGGER type_parent_changed AFTER INSERT OR UPDATE OR DELETE ON type_parent
    FOR EACH STATEMENT EXECUTE FUNCTION refresh_type_closure();
