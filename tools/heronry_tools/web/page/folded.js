// The folded graph: modules without their variables and gates. The overview shows what is lost or degraded, what leads
// to it, and one box for each function that is well; the graph of a function shows everything that contributes to it.
// Data flow downwards. The style sheet places the boxes in rows that wrap, so that the graph is never wider than its room
// and text keeps its size; this file joins the boxes by lines.

import { badge, h, named, WORDS } from "./dom.js";
import { stateOf, store } from "./store.js";
import * as details from "./details.js";

const SVG = "http://www.w3.org/2000/svg";
const WELL = ["served", "idle"];
const ofModule = (name) => `module:${name}`;
let readersOf = null; // symbol -> symbols at the other ends of its edges; the spec gives them, so they never change

function readers(snapshot) {
  if (readersOf) return readersOf;
  readersOf = new Map();
  for (const edge of Object.keys(snapshot.graph.edges)) {
    const [source, target] = edge.slice(0, edge.lastIndexOf("#")).split(">");
    if (!readersOf.has(source)) readersOf.set(source, new Set());
    readersOf.get(source).add(target);
  }
  return readersOf;
}

// Pairs of shown modules that data connect without passing a third one that is shown.
function joined(snapshot, shown) {
  const next = readers(snapshot);
  const pairs = [];
  for (const from of shown) {
    const seen = new Set([from]);
    const waiting = [from];
    while (waiting.length) {
      for (const to of next.get(waiting.pop()) ?? []) {
        if (seen.has(to)) continue;
        seen.add(to);
        if (shown.has(to)) pairs.push([from, to]);
        else waiting.push(to);
      }
    }
  }
  return pairs;
}

// Only the edges without which something would not lead to where it leads: the others cross the whole picture.
function reduced(pairs) {
  const next = new Map();
  for (const [from, to] of pairs) next.set(from, [...(next.get(from) ?? []), to]);
  const reaches = (from, goal) => {
    const seen = new Set([from]);
    const waiting = (next.get(from) ?? []).filter((one) => one !== goal);
    while (waiting.length) {
      const one = waiting.pop();
      if (one === goal) return true;
      if (seen.has(one)) continue;
      seen.add(one);
      waiting.push(...(next.get(one) ?? []));
    }
    return false;
  };
  return pairs.filter(([from, to]) => !reaches(from, to) || reaches(to, from));
}

// The row of each box: one below the lowest of those that lead to it. Edges that close a cycle do not count.
function rowsOf(keys, pairs) {
  const before = new Map(keys.map((key) => [key, []]));
  for (const [from, to] of pairs) before.get(to).push(from);
  const rank = new Map();
  const entered = new Set();
  const find = (key) => {
    if (rank.has(key)) return rank.get(key);
    if (entered.has(key)) return -1;
    entered.add(key);
    const found = Math.max(-1, ...before.get(key).map(find)) + 1;
    rank.set(key, found);
    return found;
  };
  keys.forEach(find);
  const rows = [];
  for (const key of keys) (rows[rank.get(key)] ??= []).push(key);
  const place = new Map();
  for (const row of rows) {
    const middle = (key) => {
      const known = before.get(key).filter((one) => place.has(one)).map((one) => place.get(one));
      return known.length ? known.reduce((sum, one) => sum + one, 0) / known.length : 0.5;
    };
    const wanted = new Map(row.map((key) => [key, middle(key)]));
    row.sort((a, b) => wanted.get(a) - wanted.get(b));
    row.forEach((key, at) => place.set(key, (at + 0.5) / row.length));
  }
  return rows;
}

// What is drawn: `only` is one function, or "" for the overview.
export function model(snapshot, facts, only) {
  const names = Object.keys(facts.functions).filter((name) => !only || name === only);
  const open = names.filter((name) => only || !WELL.includes(stateOf(snapshot.functions[name])));
  const stateOfKey = (key) => snapshot.graph.nodes[key] ?? "idle";
  const shown = new Set();
  for (const name of open) {
    for (const key of facts.contributing[name]) {
      if (key.startsWith("module:") && (only || !WELL.includes(stateOfKey(key)))) shown.add(key);
    }
  }
  const pairs = joined(snapshot, shown);
  for (const key of [...shown]) {
    for (const root of rootsOf(key.slice(7), snapshot, facts)) {
      shown.add(root);
      pairs.push([root, key]);
    }
  }
  const rows = rowsOf([...shown], pairs);
  const isLost = (name) => stateOf(snapshot.functions[name]) === "lost";
  open.sort((a, b) => isLost(b) - isLost(a));
  return { rows, open, pairs: reduced(pairs), folded: names.filter((name) => !open.includes(name)) };
}

// What keeps a module from running, where it is a PE or a device and nothing before it in the graph.
function rootsOf(name, snapshot, facts) {
  const { device } = facts.modules[name];
  if (snapshot.modules[name].pe) return [];
  if (device) {
    const { pe } = facts.devices[device];
    if (snapshot.pes[pe].standing === "down") return [`pe:${pe}`];
    return snapshot.down.includes(`device:${device}`) ? [`device:${device}`] : [];
  }
  const mayRun = facts.modules[name].runs_on ?? [];
  return mayRun.length && mayRun.every((pe) => snapshot.pes[pe].standing === "down") ? mayRun.map((pe) => `pe:${pe}`) : [];
}

function told(key, snapshot, facts) {
  const name = key.slice(key.indexOf(":") + 1);
  if (key.startsWith("function:")) {
    const one = snapshot.functions[name];
    const state = stateOf(one);
    const less = one.shortfalls[0] ?? `runs in mode ${one.mode}`;
    return { name, state, text: state === "lost" ? one.why_not ?? "no cause is known" : state === "degraded" ? less : WORDS[state] };
  }
  if (key.startsWith("pe:")) return { name, state: "lost", text: snapshot.pes[name].why ?? "down" };
  if (key.startsWith("device:")) return { name, state: "lost", text: "device fails" };
  const one = snapshot.modules[name];
  const state = snapshot.graph.nodes[key] ?? "idle";
  const gives = Object.keys(facts.functions).filter((each) => facts.functions[each].outputs.includes(name));
  return { name, state, text: one.pe ? `${one.mode} on ${one.pe}` : WORDS[state], gives: gives.join(", ") };
}

function box(key, snapshot, choose) {
  const { name, state, text, gives } = told(key, snapshot, store.facts);
  const kind = key.slice(0, key.indexOf(":"));
  const act = () => (kind === "function" && choose ? choose(name) : details.open({ kind, name }));
  return h("button", { type: "button", class: `box ${kind} ${state}`, "data-fold": key, "data-state": state, on: { click: act } },
    badge(state), h("b", {}, kind === "pe" ? `PE ${name}` : named(name)), h("small", {}, text, gives ? [" · for ", h("b", {}, gives)] : null));
}

// Gives a drawing that `update` brings up to date; boxes are made anew only when what they say has changed.
export function folded(only, choose) {
  const lines = document.createElementNS(SVG, "svg");
  lines.setAttribute("aria-hidden", "true");
  const stage = h("div", { class: "stages" });
  const ends = h("div", { class: "ends" });
  const rest = h("div", { class: "rest" });
  const element = h("div", { class: "folded", role: "group", "aria-label": only ? `What contributes to ${only}` : "What is lost or degraded, and why" }, ends, h("div", { class: "drawn" }, lines, stage), rest);
  let drawn = "", pairs = [], states = {};
  new ResizeObserver(() => join(lines, stage, pairs, states)).observe(stage);
  return {
    element,
    update(snapshot) {
      const found = model(snapshot, store.facts, only);
      const keys = [...found.rows.flat(), ...found.open.map((name) => `function:${name}`), ...found.folded.map((name) => `function:${name}`)];
      const text = JSON.stringify([found, keys.map((key) => told(key, snapshot, store.facts))]);
      if (text === drawn) return;
      const focused = document.activeElement?.dataset?.fold;
      drawn = text;
      pairs = found.pairs;
      states = Object.fromEntries(keys.map((key) => [key, told(key, snapshot, store.facts).state]));
      const made = (key) => box(key, snapshot, only ? null : choose);
      stage.replaceChildren(...found.rows.map((row) => h("div", { class: "stage" }, row.map(made))));
      ends.replaceChildren(...found.open.map((name) => made(`function:${name}`)));
      rest.replaceChildren(...found.folded.map((name) => made(`function:${name}`)));
      if (focused) element.querySelector(`[data-fold="${focused}"]`)?.focus();
      join(lines, stage, pairs, states);
    },
  };
}

function join(lines, stage, pairs, states) {
  const places = new Map([...stage.querySelectorAll(".box")].map((one) => [one.dataset.fold, one]));
  const at = (one) => [one.offsetLeft + one.offsetWidth / 2, one.offsetTop, one.offsetHeight];
  lines.setAttribute("width", stage.offsetWidth);
  lines.setAttribute("height", stage.offsetHeight);
  lines.replaceChildren(...pairs.flatMap(([from, to]) => {
    if (!places.has(from) || !places.has(to)) return [];
    const [x, top, high] = at(places.get(from));
    const [x2, end] = at(places.get(to));
    const start = top + high;
    if (end < start) return []; // an edge that closes a cycle: the drawing of every symbol has it
    const path = document.createElementNS(SVG, "path");
    const bend = (start + end) / 2;
    path.setAttribute("d", `M${x},${start}C${x},${bend} ${x2},${bend} ${x2},${end}`);
    path.setAttribute("class", `edge ${states[from]}`);
    return [path];
  }));
}
