// The panel: search, the card of what is selected, routes, queries, storeys and layers.

const MOST_FOUND = 50;
const at = (id) => document.getElementById(id);

export class Panel {
  // `does` has what its controls call: select(name), route(values), where(values), query(values), costs(values), grasps(values), history(values), past(index), hide(name, hidden), apart(metres).
  constructor(does) {
    this.does = does;
    this.shown = new Map(); // the values of what is drawn, by its form
    at("search").addEventListener("input", () => this.search());
    at("search").addEventListener("keydown", (event) => {
      if (event.key === "Enter") at("found").querySelector("button")?.click();
    });
    for (const id of ["route", "where", "query", "costs"]) {
      at(id).addEventListener("submit", (event) => {
        event.preventDefault();
        const values = Object.fromEntries([...new FormData(event.target)].filter(([, value]) => value.trim()));
        if (FOLLOWED.has(id)) this.shown.set(id, values);
        answer(event.target.querySelector("output"), () => does[id](values));
      });
    }
    at("moment").addEventListener("input", (event) => does.past(Number(event.target.value)));
    at("apart").addEventListener("input", (event) => does.apart(Number(event.target.value)));
  }

  // Ask again for what is drawn, as the map has changed.
  async again() {
    for (const [id, values] of this.shown) {
      await answer(at(id).querySelector("output"), () => this.does[id](values), true);
    }
  }

  // So many moments can be gone back to; the last one is now.
  moments(count) {
    const slider = at("moment");
    const now = at("past").hidden || slider.value === slider.max;
    slider.max = count - 1;
    if (now) slider.value = slider.max;
    at("past").hidden = count < 2;
  }

  moment(text) {
    at("said").value = text;
  }

  note(text) {
    at("note").textContent = text;
  }

  say(text) {
    at("status").value = text;
  }

  // Show the names, storeys and layers of a scene.
  show(house, kinds) {
    at("map-name").textContent = document.title = house.scene.map;
    this.entities = [...house.entities.values()];
    at("names").replaceChildren(...this.entities.map((each) => element("option", { value: each.name })));
    const storeys = house.scene.storeys.map((storey) => storey.name).reverse();
    at("storeys").previousElementSibling.hidden = !storeys.length;
    at("storeys").replaceChildren(...storeys.map((name) => this.box(house, name)));
    at("kinds").replaceChildren(...kinds.map((name) => this.box(house, name)));
    at("apart").parentElement.hidden = storeys.length < 2;
    at("apart").value = house.apart;
    this.search();
  }

  box(house, name) {
    const box = element("input", { type: "checkbox", checked: !house.hidden.has(name), name });
    box.addEventListener("change", () => this.does.hide(name, !box.checked));
    return element("label", {}, box, ` ${name}`);
  }

  search() {
    const words = at("search").value.toLowerCase().split(/\s+/).filter(Boolean);
    const fits = (each) =>
      words.every((word) => `${each.name} ${each.type ?? ""} ${each.label ?? ""}`.toLowerCase().includes(word));
    const found = words.length ? this.entities.filter((each) => !each.removed && fits(each)) : [];
    at("found").replaceChildren(
      ...found.slice(0, MOST_FOUND).map((each) => {
        const button = element("button", { type: "button" }, `${each.name} `, element("small", {}, each.type ?? ""));
        button.addEventListener("click", () => this.does.select(each.name, true));
        return element("li", {}, button);
      }),
      ...(found.length > MOST_FOUND ? [element("li", {}, `and ${found.length - MOST_FOUND} more`)] : []),
      ...(words.length && !found.length ? [element("li", {}, "nothing has such a name or type")] : []),
    );
  }

  // Show what is known of an entity; null for none. `writes`: its name, type and state can be changed.
  card(told, writes = false) {
    at("card").hidden = told === null;
    if (told === null || this.typing(told.name)) return;
    const rows = Object.entries(told).filter(([key, value]) => !OMITTED.has(key) && text(value ?? "") !== "");
    const stated = Object.entries(told.properties ?? {}).map(([key, value]) => [key, [value].flat()]);
    const photos = stated.flatMap(([, values]) => values.filter(isPicture));
    const own = stated
      .map(([key, values]) => [key, values.filter((each) => !isPicture(each))])
      .filter(([, values]) => values.length);
    at("card").replaceChildren(
      element("h2", {}, told.name),
      ...photos.map((src) => element("img", { src, alt: `a picture of ${told.name}` })),
      list(rows),
      ...(own.length ? [element("details", {}, element("summary", {}, "properties"), list(own))] : []),
      ...ASKED.filter(({ kinds }) => kinds.includes(told.kind)).map((each) => this.asked(told.name, each)),
      ...(writes ? CHANGED.filter((key) => key in told && told[key] !== null).map((key) => this.field(key, told[key])) : []),
    );
  }

  // The user types in a field of this card: a change of the map does not take the field away.
  typing(name) {
    const { activeElement: field } = document;
    return (
      at("card").contains(field) && field.value !== field.defaultValue && at("card").querySelector("h2").textContent === name
    );
  }

  asked(name, { label, does }) {
    const button = element("button", { type: "button" }, label);
    const output = element("output");
    button.addEventListener("click", () => answer(output, () => this.does[does]({ name })));
    return element("p", {}, button, output);
  }

  field(key, value) {
    const input = element("input", { name: key, defaultValue: value });
    input.addEventListener("change", () => {
      input.defaultValue = input.value;
      this.does.change(key, input.value);
    });
    return element("label", {}, `new ${key} `, input);
  }
}

const ASKED = [
  { label: "Show grasps", does: "grasps", kinds: ["object"] },
  { label: "Where it probably is", does: "where", kinds: ["object", "agent"] },
  { label: "Where it has been", does: "history", kinds: ["object", "agent"] },
];
const CHANGED = ["name", "type", "state"];
const OMITTED = new Set(["name", "footprint", "box", "front", "models", "properties"]);

const FOLLOWED = new Set(["route", "costs"]);

// Show in an output what is answered, or why not; `again`, what it says is kept until then.
async function answer(output, ask, again = false) {
  if (!again) output.className = "";
  if (!again) output.value = "asking";
  try {
    output.value = await ask();
    output.className = "";
  } catch (error) {
    output.className = "wrong";
    output.value = error.message;
  }
}

function list(rows) {
  return element("dl", {}, ...rows.flatMap(([key, value]) => [element("dt", {}, key), element("dd", {}, linked(text(value)))]));
}

// Whether a value is a picture, not the address of one: nothing is loaded from other hosts.
function isPicture(value) {
  return /^data:image\/(png|jpeg|webp);base64,/.test(value);
}

// A text, as a link where it is the address of a page or file, such as a CAD drawing.
function linked(text) {
  return /^https?:\/\/\S+$/.test(text) ? element("a", { href: text, target: "_blank", rel: "noopener" }, text) : text;
}

function text(value) {
  if (Array.isArray(value)) return value.map(text).join(", ");
  if (typeof value === "number") return String(Math.round(value * 1000) / 1000);
  if (value && typeof value === "object") {
    return Object.entries(value).map(([key, each]) => `${key}: ${text(each)}`).join(", ");
  }
  return String(value);
}

export function element(tag, values, ...children) {
  const made = Object.assign(document.createElement(tag), values);
  made.append(...children);
  return made;
}
