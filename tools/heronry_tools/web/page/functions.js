// The functions of the system: what it is all about.

import { badge, byId, h, list, named, setText, WORDS } from "./dom.js";
import { stateOf, store } from "./store.js";
import * as details from "./details.js";

const WORST_FIRST = ["lost", "degraded", "served", "idle"];

// One row, until all of it is asked for.
export function begin() {
  const more = byId("functions-more");
  more.addEventListener("click", () => {
    const isOpen = byId("functions").classList.toggle("open");
    more.setAttribute("aria-expanded", String(isOpen));
    setText(more, isOpen ? "Less" : "All");
  });
}

export function show() {
  const { functions, t_ns } = store.snapshot;
  const wanted = Object.values(functions).filter((one) => one.wanted);
  const served = wanted.filter((one) => one.served);
  setText(byId("functions-count"), `${served.length} of ${wanted.length} wanted ones served`);
  const rows = Object.entries(functions).map(([name, one]) => ({ name, state: stateOf(one), text: text(one, t_ns) }));
  rows.sort((a, b) => WORST_FIRST.indexOf(a.state) - WORST_FIRST.indexOf(b.state));
  list(byId("functions"), rows, (row) => row.name, ({ name, state, text: said }) =>
    h("li", {}, h("button", {
      type: "button", class: `tile ${state}`, "data-function": name, "data-state": state, title: said,
      on: { click: () => details.open({ kind: "function", name }) },
    }, badge(state), h("b", {}, named(name)), h("small", {}, said))));
}

function text(one, t_ns) {
  const state = stateOf(one);
  if (!one.wanted) return "not wanted in this phase";
  if (state === "idle") return WORDS.idle;
  if (state === "lost") {
    const since = one.not_since_ns === null ? "" : ` · for ${Math.max(0, Math.floor((t_ns - one.not_since_ns) / 1e9))} s`;
    return `lost ← ${one.why_not ?? "no cause is known"}${since}`;
  }
  const silent = one.heard === false ? " · not heard on the bus" : "";
  const less = one.shortfalls.length ? ` · but ${one.shortfalls[0]}` : "";
  return `${one.mode ?? ""} · value ${one.value ?? "–"}${silent}${less}`;
}

