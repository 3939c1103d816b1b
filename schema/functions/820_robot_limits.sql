-- Limits on what a robot states.

CREATE FUNCTION robot_states_less()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
BEGIN
    IF NOT semmap.is_trusted() THEN
        RAISE EXCEPTION '%: a robot states %', TG_TABLE_NAME, TG_ARGV[0]
            USING ERRCODE = 'check_violation', HINT = 'Correct it, or let an admin state it.';
    END IF;
    RETURN NEW;
END $$;

CREATE FUNCTION is_recent(moment timestamptz)
RETURNS boolean LANGUAGE sql STABLE
BEGIN ATOMIC
SELECT moment BETWEEN clock_timestamp() - interval '30 days' AND clock_timestamp();
END;

CREATE FUNCTION robot_states_its_own()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- A robot states in its own name. Of the statements of others, it deletes those that have ended, and lets others last longer.
DECLARE
    unstated CONSTANT text[] := ARRAY['until', 'subject_id', 'object_id'];  -- those that the server generates are not there yet
BEGIN
    IF TG_OP = 'INSERT' THEN
        NEW.stated_by := CASE WHEN semmap.is_trusted() THEN NEW.stated_by ELSE current_user END;
    ELSIF NOT semmap.is_trusted() THEN
        IF NOT EXISTS (SELECT FROM pg_catalog.pg_roles r WHERE r.rolname = OLD.stated_by AND pg_has_role(r.oid, 'MEMBER'))
           AND coalesce(OLD.until > statement_timestamp(), true)
           AND (TG_OP = 'DELETE' OR NEW.until < coalesce(OLD.until, 'infinity')
                OR to_jsonb(NEW) - unstated <> to_jsonb(OLD) - unstated) THEN
            RAISE EXCEPTION 'statement %: % stated it', OLD.id, coalesce(OLD.stated_by, 'nobody known')
                USING ERRCODE = 'insufficient_privilege', HINT = 'A robot changes and takes back its own statements.';
        ELSIF TG_OP = 'UPDATE' THEN
            NEW.stated_by := CASE WHEN OLD.until <= statement_timestamp() THEN current_user ELSE OLD.stated_by END;
        END IF;
    END IF;
    RETURN CASE TG_OP WHEN 'DELETE' THEN OLD ELSE NEW END;
END $$;

CREATE TRIGGER robot_adds_its_own BEFORE INSERT ON triple
    FOR EACH ROW WHEN (NEW.stated_by IS DISTINCT FROM current_user) EXECUTE FUNCTION robot_states_its_own();
CREATE TRIGGER robot_states_its_own BEFORE UPDATE OR DELETE ON triple
    FOR EACH ROW EXECUTE FUNCTION robot_states_its_own();

DO $$
DECLARE
    bound record;
BEGIN
    FOR bound IN SELECT row_number() OVER () AS number, b.* FROM (VALUES
        ('placement', 'pose', 'greatest(abs(NEW.pose[1]), abs(NEW.pose[2]), abs(NEW.pose[3])) > 10000',
         'poses within 10,000 m of the holder or the map''s origin'),
        ('entity', 'properties', 'pg_column_size(NEW.properties) > 65536', 'properties of at most 64 kB'),
        ('entity', 'label', 'octet_length(NEW.label) > 65536', 'labels of at most 64 kB'),
        ('link', NULL, 'pg_column_size(NEW.*) > 65536', 'properties of at most 64 kB'),
        ('execution', NULL, 'NEW.seconds > 86400', 'durations of at most a day'),
        ('execution', NULL, 'NOT abs(NEW.height) <= 10000', 'heights of at most 10,000 m'),
        ('connector', 'seen_at', 'NEW.seen_at < clock_timestamp() - interval ''30 days''', 'times of the last 30 days'),
        ('observation', NULL, 'NEW.at < clock_timestamp() - interval ''30 days''', 'times of the last 30 days'),
        ('field_version', 'at', 'NEW.at > clock_timestamp()', 'no times in the future'),
        ('mission', 'heartbeat', 'NOT is_recent(NEW.heartbeat)', 'times of the last 30 days'),
        ('mission', 'ended_at', 'NOT is_recent(NEW.ended_at)', 'times of the last 30 days'),
        ('mission_step', 'started_at', 'NOT is_recent(NEW.started_at)', 'times of the last 30 days'),
        ('mission_step', 'ended_at', 'NOT is_recent(NEW.ended_at)', 'times of the last 30 days'),
        ('mission_step', 'ended_at', 'NEW.ended_at < NEW.started_at', 'ends after their starts'),
        ('task', NULL, 'NOT is_recent(NEW.created_at)', 'times of the last 30 days'),
        ('triple', 'since', 'NOT is_recent(NEW.since)', 'times of the last 30 days'),
        ('term', NULL, 'octet_length(NEW.text) > 65536', 'terms of at most 64 kB')) b (of, stated, beyond, sentence)
    LOOP
        EXECUTE format('CREATE TRIGGER robot_adds_less_%s BEFORE INSERT ON %I FOR EACH ROW WHEN (%s) '
                       'EXECUTE FUNCTION robot_states_less(%L)', bound.number, bound.of, bound.beyond, bound.sentence);
        CONTINUE WHEN bound.stated IS NULL;  -- a robot only adds it
        EXECUTE format('CREATE TRIGGER robot_states_less_%1$s BEFORE UPDATE OF %2$I ON %3$I FOR EACH ROW '
                       'WHEN (NEW.%2$I IS DISTINCT FROM OLD.%2$I AND (%4$s)) EXECUTE FUNCTION robot_states_less(%5$L)',
                       bound.number, bound.stated, bound.of, bound.beyond, bound.sentence);
    END LOOP;
END $$;
