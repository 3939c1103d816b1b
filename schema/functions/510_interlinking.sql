-- Two interlinked data sets as one (Tosello et al., section III-D).

CREATE FUNCTION merged_records(of_links bigint)
RETURNS TABLE (resource integer, left_keys text[], right_keys text[], confidence double precision, properties jsonb)
LANGUAGE sql STABLE ROWS 1000 SET search_path = semmap, public, pg_temp SET enable_nestloop = off SET work_mem = '64MB' AS $$
-- The resources of both data sets of a link set: linked records are one row, with all different values of a property.
-- Properties of the right data set have the names of those to which they correspond. Without links, resource is null.
-- Sizes of the steps cannot be estimated: nested loops over them would take time by the square of the links.
WITH linked AS MATERIALIZED (
    SELECT l.left_key, l.right_key, l.resource, l.confidence FROM semmap.record_link l WHERE l.link_set_id = of_links
), renamed AS MATERIALIZED (
    SELECT c ->> 'right' AS old, c ->> 'left' AS new
    FROM semmap.link_set s, jsonb_array_elements(s.correspondences) c WHERE s.id = of_links
), member AS MATERIALIZED (
    SELECT true AS is_left, r.key, r.properties, l.resource
    FROM semmap.link_set s JOIN semmap.data_record r ON r.data_set_id = s.left_id
    LEFT JOIN (SELECT DISTINCT left_key, resource FROM linked) l ON l.left_key = r.key WHERE s.id = of_links
  UNION ALL
    SELECT false, r.key, r.properties, l.resource
    FROM semmap.link_set s JOIN semmap.data_record r ON r.data_set_id = s.right_id
    LEFT JOIN (SELECT DISTINCT right_key, resource FROM linked) l ON l.right_key = r.key WHERE s.id = of_links
), numbered AS MATERIALIZED (
    SELECT m.*, coalesce(m.resource, -row_number() OVER ()) AS place FROM member m
), property AS (
    SELECT v.place, jsonb_object_agg(v.name, v.found) AS properties
    FROM (SELECT n.place, coalesce(CASE WHEN NOT n.is_left THEN d.new END, p.key) AS name,
                 jsonb_agg(DISTINCT e.value) AS found
          FROM numbered n, jsonb_each(n.properties) p LEFT JOIN renamed d ON d.old = p.key, jsonb_array_elements(p.value) e
          GROUP BY 1, 2) v
    GROUP BY v.place
), resource AS (
    SELECT n.place, n.resource, array_agg(n.key ORDER BY n.key) FILTER (WHERE n.is_left) AS left_keys,
           array_agg(n.key ORDER BY n.key) FILTER (WHERE NOT n.is_left) AS right_keys
    FROM numbered n GROUP BY n.place, n.resource
), sure AS (
    SELECT l.resource, min(l.confidence) AS confidence FROM linked l GROUP BY l.resource
)
SELECT r.resource, coalesce(r.left_keys, '{}'), coalesce(r.right_keys, '{}'), s.confidence, coalesce(p.properties, '{}')
FROM resource r
LEFT JOIN property p ON p.place = r.place
LEFT JOIN sure s ON s.resource = r.resource
ORDER BY r.resource NULLS LAST, r.left_keys, r.right_keys
$$;

CREATE FUNCTION record_iri(data_set text, key text)
RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- The IRI of a record of a file, as links are written (`semmap.interlinking.same_as`).
SELECT CASE WHEN key ~ '^[A-Za-z][A-Za-z0-9+.-]*:' AND strpos(key, '/') > 0 THEN key
            ELSE 'urn:semmap:' || semmap.iri_encode(regexp_replace(regexp_replace(data_set, '^.*/', ''), '(.)\.[^.]*$', '\1'))
                 || ':' || semmap.iri_encode(key) END;
END;

CREATE FUNCTION same_as()
RETURNS TABLE (map_id integer, left_entity bigint, left_object bigint, left_iri text,
               right_entity bigint, right_object bigint, right_iri text)
LANGUAGE sql STABLE ROWS 1000 SET search_path = semmap, public, pg_temp AS $$
-- Records that describe the same resource: a record of a map is its entity, one of the stored models its object model,
-- and one of a file has an IRI. `map_id` is null where neither is an entity.
WITH linked AS MATERIALIZED (
    SELECT DISTINCT s.left_id, l.left_key, s.right_id, l.right_key FROM semmap.link_set s JOIN semmap.record_link l ON l.link_set_id = s.id
), record AS MATERIALIZED (
    SELECT k.set_id, k.key, e.map_id, e.id AS entity, o.id AS object,
           CASE WHEN d.name <> 'models' AND d.name !~ '^map ' THEN semmap.record_iri(d.name, k.key) END AS iri
    FROM (SELECT left_id AS set_id, left_key AS key FROM linked UNION SELECT right_id, right_key FROM linked) k
    JOIN semmap.data_set d ON d.id = k.set_id
    LEFT JOIN semmap.map m ON d.name = 'map ' || m.name
    LEFT JOIN semmap.entity e ON e.map_id = m.id AND e.name = k.key
    LEFT JOIN semmap.object_model o ON d.name = 'models' AND o.key = k.key
)
SELECT DISTINCT coalesce(a.map_id, b.map_id), a.entity, a.object, a.iri, b.entity, b.object, b.iri
FROM linked l JOIN record a ON a.set_id = l.left_id AND a.key = l.left_key
JOIN record b ON b.set_id = l.right_id AND b.key = l.right_key
WHERE a.map_id IS NULL OR b.map_id IS NULL OR a.map_id = b.map_id
$$;
