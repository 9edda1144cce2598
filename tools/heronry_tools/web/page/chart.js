// One chart, drawn by uPlot, which is loaded with the first one. Times are ns; uPlot gets seconds since the beginning.

import { clock } from "./dom.js";

export const NUMBERS = 6; // colours
const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3]];
const HIGH = 200;
const FONT = "12px system-ui, \"DejaVu Sans\", sans-serif";
let loading = null;

export const dashOf = (part, round) => DASHES[(part + round) % DASHES.length];

function library() {
  loading ??= new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = "/page/uplot/uPlot.iife.min.js";
    script.addEventListener("load", () => resolve(globalThis.uPlot));
    script.addEventListener("error", () => {
      loading = null;
      script.remove();
      reject(new Error("The server does not give the library of the plots; close this plot and open it again."));
    });
    document.head.append(script);
  });
  return loading;
}

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class Chart {
  #sheet;
  #acts;
  #chart = null;
  #shape = "";
  #shown = null;
  #uPlot = null;
  #watching;

  constructor(sheet, acts) {
    this.#sheet = sheet;
    this.#acts = acts;
    this.#watching = new ResizeObserver(() => this.#chart?.setSize({ width: this.#width(), height: HIGH }));
    this.#watching.observe(sheet);
    library().then((found) => {
      this.#uPlot = found;
      if (this.#shown) this.show(this.#shown);
    }).catch((error) => acts.onTrouble(error.message));
  }

  destroy() {
    this.#watching.disconnect();
    this.#chart?.destroy();
    this.#chart = this.#uPlot = null;
  }

  #width() {
    return Math.max(200, this.#sheet.clientWidth);
  }

  // shown: {lines, used, isStepped, edges, began, epochs, now}
  show(shown) {
    this.#shown = shown;
    if (this.#uPlot === null) return;
    const data = this.#data();
    const shape = JSON.stringify([shown.lines.map((line) => line.producer), shown.isStepped]);
    if (this.#chart === null || shape !== this.#shape) {
      this.#chart?.destroy();
      this.#shape = shape;
      this.#chart = new this.#uPlot(this.#options(), data, this.#sheet);
    }
    this.#chart.setData(data);
  }

  #seconds(ns) {
    return (ns - this.#shown.began) / 1e9;
  }

  // For each line twice its values: all of them, and those while somebody reads them.
  #data() {
    const { lines, used, edges: [from, to] } = this.#shown;
    const tables = lines.map(({ producer, t_ns, values }) => {
      const begin = Math.max(0, t_ns.findIndex((ns) => ns >= from) - 1);
      const times = [], all = [], read = [];
      let number = -1;
      for (let at = begin; at < t_ns.length; at += 1) {
        while (number + 1 < used.length && used[number + 1][0] <= t_ns[at]) number += 1;
        times.push(this.#seconds(t_ns[at]));
        all.push(values[at]);
        read.push(number >= 0 && used[number][1][producer] ? values[at] : null);
        if (t_ns[at] > to) break;
      }
      return [times, all, read];
    });
    return this.#uPlot.join(tables);
  }

  #options() {
    const { lines, isStepped } = this.#shown;
    const paths = isStepped ? this.#uPlot.paths.stepped({ align: 1 }) : undefined;
    const series = lines.flatMap((line) => [1.2, 3].map((width) => ({
      width, paths, dash: line.dash, points: { show: false }, stroke: () => colour(`--plot-${line.colour}`),
    })));
    const axis = { stroke: () => colour("--muted"), font: FONT, grid: { stroke: () => colour("--line"), width: 1 }, ticks: { stroke: () => colour("--line"), width: 1 } };
    return {
      width: this.#width(), height: HIGH, legend: { show: false }, padding: [16, 8, 0, 0],
      scales: { x: { time: false, range: () => this.#shown.edges.map((ns) => this.#seconds(ns)) } },
      series: [{}, ...series],
      axes: [
        { ...axis, space: 70, size: 32, values: (_, splits) => splits.map((s) => clock(Math.round(s * 1e9), 0).replace(/\.?0+(?= )/, "")) },
        { ...axis, size: (_, texts) => Math.max(40, 14 + 7.5 * Math.max(0, ...(texts ?? []).map((text) => text.length))) },
      ],
      cursor: {
        y: false, points: { size: 6 }, drag: { x: true, y: false, setScale: false, dist: 5 },
        bind: { dblclick: () => () => { this.#acts.onReset(); return null; } },
      },
      hooks: {
        draw: [(chart) => this.#marks(chart)],
        setCursor: [(chart) => this.#acts.onPoint(chart.cursor.left < 0 ? null : this.#nanoseconds(chart.posToVal(chart.cursor.left, "x")))],
        setSelect: [(chart) => this.#selected(chart)],
      },
    };
  }

  #nanoseconds(s) {
    return s * 1e9 + this.#shown.began;
  }

  #selected(chart) {
    const { left, width } = chart.select;
    if (width < 5) return;
    chart.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.#acts.onSpan(this.#nanoseconds(chart.posToVal(left, "x")), this.#nanoseconds(chart.posToVal(left + width, "x")));
  }

  // Epochs as lines with their numbers; in a recording also the moment that the page shows.
  #marks(chart) {
    const { ctx, bbox } = chart;
    const scale = this.#uPlot.pxRatio;
    const { epochs, edges: [from, to], now } = this.#shown;
    const at = (ns) => Math.round(chart.valToPos(this.#seconds(ns), "x", true));
    const line = (x, dash) => {
      ctx.setLineDash(dash.map((long) => long * scale));
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    };
    ctx.save();
    Object.assign(ctx, { lineWidth: scale, strokeStyle: colour("--muted"), fillStyle: colour("--muted"), font: FONT.replace("12px", `${12 * scale}px`), textAlign: "center", textBaseline: "bottom" });
    let labelled = -Infinity;
    for (const one of epochs) {
      if (one.t_ns < from || one.t_ns > to) continue;
      const x = at(one.t_ns);
      line(x, [2, 3]);
      if (x - labelled < 26 * scale) continue;
      labelled = x;
      ctx.fillText(String(one.epoch), x, bbox.top - scale);
    }
    if (now !== null && now >= from && now <= to) {
      Object.assign(ctx, { lineWidth: 2 * scale, strokeStyle: colour("--accent") });
      line(at(now), []);
    }
    ctx.restore();
  }
}
