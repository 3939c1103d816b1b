-- Two interlinked data sets as one (Tosello et al., section III-D).

CREATE FUNCTION merged_records(of_links bigint)
RETURNS TABLE (resource integer, left_keys text[], right_keys text[], confidence double precision, properties jsonb)
LANGUAGE sql STABLE ROWS 1000 SET search_path = semmap, public, pg_temp AS $$
-- The resources of both data sets of a link set: linked records are one row, with all different values of a property.
-- Properties of the right data set have the names of those to which they correspond. Without links, resource is null.
WITH linked AS MATERIALIZED (
    SELECT l.left_key, l.right_key, l.resource, l.confidence FROM record_link l WHERE l.link_set_id = of_links
), renamed AS MATERIALIZED (
    SELECT c ->> 'right' AS old, c ->> 'left' AS new
    FROM link_set s, jsonb_array_elements(s.correspondences) c WHERE s.id = of_links
), member AS MATERIALIZED (
    SELECT true AS is_left, r.key, r.properties, l.resource
    FROM link_set s JOIN data_record r ON r.data_set_id = s.left_id
    LEFT JOIN (SELECT DISTINCT left_key, resource FROM linked) l ON l.left_key = r.key WHERE s.id = of_links
  UNION ALL
    SELECT false, r.key, r.properties, l.resource
    FROM link_set s JOIN data_record r ON r.data_set_id = s.right_id
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
