-- The map as RDF: terms of SPARQL as columns. A term whose kind is only known at run time is two texts: its lexical
-- form, and a tag, which is I for an IRI, B for a blank node, @ and a language for a text in a language, else the
-- datatype. Null is an error of SPARQL, or an unbound variable. A function that catches an error begins a
-- subtransaction, which parallel workers cannot: neither it nor its callers are PARALLEL SAFE.

CREATE FUNCTION iri_encode(name text)
RETURNS text LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- A name as a part of an IRI: all but letters, digits, _, -, . and ~ is percent-encoded as UTF-8.
DECLARE
    letter text;
    encoded text := '';
    bytes bytea;
BEGIN
    IF name ~ '^[A-Za-z0-9_.~-]*$' THEN
        RETURN name;
    END IF;
    FOREACH letter IN ARRAY string_to_array(name, NULL) LOOP
        IF letter ~ '^[A-Za-z0-9_.~-]$' THEN
            encoded := encoded || letter;
        ELSE
            bytes := convert_to(letter, 'UTF8');
            FOR i IN 0 .. length(bytes) - 1 LOOP
                encoded := encoded || '%' || upper(lpad(to_hex(get_byte(bytes, i)), 2, '0'));
            END LOOP;
        END IF;
    END LOOP;
    RETURN encoded;
END $$;

CREATE FUNCTION entity_iri(thing bigint)
RETURNS text LANGUAGE sql STABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- The IRI of an entity.
SELECT 'urn:semmap:map:' || semmap.iri_encode(m.name) || '#' || semmap.iri_encode(e.name)
FROM semmap.entity e JOIN semmap.map m ON m.id = e.map_id WHERE e.id = thing;
END;

CREATE FUNCTION entity_of_iri(iri text)
RETURNS bigint LANGUAGE plpgsql STABLE STRICT SET search_path = semmap, public, pg_temp AS $$
-- The entity of the current map with an IRI; null if there is none.
DECLARE
    namespace text := (SELECT 'urn:semmap:map:' || semmap.iri_encode(m.name) || '#' FROM semmap.map m WHERE m.id = semmap.current_map());
    encoded text := substr(iri, length(namespace) + 1);
    hex text := (SELECT string_agg(CASE WHEN p[1] ~ '^%.' THEN substr(p[1], 2) ELSE encode(convert_to(p[1], 'UTF8'), 'hex') END, '' ORDER BY n)
                 FROM regexp_matches(encoded, '%[0-9A-F]{2}|.', 'g') WITH ORDINALITY AS piece (p, n));
BEGIN
    IF NOT starts_with(iri, namespace) OR hex IS NULL THEN
        RETURN NULL;
    END IF;
    RETURN (SELECT e.id FROM semmap.entity e WHERE e.map_id = semmap.current_map() AND e.name = convert_from(decode(hex, 'hex'), 'UTF8'));
EXCEPTION WHEN character_not_in_repertoire OR untranslatable_character OR invalid_parameter_value THEN
    RETURN NULL;  -- bytes that are no text
END $$;

CREATE FUNCTION type_iri(of_type text)
RETURNS text LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
-- The class of a semantic type: that of its ontology, or one named after the type.
SELECT coalesce((SELECT iri FROM semmap.semantic_type WHERE name = of_type), 'urn:semmap:type#' || semmap.iri_encode(of_type));
END;

CREATE FUNCTION rdf_double(number double precision)
RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
SELECT CASE number WHEN 'Infinity' THEN 'INF' WHEN '-Infinity' THEN '-INF' WHEN 'NaN' THEN 'NaN'
       ELSE CASE WHEN number::text ~ '^-?\d+$' THEN number::text || '.0' ELSE number::text END END;
END;

CREATE FUNCTION rdf_decimal(number numeric)
RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
SELECT CASE WHEN scale(number) = 0 THEN number::text || '.0'
            WHEN scale(trim_scale(number)) = 0 THEN trim_scale(number)::text || '.0' ELSE trim_scale(number)::text END;
END;

CREATE FUNCTION rdf_time(moment timestamptz)
RETURNS text LANGUAGE sql STABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
SELECT replace(to_char(moment AT TIME ZONE 'UTC', 'YYYY-MM-DD"T"HH24:MI:SS.US'), '.000000', '') || '+00:00';
END;

CREATE FUNCTION json_text(value jsonb)
RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- The lexical form of a property's value.
SELECT CASE jsonb_typeof(value) WHEN 'string' THEN value #>> '{}'
            WHEN 'number' THEN CASE WHEN value::text ~ '^-?\d+$' THEN value::text ELSE semmap.rdf_decimal(value::text::numeric) END
            ELSE value::text END;
END;

CREATE FUNCTION json_tag(value jsonb)
RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
SELECT CASE jsonb_typeof(value) WHEN 'string' THEN 'http://www.w3.org/2001/XMLSchema#string'
            WHEN 'number' THEN CASE WHEN value::text ~ '^-?\d+$' THEN 'http://www.w3.org/2001/XMLSchema#integer'
                                    ELSE 'http://www.w3.org/2001/XMLSchema#decimal' END
            WHEN 'boolean' THEN 'http://www.w3.org/2001/XMLSchema#boolean'
            ELSE 'http://www.w3.org/1999/02/22-rdf-syntax-ns#JSON' END;
END;

CREATE FUNCTION is_numeric_tag(tag text)
RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
SELECT tag = ANY (ARRAY['http://www.w3.org/2001/XMLSchema#integer', 'http://www.w3.org/2001/XMLSchema#decimal',
    'http://www.w3.org/2001/XMLSchema#double', 'http://www.w3.org/2001/XMLSchema#float',
    'http://www.w3.org/2001/XMLSchema#int', 'http://www.w3.org/2001/XMLSchema#long', 'http://www.w3.org/2001/XMLSchema#short',
    'http://www.w3.org/2001/XMLSchema#byte', 'http://www.w3.org/2001/XMLSchema#nonNegativeInteger',
    'http://www.w3.org/2001/XMLSchema#positiveInteger', 'http://www.w3.org/2001/XMLSchema#nonPositiveInteger',
    'http://www.w3.org/2001/XMLSchema#negativeInteger', 'http://www.w3.org/2001/XMLSchema#unsignedInt',
    'http://www.w3.org/2001/XMLSchema#unsignedLong', 'http://www.w3.org/2001/XMLSchema#unsignedShort',
    'http://www.w3.org/2001/XMLSchema#unsignedByte']);
END;

CREATE FUNCTION text_number(written text)
RETURNS double precision LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- A number as XML Schema writes it; null for any other text, and beyond what a double has.
DECLARE
    exact numeric;
BEGIN
    IF length(written) < 200 AND written ~ '^\s*[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d\d?)?\s*$' THEN
        RETURN written::double precision;
    ELSIF length(written) < 10000 AND written ~ '^\s*[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?\s*$' THEN
        exact := written::numeric;
        RETURN CASE WHEN exact = 0 THEN 0 WHEN abs(exact) BETWEEN 1e-307 AND 1.7976931348623157e308 THEN exact::double precision END;
    END IF;
    RETURN CASE btrim(written) WHEN 'INF' THEN 'Infinity' WHEN '+INF' THEN 'Infinity' WHEN '-INF' THEN '-Infinity' WHEN 'NaN' THEN 'NaN' END;
END $$;

CREATE FUNCTION text_decimal(written text)
RETURNS numeric LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
SELECT CASE WHEN written ~ '^\s*[+-]?(\d{1,255}(\.\d{0,255})?|\.\d{1,255})\s*$' THEN written::numeric END;
END;

CREATE FUNCTION text_integer(written text)
RETURNS numeric LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
SELECT CASE WHEN written ~ '^\s*[+-]?\d{1,255}\s*$' THEN written::numeric END;
END;

CREATE FUNCTION text_boolean(written text)
RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
SELECT CASE WHEN btrim(written) IN ('true', '1') THEN true WHEN btrim(written) IN ('false', '0') THEN false END;
END;

CREATE FUNCTION text_local_time(written text)
RETURNS timestamp LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- The clock and calendar of a time or date as XML Schema writes it, in its own time zone; null for any other text.
DECLARE
    part text[] := regexp_match(written, '^\s*(\d{4,6})-(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])'
        '(?:T(?:([01]\d|2[0-3]):([0-5]\d):([0-5]\d(?:\.\d+)?)|(24:00:00(?:\.0+)?)))?(?:Z|[+-](?:0\d|1[0-4]):[0-5]\d)?\s*$');
    day date;
BEGIN
    IF part IS NULL OR part[1]::integer NOT BETWEEN 1 AND 200000 THEN
        RETURN NULL;
    END IF;
    day := make_date(part[1]::integer, part[2]::integer, 1) + (part[3]::integer - 1);
    IF extract(month FROM day) <> part[2]::integer THEN
        RETURN NULL;  -- such as 30 February
    END IF;
    RETURN day + make_interval(days => (part[7] IS NOT NULL)::integer, hours => coalesce(part[4], '0')::integer,
                               mins => coalesce(part[5], '0')::integer, secs => coalesce(part[6], '0')::double precision);
END $$;

CREATE FUNCTION text_zone(written text)
RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- The time zone of a time as XML Schema writes it; empty where it has none.
SELECT coalesce(substring(written FROM '(Z|[+-]\d\d:\d\d)\s*$'), '');
END;

CREATE FUNCTION text_time(written text)
RETURNS timestamptz LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- A time as XML Schema writes it; UTC where it has no time zone; null for any other text.
DECLARE
    zone text := semmap.text_zone(written);
BEGIN
    RETURN semmap.text_local_time(written) AT TIME ZONE 'UTC'
         - CASE WHEN zone IN ('', 'Z') THEN interval '0' ELSE zone::interval END;
END $$;

CREATE FUNCTION text_duration(written text, tag text)
RETURNS numeric[] LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- The months and seconds of a duration as XML Schema writes it; null for any other text or datatype.
DECLARE
    part text[] := regexp_match(written, '^\s*(-)?P(?=.)(?:(\d{1,9})Y)?(?:(\d{1,9})M)?(?:(\d{1,9})D)?'
        '(?:T(?=.)(?:(\d{1,9})H)?(?:(\d{1,9})M)?(?:(\d{1,9}(?:\.\d{1,20})?)S)?)?\s*$');
    kind text := substr(tag, length('http://www.w3.org/2001/XMLSchema#') + 1);
    months numeric := 12 * coalesce(part[2], '0')::numeric + coalesce(part[3], '0')::numeric;
    seconds numeric := 86400 * coalesce(part[4], '0')::numeric + 3600 * coalesce(part[5], '0')::numeric
        + 60 * coalesce(part[6], '0')::numeric + coalesce(part[7], '0')::numeric;
    has_months boolean := coalesce(part[2], part[3]) IS NOT NULL;
    has_seconds boolean := coalesce(part[4], part[5], part[6], part[7]) IS NOT NULL;
BEGIN
    IF part IS NULL OR NOT (has_months OR has_seconds) OR written ~ 'T\s*$' OR NOT (
        kind = 'duration' OR kind = 'dayTimeDuration' AND NOT has_months OR kind = 'yearMonthDuration' AND NOT has_seconds) THEN
        RETURN NULL;
    END IF;
    RETURN CASE WHEN part[1] IS NULL THEN ARRAY[months, seconds] ELSE ARRAY[-months, -seconds] END;
END $$;

CREATE FUNCTION rdf_duration(months numeric, seconds numeric, tag text)
RETURNS text LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- A duration as XML Schema writes it.
DECLARE
    m numeric := abs(months);
    s numeric := abs(trim_scale(seconds));
    written text := CASE WHEN m >= 12 THEN div(m, 12) || 'Y' ELSE '' END || CASE WHEN m % 12 > 0 THEN m % 12 || 'M' ELSE '' END
        || CASE WHEN s >= 86400 THEN div(s, 86400) || 'D' ELSE '' END || CASE WHEN s % 86400 > 0 THEN 'T' ELSE '' END
        || CASE WHEN s % 86400 >= 3600 THEN div(s % 86400, 3600) || 'H' ELSE '' END
        || CASE WHEN s % 3600 >= 60 THEN div(s % 3600, 60) || 'M' ELSE '' END
        || CASE WHEN s % 60 > 0 THEN trim_scale(s % 60) || 'S' ELSE '' END;
BEGIN
    RETURN CASE WHEN written <> '' THEN CASE WHEN least(months, seconds) < 0 THEN '-P' ELSE 'P' END || written
                WHEN tag = 'http://www.w3.org/2001/XMLSchema#yearMonthDuration' THEN 'P0M' ELSE 'PT0S' END;
END $$;

CREATE FUNCTION rdf_regex(written text, pattern text, flags text)
RETURNS boolean LANGUAGE plpgsql IMMUTABLE STRICT SET search_path = semmap, public, pg_temp AS $$
-- Whether a text has a part that a pattern matches; null for a wrong pattern or flag.
BEGIN
    RETURN regexp_like(written, pattern, flags);
EXCEPTION WHEN invalid_regular_expression OR invalid_parameter_value THEN
    RETURN NULL;
END $$;

CREATE FUNCTION rdf_replace(written text, pattern text, replacement text, flags text)
RETURNS text LANGUAGE plpgsql IMMUTABLE STRICT SET search_path = semmap, public, pg_temp AS $$
-- A text with others for the parts that a pattern matches; null for a wrong pattern or flag.
BEGIN
    RETURN regexp_replace(written, pattern, replacement, flags);
EXCEPTION WHEN invalid_regular_expression OR invalid_parameter_value THEN
    RETURN NULL;
END $$;

CREATE FUNCTION rdf_pattern(pattern text, flags text)
RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- A pattern of XPath as one of PostgreSQL: without the flags s and q, a dot matches no end of a line.
SELECT CASE WHEN flags ~ '[sq]' OR strpos(pattern, '.') = 0 THEN pattern ELSE (
    SELECT string_agg(CASE p[1] WHEN '.' THEN '[^\n]' ELSE p[1] END, '' ORDER BY n)
    FROM regexp_matches(pattern, '\\.|\[\^?\]?(?:\\.|[^]\\])*\]|.', 'g') WITH ORDINALITY AS piece (p, n)) END;
END;

CREATE FUNCTION rdf_number(value text, tag text)
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
SELECT CASE WHEN semmap.is_numeric_tag(tag) THEN semmap.text_number(value) END;
END;

CREATE FUNCTION rdf_boolean(value text, tag text)
RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- The effective boolean value (SPARQL 1.1, section 17.2.2).
SELECT CASE WHEN tag = 'http://www.w3.org/2001/XMLSchema#boolean' THEN coalesce(semmap.text_boolean(value), false)
            WHEN tag = 'http://www.w3.org/2001/XMLSchema#string' OR starts_with(tag, '@') THEN value <> ''
            WHEN semmap.is_numeric_tag(tag) THEN coalesce(semmap.text_number(value) NOT IN (0, 'NaN'), false) END;
END;

CREATE FUNCTION rdf_order(a text, a_tag text, b text, b_tag text)
RETURNS integer LANGUAGE plpgsql STABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- -1, 0 or 1 as the literal a is before, equal to or after the literal b by value; null where they have no order.
DECLARE
    x double precision;
    y double precision;
BEGIN
    IF semmap.is_numeric_tag(a_tag) AND semmap.is_numeric_tag(b_tag) THEN
        x := semmap.text_number(a);
        y := semmap.text_number(b);
        RETURN CASE WHEN x = 'NaN' OR y = 'NaN' THEN NULL ELSE sign(x - y)::integer END;
    ELSIF a_tag <> b_tag THEN
        RETURN NULL;
    ELSIF a_tag = 'http://www.w3.org/2001/XMLSchema#string' OR starts_with(a_tag, '@') THEN
        RETURN CASE WHEN a = b THEN 0 WHEN a COLLATE "C" < b COLLATE "C" THEN -1 ELSE 1 END;
    ELSIF a_tag IN ('http://www.w3.org/2001/XMLSchema#dateTime', 'http://www.w3.org/2001/XMLSchema#date') THEN
        RETURN CASE WHEN semmap.text_time(a) = semmap.text_time(b) THEN 0 WHEN semmap.text_time(a) < semmap.text_time(b) THEN -1
                    WHEN semmap.text_time(a) > semmap.text_time(b) THEN 1 END;
    ELSIF a_tag = 'http://www.w3.org/2001/XMLSchema#boolean' THEN
        RETURN semmap.text_boolean(a)::integer - semmap.text_boolean(b)::integer;
    ELSIF a_tag IN ('http://www.w3.org/2001/XMLSchema#dayTimeDuration', 'http://www.w3.org/2001/XMLSchema#yearMonthDuration') THEN
        RETURN CASE WHEN semmap.text_duration(a, a_tag) = semmap.text_duration(b, b_tag) THEN 0
                    WHEN semmap.text_duration(a, a_tag) < semmap.text_duration(b, b_tag) THEN -1
                    WHEN semmap.text_duration(a, a_tag) > semmap.text_duration(b, b_tag) THEN 1 END;
    END IF;
    RETURN NULL;
END $$;

CREATE FUNCTION rdf_is_valid(value text, tag text)
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- Whether a literal has a value that is known here.
SELECT CASE WHEN semmap.is_numeric_tag(tag) THEN semmap.text_number(value) IS NOT NULL
            WHEN tag = 'http://www.w3.org/2001/XMLSchema#boolean' THEN semmap.text_boolean(value) IS NOT NULL
            WHEN tag IN ('http://www.w3.org/2001/XMLSchema#dateTime', 'http://www.w3.org/2001/XMLSchema#date')
            THEN semmap.text_time(value) IS NOT NULL
            WHEN tag ~ '[dD]uration$' THEN semmap.text_duration(value, tag) IS NOT NULL
            ELSE tag = 'http://www.w3.org/2001/XMLSchema#string' END;
END;

CREATE FUNCTION rdf_equal(a text, a_tag text, b text, b_tag text)
RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- Whether two terms are equal by value (SPARQL 1.1, section 17.4.1.7); null for literals of which that is unknown.
SELECT CASE WHEN a_tag = b_tag AND a = b THEN NOT (semmap.is_numeric_tag(a_tag) AND a = 'NaN')
            WHEN a_tag IN ('I', 'B') OR b_tag IN ('I', 'B') THEN false
            WHEN semmap.rdf_order(a, a_tag, b, b_tag) IS NOT NULL THEN semmap.rdf_order(a, a_tag, b, b_tag) = 0
            WHEN a_tag ~ '[dD]uration$' AND b_tag ~ '[dD]uration$'
            THEN semmap.text_duration(a, a_tag) = semmap.text_duration(b, b_tag)
            WHEN starts_with(a_tag, '@') OR starts_with(b_tag, '@') THEN false
            WHEN (semmap.is_numeric_tag(a_tag) <> semmap.is_numeric_tag(b_tag) OR a_tag <> b_tag)
                 AND semmap.rdf_is_valid(a, a_tag) AND semmap.rdf_is_valid(b, b_tag) THEN false END;
END;

CREATE FUNCTION rdf_calculate_double(operator text, x double precision, y double precision)
RETURNS double precision LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- x + y, x - y, x * y or x / y as XPath has it: what is too large is infinite, what is too small is 0; null for a division by 0.
DECLARE
    usual boolean := (x = 0 OR abs(x) BETWEEN 1e-150 AND 1e150) AND (y = 0 OR abs(y) BETWEEN 1e-150 AND 1e150);
    finite boolean := abs(x) < 'Infinity' AND abs(y) < 'Infinity';
    exact numeric;
BEGIN
    IF operator = '/' AND y = 0 THEN
        RETURN NULL;
    ELSIF NOT usual AND finite THEN
        exact := CASE operator WHEN '+' THEN x::numeric + y::numeric WHEN '-' THEN x::numeric - y::numeric
                               WHEN '*' THEN x::numeric * y::numeric ELSE 0 END;
        IF operator = '/' THEN  -- numeric has few digits of a small quotient
            exact := ln(abs(x) + (x = 0)::integer) - ln(abs(y));
            IF x = 0 OR exact < -707 THEN
                RETURN 0;
            ELSIF exact > 709.7 THEN
                RETURN sign(x) * sign(y) * double precision 'Infinity';
            END IF;
            RETURN x / y;
        ELSIF abs(exact) > 1.7976931348623157e308 THEN
            RETURN CASE WHEN exact > 0 THEN 'Infinity' ELSE '-Infinity' END;
        ELSIF abs(exact) < 1e-307 THEN
            RETURN 0;
        END IF;
        RETURN exact::double precision;
    END IF;
    RETURN CASE operator WHEN '+' THEN x + y WHEN '-' THEN x - y WHEN '*' THEN x * y ELSE x / y END;
END $$;

CREATE FUNCTION rdf_total(large double precision, small double precision, number bigint)
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- A sum of doubles by a number, infinite where it is too large: `sum` of PostgreSQL is an error there, `avg` beyond 1e154.
-- `large` is the sum of 2^-60 of those beyond 1e280, `small` of the others; null for none.
SELECT CASE WHEN number = 0 THEN 0
            WHEN coalesce(large, 0) = 0 THEN
                CASE WHEN abs(small) < 1e-280 THEN semmap.rdf_calculate_double('/', small, number) ELSE coalesce(small, 0) / number END
            WHEN abs(part) <= 1.7976931348623157e308 / 1152921504606846976 THEN part * 1152921504606846976 / number
            ELSE part * 'Infinity' END
FROM (SELECT large + CASE WHEN abs(small) >= 1 THEN small / 1152921504606846976 ELSE 0 END AS part) p;
END;

CREATE FUNCTION rdf_calculate_time(operator text, a text, a_tag text, b text, b_tag text)
RETURNS text[] LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- The text and the tag of what XPath calculates from times and durations (XPath functions 3.1, 8.4 and 9.7): a time and a
-- duration, two times, two durations, a duration and a number; null for all else.
DECLARE
    xsd CONSTANT text := 'http://www.w3.org/2001/XMLSchema#';
    times CONSTANT text[] := ARRAY[xsd || 'dateTime', xsd || 'date'];
    kinds CONSTANT text[] := ARRAY[xsd || 'dayTimeDuration', xsd || 'yearMonthDuration'];
    moved timestamp;
    x numeric[] := semmap.text_duration(a, a_tag);
    y numeric[] := semmap.text_duration(b, b_tag);
    factor numeric;
    kind text;
BEGIN
    IF operator = '+' AND b_tag = ANY (times) AND x IS NOT NULL THEN
        RETURN semmap.rdf_calculate_time('+', b, b_tag, a, a_tag);
    ELSIF operator IN ('+', '-') AND a_tag = ANY (times) AND y IS NOT NULL THEN
        factor := CASE operator WHEN '+' THEN 1 ELSE -1 END;
        moved := semmap.text_local_time(a);
        IF extract(year FROM moved) + factor * (y[1] / 12 + y[2] / 31536000) NOT BETWEEN 2 AND 9998 THEN
            RETURN NULL;
        END IF;
        moved := moved + make_interval(months => (factor * y[1])::integer) + make_interval(secs => (factor * y[2])::double precision);
        RETURN ARRAY[CASE a_tag WHEN xsd || 'date' THEN to_char(moved, 'YYYY-MM-DD')
                     ELSE replace(to_char(moved, 'YYYY-MM-DD"T"HH24:MI:SS.US'), '.000000', '') END || semmap.text_zone(a), a_tag];
    ELSIF operator = '-' AND a_tag = b_tag AND a_tag = ANY (times) THEN
        RETURN ARRAY[semmap.rdf_duration(0, extract(epoch FROM semmap.text_time(a) - semmap.text_time(b)), kinds[1]), kinds[1]];
    ELSIF operator IN ('+', '-') AND x IS NOT NULL AND y IS NOT NULL THEN
        factor := CASE operator WHEN '+' THEN 1 ELSE -1 END;
        x := ARRAY[x[1] + factor * y[1], x[2] + factor * y[2]];
        IF x[1] * x[2] < 0 THEN
            RETURN NULL;  -- months and seconds of other signs are written in no way
        END IF;
        kind := CASE WHEN a_tag = b_tag THEN a_tag ELSE xsd || 'duration' END;
        RETURN ARRAY[semmap.rdf_duration(x[1], x[2], kind), kind];
    ELSIF operator = '*' AND b_tag = ANY (kinds) AND semmap.is_numeric_tag(a_tag) THEN
        RETURN semmap.rdf_calculate_time('*', b, b_tag, a, a_tag);
    ELSIF operator IN ('*', '/') AND a_tag = ANY (kinds) AND semmap.is_numeric_tag(b_tag) THEN
        factor := CASE WHEN abs(semmap.text_number(b)) < 1e9 THEN semmap.text_number(b)::numeric END;
        factor := CASE operator WHEN '*' THEN factor ELSE 1 / nullif(factor, 0) END;
        RETURN ARRAY[semmap.rdf_duration(floor(x[1] * factor + 0.5), round(x[2] * factor, 12), a_tag), a_tag];
    ELSIF operator = '/' AND a_tag = b_tag AND a_tag = ANY (kinds) THEN
        RETURN ARRAY[semmap.rdf_decimal((x[1] + x[2]) / nullif(y[1] + y[2], 0)), xsd || 'decimal'];
    END IF;
    RETURN NULL;
END $$;

CREATE FUNCTION rdf_calculate(operator text, a text, a_tag text, b text, b_tag text)
RETURNS text[] LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- The text and the tag of a + b, a - b, a * b or a / b; null for what has no such value, and for a division by zero.
DECLARE
    xsd CONSTANT text := 'http://www.w3.org/2001/XMLSchema#';
    x numeric;
    y numeric;
BEGIN
    IF NOT (semmap.is_numeric_tag(a_tag) AND semmap.is_numeric_tag(b_tag)) THEN
        RETURN semmap.rdf_calculate_time(operator, a, a_tag, b, b_tag);
    ELSIF a_tag IN (xsd || 'double', xsd || 'float') OR b_tag IN (xsd || 'double', xsd || 'float') THEN
        RETURN ARRAY[semmap.rdf_double(semmap.rdf_calculate_double(operator, semmap.text_number(a), semmap.text_number(b))),
                     xsd || CASE WHEN xsd || 'double' IN (a_tag, b_tag) THEN 'double' ELSE 'float' END];
    END IF;
    x := semmap.text_decimal(a);
    y := semmap.text_decimal(b);
    x := CASE operator WHEN '+' THEN x + y WHEN '-' THEN x - y WHEN '*' THEN x * y ELSE x / nullif(y, 0) END;
    IF x IS NULL THEN
        RETURN NULL;
    ELSIF operator <> '/' AND a_tag <> xsd || 'decimal' AND b_tag <> xsd || 'decimal' THEN
        RETURN ARRAY[x::text, xsd || 'integer'];
    END IF;
    RETURN ARRAY[semmap.rdf_decimal(x), xsd || 'decimal'];
END $$;

CREATE FUNCTION inference_changed()
RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path = semmap, public, pg_temp AS $$
-- The change log has the inferences, as it has statements. Copies of what was told are no news.
BEGIN
    IF coalesce(current_setting('semmap.dropping', true), '') <> ''
       OR NOT EXISTS (SELECT FROM touched WHERE NOT told) THEN
        RETURN NULL;
    END IF;
    IF (SELECT count(*) FROM (SELECT FROM touched WHERE NOT told LIMIT 201) first) > 200 THEN
        INSERT INTO semmap.change (map_id, what, entities)
            SELECT m.id, 'inferred', '{}' FROM semmap.map m WHERE m.id IN (SELECT map_id FROM touched WHERE NOT told);
        RETURN NULL;
    END IF;
    INSERT INTO semmap.change (map_id, what, entities, facts)
        SELECT t.map_id, 'inferred', '{}', jsonb_agg(jsonb_build_array(t.graph,
            coalesce(to_jsonb(t.subject), to_jsonb(t.subject_id)), t.predicate,
            coalesce(to_jsonb(t.object), to_jsonb(t.object_id)), t.tag))
        FROM touched t JOIN semmap.map m ON m.id = t.map_id WHERE NOT t.told GROUP BY t.map_id;
    RETURN NULL;
END $$;

CREATE TRIGGER inference_added AFTER INSERT ON inference REFERENCING NEW TABLE AS touched
    FOR EACH STATEMENT EXECUTE FUNCTION inference_changed();
CREATE TRIGGER inference_removed AFTER DELETE ON inference REFERENCING OLD TABLE AS touched
    FOR EACH STATEMENT EXECUTE FUNCTION inference_changed();
