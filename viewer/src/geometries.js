// Geometry literals as parts that a plan draws: points, lines, and areas as rings, x and y in metres.

const KINDS = { POINT: "point", LINESTRING: "line", POLYGON: "area", TRIANGLE: "area", TIN: "facets", POLYHEDRALSURFACE: "facets" };
const LITERALS = new Map([
  ["wktLiteral", fromWkt],
  ["geoJSONLiteral", (text) => fromGeoJson(JSON.parse(text))],
  ["gmlLiteral", () => null],
]);

export function isGeometry(term) {
  return reader(term) !== undefined;
}

// The parts of a literal; null where it is in another reference system, or of a kind that is not drawn.
export function partsOf(term) {
  try {
    const parts = reader(term)(term.value);
    return parts.every(({ rings }) => rings.flat(2).every(Number.isFinite)) ? parts : null;
  } catch {
    return null;
  }
}

function reader({ type, datatype = "" }) {
  return type === "uri" ? undefined : LITERALS.get(/^http:\/\/www\.opengis\.net\/ont\/geosparql#(\w+)$/.exec(datatype)?.[1]);
}

// Each list of coordinates belongs to the last kind that is named before it.
function fromWkt(text) {
  if (text.trim().startsWith("<")) throw new Error("another reference system");
  const parts = [];
  for (const [, word, list] of text.matchAll(/([A-Z]+?)(?:ZM|Z|M)?\b|\(([^()]+)\)/gi)) {
    if (list) parts.at(-1).rings.push(list.split(",").map((point) => point.trim().split(/\s+/).slice(0, 2).map(Number)));
    else if (!/^(Z|M|EMPTY|GEOMETRYCOLLECTION)$/i.test(word)) parts.push({ kind: kindOf(word), rings: [] });
  }
  return parts.filter(({ rings }) => rings.length);
}

function fromGeoJson({ type, coordinates, geometries, crs }) {
  if (crs) throw new Error("another reference system");
  if (geometries) return geometries.flatMap(fromGeoJson);
  const depth = { Point: 0, MultiPoint: 1, LineString: 1, MultiLineString: 2, Polygon: 2, MultiPolygon: 3 }[type];
  const rings = [[[coordinates]], [coordinates], coordinates, depth > 2 && coordinates.flat()][depth];
  return [{ kind: kindOf(type), rings: rings.map((ring) => ring.map((point) => point.slice(0, 2))) }];
}

function kindOf(word) {
  const kind = KINDS[word.toUpperCase().replace(/^MULTI/, "")];
  if (!kind) throw new Error(`${word} is not drawn`);
  return kind;
}
