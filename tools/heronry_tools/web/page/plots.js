// Plots of variables: one card for each, with a line for each module that gives the variable, bold while a module reads
// it, and epochs as lines through it. Samples are asked for only while this panel is open.

import { byId, h, list, listed, named, setText } from "./dom.js";
import { get, open } from "./stream.js";
import { store } from "./store.js";
import { Chart, dashOf, NUMBERS } from "./chart.js";
import * as details from "./details.js";

const MOST = 8; // variables, as the server has it
const KEPT = 6000; // samples of each line
const LIVE_SPAN_NS = 60e9;
const LEAST_SPAN_NS = 1e8;
const POINTS = 1500;
const plots = new Map(); // variable -> what is known of it, and its card
let names = [];
let view = { span: null, end: null }; // ns; null: what is usual, and the end of what there is
let at_ns = null; // the time of the last samples
let stop = null;
let asking = 0;
let isOpen = false;
let isDue = false;

export const isOffered = (name) => store.facts.variables[name].has_numbers && (!store.facts.recorded || store.facts.has_frames);

export function link(name) {
  return isOffered(name) ? h("a", { class: "button", href: `#/plots/${name}`, "data-plot-of": name }, `Plot ${name}`) : null;
}

export function begin() {
  byId("plots-add").addEventListener("change", (event) => go([...names, event.target.value]));
  const move = (by) => () => look((from, to) => [from + by * (to - from), to + by * (to - from)]);
  const size = (by) => () => look((from, to) => [to - by * (to - from), to]);
  byId("plots-earlier").addEventListener("click", move(-0.5));
  byId("plots-later").addEventListener("click", move(0.5));
  byId("plots-shorter").addEventListener("click", size(0.5));
  byId("plots-longer").addEventListener("click", size(2));
  byId("plots-hold").addEventListener("click", () => look((from, to) => [from, to]));
  byId("plots-all").addEventListener("click", () => turn({ span: null, end: null }));
  setText(byId("plots-all"), store.facts.recorded ? "All of it" : "Follow");
  byId("plots-hold").hidden = store.facts.recorded;
  new MutationObserver(draw).observe(document.documentElement, { attributes: true, attributeFilter: ["data-theme"] });
}

const go = (wanted) => { location.hash = `#/plots/${wanted.join(",")}`; };

// #/plots/VARIABLE,VARIABLE
export function opened(rest) {
  const asked = [...new Set((rest ?? "").split(",").filter(Boolean))];
  const known = asked.filter((name) => store.facts.variables[name]?.has_numbers);
  const unknown = asked.find((name) => !known.includes(name));
  trouble(unknown ? `'${unknown}' is no variable of ${store.facts.name} that has numbers.` : "");
  names = known.slice(0, MOST);
  isOpen = true;
  for (const [name, plot] of plots) if (!names.includes(name)) forget(name, plot);
  const free = Object.keys(store.facts.variables).filter((name) => store.facts.variables[name].has_numbers && !names.includes(name));
  byId("plots-add").replaceChildren(h("option", { value: "" }, "a variable …"), ...free.map((name) => h("option", { value: name }, name)));
  byId("plots-add").disabled = names.length >= MOST;
  byId("plots-none").hidden = names.length > 0;
  byId("plots-view").hidden = names.length === 0;
  ask();
}

export function closed() {
  isOpen = false;
  stop?.();
  stop = null;
  clearTimeout(asking);
}

function forget(name, plot) {
  plot.chart?.destroy();
  plot.element.remove();
  plots.delete(name);
}

function trouble(sentence) {
  byId("plots-trouble").hidden = !sentence;
  setText(byId("plots-trouble"), sentence);
}

const query = () => names.map((name) => `variable=${encodeURIComponent(name)}`).join("&");

function ask() {
  stop?.();
  stop = null;
  if (!names.length) return;
  if (!store.facts.recorded) {
    stop = open(`/api/values?${query()}`, take, trouble);
    return;
  }
  clearTimeout(asking);
  asking = setTimeout(async () => {
    const span = store.recording && view.span !== null ? `&from_ns=${Math.round(edges()[0])}&to_ns=${Math.round(edges()[1])}` : "";
    try {
      const told = await (await get(`/api/values?${query()}${span}&points=${POINTS}`)).json();
      begun(told.plots);
      for (const plot of plots.values()) plot.lines.forEach((line) => Object.assign(line, { t_ns: [], values: [], versions: [] }));
      take("samples", { at_ns: null, ...told });
    } catch (error) {
      trouble(error.message);
    }
  }, plots.size ? 150 : 0);
}

function take(kind, data) {
  if (!isOpen) return;
  if (kind === "plots") {
    trouble("");
    begun(data);
    return;
  }
  at_ns = data.at_ns;
  for (const [name, series] of Object.entries(data.series)) {
    const plot = plots.get(name);
    if (!plot) continue;
    for (const one of series) add(plot.lines.find((line) => line.producer === one.producer && line.part === one.part), one);
    if (store.facts.recorded) plot.used = data.used[name];
    else if (data.used[name]) plot.used = [...plot.used, ...data.used[name]].slice(-KEPT);
    plot.refused = data.refused[name] ?? {};
  }
  draw();
}

// After a break the server tells again what it has kept. What is known is skipped; a gap stands where nothing was kept.
function add(line, more) {
  const isAgain = line.isBroken && line.t_ns.length > 0;
  if (isAgain && more.t_ns.at(-1) < line.t_ns[0]) Object.assign(line, { t_ns: [], values: [], versions: [] }); // another clock
  const last = line.t_ns.at(-1) ?? -Infinity;
  const from = more.t_ns.findIndex((ns) => ns > last);
  const gap = isAgain && line.t_ns.length && more.t_ns[0] > last ? { t_ns: [last], values: [null], versions: [line.versions.at(-1)] } : null;
  line.isBroken = false;
  if (from < 0) return;
  for (const what of ["t_ns", "values", "versions"]) {
    line[what].push(...(gap?.[what] ?? []), ...more[what].slice(from));
    if (!store.facts.recorded && line[what].length > 2 * KEPT) line[what].splice(0, line[what].length - KEPT);
  }
}

// What the server says of each variable at first; after a break, what was known stays.
function begun(told) {
  for (const one of told) {
    const known = plots.get(one.variable);
    if (known) {
      for (const line of known.lines) line.isBroken = true;
      continue;
    }
    const producers = [...new Set(one.series.map((each) => each.producer))];
    const lines = one.series.map((each) => ({ ...each, colour: (producers.indexOf(each.producer) % NUMBERS) + 1, dash: dashOf(each.part, Math.floor(producers.indexOf(each.producer) / NUMBERS)), t_ns: [], values: [], versions: [] }));
    const plot = { ...one, lines, used: [], refused: {}, pointed: null, chart: null };
    plots.set(one.variable, Object.assign(plot, card(plot)));
    byId("plots").append(plot.element);
  }
}

function card(plot) {
  const { variable, unit } = plot;
  const sheet = h("div", { class: "chart", role: "img", "aria-label": `${variable}${unit ? ` in ${unit}` : ""} over time; the list below has its values` });
  const silent = h("p", { class: "muted" });
  const refused = h("p", { class: "why" });
  const rows = h("ul", { class: "lines", "aria-label": `Values of ${variable}` });
  const others = () => names.filter((name) => name !== variable);
  const element = h("section", { class: "card plot", "data-plot": variable, "aria-label": `Plot of ${variable}` },
    h("header", {}, h("h3", {}, h("button", { type: "button", on: { click: () => details.open({ kind: "variable", name: variable }) } }, variable), unit ? h("small", { class: "muted" }, ` ${unit}`) : null),
      h("button", { type: "button", class: "quiet", "aria-label": `Close the plot of ${variable}`, on: { click: () => go(others()) } }, "✕")),
    sheet, silent, refused, rows);
  return { element, sheet, silent, refusedText: refused, rows };
}

// The span that is shown, in ns.
function edges() {
  const { recording, snapshot } = store;
  if (store.facts.recorded) {
    const to = view.end ?? recording.last_ns;
    return [view.span === null ? recording.first_ns : to - view.span, to];
  }
  const to = view.end ?? at_ns ?? snapshot.t_ns;
  return [Math.max(to - (view.span ?? LIVE_SPAN_NS), Math.min(snapshot.began_ns ?? 0, to - LEAST_SPAN_NS)), to];
}

function turn(to) {
  view = to;
  if (store.facts.recorded) ask();
  draw();
}

// Looks at another span, inside of what there is.
function look(change) {
  let [from, to] = change(...edges());
  const span = Math.max(LEAST_SPAN_NS, to - from);
  if (store.facts.recorded) {
    const { first_ns, last_ns } = store.recording;
    to = Math.min(Math.max(to, first_ns + Math.min(span, last_ns - first_ns)), last_ns);
    turn({ span: Math.min(span, last_ns - first_ns), end: to });
  } else turn({ span: Math.min(span, 60 * LIVE_SPAN_NS), end: Math.min(to, at_ns ?? to) });
}

export function show() {
  if (store.facts.recorded) draw(); // live plots are drawn with their samples
}

function draw() {
  if (isDue || !isOpen) return;
  isDue = true;
  requestAnimationFrame(() => {
    isDue = false;
    if (!isOpen || !store.snapshot || (store.facts.recorded && !store.recording)) return;
    byId("plots-hold").setAttribute("aria-pressed", String(view.end !== null));
    for (const plot of plots.values()) drawOne(plot);
  });
}

async function drawOne(plot) {
  plot.chart ??= new Chart(plot.sheet, { onSpan: (from, to) => look(() => [from, to]), onReset: () => turn({ span: null, end: null }), onPoint: (ns) => { plot.pointed = ns; values(plot); }, onTrouble: trouble });
  const epochs = store.facts.recorded ? store.recording.marks : store.snapshot.reconfigurations.map((one) => ({ epoch: one.epoch, t_ns: one.done_ns }));
  plot.chart.show({ lines: plot.lines, used: plot.used, isStepped: plot.is_stepped, edges: edges(), began: store.snapshot.began_ns ?? 0, epochs, now: store.facts.recorded ? store.at_ns : null });
  values(plot);
}

const last = (times, ns) => {
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= ns) low = middle + 1;
    else high = middle;
  }
  return low - 1;
};

export const usedAt = (used, ns) => used.findLast(([since]) => since <= ns)?.[1] ?? {};

// The list below a plot: the values where the pointer is, or now.
function values(plot) {
  const ns = plot.pointed ?? (store.facts.recorded ? store.at_ns : edges()[1]);
  const read = usedAt(plot.used, ns);
  const rows = plot.lines.map((line) => {
    const at = last(line.t_ns, ns);
    const isSilent = at < 0 || ns - line.t_ns[at] > line.fresh_ns;
    const value = at < 0 ? null : line.values[at];
    const text = isSilent ? "not heard" : value === null ? "invalid, or silent" : `${Number(value.toPrecision(6))}${plot.unit ? ` ${plot.unit}` : ""}`;
    return { name: line.parts > 1 ? `${line.producer}.${line.part}` : line.producer, module: line.producer, colour: line.colour, dash: line.dash, version: isSilent ? null : line.versions[at], text, readers: read[line.producer] ?? [] };
  });
  list(plot.rows, rows, (row) => row.name, row);
  const isHeard = plot.lines.some((line) => line.t_ns.length);
  setText(plot.silent, isHeard ? "" : `No frame of ${plot.variable} ${store.facts.recorded ? "was heard in this span" : "has been heard yet"}. A PE sends a datum only where a module on another PE reads it.`);
  setText(plot.refusedText, Object.entries(plot.refused).map(([producer, [count, why]]) => `${count} frame${count > 1 ? "s" : ""} of ${producer} that no PE would take: ${why}.`).join(" "));
}

function row({ name, module, colour, dash, version, text, readers }) {
  const swatch = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  swatch.setAttribute("class", `swatch p${colour}${readers.length ? " used" : ""}`);
  swatch.setAttribute("viewBox", "0 0 28 8");
  swatch.setAttribute("aria-hidden", "true");
  const line = document.createElementNS(swatch.namespaceURI, "path");
  line.setAttribute("d", "M0,4H28");
  if (dash.length) line.setAttribute("stroke-dasharray", dash.join());
  swatch.append(line);
  return h("li", { "data-line": name, "data-used": String(readers.length > 0) },
    h("span", {}, swatch, " ", h("button", { type: "button", on: { click: () => details.open({ kind: "module", name: module }) } }, named(name))),
    h("span", {}, version === null ? "" : `version ${version}`), h("b", { class: "number" }, text),
    h("small", { class: "muted" }, readers.length ? `in use: read by ${listed(readers)}` : "nobody reads it"));
}
