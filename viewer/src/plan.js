// YASGUI's view "Map": the geometries of an answer on the plan of the rooms, in the frame of the map.

import { isGeometry, partsOf } from "./geometries.js";
import { decoded } from "./link.js";
import { element } from "./panel.js";

const MOST_LABELS = 500;
const SCALE = 100; // pixels that the bar of the scale has at most
const MARGIN = 1.1;

export class Plan {
  static rooms = Promise.resolve([]); // solutions with the rooms' outlines, which lie below each answer
  label = "Map";
  priority = 5;

  constructor(yasr) {
    this.yasr = yasr;
  }

  canHandleResults() {
    return (this.yasr.results?.getBindings() ?? []).some((row) => Object.values(row).some(isGeometry));
  }

  getIcon() {
    return svg("svg", { viewBox: "0 0 16 16", width: 16 }, svg("path", { d: "M1 3l5-2 4 2 5-2v12l-5 2-4-2-5 2zM5.5 2v10h1V2zm4 1.5v11h1v-11z", "fill-rule": "evenodd" }));
  }

  async draw() {
    const rows = this.yasr.results.getBindings();
    const found = rows.flatMap((row) => shapes(row, this.yasr.getPrefixes()));
    const rooms = (await Plan.rooms).flatMap((row) => shapes(row, this.yasr.getPrefixes()));
    const drawn = found.filter(({ parts }) => parts?.length).map((each) => ({ ...each, box: extent([each]) }));
    const columns = [...new Set(drawn.map(({ name }) => name))];
    const size = ({ box: { width, height } }) => width * height;
    const below = drawn.toSorted((one, other) => size(other) - size(one)); // the largest
    const picture = svg("svg", { class: "plan", role: "img", "aria-label": `${drawn.length} geometries` });
    picture.append(
      ...rooms.filter(({ parts }) => parts).map((each) => shape(each, "room")),
      ...below.map((each) => shape(each, `shape column${columns.indexOf(each.name) % 4}`)),
      ...drawn.slice(0, MOST_LABELS).map(label),
    );
    const scale = element("span", { className: "scale" });
    const place = element("output");
    const left = found.length - drawn.length;
    const summary = `${drawn.length} geometries${left ? `; ${left} that are empty, in another reference system or of another kind are not drawn` : ""}`;
    const foot = element("p", { className: "foot" }, scale, place, element("span", {}, `${summary} · wheel: nearer · drag: move · double click: all`));
    this.yasr.resultsEl.append(picture, foot);
    this.view = new View(picture, scale, place, drawn.length ? drawn : rooms.filter(({ parts }) => parts));
  }

  destroy() {
    this.view?.end();
  }
}

// Each geometry of a solution, with the first of the other columns as its label, and all as its text.
function shapes(row, prefixes) {
  const others = Object.entries(row).filter(([, term]) => !isGeometry(term));
  const text = others.map(([name, term]) => `${name}: ${short(term, prefixes)}`).join("\n");
  const label = others.length ? short(others[0][1], prefixes) : "";
  return Object.entries(row)
    .filter(([, term]) => isGeometry(term))
    .map(([name, term]) => ({ name, text, label, parts: partsOf(term) }));
}

// A term with its prefix; an entity of the map by its name.
function short({ type, value }, prefixes) {
  if (type !== "uri") return value;
  const fitting = Object.entries(prefixes).filter(([, space]) => value.startsWith(space));
  if (!fitting.length) return value;
  const [prefix, space] = fitting.reduce((one, other) => (other[1].length > one[1].length ? other : one));
  return prefix ? `${prefix}:${value.slice(space.length)}` : decoded(value.slice(space.length));
}

function shape({ parts, text }, name) {
  const group = svg("g", { class: name }, svg("title", {}, text));
  for (const { kind, rings } of parts) {
    if (kind === "point") group.append(...rings.flat().map(([x, y]) => svg("circle", { cx: x, cy: -y })));
    else group.append(svg("path", { class: kind, d: rings.map((ring) => path(kind === "facets" ? upwards(ring) : ring, kind)).join("") }));
  }
  return group;
}

function path(ring, kind) {
  return ring.length ? `M${ring.map(([x, y]) => `${x} ${-y}`).join("L")}${kind === "line" ? "" : "Z"}` : "";
}

// A ring in counter-clockwise order, so that facets above each other do not leave holes.
function upwards(ring) {
  const twice = ring.reduce((sum, [x, y], i) => sum + x * ring[(i + 1) % ring.length][1] - y * ring[(i + 1) % ring.length][0], 0);
  return twice < 0 ? ring.toReversed() : ring;
}

function label({ box: { x, y, width, height }, label: text }) {
  return svg("text", { class: width || height ? "" : "above", x: x + width / 2, y: y + height / 2 }, text.length > 40 ? `${text.slice(0, 39)}…` : text);
}

// The rectangle around shapes, y downwards as in SVG.
function extent(all) {
  let [left, top, right, bottom] = [Infinity, Infinity, -Infinity, -Infinity];
  for (const { parts } of all) {
    for (const [x, y] of parts.flatMap(({ rings }) => rings.flat())) {
      [left, right] = [Math.min(left, x), Math.max(right, x)];
      [top, bottom] = [Math.min(top, -y), Math.max(bottom, -y)];
    }
  }
  return left > right ? { x: 0, y: 0, width: 0, height: 0 } : { x: left, y: top, width: right - left, height: bottom - top };
}

// What of the plan is seen: the wheel comes nearer, dragging moves, a double click shows all.
class View {
  constructor(picture, scale, place, all) {
    Object.assign(this, { picture, scale, place });
    const whole = extent(all);
    const show = () => {
      this.metres = Math.max((MARGIN * whole.width) / picture.clientWidth, (MARGIN * whole.height) / picture.clientHeight, 0.005);
      this.centre = [whole.x + whole.width / 2, whole.y + whole.height / 2];
      this.set();
    };
    picture.addEventListener("dblclick", show);
    picture.addEventListener("wheel", (event) => this.zoom(event), { passive: false });
    picture.addEventListener("pointerdown", (event) => picture.setPointerCapture(event.pointerId));
    picture.addEventListener("pointermove", (event) => this.point(event));
    const fit = () => picture.clientWidth && (this.centre ? this.set() : show()); // a tab behind others has no size
    fit();
    this.watch = new ResizeObserver(fit);
    this.watch.observe(picture);
  }

  end() {
    this.watch.disconnect();
  }

  // The place below the pointer, in metres, y downwards.
  at({ clientX, clientY }) {
    const { left, top, width, height } = this.picture.getBoundingClientRect();
    return [this.centre[0] + (clientX - left - width / 2) * this.metres, this.centre[1] + (clientY - top - height / 2) * this.metres];
  }

  zoom(event) {
    event.preventDefault();
    const at = this.at(event);
    const factor = Math.exp(event.deltaY / 500);
    this.metres *= factor;
    this.centre = this.centre.map((value, i) => at[i] + (value - at[i]) * factor);
    this.set();
  }

  point(event) {
    const [x, y] = this.at(event);
    this.place.value = `x ${x.toFixed(2)} m, y ${(-y).toFixed(2)} m`;
    if (!event.buttons) return;
    this.centre = [this.centre[0] - event.movementX * this.metres, this.centre[1] - event.movementY * this.metres];
    this.set();
  }

  set() {
    const { clientWidth: width, clientHeight: height } = this.picture;
    const [x, y] = this.centre;
    const m = this.metres;
    this.picture.setAttribute("viewBox", [x - (width * m) / 2, y - (height * m) / 2, width * m, height * m].join(" "));
    this.picture.style.setProperty("--pixel", `${m}px`);
    const most = SCALE * m;
    const power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].find((each) => each * power <= most) * power;
    this.scale.style.width = `${length / m}px`;
    this.scale.textContent = length < 1000 ? `${+length.toPrecision(1)} m` : `${length / 1000} km`;
    if (m !== this.decluttered) this.declutter();
  }

  // Of labels that overlap, show the first.
  declutter() {
    this.decluttered = this.metres;
    const kept = [];
    for (const text of this.picture.querySelectorAll("text")) {
      const box = text.getBoundingClientRect();
      const free = kept.every((other) => box.right < other.left || other.right < box.left || box.bottom < other.top || other.bottom < box.top);
      if (free) kept.push(box);
      text.classList.toggle("covered", !free);
    }
  }
}

function svg(tag, values, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [key, value] of Object.entries(values)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}
