// The newest missions of the map as they run; a click shows the steps of one.

import { element } from "./panel.js";

const MOST = 5;
const OFTEN = 2000; // milliseconds between looks while a mission runs
const SELDOM = 10000;

export class Missions {
  // `mark` is called with the names in the steps of the mission that is shown.
  constructor(maps, section, mark) {
    Object.assign(this, { maps, section, mark, opened: null });
  }

  async follow() {
    let runs = false;
    try {
      runs = await this.look();
    } catch {
      // the page says itself that the server is away
    }
    setTimeout(() => this.follow(), runs ? OFTEN : SELDOM);
  }

  // Show the missions; whether one of them goes on.
  async look() {
    const all = await this.maps.ask("missions", {});
    this.steps = this.opened === null ? [] : await this.maps.ask("mission_steps", { mission: this.opened });
    this.section.hidden = all.length === 0;
    const items = all.slice(0, MOST).map((each) => this.item(each, each.id === this.opened ? this.steps : []));
    this.section.querySelector("ul").replaceChildren(...items);
    return all.some(({ state }) => state === "waiting" || state === "running");
  }

  item(mission, steps) {
    const { id, robot, goal, state, reason, done, planned, simulated } = mission;
    const count = done + planned;
    const text = `${robot}: ${goal}${simulated ? " (simulated)" : ""}`;
    const how = `${state}${reason ? `: ${reason}` : ""}, ${done} of ${count} steps`;
    const button = element("button", { type: "button" }, text, element("br"), element("small", {}, how));
    button.addEventListener("click", () => this.open(id === this.opened ? null : id));
    const list = steps.map((step) => {
      const failed = step.cause ? `: ${step.cause} ${step.message ?? ""}` : "";
      return element("li", { className: step.state }, `${step.action} ${step.arguments.join(" ")} ${failed}`);
    });
    return element("li", {}, button, ...(list.length ? [element("ol", {}, ...list)] : []));
  }

  async open(mission) {
    this.opened = mission;
    await this.look();
    this.mark([...new Set(this.steps.flatMap((step) => step.arguments))]);
  }
}
