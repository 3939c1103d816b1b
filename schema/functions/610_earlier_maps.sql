-- Revision 0004 gave models outlines, and took the footprints that their hulls had.
SELECT reshape(ARRAY(SELECT entity_id FROM world w WHERE footprint IS NULL
                     AND EXISTS (SELECT FROM entity_model m WHERE m.entity_id = w.entity_id)));
