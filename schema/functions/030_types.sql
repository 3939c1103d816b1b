-- Subsumption: the closure of the T-Box, and one row per entity and supertype, which queries look up.

CREATE FUNCTION supertypes(of_type text, of_kind text)
RETURNS SETOF text LANGUAGE sql STABLE
BEGIN ATOMIC
SELECT super FROM semmap.type_closure WHERE sub = of_type
UNION SELECT super FROM semmap.type_closure WHERE sub = of_kind;
END;

CREATE FUNCTION subtypes(of_type text)
RETURNS text[] LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- A type and all that it subsumes, as an array: e.type = ANY (subtypes('table')).
SELECT array_agg(sub) FROM semmap.type_closure WHERE super = of_type;
END;

CREATE FUNCTION refresh_type_closure()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Recomputes the closure after a change of the types or of their parents, and the rows that follow from it.
DECLARE
    touched text[];
    circular text;
    parts text[] := semmap.building_parts();
BEGIN
    WITH RECURSIVE up (sub, super) AS (
        SELECT name, name FROM semmap.semantic_type
        UNION
        SELECT up.sub, p.parent FROM up JOIN semmap.type_parent p ON p.type = up.super
    ), removed AS (
        DELETE FROM semmap.type_closure c WHERE NOT EXISTS (SELECT FROM up WHERE (up.sub, up.super) = (c.sub, c.super))
        RETURNING sub
    ), added AS (
        INSERT INTO semmap.type_closure SELECT sub, super FROM up ON CONFLICT DO NOTHING RETURNING sub
    )
    SELECT array_agg(sub) INTO touched FROM (SELECT sub FROM removed UNION SELECT sub FROM added) s;

    SELECT string_agg(DISTINCT a.sub, ', ') INTO circular
    FROM semmap.type_closure a JOIN semmap.type_closure b ON a.sub = b.super AND a.super = b.sub WHERE a.sub <> a.super;
    IF circular IS NOT NULL THEN
        RAISE EXCEPTION 'the types % subsume each other', circular
            USING ERRCODE = 'check_violation', HINT = 'Remove one of the rdfs:subClassOf statements.';
    END IF;

    IF touched IS NOT NULL THEN
        PERFORM semmap.refresh_object_type(ARRAY(
            SELECT id FROM semmap.entity WHERE type = ANY (touched) OR kind = ANY (touched)));
        PERFORM semmap.follow_change(ARRAY(
            SELECT id FROM semmap.entity WHERE type = ANY (touched) AND (type = ANY (parts)) <> semmap.is_building_part(type)));
    END IF;
    RETURN NULL;
END $$;

CREATE FUNCTION refresh_object_type(ids bigint[])
RETURNS void LANGUAGE sql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
DELETE FROM semmap.object_type WHERE id = ANY (ids);
INSERT INTO semmap.object_type (map_id, type, id, label)
    SELECT e.map_id, c.super, e.id, e.name
    FROM unnest(ids) AS given (id) JOIN semmap.entity e ON e.id = given.id
    JOIN semmap.type_closure c ON c.sub IN (e.type, e.kind)
    GROUP BY e.map_id, c.super, e.id, e.name;
$$;

CREATE FUNCTION fits_kind(of_type text, of_kind text)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
-- Whether an entity of a kind may have a type: a query by type must not return entities of another kind. An
-- object of a subtype of room would be returned as a room. The leaf of a door is an object.
SELECT NOT EXISTS (SELECT FROM semmap.type_closure WHERE sub = of_type AND super <> of_kind
                   AND super IN ('room', 'region', 'elevator', 'storey', 'agent', 'object', 'connector')
                   AND NOT (of_kind IN ('object', 'connector') AND super IN ('object', 'connector')));
END;

CREATE TRIGGER type_added AFTER INSERT OR DELETE ON semantic_type
    FOR EACH STATEMENT EXECUTE FUNCTION refresh_type_closure();
CREATE TRIGGER type_renamed AFTER UPDATE OF name ON semantic_type
    FOR EACH STATEMENT EXECUTE FUNCTION refresh_type_closure();
CREATE TRIGGER type_parent_changed AFTER INSERT OR UPDATE OR DELETE ON type_parent
    FOR EACH STATEMENT EXECUTE FUNCTION refresh_type_closure();
