// Orders: only where the server takes them, and each after a question that names what it will cost. An order is sent as
// it stands here: {do, what, to}.

import { byId, h, listed } from "./dom.js";
import { post } from "./stream.js";
import { asPriorities, limitsNow, store } from "./store.js";

const MOST_PRIORITY = 32767;
const takes = (order) => order in store.facts.orders;
const isOffered = (order) => store.offered[""]?.includes(order);
const filled = (text, { what, to }) => text.replace("{what}", what).replace("{to}", to);
const word = (order) => filled(store.facts.orders[order.do].word, order);

function question(order) {
  if (order.do === "priority" && order.to === null) return `Give ${order.what} the priority of the spec again?`;
  return filled(store.facts.orders[order.do].question, order);
}

function opener(order, text, act) {
  return h("button", { type: "button", "aria-label": text && !act ? word(order) : null, class: store.facts.orders[order.do].is_grave ? "grave" : "", "data-order": [order.do, order.what].filter(Boolean).join(" "), on: { click: act ?? (() => ask(order)) } }, text ?? word(order));
}

// The server says what can be done now.
export function button(name, element, text) {
  return store.offered[element]?.includes(name) ? opener({ do: name, what: element }, text) : null;
}

export const buttons = (element) => (store.offered[element] ?? []).map((name) => opener({ do: name, what: element }));

export function priorityButton(name) {
  return isOffered("priority") ? opener({ do: "priority", what: name }, "Priority …", () => askPriority(name)) : null;
}

export function begin() {
  if (takes("script")) byId("orders").append(opener({ do: "script" }, "Script …", askScript), opener({ do: "release" }, "Release the script"));
}

export function show() {
  const release = byId("orders").querySelector('[data-order="release"]');
  if (release) release.hidden = !isOffered("release");
}

export function phaseChoice(now) {
  if (!isOffered("phase")) return now;
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

// What the planner is asked: what runs after an order. Null: no plan follows from it.
function asked({ do: name, what, to }) {
  const { down, phase, modules } = store.snapshot;
  const priorities = { ...store.snapshot.priorities };
  const of = ["retire", "restore"].includes(name) ? store.facts.retired[what] : [what];
  const found = { ask: "plan", down: down.filter((one) => !of.includes(one)), phase: name === "phase" ? what : phase };
  if (["fail", "kill", "retire"].includes(name)) found.down.push(...of);
  if (name === "priority") delete priorities[what];
  if (name === "priority" && to !== null) priorities[what] = to;
  Object.assign(found, { priorities: asPriorities(priorities), limits: limitsNow(store.snapshot) });
  if (name === "script") Object.assign(found, { ask: "script", script: what, modules: running(modules) });
  return name === "unlock" ? null : found;
}

function running(modules) {
  const all = Object.entries(modules).filter(([, one]) => one.pe !== null);
  return Object.fromEntries(all.map(([name, one]) => [name, { pe: one.pe, mode: one.mode, inputs: one.wires }]));
}

async function ask(order) {
  const dialog = byId("confirm");
  const { is_grave: grave, cost: known } = store.facts.orders[order.do];
  const cost = h("div", { "aria-live": "polite" }, h("p", { class: "muted" }, known ?? "The planner works out what that costs …"));
  const go = h("button", { type: "button", class: grave ? "grave" : "main", disabled: known === null }, word(order));
  const asking = new AbortController();
  const finish = () => {
    asking.abort();
    dialog.close();
  };
  go.addEventListener("click", async () => {
    finish();
    note(await post("/api/order", order).catch((error) => ({ done: false, sentence: error.message })));
  });
  dialog.replaceChildren(h("h2", { id: "confirm-title" }, question(order)), order.do === "script" ? h("pre", { class: "script", tabindex: "0", role: "region", "aria-label": "The script" }, order.what) : "", cost,
    h("div", { class: "bar" }, h("button", { type: "button", autofocus: true, on: { click: finish } }, "Leave it"), go));
  dialog.oncancel = () => asking.abort();
  if (!dialog.open) dialog.showModal();
  const plan = asked(order);
  if (plan === null) return;
  try {
    const answer = await post("/api/ask", plan, asking.signal);
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
    else if (before[name].served && !before[name].shortfalls.length && answer.shortfalls[name].length) worse.push(h("li", {}, h("b", {}, name), ` will be served with less than the best: ${answer.shortfalls[name][0]}`));
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
