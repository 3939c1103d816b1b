-- Derived tables are written by the functions that derive them alone, whoever asks: else pose, footprint and mesh, or a
-- type and its supertypes, would disagree. Once a statement, so that moves cost no more.

CREATE FUNCTION derived_only()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Refuses a statement that neither a trigger nor a function that derives makes. The argument says what to edit.
DECLARE
    callers text;
BEGIN
    IF pg_trigger_depth() = 1 THEN
        GET DIAGNOSTICS callers = PG_CONTEXT;
        IF callers !~ '\m(refresh_world|refresh_section|refresh_object_type|refresh_belief|find_objects|drop_map)\M' THEN
            RAISE EXCEPTION '% is derived: it is not written by hand', TG_TABLE_NAME
                USING ERRCODE = 'insufficient_privilege', HINT = 'Edit ' || TG_ARGV[0] || ': it follows.';
        END IF;
    END IF;
    RETURN NULL;
END $$;

DO $$
DECLARE
    derived record;
BEGIN
    FOR derived IN SELECT * FROM (VALUES
        ('world', 'placement.pose, the models of the entity, or the view gis_object'),
        ('section', 'placement.pose or the models of the entity'),
        ('entity_chunk', 'entity_model'),
        ('object_type', 'entity.type or type_parent'),
        ('type_closure', 'semantic_type or type_parent'),
        ('entity_object', 'entity_model or object_mesh'),
        ('belief', 'observation, placement or belief_model')) d (name, sources)
    LOOP
        EXECUTE format('CREATE TRIGGER derived BEFORE INSERT OR UPDATE OR DELETE OR TRUNCATE ON %I '
                       'FOR EACH STATEMENT EXECUTE FUNCTION derived_only(%L)', derived.name, derived.sources);
    END LOOP;
END $$;
