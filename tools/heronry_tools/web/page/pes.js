// The processing elements, with what they have and what they run.

import { badge, byId, bytes, h, list, setText } from "./dom.js";
import { lateMoves, store } from "./store.js";
import * as details from "./details.js";
import * as operate from "./operate.js";

export function show() {
  const { pes, modules } = store.snapshot;
  const moves = lateMoves(store.snapshot);
  const up = Object.values(pes).filter((pe) => pe.standing === "up").length;
  setText(byId("pes-count"), `${up} of ${Object.keys(pes).length} up`);
  const rows = Object.entries(pes).map(([name, pe]) => ({
    name, standing: pe.standing, why: pe.why, cpu: pe.cpu, ram: pe.ram, flash: pe.flash,
    node: pe.node_id, restarts: pe.restarts, reboots: pe.reboots, incarnation: pe.incarnation,
    offered: store.offered[`pe:${name}`],
    modules: pe.modules.map((one) => [one, modules[one].mode, modules[one].degraded, moves[one] ?? null]),
  }));
  list(byId("pes"), rows, (row) => row.name, card);
}

function card(pe) {
  const extra = [
    `node ${pe.node}`,
    pe.incarnation === null ? null : `boot no. ${pe.incarnation}`,
    pe.restarts ? `${pe.restarts} module restart${pe.restarts > 1 ? "s" : ""}` : null,
    pe.reboots ? `${pe.reboots} reboot${pe.reboots > 1 ? "s" : ""} seen` : null,
  ].filter(Boolean);
  return h("li", { class: `card pe ${pe.standing}`, "data-pe": pe.name, "data-standing": pe.standing },
    h("header", {}, badge(pe.standing),
      h("button", { type: "button", class: "name", on: { click: () => details.open({ kind: "pe", name: pe.name }) } }, pe.name),
      h("small", {}, extra.join(" · ")),
      operate.button("kill", `pe:${pe.name}`, "Kill"), operate.button("start", `pe:${pe.name}`, "Start")),
    pe.why ? h("p", { class: "why" }, pe.why) : null,
    h("div", { class: "budgets" },
      budget("CPU", pe.cpu, (n) => `${(n / 1000).toFixed(2)}`),
      budget("RAM", pe.ram, bytes),
      budget("Flash", pe.flash, bytes)),
    h("div", { class: "modules" }, pe.modules.map(([name, mode, degraded, from]) => h("span", {
      class: `chip${degraded ? " degraded" : ""}${from ? " moved" : ""}`, title: `${name}: mode ${mode}`,
    }, from ? `${name} ← ${from}` : name, degraded ? " (D)" : ""))),
  );
}

function budget(name, one, write) {
  const id = `${name}: ${write(one.used)} of ${write(one.of)}`;
  return [h("span", {}, name),
    h("meter", { min: 0, max: Math.max(1, one.of), value: one.used, "aria-label": id }),
    h("span", {}, `${write(one.used)} / ${write(one.of)}`)];
}

