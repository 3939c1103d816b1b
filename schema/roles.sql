-- Who may do what. Roles belong to the whole server: made once, granted here for this database.
-- Give one to a login role: GRANT semmap_robot TO turtlebot.

DO $$
DECLARE
    role text;
BEGIN
    FOREACH role IN ARRAY ARRAY['semmap_reader', 'semmap_robot', 'semmap_admin'] LOOP
        CONTINUE WHEN EXISTS (SELECT FROM pg_roles WHERE rolname = role);
        BEGIN
            EXECUTE format('CREATE ROLE %I NOLOGIN', role);
        EXCEPTION WHEN duplicate_object OR unique_violation THEN
            NULL;
        END;
    END LOOP;
END $$;

-- A reader sees everything and changes nothing.
GRANT USAGE ON SCHEMA semmap TO semmap_reader, semmap_robot, semmap_admin;
GRANT SELECT ON ALL TABLES IN SCHEMA semmap TO semmap_reader, semmap_robot, semmap_admin;
REVOKE EXECUTE ON ALL FUNCTIONS IN SCHEMA semmap FROM PUBLIC;
GRANT EXECUTE ON ALL FUNCTIONS IN SCHEMA semmap TO semmap_reader, semmap_robot, semmap_admin;
-- Functions that write with their owner's rights are for those who may write.
REVOKE EXECUTE ON FUNCTION refresh_object_type(bigint[]), refresh_world(bigint[]), reshape(bigint[]),
    record_change(text, bigint[]), prune_history(), drop_map(text), drop_unused_models()
    FROM PUBLIC, semmap_reader, semmap_robot;

-- A robot observes and moves things: it adds objects, regions and agents, says what they are and where
-- they stand, opens and closes doors. It neither deletes, nor changes the building or the T-Box.
GRANT INSERT (map_id, kind, name, label, type, properties, front) ON entity TO semmap_robot;
GRANT UPDATE (label, type, properties, front) ON entity TO semmap_robot;
GRANT INSERT, UPDATE ON placement TO semmap_robot;
GRANT INSERT ON entity_model, model, chunk, region, link TO semmap_robot;
-- A region that it draws anew has another outline; the former one goes.
GRANT UPDATE ON region TO semmap_robot;
GRANT DELETE ON entity_model, model TO semmap_robot;
GRANT UPDATE (state, seen_at) ON connector TO semmap_robot;
-- Fields are what it works out itself: it keeps them, and old versions make way.
GRANT INSERT, UPDATE, DELETE ON field, field_version, field_block TO semmap_robot;
-- So are its class, how long its ways are and what its behaviours took.
GRANT INSERT, UPDATE, DELETE ON robot_class, walk, walked_place, walked_map TO semmap_robot;
GRANT INSERT ON execution TO semmap_robot;
-- And its missions: what came of them is not taken back, but what is planned only may change.
GRANT INSERT, UPDATE ON mission TO semmap_robot;
GRANT INSERT, UPDATE, DELETE ON mission_step, reservation TO semmap_robot;
DO $$
DECLARE
    name text;
BEGIN
    FOREACH name IN ARRAY ARRAY['entity', 'placement', 'entity_model', 'chunk', 'region', 'link'] LOOP
        EXECUTE format('ALTER TABLE %I ENABLE ROW LEVEL SECURITY', name);
        EXECUTE format('CREATE POLICY read_all ON %I FOR SELECT USING (true)', name);
        EXECUTE format('CREATE POLICY admin_all ON %I TO semmap_admin USING (true) WITH CHECK (true)', name);
    END LOOP;
END $$;
CREATE POLICY robot_adds ON entity FOR INSERT TO semmap_robot
    WITH CHECK (kind IN ('object', 'region', 'agent'));
CREATE POLICY robot_describes ON entity FOR UPDATE TO semmap_robot
    USING (kind IN ('object', 'region', 'agent')) WITH CHECK (kind IN ('object', 'region', 'agent'));
CREATE POLICY robot_places ON placement FOR INSERT TO semmap_robot
    WITH CHECK ((SELECT kind FROM entity e WHERE e.id = entity_id) IN ('object', 'region', 'agent'));
CREATE POLICY robot_moves ON placement FOR UPDATE TO semmap_robot
    USING ((SELECT kind FROM entity e WHERE e.id = entity_id) IN ('object', 'region', 'agent'));

-- A model is made before anybody has it; then its mesh stays as it is.
CREATE POLICY robot_makes ON chunk FOR INSERT TO semmap_robot
    WITH CHECK (NOT EXISTS (SELECT FROM entity_model m WHERE m.model_id = chunk.model_id));
CREATE POLICY robot_shapes ON entity_model FOR INSERT TO semmap_robot
    WITH CHECK ((SELECT kind FROM entity e WHERE e.id = entity_id) IN ('object', 'region', 'agent'));
CREATE POLICY robot_bounds ON region FOR INSERT TO semmap_robot
    WITH CHECK ((SELECT kind FROM entity e WHERE e.id = entity_id) = 'region');
CREATE POLICY robot_redraws ON region FOR UPDATE TO semmap_robot
    USING ((SELECT kind FROM entity e WHERE e.id = entity_id) = 'region');
CREATE POLICY robot_reshapes ON entity_model FOR DELETE TO semmap_robot
    USING ((SELECT kind FROM entity e WHERE e.id = entity_id) = 'region');
CREATE POLICY robot_links ON link FOR INSERT TO semmap_robot
    WITH CHECK ((SELECT kind FROM entity e WHERE e.id = from_id) IN ('object', 'region', 'agent'));

-- An admin does all of it, the T-Box and the building among it.
GRANT INSERT, UPDATE, DELETE, TRUNCATE ON ALL TABLES IN SCHEMA semmap TO semmap_admin;
GRANT EXECUTE ON ALL FUNCTIONS IN SCHEMA semmap TO semmap_admin;
GRANT USAGE ON ALL SEQUENCES IN SCHEMA semmap TO semmap_robot, semmap_admin;
-- What triggers keep is written by triggers alone.
REVOKE INSERT, UPDATE, DELETE, TRUNCATE ON world, object_type, type_closure, entity_chunk, change,
    entity_history, placement_history FROM semmap_admin;
