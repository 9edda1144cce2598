// The events with severity and filter, and the latched faults, which can be acknowledged in this browser. Every new row
// moves all rows below it, and to paint hundreds of them takes a third of a processor: older events wait for a click.

import { badge, byId, clock, h, list, setText } from "./dom.js";
import { store } from "./store.js";
import * as operate from "./operate.js";

const SEVERITIES = ["error", "warning", "notice", "good", "detail"];
const KEY = "heronry-seen";
const wanted = new Set(SEVERITIES.slice(0, 4));
const NEWEST = 40;
let most = NEWEST;
let redraw = () => {};

export function begin(show) {
  redraw = show;
  byId("events-text").addEventListener("input", show);
  byId("events-older").addEventListener("click", () => { most += NEWEST; show(); });
  byId("events-severities").append(...SEVERITIES.map((severity) => h("label", { class: "severity" },
    h("input", {
      type: "checkbox", checked: wanted.has(severity),
      on: { change: (event) => { (event.target.checked ? wanted.add(severity) : wanted.delete(severity)); show(); } },
    }), badge(severity), h("span", { "aria-hidden": "true" }, severity))));
}

export function opened() {
  most = NEWEST;
}

export function show() {
  const { told, faults, silences, began_ns } = store.snapshot;
  const text = byId("events-text").value.trim().toLowerCase();
  const rows = [];
  for (let at = told.length - 1; at >= 0; at -= 1) {
    const one = told[at];
    if (wanted.has(one.severity) && (!text || `${one.sentence} ${one.event}`.toLowerCase().includes(text))) rows.push(one);
  }
  const older = rows.length - most;
  byId("events-older").hidden = older <= 0;
  setText(byId("events-older"), `Show older events (${older})`);
  list(byId("events"), rows.slice(0, most), (row) => row.number, (row) =>
    h("tr", { class: row.severity, "data-event": row.event, "data-number": row.number },
      h("td", {}, clock(row.t_ns, began_ns)), h("td", {}, badge(row.severity)), h("td", {}, row.sentence)));
  const cards = [...faults.map((fault) => ({ ...fault, seen: isSeen(fault) })), ...silences.map((one) => ({ ...one, element: `${one.module} ${one.by} ${one.what} ${one.variable}` }))];
  list(byId("faults"), cards, (card) => card.element, (card) => (card.what ? silenceCard(card) : faultCard(card)));
}

function silenceCard(one) {
  const said = one.what === "output" ? `gives no ${one.variable}, although its inputs are there` : `gets no ${one.variable} from ${one.producer}`;
  return h("div", { class: "card fault", "data-silence": one.element },
    badge("warning"), h("b", {}, one.module), h("span", { class: "muted" }, `on ${one.by} ${said}, reported ${clock(one.since_ns, store.snapshot.began_ns)}`));
}

const nameOf = (fault) => `${store.facts.digest.slice(0, 12)} ${fault.element} ${fault.since_ns}`;
const seen = () => JSON.parse(localStorage.getItem(KEY) ?? "[]");
const isSeen = (fault) => seen().includes(nameOf(fault));

function faultCard(fault) {
  const since = clock(fault.since_ns, store.snapshot.began_ns);
  const code = fault.code ? ` (${fault.code}${fault.detail ? `, detail ${fault.detail}` : ""})` : "";
  return h("div", { class: `card fault${fault.seen ? " seen" : ""}`, "data-fault": fault.element },
    badge(fault.seen ? "idle" : "error"), h("b", {}, fault.element), h("span", { class: "muted" }, `latched since ${since}, reported by ${fault.by}${code}`),
    h("span", { class: "group" }, operate.button("clear", fault.element),
      fault.seen ? h("span", { class: "muted" }, "acknowledged") : h("button", {
        type: "button",
        on: { click: () => { localStorage.setItem(KEY, JSON.stringify([...seen(), nameOf(fault)].slice(-100))); redraw(); } },
      }, "Acknowledge")));
}
