// The reconfigurations: how long each step took, what was lost and kept, and what runs where since.

import { byId, clock, h, list, listed, milliseconds } from "./dom.js";
import { store } from "./store.js";

const STEPS = ["detect", "decide", "distribute", "activate"];
const MEANING = {
  detect: "from the last sign of the old situation until it counts as changed",
  decide: "until the plan is there",
  distribute: "until every PE has its part",
  activate: "until every PE runs it",
};
let chosen = null; // TERM.EPOCH of the address
let drawn = "";

const nameOf = (one) => `${one.term ?? 0}.${one.epoch}`;
const isTimed = (one) => STEPS.some((step) => one.times_ns[step] !== null); // an epoch that was adopted has no times
const total = (one) => STEPS.reduce((sum, step) => sum + (one.times_ns[step] ?? 0), 0);

export function opened(rest) {
  chosen = rest || null;
}

export function show() {
  const all = store.snapshot.reconfigurations;
  const began = store.snapshot.began_ns;
  const one = all.find((each) => nameOf(each) === chosen) ?? all.at(-1);
  const rows = [...all].reverse().map((each) => ({
    number: each.number, name: nameOf(each), epoch: each.epoch, sentence: each.causes[0] ?? each.sentence,
    more: each.causes.length - 1, when: clock(each.done_ns, began), times: each.times_ns, total: total(each), isTimed: isTimed(each),
    lost: each.lost.length, current: each === one,
  }));
  list(byId("reconfigurations"), rows, (row) => row.number, entry);
  const article = byId("reconfiguration");
  const text = JSON.stringify([one ?? null, chosen]);
  if (text === drawn) return;
  drawn = text;
  if (!one) article.replaceChildren(h("p", {}, "Nothing has been reconfigured yet."));
  else article.replaceChildren(...story(one, began, chosen !== null && nameOf(one) !== chosen));
}

function entry(row) {
  return h("li", {}, h("a", { href: `#/timeline/${row.name}`, "aria-current": row.current ? "true" : null },
    h("span", { class: "line" }, h("span", {}, `Epoch ${row.epoch}`), row.isTimed ? h("span", {}, milliseconds(row.total)) : null),
    strip(row.times, row.total),
    h("small", {}, `${row.when} · ${row.sentence}${row.more > 0 ? ` and ${row.more} more` : ""}${row.lost ? ` · ${row.lost} no longer served` : ""}`)));
}

function strip(times, all) {
  return h("span", { class: "strip", "aria-hidden": "true" }, STEPS.map((step) => {
    const part = h("i", { class: step });
    part.style.width = `${all ? (100 * (times[step] ?? 0)) / all : 0}%`;
    return part;
  }));
}

function story(one, began, isAnother) {
  return [
    isAnother ? h("p", { class: "why" }, `Epoch ${chosen} is not in what is shown; this is the last one.`) : null,
    h("h2", {}, `Reconfiguration ${one.number}: epoch ${one.epoch}`),
    h("p", { class: "sentence" }, sentence(one)),
    h("p", { class: "muted" }, `done at ${clock(one.done_ns, began)} · `, h("a", { href: `#/timeline/${nameOf(one)}` }, "link to this one")),
    isTimed(one) ? h("h3", {}, `How long: ${milliseconds(total(one))}`) : null,
    isTimed(one) ? lanes(one) : null,
    h("h3", {}, "Functions"),
    h("div", { class: "modules" },
      one.lost.map((name) => h("span", { class: "chip lost" }, `no longer served: ${name}`)),
      one.unwanted.map((name) => h("span", { class: "chip" }, `no longer wanted: ${name}`)),
      one.gained.map((name) => h("span", { class: "chip gained" }, `served from now on: ${name}`)),
      one.kept.map((name) => h("span", { class: "chip" }, `kept: ${name}${gap(one, name)}`)),
      one.lost.length + one.unwanted.length + one.gained.length + one.kept.length ? null : h("span", { class: "muted" }, "none was served before or is now")),
    h("h3", {}, `What moved: ${one.moved.length} moved, ${one.started.length} started, ${one.stopped.length} stopped`),
    beforeAfter(one),
  ].filter(Boolean);
}

export function sentence(one) {
  if (!one.causes.length) return one.sentence;
  const lost = one.lost.length ? ` No longer served: ${listed(one.lost)}.` : one.unwanted.length ? "" : " Every function that was served is served on.";
  const unwanted = one.unwanted.length ? ` No longer wanted: ${listed(one.unwanted)}.` : "";
  return `Because of: ${one.causes.join("; ")}.${lost}${unwanted}`;
}

function gap(one, name) {
  const silent = one.outages.filter((outage) => outage.function === name && outage.to_ns !== null);
  const longest = Math.max(0, ...silent.map((outage) => outage.to_ns - outage.from_ns));
  return longest ? `, silent for ${milliseconds(longest)}` : "";
}

function lanes(one) {
  const known = STEPS.map((step) => one.times_ns[step] ?? 0);
  const silences = one.outages.map((outage) => (outage.to_ns ?? one.done_ns) - one.began_ns);
  const span = Math.max(1, total(one), ...silences);
  const rows = [];
  let from = 0;
  STEPS.forEach((step, number) => {
    rows.push(h("span", { title: MEANING[step] }, step), bar(step, from, known[number], span),
      h("span", { class: "ms", "data-step": step }, milliseconds(one.times_ns[step])));
    from += known[number];
  });
  for (const outage of one.outages) {
    const begin = Math.max(0, outage.from_ns - one.began_ns);
    const long = outage.to_ns === null ? null : outage.to_ns - outage.from_ns;
    rows.push(h("span", {}, outage.function), bar("silent", begin, long ?? span - begin, span),
      h("span", { class: "ms" }, long === null ? "not back" : `gap ${milliseconds(long)}`));
  }
  return h("div", { class: "lanes" }, rows);
}

function bar(kind, from, long, span) {
  const inner = h("i", { class: kind });
  inner.style.left = `${(100 * from) / span}%`;
  inner.style.width = `${(100 * long) / span}%`;
  return h("span", { class: "lane", "aria-hidden": "true" }, long ? inner : null);
}

function beforeAfter(one) {
  const places = [...new Set([...Object.values(one.before), ...Object.values(one.after)].map((place) => place.pe))].sort();
  const cells = [h("h4", {}, "Before"), h("h4", {}, "After")];
  for (const pe of places) {
    cells.push(side(pe, one.before, one.after, "to"), side(pe, one.after, one.before, "from"));
  }
  return h("div", { class: "before-after" }, cells);
}

function side(pe, here, other, word) {
  const names = Object.keys(here).filter((name) => here[name].pe === pe);
  return h("div", { class: "place" }, h("b", {}, pe), h("div", { class: "modules" }, names.map((name) => {
    const there = other[name];
    if (!there) return h("span", { class: `chip ${word === "to" ? "lost" : "gained"}` }, `${name} ${word === "to" ? "(stopped)" : "(started)"}`);
    if (there.pe !== pe) return h("span", { class: "chip moved" }, word === "to" ? `${name} → ${there.pe}` : `${name} ← ${there.pe}`);
    const mode = there.mode === here[name].mode ? "" : ` (${here[name].mode})`;
    return h("span", { class: `chip${mode ? " degraded" : ""}` }, `${name}${mode}`);
  }), names.length ? null : h("span", { class: "muted" }, "nothing")));
}
