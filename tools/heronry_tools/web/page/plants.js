// The plants of the spec: whether the control loop through each is closed. Absent where the spec names none.

import { badge, byId, h, list, listed, setText } from "./dom.js";
import { store } from "./store.js";

const LOOPS = { on_path: "closed", open: "open", unmoved: "open", unseen: "open" };

export function show() {
  const plants = Object.entries(store.snapshot.plants);
  byId("plants-section").hidden = plants.length === 0;
  setText(byId("plants-count"), `${plants.filter(([, one]) => one.state === "on_path").length} of ${plants.length} closed`);
  const rows = plants.map(([name, one]) => ({ name, loop: LOOPS[one.state] ?? "unknown", why: one.why, of: store.facts.plants[name] }));
  list(byId("plants"), rows, (row) => row.name, ({ name, loop, why, of }) =>
    h("li", { class: `card pe ${loop === "open" ? "down" : loop === "closed" ? "" : "waiting"}`, "data-plant": name, "data-loop": loop },
      h("header", {}, badge(loop), h("b", {}, name), h("small", {}, `criticality ${of.criticality}`)),
      why ? h("p", { class: "why" }, why) : null,
      h("p", { class: "muted" }, `moved by ${listed(of.moved_by)} · seen by ${listed(of.seen_by)}`)));
}
