-- What follows from the facts of a map by its ontology, and what its facts must conform to.

-- The maps that are reasoned about. Without a row, a map has no inferences.
CREATE TABLE reasoning (
    map_id     integer PRIMARY KEY REFERENCES map ON DELETE CASCADE,
    axioms     text NOT NULL,                                  -- digest of the ontology that the inferences follow from
    cursor     text NOT NULL,                                  -- the changes that they consider
    at         timestamptz NOT NULL DEFAULT clock_timestamp(), -- when they were last brought up to date
    properties text[] NOT NULL DEFAULT '{}',                   -- properties with inferences,
    classes    text[] NOT NULL DEFAULT '{}',                   -- and classes: queries on others need not look for them
    inferences     bigint NOT NULL DEFAULT 0,                  -- how many there are,
    contradictions bigint NOT NULL DEFAULT 0                   -- and of these, how many contradictions
);

-- The facts that rules are about: copies of those that are told, by which a change is found, and inferences.
-- There is no foreign key to entities: what follows from an entity is retracted after it was deleted.
CREATE TABLE inference (
    map_id     integer NOT NULL REFERENCES reasoning ON DELETE CASCADE,
    subject_id bigint,                                         -- an entity of the map,
    subject    text,                                           -- or any other IRI
    predicate  text NOT NULL,                                  -- IRI
    object_id  bigint,                                         -- an entity of the map,
    object     text,                                           -- or the text of any other term
    tag        text,                                           -- of that term: I for an IRI, @ and a language, or the datatype
    told       boolean NOT NULL,
    CONSTRAINT inference_has_one_subject CHECK (num_nonnulls(subject_id, subject) = 1),
    CONSTRAINT inference_has_one_object CHECK (num_nonnulls(object_id, object) = 1 AND (object IS NULL) = (tag IS NULL))
);
CREATE INDEX inference_subject_id ON inference (subject_id, predicate) WHERE subject_id IS NOT NULL;
CREATE INDEX inference_object_id ON inference (object_id, predicate) WHERE object_id IS NOT NULL;
CREATE INDEX inference_subject ON inference (map_id, subject, predicate) WHERE subject IS NOT NULL;
CREATE INDEX inference_object ON inference (map_id, md5(object), predicate) WHERE object IS NOT NULL;
CREATE INDEX inference_predicate ON inference (map_id, predicate, object) WHERE NOT told AND tag = 'I';

-- SHACL shapes that an update must not break.
CREATE TABLE binding_shapes (
    map_id integer NOT NULL REFERENCES map ON DELETE CASCADE,
    name   text NOT NULL CHECK (name <> ''),
    turtle text NOT NULL,
    at     timestamptz NOT NULL DEFAULT clock_timestamp(),
    PRIMARY KEY (map_id, name)
);
