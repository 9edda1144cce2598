// The dependency graph, folded (folded.js) or with every symbol: the server has drawn that one, and this file only sets
// classes and the texts of places. Both are moved by dragging and scrolling, and sized by the buttons and by two fingers.

import { badge, byId, h, LETTERS, list, named, WORDS } from "./dom.js";
import { get } from "./stream.js";
import { lateMoves, store } from "./store.js";
import * as details from "./details.js";
import { folded } from "./folded.js";

const STATES = ["served", "degraded", "lost", "idle", "dead"];
const WORST_FIRST = { lost: 4, served: 3, degraded: 3, idle: 1, dead: 0 };
const LEGIBLE = 1; // the least size that is offered first: no text is below 11 px
const drawings = new Map(); // function or "" -> parts of the drawing of every symbol
const folds = new Map(); // function or "" -> the folded drawing
let shown = "";
let isWhole = false; // every symbol is drawn
let zoom = null; // null: as wide as there is room, but legible; "fit": all of it
let redraw = () => {};

export function begin(show) {
  redraw = show;
  const select = byId("graph-function");
  select.append(h("option", { value: "" }, "overview"), ...Object.keys(store.facts.functions).map((name) => h("option", { value: name }, name)));
  select.addEventListener("change", () => choose(select.value));
  byId("graph-larger").addEventListener("click", () => size(1.25));
  byId("graph-smaller").addEventListener("click", () => size(0.8));
  byId("graph-fit").addEventListener("click", () => size("fit"));
  byId("graph-symbols").addEventListener("change", (event) => {
    isWhole = event.target.checked;
    zoom = null;
    choose(shown);
  });
  byId("table").addEventListener("toggle", show);
  pinch(byId("graph"));
  const state = byId("table-state");
  state.append(h("option", { value: "" }, "every"), ...STATES.map((one) => h("option", { value: one }, WORDS[one])));
  state.addEventListener("change", show);
  byId("legend").append(...STATES.map((one) => h("li", {}, badge(one), WORDS[one])), h("li", {}, "bold: in use"));
  addEventListener("resize", fit);
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
  shown = name;
  byId("graph-function").value = name;
  if (isWhole && !drawings.has(name)) {
    const parts = await drawing(name);
    parts.svg.addEventListener("click", (event) => pick(event.target.closest(".node")));
    parts.svg.addEventListener("keydown", keys);
    parts.nodes[0]?.element.setAttribute("tabindex", "0");
    drawings.set(name, parts);
    if (shown !== name) return;
  }
  if (!isWhole && !folds.has(name)) folds.set(name, folded(name, choose));
  byId("graph").replaceChildren(isWhole ? drawings.get(name).svg : folds.get(name).element);
  redraw();
  fit();
}

// #/graph/FUNCTION shows what contributes to it.
export function opened(name) {
  if (name && name in store.facts.functions && name !== shown) choose(name);
  else fit();
}

const part = () => (isWhole ? drawings.get(shown)?.svg : folds.get(shown)?.element);

// The width and height that a drawing has at the size 1.
function natural(element) {
  if (isWhole) return [element.viewBox.baseVal.width, element.viewBox.baseVal.height];
  element.style.zoom = "1";
  return [element.scrollWidth, element.scrollHeight];
}

let scale = 1;

function size(factor) {
  zoom = factor === "fit" ? factor : Math.min(4, Math.max(0.15, scale * factor));
  fit();
}

function fit() {
  const element = part();
  if (!element || byId("panel-graph").hidden) return;
  const room = byId("graph");
  const [width, height] = natural(element);
  const most = Math.min(room.clientWidth / width, (parseFloat(getComputedStyle(room).maxHeight) || height) / height);
  const first = isWhole ? Math.max(Math.min(1.15, room.clientWidth / width), LEGIBLE) : LEGIBLE;
  scale = zoom === "fit" ? Math.min(1.15, most) : (zoom ?? first);
  if (isWhole) {
    element.style.width = `${Math.floor(width * scale)}px`;
    element.style.height = "auto";
  } else element.style.zoom = String(scale);
}

// Two fingers change the size; one moves what is shown, as the browser does it anyway.
function pinch(room) {
  const fingers = new Map();
  let apart = 0, began = 1;
  const distance = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  room.addEventListener("pointerdown", (event) => {
    if (event.pointerType !== "touch") return;
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (fingers.size === 2) [apart, began] = [distance(), scale];
  });
  room.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (fingers.size === 2 && apart > 0) {
      zoom = Math.min(4, Math.max(0.15, (began * distance()) / apart));
      fit();
    }
  });
  for (const end of ["pointerup", "pointercancel"]) room.addEventListener(end, (event) => fingers.delete(event.pointerId));
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
    const place = runs?.pe ? (from ? `${from} → ${runs.pe}` : `on ${runs.pe}`) : ["dead", "lost"].includes(state) ? `× ${WORDS[state]}` : "";
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
  const picked = details.pickedKey();
  if (!isWhole) folds.get(shown)?.update(snapshot);
  else if (drawings.has(shown)) colour(drawings.get(shown), snapshot.graph, snapshot.modules, lateMoves(snapshot), picked);
  if (byId("table").open) table(snapshot, picked);
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
      h("td", {}, h("button", { type: "button", on: { click: () => details.open(target(row.key)) } }, named(row.name)), h("small", { class: "muted" }, ` ${row.kind}${row.where ? ` · ${row.where}` : ""}`))));
}
