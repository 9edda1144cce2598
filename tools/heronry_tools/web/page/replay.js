// A recorded flight: a slider over its time, at its own speed or four times that, and a step to the next reconfiguration.

import { byId, clock, h, setText } from "./dom.js";
import { store } from "./store.js";

const LEAD_NS = 1.5e9; // a step shows what leads to the reconfiguration
let at = null;
let speed = 0;
let connect = () => {};
let parts = null;
let dragging = 0;

export function begin(open) {
  connect = open;
}

export const query = () => (at === null ? "?speed=0" : `?at_ns=${Math.round(at)}&speed=${speed}`);

function go(ns, faster) {
  const { first_ns, last_ns } = store.recording;
  at = Math.min(Math.max(ns, first_ns), last_ns);
  speed = faster;
  connect(query());
}

function build(bar) {
  const { marks, first_ns, last_ns } = store.recording;
  const slider = h("input", { type: "range", min: 0, max: 1000, step: 1, value: 0, "aria-label": "Time in the recording" });
  slider.addEventListener("input", () => {
    clearTimeout(dragging);
    const ns = first_ns + ((last_ns - first_ns) * Number(slider.value)) / 1000;
    dragging = setTimeout(() => { dragging = 0; go(ns, 0); }, 120);
  });
  const ticks = h("span", { class: "ticks", "aria-hidden": "true" }, marks.map((mark) => {
    const tick = h("i", { title: mark.what });
    tick.style.left = `${(100 * (mark.t_ns - first_ns)) / Math.max(1, last_ns - first_ns)}%`;
    return tick;
  }));
  const time = h("span", {});
  const play = (times) => h("button", { type: "button", "data-speed": times, on: { click: () => go(store.at_ns >= last_ns ? first_ns : store.at_ns, times) } }, `▶ ${times}×`);
  const pause = h("button", { type: "button", "aria-label": "Pause", on: { click: () => go(store.at_ns, 0) } }, "❚❚", h("span", { class: "long" }, "Pause"));
  const step = (way) => () => {
    const now = store.at_ns;
    const next = way > 0 ? marks.find((mark) => mark.t_ns > now + 1e6) : [...marks].reverse().find((mark) => mark.t_ns < now - LEAD_NS);
    if (next) go(next.t_ns + 1e6, 0);
  };
  bar.append(h("span", { class: "group" },
    h("button", { type: "button", id: "replay-previous", "aria-label": "Previous reconfiguration", on: { click: step(-1) } }, "|◀"), play(1), play(4), pause,
    h("button", { type: "button", id: "replay-next", "aria-label": "Next reconfiguration", on: { click: step(1) } }, h("span", { class: "long" }, "Next reconfiguration"), "▶|")),
  h("span", { class: "track" }, slider, ticks), time);
  return { slider, time, pause };
}

export function show() {
  if (!store.recording) return;
  const bar = byId("replay");
  bar.hidden = false;
  document.body.classList.add("is-replay");
  parts ??= build(bar);
  const { first_ns, last_ns } = store.recording;
  const now = store.at_ns ?? first_ns;
  if (!dragging) parts.slider.value = String(Math.round((1000 * (now - first_ns)) / Math.max(1, last_ns - first_ns)));
  const text = `${clock(now, first_ns)} of ${clock(last_ns, first_ns)}`;
  setText(parts.time, text);
  parts.slider.setAttribute("aria-valuetext", text);
  parts.pause.disabled = !store.plays;
}
