// What this page knows: the snapshot as the server has it, and the loads of the last minutes.

const KEPT = { told: 500, reconfigurations: 100 };
const KEPT_LOADS = 600;

export const store = { facts: null, snapshot: null, offered: {}, loads: {}, recording: null, at_ns: null, plays: false };

function addLoads(loads) {
  for (const load of loads) {
    const kept = (store.loads[load.bus] ??= []);
    kept.push(load);
    if (kept.length > KEPT_LOADS) kept.splice(0, kept.length - KEPT_LOADS);
  }
}

// A hundred reconfigurations name the same few places again and again: each place is kept once.
const places = new Map();

function place({ pe, mode }) {
  const name = `${pe} ${mode}`;
  if (!places.has(name)) places.set(name, { pe, mode });
  return places.get(name);
}

function lean(reconfigurations) {
  for (const one of reconfigurations) {
    for (const side of [one.before, one.after]) {
      for (const module of Object.keys(side)) side[module] = place(side[module]);
    }
  }
}

export function takeWhole(data) {
  store.snapshot = data.snapshot;
  lean(data.snapshot.reconfigurations);
  store.offered = data.offered ?? {};
  store.loads = {};
  addLoads(data.loads);
  store.recording = data.recording ?? null;
  store.at_ns = data.at_ns ?? null;
}

export function takeChange(data) {
  const snapshot = store.snapshot;
  if (snapshot === null) return;
  Object.assign(snapshot, data.set);
  if (data.offered) store.offered = data.offered;
  for (const [name, entries] of Object.entries(data.merge)) Object.assign(snapshot[name], entries);
  for (const [part, entries] of Object.entries(data.graph)) Object.assign(snapshot.graph[part], entries);
  lean(data.reconfigurations ?? []);
  for (const [name, most] of Object.entries(KEPT)) {
    if (data[name]) snapshot[name] = numbered(snapshot[name], data[name], most);
  }
  addLoads(data.loads);
}

function numbered(known, changed, most) {
  const all = new Map(known.map((one) => [one.number, one]));
  for (const one of changed) all.set(one.number, one);
  return [...all.values()].sort((a, b) => a.number - b.number).slice(-most);
}

export function stateOf(one) {
  if (!one.wanted) return "idle";
  if (one.served === null) return "idle";
  if (!one.served) return "lost";
  return one.degraded || one.shortfalls.length ? "degraded" : "served"; // upstream of its output, too
}

// What a question to the planner says of changed priorities and limited links.
export const asPriorities = (priorities) => Object.entries(priorities).map(([name, to]) => `${name}=${to}`);

export function limitsNow(snapshot) {
  const limited = Object.entries(snapshot.buses).filter(([, bus]) => bus.link);
  return limited.map(([name, bus]) => `bus:${name}=${bus.link === "gone" ? "0%" : bus.link}`);
}

// The modules that have moved lately, with the PE that they came from: moves are shown as moves.
const LATELY_NS = 20e9;

export function lateMoves(snapshot) {
  const moves = {};
  for (const one of snapshot.reconfigurations) {
    if (snapshot.t_ns - one.done_ns > LATELY_NS) continue;
    for (const name of one.moved) {
      const from = one.before[name], to = one.after[name];
      if (from && to && from.pe !== to.pe) moves[name] = from.pe;
    }
  }
  return moves;
}
