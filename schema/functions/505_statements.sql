-- Statements: `triple` has them as numbers of entities and, negative, of terms; the view `statement` has them as texts.

CREATE FUNCTION term_id(text text, tag text DEFAULT 'I')
RETURNS bigint LANGUAGE sql STABLE PARALLEL SAFE STRICT
-- The number of a term; null for one that no statement has had.
BEGIN ATOMIC
SELECT t.id FROM term t WHERE md5(t.text)::uuid = md5(term_id.text)::uuid AND t.tag = term_id.tag AND t.text = term_id.text;
END;

CREATE FUNCTION term_ids(texts text[], tags text[])
RETURNS bigint[] LANGUAGE plpgsql SET search_path = semmap, public, pg_temp SET plan_cache_mode = force_custom_plan AS $$
-- The numbers of terms, in order; those that are not there are added. The insertion locks the table for `prune_terms`,
-- which waits for the end of this transaction, even where it adds none. It is planned for the number of terms.
DECLARE
    found bigint[];
BEGIN
    FOR attempt IN 1..2 LOOP
        BEGIN  -- without ON CONFLICT, which takes twice the time
            WITH given AS MATERIALIZED (
                SELECT g.text COLLATE "C" AS text, g.tag COLLATE "C" AS tag, g.n
                FROM unnest(texts, tags) WITH ORDINALITY g (text, tag, n)),
            known AS MATERIALIZED (
                SELECT g.n, t.id FROM given g JOIN semmap.term t
                ON md5(t.text)::uuid = md5(g.text)::uuid AND t.tag = g.tag AND t.text = g.text),
            added AS (
                INSERT INTO semmap.term (text, tag)
                    SELECT DISTINCT g.text, g.tag FROM given g WHERE g.n NOT IN (SELECT k.n FROM known k) ORDER BY 1, 2
                    RETURNING id, text, tag)
            SELECT array_agg(coalesce(k.id, a.id) ORDER BY g.n) INTO found
                FROM given g LEFT JOIN known k ON k.n = g.n LEFT JOIN added a ON k.n IS NULL AND a.text = g.text AND a.tag = g.tag;
            RETURN found;
        EXCEPTION WHEN unique_violation THEN  -- another transaction added one meanwhile
            INSERT INTO semmap.term (text, tag)
                SELECT DISTINCT g.text COLLATE "C", g.tag COLLATE "C" FROM unnest(texts, tags) g (text, tag) ORDER BY 1, 2
                ON CONFLICT DO NOTHING;
        END;
    END LOOP;
    RAISE EXCEPTION 'terms of these statements were added at the same time'
        USING ERRCODE = 'serialization_failure', HINT = 'Try again.';
END $$;

CREATE FUNCTION prune_terms()
RETURNS bigint LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- Deletes terms that no statement has any more; returns how many. None while another transaction states or takes back
-- facts, which may use them. It takes time by the number of terms and statements, whatever the planner knows of them.
DECLARE
    gone bigint;
BEGIN
    LOCK TABLE semmap.term IN EXCLUSIVE MODE NOWAIT;
    DELETE FROM semmap.term t WHERE t.id IN (
        SELECT u.id FROM semmap.term u
        EXCEPT (SELECT s.subject FROM semmap.triple s UNION ALL SELECT s.predicate FROM semmap.triple s
                UNION ALL SELECT s.object FROM semmap.triple s UNION ALL SELECT s.graph FROM semmap.triple s));
    GET DIAGNOSTICS gone = ROW_COUNT;
    RETURN gone;
EXCEPTION WHEN lock_not_available THEN
    RETURN 0;
END $$;

CREATE FUNCTION stated_shape(written text, tag text)
RETURNS geometry LANGUAGE plpgsql IMMUTABLE STRICT COST 5000 SET search_path = semmap, public, pg_temp AS $$
-- The geometry of a term for topological relations; null where it has none, or an invalid one.
DECLARE
    shape geometry := semmap.text_geometry(written, tag);
BEGIN
    RETURN CASE WHEN ST_IsValid(shape) THEN shape END;
EXCEPTION WHEN OTHERS THEN  -- a type that GEOS does not know
    RETURN NULL;
END $$;

CREATE FUNCTION loose_box(geom geometry)
RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- A box in degrees around what the lines of a geometry are in other systems: curved, by the square of their length.
SELECT ST_Expand(ST_Envelope(geom), 0.01 * size + 0.002 * size * size) FROM ST_Length(ST_BoundingDiagonal(geom)) size;
END;

CREATE FUNCTION stated_box(written text, tag text)
RETURNS geometry LANGUAGE sql IMMUTABLE STRICT COST 5000 SET search_path = semmap, public, pg_temp AS $$
-- A box around the geometry of a term: in the map's frame, or in longitude and latitude. It is kept as long as its index,
-- which `semmap db upgrade` makes again: reference systems that are added later, or changed, are not in it.
SELECT CASE WHEN ST_SRID(shape) = 0 THEN ST_Envelope(shape) ELSE semmap.loose_box(semmap.transformed(shape, 4326)) END
FROM (SELECT semmap.stated_shape(written, tag) AS shape) s
$$;

CREATE FUNCTION earth_box(footprint geometry, of_map integer)
RETURNS geometry LANGUAGE sql STABLE
BEGIN ATOMIC
-- A box around a geometry of the map's frame, in longitude and latitude; null where the map has no georeference.
SELECT semmap.loose_box(semmap.on_earth(footprint, of_map));
END;

CREATE FUNCTION is_on_earth(written text, tag text)
RETURNS boolean LANGUAGE sql IMMUTABLE
BEGIN ATOMIC
-- Whether a geometry literal is in a reference system; not in the map's frame, which it may name. Most name none.
SELECT CASE WHEN written ~ '^\s*<[^>]*>\s*[A-Za-z]|srsName|"crs"'
            THEN coalesce(ST_SRID(semmap.text_geometry(written, tag)) <> 0, false) ELSE false END;
END;

CREATE INDEX term_shape ON term USING gist (stated_box(text, tag))
    WHERE tag IN ('http://www.opengis.net/ont/geosparql#wktLiteral', 'http://www.opengis.net/ont/geosparql#gmlLiteral',
                  'http://www.opengis.net/ont/geosparql#geoJSONLiteral');
CREATE INDEX term_on_earth ON term (id)
    WHERE tag IN ('http://www.opengis.net/ont/geosparql#wktLiteral', 'http://www.opengis.net/ont/geosparql#gmlLiteral',
                  'http://www.opengis.net/ont/geosparql#geoJSONLiteral') AND is_on_earth(text, tag);

CREATE VIEW statement WITH (security_invoker = true) AS
    SELECT t.id, t.map_id, coalesce(g.text, '') AS graph,          -- IRI; empty: the default graph
           t.subject_id,                                           -- an entity of the map,
           s.text AS subject,                                      -- or any other IRI
           p.text AS predicate,                                    -- IRI
           t.object_id,                                            -- an entity of the map,
           o.text AS object,                                       -- or the text of any other term
           o.tag,                                                  -- of that term: I for an IRI, @ and a language, or the datatype
           t.since, t.until, t.stated_by
    FROM triple t JOIN term p ON p.id = t.predicate LEFT JOIN term g ON g.id = t.graph
    LEFT JOIN term s ON s.id = t.subject LEFT JOIN term o ON o.id = t.object;
ALTER VIEW statement ALTER COLUMN graph SET DEFAULT '';
ALTER VIEW statement ALTER COLUMN since SET DEFAULT clock_timestamp();
ALTER VIEW statement ALTER COLUMN stated_by SET DEFAULT current_user;

CREATE FUNCTION statement_written()
RETURNS trigger LANGUAGE plpgsql SET search_path = semmap, public, pg_temp AS $$
-- Writes a row of the view into `triple`.
DECLARE
    numbers bigint[];
BEGIN
    IF TG_OP = 'DELETE' THEN
        DELETE FROM semmap.triple t WHERE t.id = OLD.id;
        RETURN CASE WHEN FOUND THEN OLD END;
    ELSIF num_nonnulls(NEW.subject_id, NEW.subject) <> 1 OR num_nonnulls(NEW.object_id, NEW.object) <> 1
       OR (NEW.object IS NULL) <> (NEW.tag IS NULL) OR '' IN (NEW.subject, NEW.predicate, NEW.tag) THEN
        RAISE EXCEPTION 'a statement has one subject and one object'
            USING ERRCODE = 'check_violation', HINT = 'Give subject_id or subject, and object_id or object with its tag.';
    END IF;
    numbers := semmap.term_ids(array_remove(ARRAY[NEW.predicate, nullif(NEW.graph, ''), NEW.subject, NEW.object], NULL),
                               array_remove(ARRAY['I', CASE WHEN NEW.graph <> '' THEN 'I' END, CASE WHEN NEW.subject IS NOT NULL THEN 'I' END, NEW.tag], NULL));
    IF TG_OP = 'INSERT' THEN
        INSERT INTO semmap.triple (map_id, graph, subject, predicate, object, since, until, stated_by)
            VALUES (NEW.map_id, CASE WHEN NEW.graph = '' THEN 0 ELSE numbers[2] END,
                    coalesce(NEW.subject_id, semmap.term_id(NEW.subject)), numbers[1],
                    coalesce(NEW.object_id, semmap.term_id(NEW.object, NEW.tag)), NEW.since, NEW.until, NEW.stated_by)
            RETURNING id INTO NEW.id;
        RETURN NEW;
    END IF;
    UPDATE semmap.triple t SET map_id = NEW.map_id, graph = CASE WHEN NEW.graph = '' THEN 0 ELSE numbers[2] END,
               subject = coalesce(NEW.subject_id, semmap.term_id(NEW.subject)), predicate = numbers[1],
               object = coalesce(NEW.object_id, semmap.term_id(NEW.object, NEW.tag)),
               since = NEW.since, until = NEW.until, stated_by = NEW.stated_by
        WHERE t.id = OLD.id;
    RETURN CASE WHEN FOUND THEN NEW END;
END $$;

CREATE TRIGGER statement_written INSTEAD OF INSERT OR UPDATE OR DELETE ON statement
    FOR EACH ROW EXECUTE FUNCTION statement_written();

-- Statements about an IRI follow the entity that gets the IRI.

CREATE FUNCTION triple_adopted()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
DECLARE
    named record;
BEGIN
    IF NOT EXISTS (SELECT FROM semmap.term) THEN
        RETURN NULL;
    END IF;
    FOR named IN SELECT f.id, f.map_id, t.id AS term FROM fresh f JOIN semmap.term t
                 ON md5(t.text)::uuid = md5(semmap.entity_iri(f.id))::uuid AND t.tag = 'I' LOOP
        UPDATE semmap.triple s SET subject = named.id WHERE s.map_id = named.map_id AND s.subject = named.term;
        UPDATE semmap.triple s SET object = named.id WHERE s.map_id = named.map_id AND s.object = named.term;
    END LOOP;
    RETURN NULL;
END $$;

CREATE TRIGGER triple_adopted AFTER INSERT ON entity REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION triple_adopted();
CREATE TRIGGER triple_readopted AFTER UPDATE ON entity REFERENCING NEW TABLE AS fresh
    FOR EACH STATEMENT EXECUTE FUNCTION triple_adopted();

CREATE FUNCTION triple_changed()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- The change log has the statements, and the entities that they are about. Deleting an entity or a map is a change already.
DECLARE
    stated triple[];
BEGIN
    IF coalesce(current_setting('semmap.dropping', true), '') <> '' THEN
        RETURN NULL;
    END IF;
    IF TG_OP = 'UPDATE' THEN
        stated := ARRAY(SELECT f FROM former f UNION ALL SELECT t FROM touched t);
    ELSE
        stated := ARRAY(SELECT t FROM touched t);
    END IF;
    INSERT INTO semmap.change (map_id, what, entities, facts)
        SELECT m.id, 'statement', ARRAY(SELECT DISTINCT s.subject FROM unnest(stated) s WHERE s.map_id = m.id AND s.subject > 0),
               CASE WHEN cardinality(stated) <= 200 THEN
                   (SELECT jsonb_agg(jsonb_build_array(coalesce(g.text, ''), coalesce(to_jsonb(a.text), to_jsonb(s.subject)), p.text,
                                                       coalesce(to_jsonb(b.text), to_jsonb(s.object)), b.tag))
                    FROM unnest(stated) s JOIN semmap.term p ON p.id = s.predicate LEFT JOIN semmap.term g ON g.id = s.graph
                    LEFT JOIN semmap.term a ON a.id = s.subject LEFT JOIN semmap.term b ON b.id = s.object WHERE s.map_id = m.id) END
        FROM semmap.map m WHERE m.id IN (SELECT s.map_id FROM unnest(stated) s);
    RETURN NULL;
END $$;

CREATE TRIGGER triple_added AFTER INSERT ON triple REFERENCING NEW TABLE AS touched
    FOR EACH STATEMENT EXECUTE FUNCTION triple_changed();
CREATE TRIGGER triple_edited AFTER UPDATE ON triple REFERENCING OLD TABLE AS former NEW TABLE AS touched
    FOR EACH STATEMENT EXECUTE FUNCTION triple_changed();
CREATE TRIGGER triple_removed AFTER DELETE ON triple REFERENCING OLD TABLE AS touched
    FOR EACH STATEMENT EXECUTE FUNCTION triple_changed();
