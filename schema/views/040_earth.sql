-- Maps with a georeference, on the earth: the same footprints in longitude and latitude.

CREATE VIEW gis_earth AS
    SELECT e.id AS fid, m.name AS map, s.name AS storey, e.kind, e.name, e.type,
           on_earth(ST_Force2D(coalesce(placed_section(c.outline, w.pose), w.footprint)), e.map_id)::geometry(MultiPolygon, 4326) AS geom
    FROM entity e JOIN map m ON m.id = e.map_id AND m.crs IS NOT NULL
    JOIN world w ON w.entity_id = e.id LEFT JOIN entity s ON s.id = w.storey_id LEFT JOIN section c ON c.entity_id = e.id
    WHERE w.footprint IS NOT NULL;
