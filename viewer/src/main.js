// The page: reads the map, shows it, follows its changes, and does what the panel asks.

import { House, LAYERS } from "./house.js";
import { Hand } from "./hand.js";
import { numbers, readLink, takeToken, writeLink } from "./link.js";
import { Maps } from "./maps.js";
import { Missions } from "./missions.js";
import { Panel } from "./panel.js";
import { Stage } from "./stage.js";

const MOST_TOLD = 20; // lines of a history or answer
const REREAD = 100; // milliseconds that changes are gathered before the scene is read again

const link = readLink();
const token = takeToken();
const maps = new Maps(token);
const canvas = document.getElementById("stage");
const stage = new Stage(canvas, document.getElementById("labels"), document.getElementById("panel"));
const house = new House(stage);
const panel = new Panel({ select, route, where, query, costs, grasps, history, past, hide, apart, change });
const hand = token ? new Hand(stage, house, tried) : null;
let selected = null;
let moments = [];
let wanted = null; // the past moment that is shown

async function read() {
  const [scene, meshes] = await Promise.all([
    maps.get("scene").then((reply) => reply.json()),
    maps.get("meshes.glb").then((reply) => reply.arrayBuffer()),
  ]);
  await house.show(scene, meshes);
  house.mark(selected ? [selected] : []);
  hand?.hold(house.entities.get(selected));
  panel.show(house, [...new Set(Object.values(LAYERS)), "ceilings", ...house.overlays.groups.map(({ name }) => name)]);
  const shapeless = scene.things.filter((thing) => thing.mesh === null).length;
  const notes = [
    scene.places.length ? "" : "The map has no rooms: semmap rooms find finds them in its walls.",
    shapeless ? `${shapeless} things have no shape and are not drawn.` : "",
  ];
  panel.note(notes.join(" ").trim());
  return scene;
}

async function start() {
  await maps.open(new URLSearchParams(location.search).get("map"));
  document.getElementById("query-page").search = new URLSearchParams({ map: maps.name });
  for (const each of (link.hidden ?? "ceilings").split(",").filter(Boolean)) house.hidden.add(each);
  house.apart = Number(link.apart) || 0;
  const scene = await read();
  moments = await (await maps.get("moments")).json();
  panel.moments(moments.length);
  const from = numbers(link.from, 3);
  const to = numbers(link.to, 3);
  if (from && to) {
    stage.camera.position.set(...from);
    stage.controls.target.set(...to);
    stage.controls.update();
  } else whole();
  stage.controls.addEventListener("end", remember);
  if (link.selected) await select(link.selected);
  new Missions(maps, document.getElementById("missions"), markKnown).follow();
  maps.follow(scene.cursor, hear, (text) => panel.say(text)).catch((error) => panel.say(error.message));
}

let waiting = null;
let stale = null;

function hear(event) {
  const [former, renamed] = event.values?.name ?? [];
  if (former === selected && renamed) {
    selected = renamed;
    writeLink({ selected });
  }
  if (!house.hear(event)) waiting ??= setTimeout(reread, REREAD);
  if (event.at > (moments.at(-1) ?? "")) panel.moments(moments.push(event.at));
  stale ??= setTimeout(again, 10 * REREAD);
  if (event.name !== selected) return;
  if (!renamed && !hand?.busy) hand?.hold(house.entities.get(selected));
  card();
}

async function again() {
  await panel.again();
  stale = null;
}

// Carry out a change; what the map refuses is shown as it is there.
async function tried(operation, values) {
  try {
    await maps.ask(operation, values);
    panel.say(`${operation.replace("_", " ")}: done`);
  } catch (error) {
    panel.say(error.message);
    await reread();
    throw error;
  }
}

// Change a value of what is selected: its name, type or state.
function change(key, value) {
  const entity = house.entities.get(selected);
  const { name, [key]: former } = entity;
  const back = key === "name" ? value : name;
  hand
    .act(`set_${key}`, { entity: name, value }, [`set_${key}`, { entity: back, value: former }], () => house.entities.get(back)?.[key] === value)
    .then(() => key === "name" || (entity[key] = value), card);
}

async function reread() {
  waiting = null;
  try {
    await read();
  } catch (error) {
    panel.say(error.message);
    waiting ??= setTimeout(reread, 10 * REREAD);
  }
}

async function select(of, near = false) {
  selected = house.entities.has(of) ? of : null;
  house.mark(selected ? [selected] : []);
  hand?.hold(house.entities.get(selected));
  writeLink({ selected: selected ?? "" });
  if (near && selected) {
    const box = house.box([selected]);
    if (!box.isEmpty()) stage.look(box.expandByScalar(1.5));
    remember();
  }
  await card();
}

async function card() {
  const asked = selected;
  if (asked === null) return panel.card(null);
  try {
    const told = await maps.ask("describe", wanted ? { name: asked, at: wanted } : { name: asked });
    const { state = null } = house.entities.get(asked);
    if (asked === selected) panel.card({ ...told, state }, hand !== null);
  } catch (error) {
    panel.card({ name: asked, error: error.message });
  }
}

async function route(values) {
  house.overlays.drawWays([]);
  const found = await maps.ask("route", values);
  const ways = await (await maps.get(`ways?${new URLSearchParams(values)}`)).json();
  house.overlays.drawWays(ways.map((way) => way.points));
  const doors = found.doors.map((door) => door.name).join(", ");
  const told = `${found.metres.toFixed(1)} m, ${found.seconds.toFixed(0)} s${doors ? ` through ${doors}` : ""}`;
  return found.assumed_body ? `${told}; ${found.assumed_body}` : told;
}

// Mark the places where something probably is by their probabilities.
async function where(values) {
  const { belief } = await maps.ask("where", values);
  house.mark(new Map(belief.map((each) => [each.place, Math.sqrt(each.probability)])));
  const likely = belief.filter((each) => each.probability >= 0.01);
  return likely.map((each) => `${each.place} ${Math.round(100 * each.probability)} %`).join(", ");
}

function markKnown(names) {
  const known = names.filter((name) => house.entities.has(name));
  house.mark(known);
  return known;
}

// Mark the entities of an answer, and draw its voxels.
async function query({ text, language }) {
  house.overlays.drawVoxels([], 0);
  if (language === "fields") return fields(text);
  const answer = await maps.ask(language, language === "sql" ? { statement: text } : { text });
  const known = markKnown((answer.rows ?? []).flat());
  if (!answer.rows) return JSON.stringify(answer);
  const told = `${answer.rows.length} answers, ${new Set(known).size} entities`;
  const values = answer.rows.slice(0, MOST_TOLD).map((row) => row.join(", "));
  return known.length || !values.length ? told : `${told}:\n${values.join("\n")}`;
}

async function fields(text) {
  const { size, sets, names, total, truth, left_out } = await (await maps.get(`voxels?${new URLSearchParams({ text })}`)).json();
  if (truth !== null) return truth ? "yes" : "no";
  house.overlays.drawVoxels(sets, size);
  markKnown(names);
  const drawn = sets.reduce((sum, { centres }) => sum + centres.length, 0);
  const unknown = left_out.length ? `; ${left_out.length} entities have no voxels` : "";
  return `${total} answers, ${drawn} voxels drawn${unknown}`;
}

// Where something has been, the newest first.
async function history({ name: entity }) {
  const versions = await maps.ask("history", { entity });
  const told = versions.reverse().map(({ begin, holder, pose }) => {
    const at = Object.values(pose).slice(0, 3).map((value) => value.toFixed(2)).join(", ");
    return `${new Date(begin).toLocaleString()}: ${holder ?? name} (${at})`;
  });
  return told.length > MOST_TOLD ? `${told.slice(0, MOST_TOLD).join("\n")}\nand ${told.length - MOST_TOLD} before` : told.join("\n");
}

// Draw the stored grasps of what is selected; who may write lets the server look for some first.
async function grasps({ name }) {
  if (token) await maps.ask("grasps", { name });
  const found = await (await maps.get(`grasps?${new URLSearchParams({ name })}`)).json();
  house.overlays.drawGrasps(found);
  return found.length ? `${found.length} grasps` : "no grasp is stored";
}

// Lay the costs of a robot on the floors, and again after changes.
async function costs(values) {
  const layers = await (await maps.get(`costs?${new URLSearchParams(values)}`)).json();
  await house.overlays.drawCosts(layers);
  const names = layers.map(({ storey, part }) => (part ? `${storey} ${part}` : storey));
  return `${names.join(", ")}, as of ${new Date().toLocaleTimeString()}`;
}

// Show where things were at the index-th moment; at the last one, where they are.
async function past(index) {
  wanted = index < moments.length - 1 ? moments[index] : null;
  hand?.hold(wanted ? undefined : house.entities.get(selected));
  panel.moment(wanted ? new Date(wanted).toLocaleString() : "now");
  card();
  if (wanted === null) return house.goTo(null);
  const asked = wanted;
  const { poses } = await (await maps.get(`poses?at=${encodeURIComponent(asked)}`)).json();
  if (asked === wanted) house.goTo(poses);
}

function hide(of, hidden) {
  if (hidden) house.hidden.add(of);
  else house.hidden.delete(of);
  house.arrange();
  writeLink({ hidden: [...house.hidden].join(",") || "," });
}

function apart(metres) {
  house.apart = metres;
  house.arrange();
  writeLink({ apart: metres || "" });
}

function whole() {
  stage.look(house.box());
}

function remember() {
  const short = (vector) => vector.toArray().map((value) => value.toFixed(2)).join(",");
  writeLink({ from: short(stage.camera.position), to: short(stage.controls.target) });
}

let down = null;
canvas.addEventListener("pointerdown", (event) => (down = event));
canvas.addEventListener("pointerup", (event) => {
  if (hand?.busy) return;
  if (down && Math.hypot(event.clientX - down.clientX, event.clientY - down.clientY) < 4) {
    select(house.met(stage.ray(event)) ?? null);
  }
});
addEventListener("keydown", (event) => {
  const writes = /input|textarea/i.test(event.target.tagName);
  if (event.key === "Escape") select(null);
  else if (writes) return;
  else if (event.key === "z" && (event.ctrlKey || event.metaKey)) {
    hand?.undo().then((text) => panel.say(text), () => {});
  } else if (event.key === "f") whole();
  else if (event.key === "/") {
    event.preventDefault();
    document.getElementById("search").focus();
  }
});

window.semmap = { hand, house, stage, ready: start() };
window.semmap.ready.catch((error) => panel.say(error.message));
