-- A map of {objects} objects, 100 to a room of 10 x 10 m, ten muffins among them, each on a table of its
-- own. 600 object types below ten families; `furniture` has 200 subtypes. The triggers do their work.

INSERT INTO map (name) VALUES ('{name}');
SET semmap.map = '{name}';
SET LOCAL semmap.deriving = 'off';  -- all holders are given, as when a file is imported

INSERT INTO semantic_type (name)
    SELECT * FROM unnest(ARRAY['furniture', 'table', 'desk', 'muffin', 'ware', 'tool', 'kitchen']) t
    UNION ALL SELECT format('furniture_%s', i) FROM generate_series(1, 198) i
    UNION ALL SELECT format('ware_%s', i) FROM generate_series(1, 400) i
ON CONFLICT DO NOTHING;
INSERT INTO type_parent (type, parent)
    SELECT * FROM (VALUES ('furniture', 'object'), ('table', 'furniture'), ('desk', 'table'), ('ware', 'object'),
                          ('tool', 'ware'), ('muffin', 'ware'), ('kitchen', 'room')) v
    UNION ALL SELECT format('furniture_%s', i), 'furniture' FROM generate_series(1, 198) i
    UNION ALL SELECT format('ware_%s', i), CASE WHEN i % 2 = 0 THEN 'tool' ELSE 'ware' END FROM generate_series(1, 400) i
ON CONFLICT DO NOTHING;

CREATE TEMP TABLE base AS SELECT coalesce(max(id), 0) AS id FROM entity;

INSERT INTO model (digest, kind, triangles, closed, hull)
    SELECT '{name}', 'box', 12, true,
           (SELECT ST_Collect(ST_MakePoint(x, y, z))
            FROM (VALUES (-0.4), (0.4)) a (x), (VALUES (-0.4), (0.4)) b (y), (VALUES (0.0), (0.75)) c (z));
INSERT INTO chunk (model_id, number, geom)
    SELECT id, 0, prism_tin(ST_MakeEnvelope(-0.4, -0.4, 0.4, 0.4), 0, 0.75) FROM model WHERE digest = '{name}';

-- rooms: base+1 .. base+{rooms}; the objects follow, 100 to a room, the first five of them tables
INSERT INTO entity (id, map_id, kind, name, type)
    SELECT base.id + i, current_map(), 'room', format('room%s', i), CASE WHEN i % 50 = 0 THEN 'kitchen' ELSE 'room' END
    FROM base, generate_series(1, {rooms}) i;
INSERT INTO room (entity_id, ceiling) SELECT base.id + i, 2.5 FROM base, generate_series(1, {rooms}) i;
INSERT INTO placement (entity_id, pose)
    SELECT base.id + i, ARRAY[10.0 * (i % 100), 10.0 * (i / 100), 0, 0, 0, 0, 1] FROM base, generate_series(1, {rooms}) i;

-- In batches, which grow with the tables: the triggers keep the plans that fit the statistics of the first.
DO $$
DECLARE
    made integer := 0;
    batch integer;
BEGIN
WHILE made < {objects} LOOP
batch := least({objects} - made, 20000, greatest(made, 1000));
INSERT INTO entity (id, map_id, kind, name, type)
    SELECT base.id + {rooms} + i, current_map(), 'object', format('object%s', i),
           CASE WHEN i % 100 BETWEEN 1 AND 4 THEN 'table' WHEN i % 100 = 5 THEN 'desk'
                WHEN i % ({objects} / 10) = 50 THEN 'muffin'
                WHEN i % 100 <= 20 THEN format('furniture_%s', 1 + i % 198)
                ELSE format('ware_%s', 1 + i % 400) END
    FROM base, generate_series(made + 1, made + batch) i;
INSERT INTO entity_model (entity_id, model_id)
    SELECT base.id + {rooms} + i, m.id FROM base, generate_series(made + 1, made + batch) i, model m WHERE m.digest = '{name}';
INSERT INTO placement (entity_id, holder_id, pose)
    SELECT base.id + {rooms} + i,
           CASE WHEN i % 100 BETWEEN 1 AND 20 THEN base.id + 1 + (i - 1) / 100                -- stands in its room
                ELSE base.id + {rooms} + 100 * ((i - 1) / 100) + 1 + i % 5 END,               -- lies on a table there
           CASE WHEN i % 100 BETWEEN 1 AND 20 THEN ARRAY[0.45 * (i % 100), 0.9 * (i % 11), 0, 0, 0, 0, 1]
                ELSE ARRAY[0.01 * (i % 37), 0.01 * (i % 41), 0.75, 0, 0, 0, 1] END
    FROM base, generate_series(made + 1, made + batch) i;
made := made + batch;
IF made <= 100000 THEN
    ANALYZE entity, object_type, entity_model, entity_chunk, placement, world;
END IF;
END LOOP;
END $$;
SELECT setval(pg_get_serial_sequence('entity', 'id'), max(id)) FROM entity;
DROP TABLE base;
