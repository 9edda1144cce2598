// Orders: only where the server takes them, and each after a question that names what it will cost.

import { byId, h, listed } from "./dom.js";
import { post } from "./stream.js";
import { store } from "./store.js";

const ORDERS = {
  fail: { word: "Fail", says: (what) => `Plan without ${what}, whatever is heard of it?`, grave: true },
  clear: { word: "Clear", says: (what) => `Count ${what} as working again?` },
  kill: { word: "Kill", says: (what) => `Kill the process of ${what} (SIGKILL)?`, grave: true },
  restore: { word: "Restore", says: (what) => `Start the process of ${what} again?` },
  phase: { word: "Enter", says: (what) => `Enter the phase ${what}?` },
};
const OF_A_PE = ["kill", "restore"];

export function button(order, element) {
  if (!store.facts.orders.includes(order) || (OF_A_PE.includes(order) && !element.startsWith("pe:"))) return null;
  const { word, grave } = ORDERS[order];
  return h("button", { type: "button", class: grave ? "grave" : "", "data-order": `${order} ${element}`, on: { click: () => ask(order, element) } }, `${word} ${element}`);
}

export function phaseChoice(now) {
  if (!store.facts.orders.includes("phase") || store.facts.phases.length < 2) return now;
  return h("select", {
    "aria-label": "Phase",
    on: {
      change: (event) => {
        const to = event.target.value;
        event.target.value = now;
        ask("phase", to);
      },
    },
  }, store.facts.phases.map((name) => h("option", { value: name, selected: name === now }, name)));
}

function situationAfter(order, what) {
  const { down, phase } = store.snapshot;
  if (order === "phase") return { down, phase: what };
  const without = down.filter((one) => one !== what);
  return { down: order === "fail" || order === "kill" ? [...without, what] : without, phase };
}

async function ask(order, what) {
  const dialog = byId("confirm");
  const { word, says, grave } = ORDERS[order];
  const cost = h("div", { "aria-live": "polite" }, h("p", { class: "muted" }, "The planner works out what that costs …"));
  const go = h("button", { type: "button", class: grave ? "grave" : "main", disabled: true }, order === "phase" ? `Enter ${what}` : `${word} ${what}`);
  const asking = new AbortController();
  const finish = () => {
    asking.abort();
    dialog.close();
  };
  go.addEventListener("click", async () => {
    finish();
    const answer = await post("/api/order", { do: order, what }).catch((error) => ({ done: false, sentence: error.message }));
    note(answer);
  });
  dialog.replaceChildren(h("h2", { id: "confirm-title" }, says(what)), cost, h("div", { class: "bar" }, h("button", { type: "button", autofocus: true, on: { click: finish } }, "Leave it"), go));
  dialog.oncancel = () => asking.abort();
  dialog.showModal();
  try {
    const priorities = Object.entries(store.snapshot.priorities).map(([name, number]) => `${name}=${number}`);
    const answer = await post("/api/ask", { ask: "plan", priorities, ...situationAfter(order, what) }, asking.signal);
    cost.replaceChildren(...consequences(answer));
    go.disabled = false;
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
