// What if: elements down or another phase, planned by the planner's own process. Nothing that flies is touched.

import { badge, byId, h, named, WORDS } from "./dom.js";
import { post } from "./stream.js";
import { asPriorities, limitsNow, store } from "./store.js";
import { colour, drawing } from "./graph.js";
import { explanation } from "./details.js";

const KINDS = { pe: "PEs", device: "Devices", bus: "Buses", channel: "Channels", module: "Modules" };
let asking = null;
let waiting = 0;
let parts = null;
let boxes = new Map();
let phase = null;

export function begin() {
  phase = h("select", { id: "what-if-phase" }, store.facts.phases.map((name) => h("option", { value: name }, name)));
  const form = byId("what-if-form");
  form.addEventListener("submit", (event) => event.preventDefault());
  form.append(
    h("p", { class: "muted" }, "Tick what is down. Changed priorities and limited links count as they are now. This is only planned: nothing that flies is touched."),
    h("div", { class: "bar" }, store.facts.phases.length ? h("label", {}, "Phase ", phase) : null,
      h("button", { type: "button", on: { click: asNow } }, "As it is now"), h("button", { type: "button", on: { click: () => set([]) } }, "Nothing down")));
  for (const [kind, title] of Object.entries(KINDS)) {
    const elements = store.facts.elements.filter((element) => element.startsWith(`${kind}:`));
    if (!elements.length) continue;
    form.append(h("details", { open: kind === "pe" }, h("summary", {}, title), h("fieldset", {}, h("legend", { class: "hidden-title" }, `${title} that are down`), elements.map(box))));
  }
  form.addEventListener("change", () => ask());
}

function box(element) {
  const input = h("input", { type: "checkbox", value: element });
  boxes.set(element, input);
  return h("label", {}, input, element.slice(element.indexOf(":") + 1));
}

function asNow() {
  if (store.snapshot.phase) phase.value = store.snapshot.phase;
  set(store.snapshot.down);
}

function set(down) {
  for (const [element, input] of boxes) input.checked = down.includes(element);
  ask();
}

export function opened() {
  post("/api/warm", {}).catch(() => {});
  if (!byId("what-if-answer").firstChild && store.snapshot) asNow();
}

export function show() {
  if (!byId("what-if-answer").firstChild) asNow();
}

const question = () => ({
  down: [...boxes].filter(([, input]) => input.checked).map(([element]) => element),
  phase: store.facts.phases.length ? phase.value : null,
});

async function ask() {
  asking?.abort();
  asking = new AbortController();
  const { signal } = asking;
  const number = (waiting += 1);
  const into = byId("what-if-answer");
  if (!into.firstChild) into.append(h("p", { class: "card muted" }, "The planner is asked …"));
  into.classList.add("busy");
  try {
    await new Promise((resolve) => setTimeout(resolve, 200));
    if (number !== waiting) return;
    const asked = question();
    const { snapshot } = store;
    asked.priorities = snapshot.priorities;
    const more = { priorities: asPriorities(snapshot.priorities), limits: limitsNow(snapshot) };
    const answer = await post("/api/ask", { ask: "plan", ...asked, ...more }, signal);
    parts ??= await drawing("");
    if (number === waiting) answered(into, asked, answer);
  } catch (error) {
    if (error.name !== "AbortError") into.replaceChildren(h("p", { class: "card why" }, error.message));
  } finally {
    if (number === waiting) into.classList.remove("busy");
  }
}

function answered(into, asked, answer) {
  if (!answer.plan) {
    into.replaceChildren(h("p", { class: "card why" }, answer.refused ?? answer.sentence));
    return;
  }
  const { plan, graph, shortfalls } = answer;
  colour(parts, graph, plan.modules);
  parts.svg.style.width = `${parts.width}px`;
  parts.svg.style.height = "auto";
  for (const { element } of parts.nodes) element.setAttribute("role", "img");
  const wanted = Object.entries(plan.functions).filter(([name]) => isWanted(name, asked));
  const served = wanted.filter(([, one]) => one.served).length;
  const rows = Object.entries(plan.functions).map(([name, one]) => functionRow(name, one, shortfalls[name], asked));
  into.replaceChildren(
    h("section", { class: "card" }, h("h3", {}, `${served} of ${wanted.length} wanted functions would be served`),
      h("table", { "data-plan": JSON.stringify(plan) }, h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "Function"), h("th", { scope: "col" }, "Then"), h("th", { scope: "col" }, "Now"), h("th", { scope: "col" }, "Why"))), h("tbody", {}, rows))),
    h("section", { class: "card" }, h("h3", {}, "Modules that would run elsewhere than now"), moves(plan.modules)),
    h("div", { class: "sheet", tabindex: "0", role: "region", "aria-label": "The graph as it would be" }, parts.svg));
}

const isWanted = (name, asked) => name in asked.priorities ? asked.priorities[name] > 0 : store.facts.functions[name].wanted_in.includes(asked.phase);

function functionRow(name, then, less, asked) {
  const now = store.snapshot.functions[name];
  const wanted = isWanted(name, asked);
  const isBest = !wanted || (then.served && then.value >= 100 && !less.length);
  const state = !wanted ? "idle" : then.served ? (isBest ? "served" : "degraded") : "lost";
  const into = h("div", { "aria-live": "polite" });
  const why = h("button", { type: "button", on: { click: async () => {
    why.disabled = true;
    into.replaceChildren(h("p", { class: "muted" }, "The planner is asked …"));
    into.replaceChildren(...explanation(await post("/api/ask", { ask: "why", function: name, down: asked.down, phase: asked.phase })));
    why.disabled = false;
  } } }, "Why?");
  return h("tr", { "data-what-if": name, "data-served": String(then.served), "data-state": state }, h("td", {}, named(name)),
    h("td", {}, badge(state), ` ${then.served ? `${then.mode}, value ${then.value}` : wanted ? "not served" : "not wanted"}`),
    h("td", {}, now.served ? `${now.mode}, value ${now.value}` : now.wanted ? WORDS.lost : "not wanted"), h("td", {}, wanted ? (then.why_not ?? less[0] ?? "") : "", " ", isBest ? null : why, into));
}

function moves(then) {
  const now = store.snapshot.modules;
  const found = [];
  for (const [name, one] of Object.entries(now)) {
    const to = then[name];
    if (!to && one.pe) found.push(h("span", { class: "chip lost" }, `${name} would stop`));
    else if (to && !one.pe) found.push(h("span", { class: "chip gained" }, `${name} would start on ${to.pe}`));
    else if (to && to.pe !== one.pe) found.push(h("span", { class: "chip moved" }, `${name}: ${one.pe} → ${to.pe}`));
    else if (to && to.mode !== one.mode) found.push(h("span", { class: "chip degraded" }, `${name}: ${one.mode} → ${to.mode}`));
  }
  return h("div", { class: "modules" }, found.length ? found : h("span", { class: "muted" }, "none: everything stays where it is"));
}
