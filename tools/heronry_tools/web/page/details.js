// Everything that is known of one thing: what the spec says, what runs, and why something is not served.

import { ago, badge, byId, bytes, h, listed, percent, WORDS } from "./dom.js";
import { post } from "./stream.js";
import { stateOf, store } from "./store.js";
import * as operate from "./operate.js";
import * as plots from "./plots.js";

let picked = null;
let drawn = "";
let redraw = () => {};
let back = null; // where the focus was

export function begin(show) {
  redraw = show;
}

export function open(what) {
  back = document.activeElement;
  picked = what;
  drawn = "";
  redraw();
  requestAnimationFrame(() => byId("details").querySelector("h2")?.focus());
}

export function close() {
  if (!picked) return;
  picked = null;
  redraw();
  back?.focus?.();
}

export const pickedKey = () => (picked ? `${picked.kind}:${picked.name}` : null);

export function show() {
  const section = byId("details");
  section.hidden = picked === null;
  if (!picked) {
    if (drawn) section.replaceChildren();
    drawn = "";
    return;
  }
  const rows = (TELL[picked.kind] ?? nothing)(picked.name, store.snapshot, store.facts);
  const text = JSON.stringify([picked, rows, (rows.elements ?? []).map((element) => store.offered[element])]);
  if (text === drawn) return;
  const why = drawn && section.querySelector(".explained");
  drawn = text;
  const state = rows.state;
  section.replaceChildren(
    h("header", {}, h("h2", { id: "details-title", tabindex: "-1" }, state ? badge(state) : null, ` ${picked.kind} ${picked.name}`),
      h("button", { type: "button", class: "quiet", "aria-label": "Close", on: { click: close } }, "✕")),
    h("dl", {}, Object.entries(rows.facts).filter(([, value]) => value !== null && value !== undefined && value !== "")
      .map(([name, value]) => [h("dt", {}, name), h("dd", {}, String(value))])),
    h("div", { class: "group" }, rows.function ? h("a", { class: "button", href: `#/graph/${rows.function}` }, "Show in the graph") : null,
      rows.function ? h("button", { type: "button", on: { click: (event) => explain(rows.function, event.target) } }, "Why, and what would repair it") : null,
      (rows.plots ?? []).map(plots.link),
      picked.kind === "function" ? operate.priorityButton(picked.name) : null,
      (rows.elements ?? []).map(operate.buttons)),
    why || h("div", { class: "explained", "aria-live": "polite" }));
}

async function explain(name, button) {
  const into = byId("details").querySelector(".explained");
  into.replaceChildren(h("p", { class: "muted" }, "The planner is asked …"));
  button.disabled = true;
  const { down, phase } = store.snapshot;
  into.replaceChildren(...explanation(await post("/api/ask", { ask: "why", function: name, down, phase })));
  button.disabled = false;
}

export function explanation(answer) {
  if (!answer.why) return [h("p", { class: "why" }, answer.refused ?? answer.sentence)];
  const { why } = answer;
  const head = why.served ? (why.value < why.best_value ? `served in mode ${why.mode}: value ${why.value} instead of ${why.best_value}` : `served in its best mode, ${why.mode}`) : `not served: ${why.why_not}`;
  const repairs = why.repairs.map((one) => [...one.restore.map((element) => `${element} comes back`), ...one.add.map((more) => `${more.more} more ${more.kind} on ${more.name}`)].join(", and "));
  return [
    h("p", {}, head),
    why.shortfalls.length ? [h("p", { class: "muted" }, "less than the best, in it and upstream of it:"), h("ul", { class: "why-list" }, why.shortfalls.map((one) => h("li", {}, one)))] : null,
    why.reasons.length ? [h("p", { class: "muted" }, "because, all at once:"), h("ul", { class: "why-list" }, why.reasons.map((one) => h("li", {}, one.text)))] : null,
    repairs.length ? [h("p", { class: "muted" }, "repaired by any one of:"), h("ul", { class: "repairs" }, repairs.map((one) => h("li", {}, one)))] : null,
  ].flat().filter(Boolean);
}

const nothing = () => ({ facts: {} });
const live = (snapshot, key) => snapshot.graph.nodes[key] ?? "idle";

const TELL = {
  function: (name, snapshot, facts) => {
    const one = snapshot.functions[name];
    const state = stateOf(one);
    return {
      state,
      function: name,
      facts: {
        state: one.wanted ? WORDS[state] : "not wanted in this phase", why: one.why_not, "served by": facts.functions[name].outputs.filter((output) => snapshot.modules[output].pe).join(", "),
        mode: one.mode, value: one.value, "less than the best": one.shortfalls.join("; ") || null, criticality: one.criticality, priority: one.priority,
        "on the bus": one.heard === null ? null : one.heard ? "heard" : "not heard", "last output": ago(one.heard_ns, snapshot),
        "not served since": ago(one.not_since_ns, snapshot), "one of": facts.functions[name].outputs.join(", "),
      },
    };
  },
  pe: (name, snapshot, facts) => {
    const one = snapshot.pes[name];
    return {
      state: one.standing,
      elements: [`pe:${name}`],
      facts: {
        standing: WORDS[one.standing], why: one.why, "node-ID": one.node_id, buses: facts.pes[name].buses.join(", "), features: facts.pes[name].features.join(", "),
        "last heard": ago(one.last_heard_ns, snapshot), "number of its boot": one.incarnation, "reboots since this page's source began": one.reboots, "module restarts": one.restarts, epoch: one.epoch, runs: one.runs,
        "hears a manager": one.hears_manager === null ? null : one.hears_manager ? "yes" : "no", "CPU as measured": one.load_percent === null ? null : `${one.load_percent} %`,
        "CPU planned": `${one.cpu.used / 1000} of ${one.cpu.of / 1000} cores`, RAM: `${bytes(one.ram.used)} of ${bytes(one.ram.of)}`, flash: `${bytes(one.flash.used)} of ${bytes(one.flash.of)}`,
        modules: listed(one.modules), standstills: one.stood_still || null,
        "its agent in 10 s": one.cost && `${one.cost.wake_ups_per_s} wake-ups/s, ${one.cost.agent_per_mille / 10} % of a core, modules ${one.cost.modules_per_mille / 10} %, longest turn ${one.cost.longest_turn_us / 1000} ms`,
      },
    };
  },
  module: (name, snapshot, facts) => {
    const one = snapshot.modules[name];
    const of = facts.modules[name];
    const wires = Object.values(one.wires).map((wire) => `${wire.variable} version ${wire.version} from ${wire.producer}`);
    const serves = Object.keys(facts.functions).filter((each) => facts.functions[each].outputs.includes(name));
    return {
      state: live(snapshot, `module:${name}`),
      function: serves[0],
      elements: [`module:${name}`, ...snapshot.faults.map((fault) => fault.element).filter((one) => one.startsWith(`module:${name}@`))],
      plots: [...new Set(of.modes.flatMap((mode) => Object.keys(mode.gives)))],
      facts: {
        state: WORDS[live(snapshot, `module:${name}`)], "runs on": one.pe ?? "no PE", mode: one.mode, "why not": one.pe ? null : one.can_run ? "it could run, and is not chosen" : "it lacks what it needs: see the crossed symbols before it",
        wires: wires.join("; "), serves: serves.join(", "), failure: one.failure, restarts: one.restarts || null, device: of.device, "may run on": of.runs_on?.join(", "), image: of.image,
        ...Object.fromEntries(of.modes.map((mode) => [`mode ${mode.name}`, `needs ${mode.needs ?? "nothing"}; gives ${listed(Object.entries(mode.gives).map(([variable, version]) => `${variable} version ${version}`))}`])),
      },
    };
  },
  variable: (name, snapshot, facts) => {
    const of = facts.variables[name];
    const givers = of.given_by.map((giver) => `${giver.module} (${giver.mode}, version ${giver.version})${snapshot.modules[giver.module].mode === giver.mode ? ": now" : ""}`);
    const readers = Object.entries(snapshot.modules).filter(([, one]) => Object.values(one.wires).some((wire) => wire.variable === name)).map(([reader]) => reader);
    return { state: live(snapshot, `variable:${name}`), plots: [name], facts: { state: WORDS[live(snapshot, `variable:${name}`)], versions: of.versions, unit: of.unit, "given by": givers.join("; ") || "no module", "read by": listed(readers) } };
  },
  device: (name, snapshot, facts) => {
    const of = facts.devices[name];
    const fault = snapshot.faults.find((one) => one.element === `device:${name}`);
    const drivers = Object.entries(facts.modules).filter(([, module]) => module.device === name).map(([module]) => module);
    return {
      state: live(snapshot, `device:${name}`), elements: [`device:${name}`],
      facts: { state: WORDS[live(snapshot, `device:${name}`)], kind: of.kind, "connected to": of.pe, "its PE is": WORDS[snapshot.pes[of.pe].standing], fault: fault ? `latched, reported by ${fault.by}` : null, drivers: drivers.join(", ") },
    };
  },
  demux: (name, snapshot, facts) => {
    const of = facts.demuxes[name];
    const runs = of.branches.filter((branch) => snapshot.modules[branch].pe);
    return { state: live(snapshot, `demux:${name}`), facts: { state: WORDS[live(snapshot, `demux:${name}`)], input: of.variable, branches: of.branches.join(", "), "runs now": listed(runs) } };
  },
  gate: (name, snapshot, facts) => {
    const [module, mode] = name.split("/");
    const needs = facts.modules[module]?.modes.find((one) => one.name === mode)?.needs;
    return { state: live(snapshot, `gate:${name}`), facts: { state: WORDS[live(snapshot, `gate:${name}`)], "input of": `${module}, mode ${mode}`, "the whole need": needs } };
  },
  bus: (name, snapshot) => ({ elements: [`bus:${name}`], facts: { load: percent(snapshot.buses[name].load) } }),
};
