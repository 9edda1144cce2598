// Orders: only where the server takes them, and each after a question that names what it will cost. An order is sent as
// it stands here: {do, what, to}.

import { byId, h, listed } from "./dom.js";
import { post } from "./stream.js";
import { asPriorities, limitsNow, store } from "./store.js";

const MOST_PRIORITY = 32767;
const ORDERS = {
  fail: { word: ({ what }) => `Fail ${what}`, says: ({ what }) => `Plan without ${what}, whatever is heard of it?`, grave: true },
  clear: { word: ({ what }) => `Clear ${what}`, says: ({ what }) => `Count ${what} as working again?` },
  kill: { word: ({ what }) => `Kill ${what}`, says: ({ what }) => `Kill the process of ${what} (SIGKILL)?`, grave: true },
  restore: { word: ({ what }) => `Start ${what} again`, says: ({ what }) => `Start the process of ${what} again?` },
  unlock: {
    word: ({ what }) => `Unlock ${what}`, says: ({ what }) => `Let other tools write to ${what} for a while (NMT, SDO)?`, grave: true,
    cost: "No plan changes because of this order. A tool that writes to the PE meanwhile can stop what runs there; the planner cannot foresee that.",
  },
  phase: { word: ({ what }) => `Enter ${what}`, says: ({ what }) => `Enter the phase ${what}?` },
  priority: { word: ({ what }) => `Change ${what}`, says: ({ what, to }) => (to === null ? `Give ${what} the priority of the spec again?` : `Give ${what} the priority ${to}?`) },
  script: { word: () => "Fly the script", says: () => "Fly what this script makes of the running configuration, and hold it?", grave: true },
  release: { word: () => "Release", says: () => "Hold the script no longer, and seek the best plan again?" },
};
const OF_A_PE = ["kill", "restore", "unlock"];

const takes = (order) => store.facts.orders.includes(order);

function opener(order, text, act) {
  return h("button", { type: "button", class: ORDERS[order.do].grave ? "grave" : "", "data-order": [order.do, order.what].filter(Boolean).join(" "), on: { click: act ?? (() => ask(order)) } }, text ?? ORDERS[order.do].word(order));
}

// What can be done now. A PE that is declared failed may still live, one in quarantine is cleared though it works, and
// one that waits for a table is unlocked though it counts as down.
const standing = (element) => (element.startsWith("pe:") ? store.snapshot.pes[element.slice(3)]?.standing : undefined);
const isLatched = (element) => store.snapshot.faults.some((fault) => fault.element === element);
const NOW = {
  kill: (element) => standing(element) !== "down" || isLatched(element),
  restore: (element) => standing(element) === "down",
  unlock: () => true,
  fail: (element) => !isLatched(element),
  clear: (element) => isLatched(element) || standing(element) === "returning",
};

export function button(name, element) {
  if (!takes(name) || !NOW[name](element) || (OF_A_PE.includes(name) && !element.startsWith("pe:"))) return null;
  return opener({ do: name, what: element });
}

export function priorityButton(name) {
  return takes("priority") ? opener({ do: "priority", what: name }, "Priority …", () => askPriority(name)) : null;
}

export function begin() {
  if (takes("script")) byId("orders").append(opener({ do: "script" }, "Script …", askScript), opener({ do: "release" }, "Release the script"));
}

export function show() {
  const release = byId("orders").querySelector('[data-order="release"]');
  if (release) release.hidden = !["held", "asked"].includes(store.snapshot.script.state);
}

export function phaseChoice(now) {
  if (!takes("phase") || store.facts.phases.length < 2) return now;
  return h("select", {
    "aria-label": "Phase",
    on: {
      change: (event) => {
        const to = event.target.value;
        event.target.value = now;
        ask({ do: "phase", what: to });
      },
    },
  }, store.facts.phases.map((name) => h("option", { value: name, selected: name === now }, name)));
}

function askPriority(name) {
  const { priority } = store.snapshot.functions[name];
  const number = h("input", { type: "number", id: "order-priority", min: 0, max: MOST_PRIORITY, step: 1, value: priority, required: true });
  form(`The priority of ${name}`, [h("label", { htmlFor: "order-priority" }, `From 0 (not wanted) to ${MOST_PRIORITY}; now ${priority}`), number],
    () => ({ do: "priority", what: name, to: number.valueAsNumber }),
    h("button", { type: "button", on: { click: () => ask({ do: "priority", what: name, to: null }) } }, "As in the spec"));
}

function askScript() {
  const text = h("textarea", { id: "order-script", rows: 8, required: true, spellcheck: false });
  form("A script", [h("label", { htmlFor: "order-script" }, "Statements on modules and their wires, as of 'heronry pcs apply'"), text], () => ({ do: "script", what: text.value }));
}

// A dialog in which something is filled in first; what an order costs is asked next.
function form(title, fields, order, ...more) {
  const dialog = byId("confirm");
  const filled = h("form", { method: "dialog", class: "fill", on: { submit: (event) => { event.preventDefault(); ask(order()); } } },
    fields, h("div", { class: "bar" }, h("button", { type: "button", on: { click: () => dialog.close() } }, "Leave it"), more, h("button", { type: "submit", class: "main" }, "What would follow?")));
  dialog.replaceChildren(h("h2", { id: "confirm-title" }, title), filled);
  dialog.oncancel = null;
  if (!dialog.open) dialog.showModal();
}

// The question to the planner: what runs after an order. Null: no plan follows from it.
function question({ do: name, what, to }) {
  const { down, phase, modules } = store.snapshot;
  const priorities = { ...store.snapshot.priorities };
  const asked = { ask: "plan", down: down.filter((one) => one !== what), phase: name === "phase" ? what : phase };
  if (name === "fail" || name === "kill") asked.down.push(what);
  if (name === "priority") delete priorities[what];
  if (name === "priority" && to !== null) priorities[what] = to;
  Object.assign(asked, { priorities: asPriorities(priorities), limits: limitsNow(store.snapshot) });
  if (name === "script") Object.assign(asked, { ask: "script", script: what, modules: running(modules) });
  return name === "unlock" ? null : asked;
}

function running(modules) {
  const all = Object.entries(modules).filter(([, one]) => one.pe !== null);
  return Object.fromEntries(all.map(([name, one]) => [name, { pe: one.pe, mode: one.mode, inputs: one.wires }]));
}

async function ask(order) {
  const dialog = byId("confirm");
  const { word, says, grave, cost: known } = ORDERS[order.do];
  const cost = h("div", { "aria-live": "polite" }, h("p", { class: "muted" }, known ?? "The planner works out what that costs …"));
  const go = h("button", { type: "button", class: grave ? "grave" : "main", disabled: known === undefined }, word(order));
  const asking = new AbortController();
  const finish = () => {
    asking.abort();
    dialog.close();
  };
  go.addEventListener("click", async () => {
    finish();
    note(await post("/api/order", order).catch((error) => ({ done: false, sentence: error.message })));
  });
  dialog.replaceChildren(h("h2", { id: "confirm-title" }, says(order)), order.do === "script" ? h("pre", { class: "script", tabindex: "0", role: "region", "aria-label": "The script" }, order.what) : "", cost,
    h("div", { class: "bar" }, h("button", { type: "button", autofocus: true, on: { click: finish } }, "Leave it"), go));
  dialog.oncancel = () => asking.abort();
  if (!dialog.open) dialog.showModal();
  const asked = question(order);
  if (asked === null) return;
  try {
    const answer = await post("/api/ask", asked, asking.signal);
    cost.replaceChildren(...consequences(answer));
    go.disabled = order.do === "script" && !answer.plan;
  } catch (error) {
    if (error.name !== "AbortError") cost.replaceChildren(h("p", { class: "why" }, `What it costs is not known: ${error.message}`));
  }
}

export function consequences(answer) {
  if (!answer.plan) return [h("p", { class: "why" }, `What it costs is not known: ${answer.refused ?? answer.sentence}`)];
  const before = store.snapshot.functions;
  const lost = [], worse = [], gained = [];
  for (const [name, after] of Object.entries(answer.plan.functions)) {
    if (before[name].served && !after.served) lost.push(h("li", {}, h("b", {}, name), ` will be lost: ${after.why_not}`));
    else if (before[name].served && after.value < before[name].value) worse.push(h("li", {}, h("b", {}, name), ` will be served in mode ${after.mode}: value ${after.value} instead of ${before[name].value}`));
    else if (!before[name].served && after.served) gained.push(name);
  }
  return [
    lost.length ? h("ul", { class: "lost-list" }, lost) : h("p", {}, "No function will be lost."),
    worse.length ? h("ul", {}, worse) : null,
    gained.length ? h("p", {}, `Will be served again: ${listed(gained)}.`) : null,
  ].filter(Boolean);
}

function note(answer) {
  const banner = byId("note");
  banner.hidden = false;
  banner.className = `banner ${answer.done ? "note" : "stale"}`;
  banner.textContent = answer.sentence;
  setTimeout(() => { banner.hidden = true; }, 8000);
}
