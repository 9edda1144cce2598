// The page: connects, and shows what is known in the panel that is open, at most once a frame.

import { byId, clock, h, list, setText } from "./dom.js";
import { fileAddress, get, open, takeToken } from "./stream.js";
import { store, takeChange, takeWhole } from "./store.js";
import * as graph from "./graph.js";
import * as timeline from "./timeline.js";
import * as buses from "./buses.js";
import * as plots from "./plots.js";
import * as events from "./events.js";
import * as whatIf from "./what_if.js";
import * as pes from "./pes.js";
import * as coming from "./coming.js";
import * as plants from "./plants.js";
import * as functions from "./functions.js";
import * as details from "./details.js";
import * as replay from "./replay.js";
import * as operate from "./operate.js";

const PANELS = { graph, timeline, buses, plots, events, "what-if": whatIf };
const STALE_S = 3;
let panel = "graph";
let heard = performance.now();
let age = { age_s: 0, trouble: null, broken: null };
let isDrawn = true;
let stop = null;

function show() {
  if (!isDrawn) return;
  isDrawn = false;
  requestAnimationFrame(() => {
    isDrawn = true;
    if (store.snapshot === null) return;
    chips();
    functions.show();
    pes.show();
    coming.show();
    plants.show();
    operate.show();
    PANELS[panel].show();
    details.show();
    replay.show();
    setText(byId("timeline-count"), String(store.snapshot.reconfigurations.length));
    setText(byId("faults-count"), store.snapshot.faults.length ? `${store.snapshot.faults.length} latched` : "");
  });
}

const SOURCES = {
  manager: "a manager here", bus: "the bus alone: no causes", log: "a log", record: "a recording", simulator: "the simulator",
};

const STANDINGS = { standby: "stands by" };

function chips() {
  const snapshot = store.snapshot;
  const manager = snapshot.manager;
  const rows = [
    ["time", clock(snapshot.t_ns, snapshot.began_ns)],
    ["phase", snapshot.phase ?? "–"],
    ["stage", snapshot.stage],
    ["epoch", snapshot.epoch ?? "–"],
    ["term", manager.term ?? "–"],
    ["manager", manager.node === null ? "–" : `${manager.node} ${STANDINGS[manager.state] ?? manager.state ?? ""}`],
    ["from", SOURCES[snapshot.source] ?? snapshot.source],
  ];
  list(byId("chips"), rows, (row) => row[0], ([name, value]) =>
    h("div", { "data-chip": name }, h("dt", {}, name), h("dd", {}, name === "phase" ? operate.phaseChoice(value) : String(value))));
}

function take(kind, data) {
  heard = performance.now();
  if (kind === "whole") {
    if (!data.recording && data.snapshot.spec_digest !== store.facts.digest) {
      location.reload(); // the aircraft has changed to another spec: everything here is of the one before
      return;
    }
    takeWhole(data);
    age.broken = null;
  } else if (kind === "change") {
    const last = store.snapshot?.told.at(-1)?.number ?? 0;
    takeChange(data);
    speak((data.told ?? []).filter((one) => one.number > last));
  } else if (kind === "beat") {
    age = { ...data, broken: null };
    if (data.at_ns !== undefined) Object.assign(store, { at_ns: data.at_ns, plays: data.plays });
  }
  stale();
  show();
}

function speak(told) {
  const said = told.filter((one) => ["error", "warning"].includes(one.severity) || one.event === "reconfigured");
  if (said.length && !store.recording) setText(byId("spoken"), said.map((one) => one.sentence).join(". "));
}

function stale() {
  const silent = (performance.now() - heard) / 1000;
  const age_s = Math.max(age.age_s ?? 0, silent);
  const banner = byId("stale");
  const why = age.broken ?? age.trouble ?? (silent > STALE_S ? "the server is silent" : "nothing comes from the feed");
  banner.hidden = !(age.broken || age.trouble || age_s > STALE_S);
  if (!banner.hidden) setText(banner, `STALE ${Math.floor(age_s)} s: ${why}. What is shown is the last that was known.`);
  document.body.classList.toggle("is-stale", !banner.hidden);
}

export function connect(query = "") {
  stop?.();
  stop = open(`/api/stream${query}`, take, (why) => {
    age.broken = why;
    stale();
  });
}

function route() {
  const [name, rest] = location.hash.replace(/^#\//, "").split("/");
  panel = name in PANELS ? name : "graph";
  for (const [one, of] of Object.entries(PANELS)) {
    byId(`panel-${one}`).hidden = one !== panel;
    if (one === panel) of.opened?.(rest);
    else of.closed?.();
  }
  for (const link of byId("tabs").querySelectorAll("a")) {
    if (link.hash === `#/${panel}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  show();
}

function theme() {
  const button = byId("theme");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const apply = () => {
    const chosen = localStorage.getItem("heronry-theme") ?? "auto";
    document.documentElement.dataset.theme = chosen === "auto" ? (dark.matches ? "dark" : "light") : chosen;
    button.textContent = { auto: "◐ Auto", light: "☀ Light", dark: "☾ Dark" }[chosen];
    button.setAttribute("aria-label", `Colours: ${chosen}`);
  };
  button.addEventListener("click", () => {
    const order = ["auto", "light", "dark"];
    const now = localStorage.getItem("heronry-theme") ?? "auto";
    localStorage.setItem("heronry-theme", order[(order.indexOf(now) + 1) % order.length]);
    apply();
  });
  dark.addEventListener("change", apply);
  apply();
}

async function begin() {
  takeToken();
  theme();
  setInterval(stale, 500);
  for (;;) {
    try {
      store.facts = await (await get("/api/facts")).json();
      break;
    } catch (error) {
      byId("stale").hidden = false;
      setText(byId("stale"), error instanceof TypeError ? "The server does not answer." : error.message);
      await new Promise((resolve) => setTimeout(resolve, 1000));
    }
  }
  document.title = `${store.facts.name} · heronry`;
  setText(byId("spec"), store.facts.name);
  byId("events-file").href = fileAddress("/api/events.jsonl");
  byId("frames-file").href = fileAddress("/api/flight.log");
  byId("frames-file").hidden = !store.facts.has_frames;
  for (const one of [graph, timeline, buses, plots, events, whatIf, pes, functions, details, operate]) one.begin?.(show);
  replay.begin(connect);
  addEventListener("hashchange", route);
  addEventListener("keydown", (event) => {
    if (event.key === "Escape") details.close();
  });
  route();
  connect(store.facts.recorded ? replay.query() : "");
}

globalThis.heronry = { store }; // for a look from the browser's console, and for tests
begin();
