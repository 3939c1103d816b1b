-- Claims of connectors and elevators; times are those of the server's clock.

CREATE FUNCTION reservation_stamp()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
DECLARE
    moment timestamptz := clock_timestamp();
BEGIN
    IF TG_OP = 'UPDATE' THEN
        NEW.since := CASE WHEN NEW.robot_id = OLD.robot_id THEN least(OLD.since, moment) ELSE moment END;
    ELSE
        NEW.since := moment;
    END IF;
    IF NEW.expires > moment + interval '1 hour' THEN
        RAISE EXCEPTION 'a claim expires within an hour, not at %', NEW.expires
            USING ERRCODE = 'check_violation', HINT = 'Renew it while the robot needs the connector or elevator.';
    END IF;
    RETURN NEW;
END $$;

CREATE TRIGGER reservation_stamp BEFORE INSERT OR UPDATE ON reservation
    FOR EACH ROW EXECUTE FUNCTION reservation_stamp();

CREATE FUNCTION claim(resource bigint, robot bigint, seconds double precision)
RETURNS boolean LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Claims a connector or elevator for a robot for so many seconds, or renews its claim; false if another
-- robot has claimed it. A claim for more than an hour is of a clock that was set back.
BEGIN
    UPDATE semmap.reservation SET robot_id = robot, expires = clock_timestamp() + make_interval(secs => seconds)
        WHERE resource_id = resource AND (robot_id = robot OR expires NOT BETWEEN clock_timestamp() AND clock_timestamp() + interval '1 hour');
    IF NOT FOUND THEN
        INSERT INTO semmap.reservation (resource_id, robot_id, expires)
            VALUES (resource, robot, clock_timestamp() + make_interval(secs => seconds)) ON CONFLICT DO NOTHING;
    END IF;
    RETURN FOUND;
END $$;

CREATE FUNCTION is_own_robot(robot bigint)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
-- Whether an agent is a robot of the current role: it has the name of that role, or of one that the role is
-- a member of. So each robot logs in by its own name, and a fleet manager is a member of several.
SELECT EXISTS (SELECT FROM semmap.entity e JOIN pg_catalog.pg_roles r ON r.rolname = e.name
               WHERE e.id = robot AND e.kind = 'agent' AND pg_has_role(r.oid, 'MEMBER'));
END;

CREATE FUNCTION is_other_robot(agent bigint)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
-- Whether an agent is a robot that logs in by a role of its own, which is not the current one.
SELECT EXISTS (SELECT FROM semmap.entity e JOIN pg_catalog.pg_roles r ON r.rolname = e.name
               WHERE e.id = agent AND e.kind = 'agent' AND NOT pg_has_role(r.oid, 'MEMBER'));
END;

CREATE FUNCTION is_own_mission(mission bigint)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
SELECT EXISTS (SELECT FROM semmap.mission m WHERE m.id = mission AND semmap.is_own_robot(m.robot_id));
END;

CREATE FUNCTION seen_stamp()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- The time of an observation is not in the future.
BEGIN
    NEW.seen_at := least(NEW.seen_at, clock_timestamp());
    RETURN NEW;
END $$;

CREATE TRIGGER seen_stamp BEFORE UPDATE OF seen_at ON connector
    FOR EACH ROW WHEN (NEW.seen_at IS NOT NULL) EXECUTE FUNCTION seen_stamp();
