-- The object model of each entity, kept by triggers: by its visual mesh, else by its collision mesh.
CREATE TABLE entity_object (
    entity_id bigint PRIMARY KEY REFERENCES entity ON DELETE CASCADE,
    object_id bigint NOT NULL REFERENCES object_model ON DELETE CASCADE
);
CREATE INDEX entity_object_object ON entity_object (object_id);
