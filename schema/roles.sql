-- The rights of each role. Roles belong to the whole server: made once, granted here for this database.
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

-- A robot observes and moves objects: it adds objects, regions and agents, describes and places them, opens
-- and closes doors. It neither deletes, nor changes the building or the T-Box. Times are the server's.
GRANT INSERT (map_id, kind, name, label, type, properties, front) ON entity TO semmap_robot;
GRANT UPDATE (label, type, properties, front) ON entity TO semmap_robot;
GRANT INSERT (entity_id, holder_id, pose, relation, confidence) ON placement TO semmap_robot;
GRANT UPDATE (holder_id, pose, relation, confidence) ON placement TO semmap_robot;
GRANT INSERT ON entity_model, model, chunk, support_surface, region, link TO semmap_robot;
-- When it redraws a region, the previous outline is deleted.
GRANT UPDATE ON region TO semmap_robot;
GRANT DELETE ON entity_model, model TO semmap_robot;
GRANT UPDATE (state, seen_at) ON connector TO semmap_robot;
-- It writes fields, and deletes their old versions.
GRANT INSERT, UPDATE, DELETE ON field, field_version, field_block TO semmap_robot;
-- It writes travel times and the durations of its behaviours. A robot class is shared by its robots: a robot does
-- not change it, but locks it while it stores travel times.
GRANT INSERT, UPDATE ON robot_class TO semmap_robot;
GRANT INSERT, UPDATE, DELETE ON travel_time, travel_time_place, travel_time_map TO semmap_robot;
GRANT INSERT (robot_class_id, behaviour, entity_id, seconds, height, succeeded) ON execution TO semmap_robot;
-- It writes its own missions: outcomes are final, planned steps may change.
GRANT INSERT (map_id, robot_id, goal) ON mission TO semmap_robot;
GRANT UPDATE (state, reason, runner, heartbeat, ended_at) ON mission TO semmap_robot;
GRANT INSERT, UPDATE, DELETE ON mission_step TO semmap_robot;
GRANT INSERT (resource_id, robot_id, expires), UPDATE (robot_id, expires), DELETE ON reservation TO semmap_robot;
-- It stores what it observed, and what it is taught of relations and actions; the T-Box stays as it is.
GRANT INSERT (entity_id, place_id, at, seen, inside, position, visible, hit, false_alarm, observer_id) ON observation TO semmap_robot;
GRANT INSERT ON taught_relation, taught_action TO semmap_robot;
GRANT INSERT (map_id, name) ON teaching TO semmap_robot;
-- Triggers note what a teaching changes; a robot notes what it teaches again, which changes nothing.
GRANT INSERT (teaching_id, of_table, key, what, former, taught) ON taught_fact TO semmap_robot;
-- It stores what it knows and learns of manipulation; triggers count outcomes, and an admin decides whom to trust.
GRANT INSERT ON device, gripper, automaton, object_model, object_mesh, action_step, path TO semmap_robot;
GRANT UPDATE (shape, size, shape_pose, inliers, deviation) ON object_model TO semmap_robot;
GRANT INSERT (key, kind, object_id, gripper_id, pose, pre_pose, post_pose, motion, approach, family, width, posture, pre_posture, quality, shift),
    UPDATE (replaced_by) ON action TO semmap_robot;
GRANT INSERT (map_id, robot_id, kind, entity_id, action_id, start, goal, deadline, outcome, message, created_at),
    UPDATE (action_id, start, goal, outcome, message) ON task TO semmap_robot;
-- It states facts that no other table has a column for, and takes them back.
GRANT INSERT, UPDATE, DELETE ON statement, triple TO semmap_robot;
GRANT INSERT (text, tag) ON term TO semmap_robot;
-- Its updates keep the inferences up to date; an admin decides which shapes bind them.
GRANT INSERT, UPDATE, DELETE ON reasoning, inference TO semmap_robot;
-- It stores data sets and the links between them; an admin takes links back.
GRANT INSERT (name, digest) ON data_set TO semmap_robot;
GRANT INSERT ON data_record, record_link TO semmap_robot;
GRANT INSERT (left_id, right_id, pattern, correspondences, labels) ON link_set TO semmap_robot;

DO $$
DECLARE
    name text;
BEGIN
    FOREACH name IN ARRAY ARRAY['entity', 'placement', 'entity_model', 'model', 'chunk', 'support_surface', 'region', 'link',
                                'mission', 'mission_step', 'reservation', 'robot_class', 'task', 'taught_fact'] LOOP
        EXECUTE format('ALTER TABLE %I ENABLE ROW LEVEL SECURITY', name);
        EXECUTE format('CREATE POLICY read_all ON %I FOR SELECT USING (true)', name);
        EXECUTE format('CREATE POLICY admin_all ON %I TO semmap_admin USING (true) WITH CHECK (true)', name);
    END LOOP;
END $$;
CREATE POLICY robot_adds ON entity FOR INSERT TO semmap_robot
    WITH CHECK (kind IN ('object', 'region', 'agent'));
CREATE POLICY robot_describes ON entity FOR UPDATE TO semmap_robot
    USING (kind IN ('object', 'region', 'agent') AND NOT is_other_robot(id))
    WITH CHECK (kind IN ('object', 'region', 'agent'));
CREATE POLICY robot_places ON placement FOR INSERT TO semmap_robot
    WITH CHECK ((SELECT kind FROM entity e WHERE e.id = entity_id) IN ('object', 'region', 'agent')
                AND NOT is_other_robot(entity_id));
CREATE POLICY robot_moves ON placement FOR UPDATE TO semmap_robot
    USING ((SELECT kind FROM entity e WHERE e.id = entity_id) IN ('object', 'region', 'agent')
           AND NOT is_other_robot(entity_id));

-- A robot writes its own model before an entity uses it; then its mesh is fixed.
CREATE POLICY robot_makes ON model FOR INSERT TO semmap_robot WITH CHECK (true);
CREATE POLICY robot_drops ON model FOR DELETE TO semmap_robot USING (starts_with(digest, current_user || '/'));
CREATE POLICY robot_meshes ON chunk FOR INSERT TO semmap_robot
    WITH CHECK (NOT EXISTS (SELECT FROM entity_model m WHERE m.model_id = chunk.model_id)
                AND (SELECT starts_with(m.digest, current_user || '/') FROM model m WHERE m.id = chunk.model_id));
CREATE POLICY robot_levels ON support_surface FOR INSERT TO semmap_robot
    WITH CHECK ((SELECT starts_with(m.digest, current_user || '/') FROM model m WHERE m.id = model_id));
CREATE POLICY robot_shapes ON entity_model FOR INSERT TO semmap_robot
    WITH CHECK ((SELECT kind FROM entity e WHERE e.id = entity_id) IN ('object', 'region', 'agent')
                AND NOT is_other_robot(entity_id));
CREATE POLICY robot_bounds ON region FOR INSERT TO semmap_robot
    WITH CHECK ((SELECT kind FROM entity e WHERE e.id = entity_id) = 'region');
CREATE POLICY robot_redraws ON region FOR UPDATE TO semmap_robot
    USING ((SELECT kind FROM entity e WHERE e.id = entity_id) = 'region');
CREATE POLICY robot_reshapes ON entity_model FOR DELETE TO semmap_robot
    USING ((SELECT kind FROM entity e WHERE e.id = entity_id) = 'region');
CREATE POLICY robot_restates ON taught_fact FOR INSERT TO semmap_robot WITH CHECK (former = taught);
CREATE POLICY robot_links ON link FOR INSERT TO semmap_robot
    WITH CHECK ((SELECT kind FROM entity e WHERE e.id = from_id) IN ('object', 'region', 'agent'));

CREATE POLICY robot_defines ON robot_class FOR INSERT TO semmap_robot WITH CHECK (true);
CREATE POLICY robot_locks ON robot_class FOR UPDATE TO semmap_robot USING (true) WITH CHECK (false);

-- A robot cannot change missions and claims of other robots; it can take over a claim that has expired.
CREATE POLICY robot_adds ON mission FOR INSERT TO semmap_robot WITH CHECK (is_own_robot(robot_id));
CREATE POLICY robot_pursues ON mission FOR UPDATE TO semmap_robot
    USING (is_own_robot(robot_id)) WITH CHECK (is_own_robot(robot_id));
CREATE POLICY robot_adds ON task FOR INSERT TO semmap_robot WITH CHECK (is_own_robot(robot_id));
CREATE POLICY robot_pursues ON task FOR UPDATE TO semmap_robot USING (is_own_robot(robot_id)) WITH CHECK (is_own_robot(robot_id));
CREATE POLICY robot_plans ON mission_step FOR INSERT TO semmap_robot WITH CHECK (is_own_mission(mission_id));
CREATE POLICY robot_steps ON mission_step FOR UPDATE TO semmap_robot
    USING (is_own_mission(mission_id) AND state IN ('planned', 'started')) WITH CHECK (is_own_mission(mission_id));
CREATE POLICY robot_replans ON mission_step FOR DELETE TO semmap_robot
    USING (is_own_mission(mission_id) AND state = 'planned');
CREATE POLICY robot_claims ON reservation FOR INSERT TO semmap_robot WITH CHECK (is_own_robot(robot_id));
CREATE POLICY robot_renews ON reservation FOR UPDATE TO semmap_robot
    USING (is_own_robot(robot_id) OR expires NOT BETWEEN clock_timestamp() AND clock_timestamp() + interval '1 hour')
    WITH CHECK (is_own_robot(robot_id));
CREATE POLICY robot_releases ON reservation FOR DELETE TO semmap_robot USING (is_own_robot(robot_id));

-- An admin may do all of this, and change the T-Box and the building; of the views, it writes only those with triggers.
-- It does not truncate tables: no history, change or world coordinate would follow.
DO $$
DECLARE
    name regclass;
BEGIN
    FOR name IN SELECT oid FROM pg_class WHERE relnamespace = 'semmap'::regnamespace
                AND (relkind = 'r' OR relkind = 'v' AND relname IN ('statement', 'gis_storey', 'gis_room', 'gis_object', 'gis_region', 'gis_connector')) LOOP
        EXECUTE format('GRANT INSERT, UPDATE, DELETE ON %s TO semmap_admin', name);
    END LOOP;
END $$;
GRANT USAGE ON ALL SEQUENCES IN SCHEMA semmap TO semmap_robot, semmap_admin;
-- Tables that triggers maintain are written by triggers only.
REVOKE INSERT, UPDATE, DELETE ON world, section, object_type, type_closure, entity_chunk, change, change_pruned,
    entity_history, placement_history, belief, entity_object, kept_relation, kept_pair, written FROM semmap_admin;

-- Functions that can write are executed by those who need them alone. A trigger function that everybody may
-- execute could be attached to a user's own table.
DO $$
DECLARE
    called record;
BEGIN
    FOR called IN
        SELECT p.oid::regprocedure AS name, coalesce(needed.roles, '{}') AS roles
        FROM pg_proc p LEFT JOIN (VALUES
            ('copy_map', ARRAY['semmap_admin']), ('drop_map', ARRAY['semmap_admin']), ('drop_unused_models', ARRAY['semmap_admin']),
            ('prune_history', ARRAY['semmap_admin']), ('prune_changes', ARRAY['semmap_admin']),
            ('prune_observations', ARRAY['semmap_admin']), ('prune_terms', ARRAY['semmap_admin']),
            ('prune_written', ARRAY['semmap_admin']),
            ('term_ids', ARRAY['semmap_robot', 'semmap_admin']),
            ('derive_again', ARRAY['semmap_admin']), ('follow_change', ARRAY['semmap_admin']), ('recognise_parts', ARRAY['semmap_admin']),
            ('put_door', ARRAY['semmap_admin']), ('turn_to', ARRAY['semmap_admin']), ('fit_shape', ARRAY['semmap_admin']),
            ('settle', ARRAY['semmap_reader', 'semmap_robot', 'semmap_admin']),
            -- It writes what everybody may compute, of its own arguments nothing.
            ('keep_relation', ARRAY['semmap_reader', 'semmap_robot', 'semmap_admin']),
            ('note_write', ARRAY['semmap_robot', 'semmap_admin']), ('was_written', ARRAY['semmap_robot', 'semmap_admin']),
            ('undo_teaching', ARRAY['semmap_admin']),
            ('refresh_belief', ARRAY['semmap_robot', 'semmap_admin']), ('refresh_beliefs', ARRAY['semmap_robot', 'semmap_admin']),
            ('end_idle_robots', ARRAY['semmap_robot', 'semmap_admin']), ('robot_wastes_turn', ARRAY['semmap_robot', 'semmap_admin']),
            ('hold_still', ARRAY['semmap_robot', 'semmap_admin']), ('queue_writer', ARRAY['semmap_robot', 'semmap_admin']),
            ('move_to', ARRAY['semmap_robot', 'semmap_admin']), ('put', ARRAY['semmap_robot', 'semmap_admin']),
            ('claim', ARRAY['semmap_robot', 'semmap_admin']), ('drawn_model', ARRAY['semmap_robot', 'semmap_admin'])
        ) needed (name, roles) ON needed.name = p.proname
        WHERE p.pronamespace = 'semmap'::regnamespace
          AND (p.provolatile = 'v' OR p.prosecdef OR p.prorettype = 'trigger'::regtype)
    LOOP
        EXECUTE format('REVOKE EXECUTE ON FUNCTION %s FROM PUBLIC, semmap_reader, semmap_robot, semmap_admin', called.name);
        IF called.roles <> '{}' THEN
            EXECUTE format('GRANT EXECUTE ON FUNCTION %s TO %s', called.name, array_to_string(called.roles, ', '));
        END IF;
    END LOOP;
END $$;
