-- Gives tables, columns, indexes and constraints of older databases the names that the code uses. Each revision that
-- runs code runs this first; a database that has the new names is left as it is.

DO $$
DECLARE
    renamed record;
    part    record;
BEGIN
    FOR renamed IN SELECT * FROM (VALUES
            ('walk', 'travel_time'),
            ('walked_place', 'travel_time_place'),
            ('walked_map', 'travel_time_map')) n (before, after)
        WHERE to_regclass('semmap.' || before) IS NOT NULL
    LOOP
        FOR part IN SELECT conname AS name FROM pg_constraint
                    WHERE conrelid = ('semmap.' || renamed.before)::regclass AND starts_with(conname, renamed.before || '_')
        LOOP
            EXECUTE format('ALTER TABLE semmap.%I RENAME CONSTRAINT %I TO %I', renamed.before, part.name,
                           renamed.after || substr(part.name, length(renamed.before) + 1));
        END LOOP;
        EXECUTE format('ALTER TABLE semmap.%I RENAME TO %I', renamed.before, renamed.after);
    END LOOP;

    FOR renamed IN SELECT * FROM (VALUES
            ('walk_place', 'travel_time_in'),
            ('walk_from', 'travel_time_from'),
            ('walk_to', 'travel_time_to'),
            ('walked_place_place', 'travel_time_place_of')) n (before, after)
        WHERE to_regclass('semmap.' || before) IS NOT NULL
    LOOP
        EXECUTE format('ALTER INDEX semmap.%I RENAME TO %I', renamed.before, renamed.after);
    END LOOP;

    FOR renamed IN SELECT * FROM (VALUES
            ('mission_step', 'stage', 'command'),
            ('mission_step', 'said', 'message')) n (of, before, after)
        WHERE EXISTS (SELECT FROM pg_attribute WHERE attrelid = to_regclass('semmap.' || of) AND attname = before)
    LOOP
        EXECUTE format('ALTER TABLE semmap.%I RENAME COLUMN %I TO %I', renamed.of, renamed.before, renamed.after);
    END LOOP;
END $$;
