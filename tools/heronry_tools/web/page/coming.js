// What is on its way: tables and code that PEs wait for, and nodes that the spec does not have. Absent where there is none.

import { byId, h, list, listed, setText } from "./dom.js";
import { store } from "./store.js";

export function show() {
  const { transfers, strangers } = store.snapshot;
  byId("coming-section").hidden = transfers.length + strangers.length === 0;
  setText(byId("coming-count"), `${transfers.length + strangers.length}`);
  list(byId("coming"), [...transfers, ...strangers], (one) => one.pe === undefined ? `node ${one.node}` : `${one.what} ${one.pe}`,
    (one) => one.pe === undefined ? stranger(one) : transfer(one));
}

function transfer({ pe, what, says, percent }) {
  return h("li", { class: "card pe waiting", "data-coming": pe },
    h("header", {}, h("b", {}, pe), h("small", {}, percent === null ? `waits for its ${what}` : `${what}: ${percent} %`)),
    percent === null ? null : h("progress", { max: 100, value: percent, "aria-label": `${what} of ${pe}` }),
    h("p", { class: "why" }, says));
}

function stranger({ node, says, offer, images, adopt }) {
  return h("li", { class: "card pe waiting", "data-stranger": node },
    h("header", {}, h("b", {}, `node ${node}`), h("small", {}, "not in the spec")),
    h("p", { class: "why" }, `it ${says}`),
    offer ? h("p", {}, offer) : null,
    images.length ? h("p", { class: "muted" }, `images: ${listed(images)}`) : null,
    adopt ? h("p", {}, h("code", {}, adopt)) : null);
}
