// The dependency graph: the server has drawn it, and this file only sets classes and the texts of places.

import { badge, byId, h, LETTERS, list, named, WORDS } from "./dom.js";
import { get } from "./stream.js";
import { lateMoves, store } from "./store.js";
import * as details from "./details.js";

const STATES = ["served", "degraded", "lost", "idle", "dead"];
const WORST_FIRST = { lost: 4, served: 3, degraded: 3, idle: 1, dead: 0 };
const drawings = new Map(); // function or "" -> parts
let shown = "";
let zoom = null; // null: as wide as there is room, but legible; "fit": as wide as there is room
let redraw = () => {};

export function begin(show) {
  redraw = show;
  const select = byId("graph-function");
  select.append(h("option", { value: "" }, "all functions"), ...Object.keys(store.facts.functions).map((name) => h("option", { value: name }, name)));
  select.addEventListener("change", () => choose(select.value));
  byId("graph-larger").addEventListener("click", () => size(1.25));
  byId("graph-smaller").addEventListener("click", () => size(0.8));
  byId("graph-fit").addEventListener("click", () => size("fit"));
  const state = byId("table-state");
  state.append(h("option", { value: "" }, "every"), ...STATES.map((one) => h("option", { value: one }, WORDS[one])));
  state.addEventListener("change", show);
  byId("legend").append(...STATES.map((one) => h("li", {}, badge(one), WORDS[one])), h("li", {}, "bold: in use"));
  addEventListener("resize", () => fit(drawings.get(shown)));
  choose("");
}

export async function drawing(name) {
  const text = await (await get(`/api/graph?function=${encodeURIComponent(name)}`)).text();
  const svg = document.importNode(new DOMParser().parseFromString(text, "image/svg+xml").documentElement, true);
  svg.setAttribute("aria-label", name ? `What contributes to ${name}` : "The whole graph");
  const parts = { svg, nodes: [], edges: [], width: svg.viewBox.baseVal.width };
  for (const element of svg.querySelectorAll(".node")) {
    const key = element.dataset.key ?? element.dataset.again;
    const base = element.getAttribute("class");
    const place = base.includes("module") ? element.querySelector(".note") : null;
    place?.classList.add("place");
    if (place) place.textContent = "";
    parts.nodes.push({ key, element, base, place, title: element.querySelector("title"), cells: [...element.querySelectorAll(".cell")] });
    element.setAttribute("role", "button");
    element.setAttribute("tabindex", "-1");
  }
  for (const element of svg.querySelectorAll(".edge")) parts.edges.push({ element, keys: element.dataset.edges.split(" ") });
  return parts;
}

async function choose(name) {
  if (!drawings.has(name)) {
    const parts = await drawing(name);
    parts.svg.addEventListener("click", (event) => pick(event.target.closest(".node")));
    parts.svg.addEventListener("keydown", keys);
    parts.nodes[0]?.element.setAttribute("tabindex", "0");
    drawings.set(name, parts);
  }
  shown = name;
  byId("graph-function").value = name;
  byId("graph").replaceChildren(drawings.get(name).svg);
  fit(drawings.get(name));
  redraw();
}

// #/graph/FUNCTION shows what contributes to it.
export function opened(name) {
  if (name && name in store.facts.functions && name !== shown) choose(name);
}

function size(factor) {
  const parts = drawings.get(shown);
  const now = parts.svg.getBoundingClientRect().width / parts.width;
  zoom = factor === "fit" ? factor : Math.min(4, Math.max(0.15, now * factor));
  fit(parts);
}

function fit(parts) {
  if (!parts) return;
  const room = byId("graph").clientWidth;
  const whole = Math.min(1.15, room / parts.width);
  const scale = zoom === "fit" ? whole : (zoom ?? Math.max(whole, 0.7));
  parts.svg.style.width = `${Math.round(parts.width * scale)}px`;
  parts.svg.style.height = "auto";
}

function pick(element) {
  if (element) details.open(target(element.dataset.key ?? element.dataset.again));
}

export function target(key) {
  const cut = key.indexOf(":");
  return { kind: key.slice(0, cut), name: key.slice(cut + 1) };
}

// Arrow keys move the focus to the nearest symbol in that direction.
function keys(event) {
  const from = event.target.closest(".node");
  if (!from) return;
  if (event.key === "Enter" || event.key === " ") {
    event.preventDefault();
    pick(from);
    return;
  }
  const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  if (!way) return;
  event.preventDefault();
  const middle = (element) => {
    const box = element.querySelector(".body").getBoundingClientRect();
    return [box.x + box.width / 2, box.y + box.height / 2];
  };
  const [x, y] = middle(from);
  let best = null;
  for (const { element } of drawings.get(shown).nodes) {
    const [a, b] = middle(element);
    const along = (a - x) * way[0] + (b - y) * way[1];
    const across = Math.abs((a - x) * way[1]) + Math.abs((b - y) * way[0]);
    if (along > 4 && (!best || along + 3 * across < best.far)) best = { element, far: along + 3 * across };
  }
  if (!best) return;
  from.setAttribute("tabindex", "-1");
  best.element.setAttribute("tabindex", "0");
  best.element.focus();
}

// Colours a drawing: `live` is the graph of a snapshot, `modules` says where each module runs.
export function colour(parts, live, modules, moves = {}, picked = null) {
  for (const node of parts.nodes) {
    const state = live.nodes[node.key] ?? "idle";
    const name = node.key.startsWith("module:") ? node.key.slice(7) : null;
    const runs = name === null ? null : modules[name];
    const from = name === null ? undefined : moves[name];
    const mark = `${node.base} ${state}${from ? " moved" : ""}${picked === node.key ? " picked" : ""}`;
    if (node.mark !== mark) node.element.setAttribute("class", (node.mark = mark));
    node.cells.forEach((cell, number) => {
      const of = `cell ${live.cells[`${node.key}#${number}`] ?? ""}`;
      if (cell.getAttribute("class") !== of) cell.setAttribute("class", of);
    });
    const place = runs?.pe ? (from ? `${from} → ${runs.pe}` : `on ${runs.pe}`) : "";
    if (node.place && node.place.textContent !== place) node.place.textContent = place;
    const label = `${node.key.replace(":", " ")}, ${WORDS[state]}${place ? `, ${place}` : ""}`;
    if (node.label !== label) {
      node.label = label;
      node.element.setAttribute("aria-label", label);
      node.title.textContent = label;
    }
  }
  for (const edge of parts.edges) {
    let state = "dead";
    for (const key of edge.keys) {
      const one = live.edges[key] ?? "idle";
      if (WORST_FIRST[one] > WORST_FIRST[state]) state = one;
    }
    if (edge.state !== state) edge.element.setAttribute("class", `edge ${(edge.state = state)}`);
  }
}

export function show() {
  const snapshot = store.snapshot;
  const parts = drawings.get(shown);
  const picked = details.pickedKey();
  const moves = lateMoves(snapshot);
  if (parts) colour(parts, snapshot.graph, snapshot.modules, moves, picked);
  table(snapshot, picked);
}

function table(snapshot, picked) {
  const only = shown ? new Set(store.facts.contributing[shown]) : null;
  const state = byId("table-state").value;
  const rows = [];
  for (const { key, kind, label } of store.facts.symbols) {
    const live = snapshot.graph.nodes[key] ?? "idle";
    if ((only && !only.has(key)) || (state && live !== state)) continue;
    const name = key.slice(key.indexOf(":") + 1);
    const module = kind === "module" ? snapshot.modules[name] : null;
    const device = store.facts.devices[name];
    const where = module?.pe ? `${module.pe}, ${module.mode}` : device && key.startsWith("device:") ? `on ${device.pe}` : "";
    rows.push({ key, kind, name: key.startsWith("gate:") ? `${label} of ${name}` : name, live, where, picked: key === picked });
  }
  list(byId("symbols"), rows, (row) => row.key, (row) =>
    h("tr", { class: row.picked ? "picked" : "", "data-symbol": row.key, "data-state": row.live },
      h("td", {}, h("span", { class: `badge ${row.live}`, "aria-hidden": "true" }, LETTERS[row.live]), ` ${WORDS[row.live]}`),
      h("td", {}, h("button", { type: "button", on: { click: () => details.open(target(row.key)) } }, named(row.name)), h("small", { class: "muted" }, ` ${row.kind}`)),
      h("td", {}, row.where)));
}
