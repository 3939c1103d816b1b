-- How long a robot can keep others waiting.

CREATE FUNCTION is_trusted(login name DEFAULT current_user)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
-- Whether a role has the rights of an admin, or of the schema's owner. Robots and readers have not.
SELECT pg_has_role(login, 'semmap_admin', 'USAGE')
    OR pg_has_role(login, (SELECT nspowner FROM pg_catalog.pg_namespace WHERE nspname = 'semmap'), 'USAGE');
END;

CREATE FUNCTION caller()
RETURNS name LANGUAGE sql STABLE
BEGIN ATOMIC
-- The role of the session, also in a function that runs with its owner's rights.
SELECT CASE current_setting('role') WHEN 'none' THEN session_user ELSE current_setting('role')::name END;
END;

CREATE FUNCTION may_move(login name, thing bigint)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
-- Whether a role may move an entity: the policy `robot_moves`, for a function that runs with its owner's rights.
SELECT semmap.is_trusted(login) OR EXISTS (
    SELECT FROM semmap.entity e WHERE e.id = thing AND e.kind IN ('object', 'region', 'agent')
    AND NOT EXISTS (SELECT FROM pg_catalog.pg_roles r
                    WHERE e.kind = 'agent' AND r.rolname = e.name AND NOT pg_has_role(login, r.oid, 'MEMBER')));
END;

CREATE FUNCTION holds_turn(process integer)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
-- Whether a session has the turn of those who move entities.
SELECT EXISTS (SELECT FROM pg_catalog.pg_locks l
               WHERE l.pid = process AND l.granted AND l.locktype = 'advisory' AND l.classid = 0 AND l.objsubid = 2
                 AND l.objid::bigint = hashtext('semmap.placement')::bigint & 4294967295
                 AND l.database = (SELECT oid FROM pg_catalog.pg_database WHERE datname = current_database()));
END;

CREATE FUNCTION keeps_others_waiting(process integer)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
-- Whether a session has a lock for which writers can wait: the turn, one of a table for more than reading, or one of those
-- that importers and the writers of regions and grippers take. Missions keep theirs while they run.
SELECT semmap.holds_turn(process) OR EXISTS (
    SELECT FROM pg_catalog.pg_locks l
    WHERE l.pid = process AND l.granted
      AND (l.locktype = 'relation' AND l.mode <> 'AccessShareLock'
           OR l.locktype = 'advisory' AND l.objsubid = 1 AND (l.classid::bigint << 32) | l.objid::bigint
              IN (hashtext('semmap.import'), hashtext('semmap.regions'), hashtext('semmap default gripper'))));
END;

CREATE FUNCTION end_idle_robots()
RETURNS boolean LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Ends the sessions of robots and readers that keep others waiting and have been idle for 10 s, or in their transaction for
-- a minute. A login can set its own timeouts back, but not this one. Returns whether there are others in a transaction.
DECLARE
    others boolean := false;
    robot record;
BEGIN
    PERFORM pg_stat_clear_snapshot();
    FOR robot IN
        SELECT a.pid, a.state <> 'idle' AS busy,
               a.state LIKE 'idle%' AND a.state_change < clock_timestamp() - interval '10 s'
               OR a.xact_start < clock_timestamp() - interval '1 minute' AS late
        FROM pg_catalog.pg_stat_activity a
        WHERE a.datname = current_database() AND a.pid <> pg_backend_pid()
          AND (a.xact_start IS NOT NULL OR a.pid IN (SELECT l.pid FROM pg_catalog.pg_locks l WHERE l.locktype = 'advisory'))
          AND NOT semmap.is_trusted(a.usename)
    LOOP
        IF robot.late AND pg_has_role('pg_signal_backend', 'USAGE') AND semmap.keeps_others_waiting(robot.pid) THEN
            PERFORM pg_terminate_backend(robot.pid);
        ELSE
            others := others OR robot.busy;
        END IF;
    END LOOP;
    RETURN others;
END $$;

CREATE FUNCTION robot_wastes_turn()
RETURNS boolean LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Whether a robot has the turn and has been idle for 0.2 s.
BEGIN
    PERFORM pg_stat_clear_snapshot();
    RETURN EXISTS (SELECT FROM pg_catalog.pg_stat_activity a
                   WHERE a.datname = current_database()
                     AND a.state LIKE 'idle%' AND a.state_change < clock_timestamp() - interval '0.2 s'
                     AND NOT semmap.is_trusted(a.usename) AND semmap.holds_turn(a.pid));
END $$;
