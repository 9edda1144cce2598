// Building and updating elements. Text only ever goes in as text, so nothing that a bus says becomes markup.

export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === "on") for (const [kind, act] of Object.entries(value)) element.addEventListener(kind, act);
    else if (name === "class") element.className = value;
    else if (name in element && name !== "list" && name !== "role") element[name] = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(2).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export const byId = (id) => document.getElementById(id);

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function setClass(element, name) {
  if (element.getAttribute("class") !== name) element.setAttribute("class", name);
}

const children = new WeakMap(); // parent -> key -> what stands there

// Makes the children of `parent` those of `items`, in their order. A child is kept as long as its key stays, and is
// made anew only when what it shows has changed.
export function list(parent, items, keyOf, make) {
  const known = children.get(parent) ?? children.set(parent, new Map()).get(parent);
  const wanted = new Set();
  let before = null;
  for (const item of items) {
    const key = String(keyOf(item));
    const shown = JSON.stringify(item);
    wanted.add(key);
    let row = known.get(key);
    if (!row || row.shown !== shown) {
      const element = make(item);
      if (row) {
        const focused = row.element.contains(document.activeElement);
        row.element.replaceWith(element);
        if (focused) (element.querySelector("button, a, select") ?? element).focus?.();
      }
      row = { shown, element };
      known.set(key, row);
    }
    const place = before ? before.nextSibling : parent.firstChild;
    if (row.element !== place) parent.insertBefore(row.element, place);
    before = row.element;
  }
  for (const [key, row] of known) {
    if (wanted.has(key)) continue;
    row.element.remove();
    known.delete(key);
  }
}

export const LETTERS = {
  served: "S", degraded: "D", lost: "L", idle: "–", dead: "×",
  closed: "C", open: "O", unknown: "?",
  up: "UP", suspect: "?", down: "×", returning: "…", waiting: "–",
  error: "E", warning: "W", notice: "N", good: "G", detail: "·",
};

export const WORDS = {
  served: "served", degraded: "degraded", lost: "lost", idle: "not chosen", dead: "cannot run",
  closed: "loop closed", open: "loop open", unknown: "not known",
  up: "up", suspect: "suspect", down: "down", returning: "returning", waiting: "not heard yet",
};

export function badge(state) {
  const word = WORDS[state] ?? state;
  return h("span", { class: `badge ${state}`, role: "img", "aria-label": word, title: word }, LETTERS[state] ?? "?");
}

export function milliseconds(ns) {
  if (ns === null || ns === undefined) return "not known";
  const ms = ns / 1e6;
  return ms >= 10000 ? `${(ms / 1000).toFixed(1)} s` : `${ms.toFixed(ms < 100 ? 1 : 0)} ms`;
}

export function clock(ns, began) {
  if (ns === null || ns === undefined || began === null) return "–";
  const s = (ns - began) / 1e9;
  if (s < 60) return `${s.toFixed(2)} s`;
  return `${Math.floor(s / 60)}:${(s % 60).toFixed(1).padStart(4, "0")} min`;
}

// How long ago, in whole seconds: a text that changed with every frame could not be read.
export function ago(ns, { t_ns }) {
  if (ns === null || ns === undefined) return null;
  const s = Math.floor((t_ns - ns) / 1e9);
  if (s < 1) return "less than a second ago";
  return s < 60 ? `${s} s ago` : `${Math.floor(s / 60)} min ${s % 60} s ago`;
}

// A name that may be broken after its underscores.
export const named = (name) => name.split("_").flatMap((part, at) => (at ? ["_", h("wbr"), part] : [part]));

export const percent = (share) => (share === null || share === undefined ? "–" : `${(share * 100).toFixed(1)} %`);

export function bytes(number) {
  if (number >= 1 << 20) return `${(number / (1 << 20)).toFixed(1)} MiB`;
  return number >= 1024 ? `${(number / 1024).toFixed(0)} KiB` : `${number} B`;
}

export const listed = (names) => (names.length ? names.join(", ") : "nothing");
