// The query page: YASGUI for the SPARQL endpoint of one map, with its prefixes and questions of the documentation.

import Yasgui from "@zazuko/yasgui";
import "@zazuko/yasgui/build/yasgui.min.css";
import papers from "../../docs/questions.md?raw";
import twenty from "../../docs/twenty_questions.md?raw";
import { decoded, readLink, takeToken, writeLink } from "./link.js";
import { Maps, reason } from "./maps.js";
import { element } from "./panel.js";
import { Plan } from "./plan.js";
import "./query.css";

const OUTLINES = "SELECT ?room ?outline {\n    ?room a semmap:Room ; geo:hasDefaultGeometry/geo:asWKT ?outline\n}";
const { Yasqe, Yasr, Tab } = Yasgui;
const at = (id) => document.getElementById(id);

const link = readLink();
const maps = new Maps(takeToken());

async function start() {
  await maps.open(new URLSearchParams(location.search).get("map"));
  at("viewer").search = new URLSearchParams({ map: maps.name });
  at("map-name").textContent = `Query ${maps.name}`;
  document.title = `${maps.name}: query`;
  const prefixes = await (await maps.get("rdf/prefixes")).json();
  at("prefixes").append(...Object.entries(prefixes).flatMap(([name, space]) => [element("dt", {}, `${name}:`), element("dd", {}, space)]));
  Plan.rooms = solutions(OUTLINES).catch(() => []);
  const declared = (text) => declarations(text, prefixes) + text;
  await offer(examples(), declared);
  window.semmap.yasgui = open(prefixes, declared(OUTLINES));
}

// YASGUI, whose requests go to this map alone: a link sets the text of a query, and does not run it.
function open(prefixes, value) {
  Yasr.registerPlugin("map", Plan);
  Yasr.defaults.errorRenderers = [async ({ text }) => element("pre", { className: "errorMessage" }, reason(text))];
  const lines = Object.entries(prefixes).map(([name, space]) => `${name}: <${space}>`);
  Yasqe.forkAutocompleter("prefixes", { name: "map", get: lines, persistenceId: null });
  Object.assign(Yasqe.defaults, { autocompleters: ["variables", "map"], editorHeight: "190px" });
  Tab.prototype.getShareableLink = function () {
    return `${location.origin}${location.pathname}${location.search}#${new URLSearchParams({ query: this.getQuery() })}`;
  };
  const yasgui = new Yasgui(at("yasgui"), {
    persistenceId: `semmap ${maps.name}`,
    populateFromUrl: false,
    requestConfig: { endpoint: () => `${maps.at}rdf/sparql`, acceptHeaderGraph: "text/turtle" },
    yasqe: { value },
    yasr: { prefixes, maxPersistentResponseSize: 0 },
  });
  const known = new WeakSet();
  yasgui.on("queryBefore", (_, tab) => {
    at("note").value = "";
    const editor = tab.getYasqe();
    if (known.has(editor)) return;
    known.add(editor);
    // Headers of its settings YASGUI shows in the commands for cURL that it offers to share.
    editor.on("query", (_, request) => Object.entries(maps.headers).forEach(([key, value]) => request.headers.set(key, value)));
    editor.on("queryResponse", (_, answer) => (at("note").value = answer.headers?.get("Semmap-Note") ?? ""));
  });
  if (link.query) yasgui.addTab(true, { name: "Link", yasqe: { value: link.query } }, { avoidDuplicateTabs: true });
  writeLink({ query: "" });
  // An entity in a table leads to it in the viewer.
  at("yasgui").addEventListener("click", ({ target }) => {
    const name = target.closest(".yasr a.iri") && /^:(.*)/.exec(target.textContent)?.[1];
    if (name) location.assign(`${at("viewer").href}#${new URLSearchParams({ selected: decoded(name) })}`);
  });
  at("examples").addEventListener("change", ({ target }) => {
    const name = target.selectedOptions[0].text;
    const tab = yasgui.addTab(true, { name, yasqe: { value: target.value } }, { avoidDuplicateTabs: true });
    yasgui.selectTabId(tab.getId());
    tab.query().catch(() => {}); // the tab shows why
    target.value = "";
  });
  return yasgui;
}

// The questions in SPARQL of pages, by the chapter in which they are.
function examples() {
  return [twenty, papers].flatMap((page) =>
    page
      .split("\n## ")
      .slice(1)
      .map((chapter) => {
        const [title, ...parts] = chapter.split("\n### ");
        const questions = parts.map((part) => ({ question: part.split("\n")[0], text: /^```sparql\n(.*?)\n```$/ms.exec(part)?.[1] }));
        return { title: title.split("\n")[0], questions: questions.filter(({ text }) => text) };
      }),
  );
}

// The endpoint knows its prefixes, but YASGUI and other endpoints want them declared.
function declarations(text, prefixes) {
  const used = new Set([...text.matchAll(/(?<![\w:])(\w*):/g)].map(([, name]) => name));
  return Object.entries(prefixes).map(([name, space]) => (used.has(name) ? `PREFIX ${name}: <${space}>\n` : "")).join("");
}

// Offer the examples that name no entity which this map lacks.
async function offer(chapters, declared) {
  const named = ({ text }) => [...text.matchAll(/(?<![\w:])(:[A-Za-z][\w-]*)/g)].map(([, name]) => name);
  const names = new Set(chapters.flatMap(({ questions }) => questions.flatMap(named)));
  const rows = await solutions(`SELECT ?x ?name { VALUES ?x { ${[...names].join(" ")} } ?x semmap:name ?name }`);
  const here = new Set(rows.map(({ name }) => `:${name.value}`));
  for (const { title, questions } of chapters) {
    const fitting = questions.filter((each) => named(each).every((name) => here.has(name)));
    const options = fitting.map(({ question, text }) => element("option", { value: declared(text) }, question));
    if (options.length) at("examples").append(element("optgroup", { label: title }, ...options));
  }
}

async function solutions(text) {
  const reply = await maps.get(`rdf/sparql?${new URLSearchParams({ query: text })}`);
  return (await reply.json()).results.bindings;
}

window.semmap = { ready: start() };
window.semmap.ready.catch((error) => (at("note").value = error.message));
