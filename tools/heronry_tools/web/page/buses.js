// The load of each bus over the last minutes, by kind of traffic, drawn without a library.

import { byId, clock, h, percent, setText } from "./dom.js";
import { store } from "./store.js";

const SVG = "http://www.w3.org/2000/svg";
let wide = 800;
const HIGH = 200, FOOT = 18, SIDE = 44;
const SPAN_NS = 60e9; // the least that is shown
const MOST_NS = 600e9;
const cards = new Map();

function svg(tag, properties, text) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(properties)) element.setAttribute(name, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

export function show() {
  for (const [name, bus] of Object.entries(store.snapshot.buses)) {
    if (!cards.has(name)) {
      cards.set(name, card(name));
      byId("buses").append(cards.get(name).element);
    }
    draw(cards.get(name), name, bus);
  }
}

function card(name) {
  const facts = store.facts.buses[name];
  const now = h("span", { class: "muted" });
  const trouble = h("p", { class: "why" });
  const picture = svg("svg", { role: "img" });
  const kinds = h("div", { class: "kinds" });
  const element = h("section", { class: "card bus", "data-bus": name, "aria-label": `Bus ${name}` },
    h("h3", {}, name, h("small", { class: "muted" }, `${facts.kind}, ${facts.bit_rate / 1000} kbit/s`), now), trouble, picture, kinds);
  return { element, now, trouble, picture, kinds, drawn: "" };
}

function draw(parts, name, bus) {
  const loads = store.loads[name] ?? [];
  const mark = `${loads.at(-1)?.number}/${bus.planned}/${bus.trouble}/${bus.link}/${bus.load}/${parts.picture.clientWidth}`;
  if (parts.drawn === mark) return;
  parts.drawn = mark;
  const frames = bus.frames_per_s === null ? "" : `, ${bus.frames_per_s} frames/s`;
  setText(parts.now, bus.load === null ? "no traffic is measured here" : `load ${percent(bus.load)}, peak ${percent(bus.peak)}${frames}`);
  setText(parts.trouble, [bus.trouble, bus.link ? `link: ${bus.link} of its bandwidth` : null, bus.errors ? `${bus.errors} error frames` : null,
    bus.error_state && bus.error_state !== "active" ? `controller: ${bus.error_state}` : null].filter(Boolean).join(" · "));
  const kinds = [...new Set(loads.flatMap((load) => Object.keys(load.bits_per_s)))].sort();
  const began = store.snapshot.began_ns ?? 0;
  const from = Math.max(began, store.snapshot.t_ns - MOST_NS);
  const { recording } = store;
  const least = recording ? Math.min(SPAN_NS, recording.last_ns - recording.first_ns) : SPAN_NS;
  const last = Math.max(store.snapshot.t_ns, from + least);
  wide = Math.max(240, parts.picture.clientWidth);
  parts.picture.setAttribute("viewBox", `0 0 ${wide} ${HIGH + FOOT}`);
  const x = (ns) => SIDE + ((wide - SIDE) * (ns - from)) / Math.max(1, last - from);
  const most = Math.max(bus.most, bus.planned ?? 0, ...loads.map((load) => load.peak ?? load.load)) * 1.08;
  const y = (share) => HIGH - (HIGH * share) / most;
  const drawn = [];
  const step = most > 0.5 ? 0.2 : most > 0.2 ? 0.1 : 0.05;
  for (let share = 0; share <= most; share += step) {
    drawn.push(svg("path", { class: "rule", d: `M${SIDE},${y(share)}H${wide}` }), svg("text", { class: "axis", x: 2, y: y(share) - 3 }, `${Math.round(share * 100)} %`));
  }
  let below = loads.map(() => 0);
  kinds.forEach((kind, number) => {
    const above = loads.map((load, at) => below[at] + (load.bits_per_s[kind] ?? 0) / bus.bit_rate);
    const top = loads.map((load, at) => `${x(load.t_ns).toFixed(1)},${y(above[at]).toFixed(1)}`);
    const foot = loads.map((load, at) => `${x(load.t_ns).toFixed(1)},${y(below[at]).toFixed(1)}`).reverse();
    if (loads.length > 1) drawn.push(svg("polygon", { class: `k${(number % 6) + 1}`, points: [...top, ...foot].join(" ") }));
    below = above;
  });
  drawn.push(svg("path", { class: "most", d: `M${SIDE},${y(bus.most)}H${wide}` }));
  if (bus.planned !== null) drawn.push(svg("path", { class: "planned", d: `M${SIDE},${y(bus.planned)}H${wide}` }));
  let labelled = 0;
  for (const one of store.snapshot.reconfigurations) {
    if (one.done_ns < from) continue;
    const at = x(one.done_ns);
    drawn.push(svg("path", { class: "epoch", d: `M${at},0V${HIGH}` }));
    if (at - labelled < 18) continue;
    labelled = at;
    drawn.push(svg("text", { class: "axis", x: at + 3, y: 11 }, String(one.epoch)));
  }
  drawn.push(svg("text", { class: "axis", x: SIDE, y: HIGH + 14 }, clock(from, store.snapshot.began_ns)), svg("text", { class: "axis", x: wide, y: HIGH + 14, "text-anchor": "end" }, clock(last, store.snapshot.began_ns)));
  parts.picture.replaceChildren(...drawn);
  parts.picture.setAttribute("aria-label", `Load of ${name}: now ${percent(bus.load)}, at most ${percent(bus.most)} is allowed, ${percent(bus.planned)} is planned`);
  parts.kinds.replaceChildren(
    ...kinds.map((kind, number) => h("span", {}, h("i", { class: `k${(number % 6) + 1}` }), `${kind}: ${percent((bus.bits_per_s[kind] ?? 0) / bus.bit_rate)}`)),
    h("span", { class: "muted" }, `most allowed for data ${percent(bus.most)} (dashed) · planned ${percent(bus.planned)} (dotted) · lines with a number: epochs`));
}
