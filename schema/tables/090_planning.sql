-- docs/decisions/indexes_with_a_condition_that_is_always_true_and_keys_without_histograms.md
-- Settings for planning the joins of Figure 3 (object_type thrice, placement and entity_chunk twice each):
-- run in under a millisecond, they were weighed for four. A plan read 2,469 pages to weigh merge joins
-- that it never takes: the ends of each index of a column with a histogram. So the keys of these tables
-- have no histogram, and where one cannot be spared, no index that covers the whole table: each lookup
-- by a key implies the condition. What it costs: to read one of them whole and in order, they are sorted.

CREATE UNIQUE INDEX object_type_id ON object_type (id, type) INCLUDE (map_id, label) WHERE id IS NOT NULL;
CREATE INDEX placement_holder ON placement (holder_id) INCLUDE (entity_id) WHERE holder_id IS NOT NULL;
CREATE INDEX entity_chunk_entity ON entity_chunk (entity_id) INCLUDE (id) WHERE entity_id IS NOT NULL;

ALTER TABLE placement ALTER COLUMN entity_id SET STATISTICS 0;
ALTER TABLE entity_chunk ALTER COLUMN id SET STATISTICS 0;
-- At the default of 100, ten muffins among a million objects are estimated as thousands.
ALTER TABLE object_type ALTER COLUMN type SET STATISTICS 500;

-- They are looked up, seldom read through: parallel plans would be weighed each time, and seldom taken.
ALTER TABLE object_type SET (parallel_workers = 0);
ALTER TABLE placement SET (parallel_workers = 0);
ALTER TABLE entity_chunk SET (parallel_workers = 0);
