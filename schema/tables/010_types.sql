-- The T-Box: semantic types and what subsumes them (Deeken et al., section 3.3, A2).

CREATE TABLE semantic_type (
    name    text PRIMARY KEY CHECK (name ~ '^[^\s].*$'),       -- lower snake case: dining_table
    label   text,
    iri     text UNIQUE,
    comment text,
    origin  text NOT NULL DEFAULT 'import' CHECK (origin IN ('schema', 'ontology', 'import')),
    typical_size double precision[]                            -- length (x), width (y), height (z), metres
            CHECK (cardinality(typical_size) = 3 AND 0 < ALL (typical_size) AND 'Infinity' > ALL (typical_size)),
    found_in   text[] NOT NULL DEFAULT '{}',                   -- types of places where such things are usually found
    keeps      double precision CHECK (keeps > 0 AND keeps < 'Infinity'),  -- how readily things are kept there, per area, to a table's
    functions  text[] NOT NULL DEFAULT '{}',                   -- what such things are used for: drinking
    properties jsonb NOT NULL DEFAULT '{}' CHECK (jsonb_typeof(properties) = 'object')  -- that entities of the type have by default
);

CREATE TABLE type_parent (
    type   text NOT NULL REFERENCES semantic_type ON UPDATE CASCADE ON DELETE CASCADE,
    parent text NOT NULL REFERENCES semantic_type ON UPDATE CASCADE ON DELETE CASCADE,
    PRIMARY KEY (type, parent),
    CHECK (type <> parent)
);

-- Every type with each of its supertypes, including itself. Maintained by triggers.
CREATE TABLE type_closure (
    sub   text NOT NULL,
    super text NOT NULL,
    PRIMARY KEY (sub, super)
);
CREATE INDEX type_closure_super ON type_closure (super, sub);

-- Which ontology files the T-Box was loaded from, and in which state.
CREATE TABLE ontology (
    name   text PRIMARY KEY,
    digest text NOT NULL
);

INSERT INTO semantic_type (name, label, origin) VALUES
    ('entity', 'Entity', 'schema'), ('room', 'Room', 'schema'), ('object', 'Object', 'schema'),
    ('region', 'Region', 'schema'), ('connector', 'Connector', 'schema'),
    ('elevator', 'Elevator', 'schema'), ('storey', 'Storey', 'schema'), ('agent', 'Agent', 'schema');
INSERT INTO type_parent (type, parent)
    SELECT name, 'entity' FROM semantic_type WHERE name <> 'entity';
INSERT INTO type_closure (sub, super)
    SELECT name, name FROM semantic_type UNION SELECT type, parent FROM type_parent;
