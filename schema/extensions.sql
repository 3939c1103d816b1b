-- What the schema needs of the server: PostGIS, and pgRouting where the server has it and the user may create it.

CREATE EXTENSION IF NOT EXISTS postgis SCHEMA public;

DO $$ BEGIN
    IF EXISTS (SELECT FROM pg_available_extensions WHERE name = 'pgrouting') THEN
        CREATE EXTENSION IF NOT EXISTS pgrouting SCHEMA public;
    END IF;
EXCEPTION WHEN insufficient_privilege THEN
    RAISE NOTICE 'only an administrator can create the extension pgrouting';
END $$;
