-- One placement per entity: its holder and its pose relative to the holder. This row is the inventory
-- and the frame at once, so they cannot disagree.

CREATE TABLE placement (
    entity_id  bigint PRIMARY KEY REFERENCES entity ON DELETE CASCADE,
    holder_id  bigint REFERENCES entity,                       -- the map itself where null
    pose       double precision[] NOT NULL DEFAULT '{0,0,0,0,0,0,1}',
    relation   text NOT NULL DEFAULT 'in' CHECK (relation IN ('in', 'on')),
    confidence double precision CHECK (confidence BETWEEN 0 AND 1),  -- of a holder derived from geometry; null: stated
    since      timestamptz NOT NULL DEFAULT statement_timestamp()
               CONSTRAINT placement_since_is_finite CHECK (isfinite(since)),
    CONSTRAINT placement_not_in_itself CHECK (holder_id <> entity_id),
    CONSTRAINT placement_pose_has_seven_finite_numbers CHECK (
        cardinality(pose) = 7 AND array_position(pose, NULL) IS NULL
        AND 'NaN' <> ALL (pose) AND 'Infinity' <> ALL (pose) AND '-Infinity' <> ALL (pose)),
    CONSTRAINT placement_pose_is_within_ten_thousand_kilometres CHECK (
        greatest(abs(pose[1]), abs(pose[2]), abs(pose[3])) <= 1e7),
    CONSTRAINT placement_quaternion_is_unit CHECK (
        abs(pose[4]*pose[4] + pose[5]*pose[5] + pose[6]*pose[6] + pose[7]*pose[7] - 1) < 1e-6)
) WITH (fillfactor = 80);

-- Where each entity is in the map's frame. Maintained by triggers, never written by hand.
CREATE TABLE world (
    entity_id bigint PRIMARY KEY REFERENCES placement ON DELETE CASCADE,
    map_id    integer NOT NULL,
    storey_id bigint,
    pose      double precision[] NOT NULL,
    box       geometry(LineStringZ, 0) NOT NULL,               -- from the lowest corner of its 3D box to the highest
    footprint geometry(MultiPolygon, 0)                        -- null without geometry
) WITH (fillfactor = 80);
CREATE INDEX world_box ON world USING gist (box gist_geometry_ops_nd);
CREATE INDEX world_flat ON world USING gist (box);             -- ten times as fast to query as the 3D one
CREATE INDEX world_footprint ON world USING gist (footprint);
CREATE INDEX world_storey ON world (storey_id);
