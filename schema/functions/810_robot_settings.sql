-- The settings that only the functions of the schema, admins and owners make.

CREATE FUNCTION robot_sets_nothing()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- By these settings the functions of the schema tell its triggers what they do. Those that a robot made are removed after
-- its statement, before the triggers that read them: their names come later in the alphabet.
BEGIN
    IF NOT semmap.is_trusted() THEN
        PERFORM set_config(name, '', true)
            FROM unnest(ARRAY['semmap.deriving', 'semmap.dropping', 'semmap.emptied', 'semmap.believing']) name
            WHERE current_setting(name, true) <> '';
    END IF;
    RETURN NULL;
END $$;

DO $$
DECLARE
    written text;
BEGIN
    FOREACH written IN ARRAY ARRAY['connector', 'entity', 'entity_model', 'inference', 'link', 'observation', 'placement', 'region',
                                   'support_surface', 'triple'] LOOP
        EXECUTE format('CREATE TRIGGER a_robot_sets_nothing AFTER INSERT OR UPDATE OR DELETE ON %I '
                       'FOR EACH STATEMENT EXECUTE FUNCTION robot_sets_nothing()', written);
    END LOOP;
END $$;
