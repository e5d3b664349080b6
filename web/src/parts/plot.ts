/** Target motion, or force, against insertion depth: the live model, and the others' curves as they were left. */

import { axisTop, Curves, type Curve } from "../curves";
import { h, s } from "../dom";
import { choose, radioKeys } from "./buttons";
import { standApart } from "../plotLabels";
import type { LoggedEvent, Readouts } from "../protocol";
import type { Session } from "../session";
import { Traces } from "../traces";

const ROOM = { left: 22, right: 8, top: 22, bottom: 22 };
const EVERY = 100;
/** px that a name takes. */
const LABEL = 78;
/** px between two names. */
const LINE = 13;
const DASHES = ["5 4", "1.500 3.500", "8 3 2 3"];

interface Named { id: string; points: Curve }
interface Shown { id: "motion" | "force"; name: string; unit: string; least: number; value: (readouts: Readouts) => number | null }

const SHOWN: readonly Shown[] = [
  { id: "motion", name: "Target motion", unit: "mm", least: 2, value: ({ moved }) => moved },
  { id: "force", name: "Force", unit: "N", least: 1, value: ({ hub }) => hub?.axial_n ?? null },
];

export class MotionPlot {
  private readonly svg = s("svg", { class: "plot", role: "img" });
  private readonly unit = h("span", {});
  private readonly tabs = SHOWN.map(({ id, name }) => h("button", { type: "button", role: "radio", "data-plot": id, onclick: () => this.show(id) }, name));
  readonly element = h(
    "section",
    { class: "panel motion", "aria-label": "Against insertion depth" },
    h("div", { class: "panel-head" }, h("div", { class: "segments", role: "radiogroup", "aria-label": "Plot" }, ...this.tabs), this.unit),
    this.svg,
  );
  private readonly curves = { motion: new Curves(), force: new Traces() };
  private shown: Shown = SHOWN[0];
  /** Of this pass, with the depth of each. */
  private events: LoggedEvent[] = [];
  private passes = -1;
  private dirty = true;
  private drawnAt = -Infinity;
  private size = { width: 0, height: 0 };

  constructor(private readonly session: Session) {
    new ResizeObserver(([entry]) => {
      this.size = { width: entry.contentRect.width, height: entry.contentRect.height };
      this.dirty = true;
    }).observe(this.svg);
    radioKeys(this.element, () => this.tabs, (k) => this.show(SHOWN[k].id));
    session.drawn.on(({ header }) => {
      this.curves.motion.add(header.model, header);
      this.curves.force.add(header.model, header);
      if (header.pass.passes !== this.passes) this.events = [];
      this.passes = header.pass.passes;
      this.dirty = true;
    });
    session.happened.on((event) => this.events.push(event));
    session.sceneReady.on(() => {
      if (!session.resumed) for (const curves of Object.values(this.curves)) curves.clear();
      this.dirty = true;
    });
    this.show("motion");
  }

  private show(id: Shown["id"]): void {
    this.shown = SHOWN.find((one) => one.id === id) ?? SHOWN[0];
    for (const tab of this.tabs) choose(tab, tab.dataset.plot === this.shown.id);
    this.unit.textContent = `${this.shown.unit}, against depth`;
    this.svg.setAttribute("aria-label", `${this.shown.name} in ${this.shown.unit} against insertion depth in mm`);
    this.dirty = true;
  }

  tick(now: number): void {
    if (!this.dirty || now - this.drawnAt < EVERY || this.size.width < 1) return;
    this.dirty = false;
    this.drawnAt = now;
    this.svg.replaceChildren(...this.draw());
  }

  private draw(): SVGElement[] {
    const { frame, scene, model } = this.session;
    const width = this.size.width - ROOM.left - ROOM.right;
    const height = this.size.height - ROOM.top - ROOM.bottom;
    const { shown, events } = this;
    const curves = this.curves[shown.id];
    const all = curves.models.map((id) => ({ id, points: curves.get(id) }));
    const deepest = Math.max(0, ...all.flatMap(({ points }) => points.map(([depth]) => depth)));
    const values = all.flatMap(({ points }) => points.map(([, value]) => value));
    const largest = Math.max(0, ...values);
    const x = axisTop(deepest, 80, 5);
    const lowest = Math.min(0, ...values);
    const y = axisTop(Math.max(largest, -lowest), shown.least, lowest < 0 ? 2 : 3);
    const below = -y.step * Math.ceil(-lowest / y.step - 1e-9);
    const px = (depth: number) => ROOM.left + (width * depth) / x.top;
    const py = (value: number) => ROOM.top + (height * (y.top - value)) / (y.top - below);
    const line = (points: readonly (readonly [number, number])[]) =>
      points.length < 2 ? "" : `M${points.map(([a, b]) => `${px(a).toFixed(1)} ${py(b).toFixed(1)}`).join("L")}`;
    const out: SVGElement[] = [];
    for (let value = below; value <= y.top + 1e-9; value += y.step) {
      out.push(s("path", { class: "grid-line", d: `M${px(0)} ${py(value).toFixed(1)}H${px(x.top)}` }));
      out.push(s("text", { x: ROOM.left - 8, y: (py(value) + 4).toFixed(1), "text-anchor": "end" }, plain(value)));
    }
    for (let value = 0; value <= x.top + 1e-9; value += x.step) {
      out.push(s("text", { x: px(value).toFixed(1), y: this.size.height - 5, "text-anchor": value > 0 && value >= x.top ? "end" : "middle" }, plain(value)));
    }
    if (shown.id === "force") {
      for (const { depth, text } of events) out.push(s("path", { class: "event", d: `M${px(depth).toFixed(1)} ${ROOM.top}V${ROOM.top + height}` }, s("title", {}, text)));
    }
    const name = (id: string) => scene?.models.find((candidate) => candidate.id === id)?.name ?? id;
    const highest = (from: number, to: number) =>
      Math.min(...all.flatMap(({ points }) => points.filter(([depth]) => px(depth) >= from && px(depth) <= to).map(([, moved]) => py(moved))));
    // beside the end of its curve, or over all curves where there is no room
    const label = ({ id, points }: Named) => {
      const [depth, moved] = points[points.length - 1];
      const end = px(depth);
      const room = end + LABEL < this.size.width;
      const at = room ? py(moved) + 4 : Math.min(py(moved), highest(end - LABEL, end)) - 9;
      const text = s("text", { class: id === model ? "live" : "other", x: (end + (room ? 9 : 4)).toFixed(1), "text-anchor": room ? "start" : "end" }, name(id));
      return { at, text };
    };
    const live = all.find(({ id }) => id === model);
    const others = all.filter(({ id, points }) => id !== model && points.length > 1);
    others.forEach(({ points }, k) => out.push(s("path", { class: "other", d: line(points), "stroke-dasharray": DASHES[k % DASHES.length] })));
    if (live) out.push(s("path", { class: "live", d: line(live.points) }));
    const labels = (live && live.points.length > 1 ? [live, ...others] : others).map(label);
    const heights = standApart(labels.map(({ at }) => at), 9, ROOM.top + height - 4, LINE);
    labels.forEach(({ text }, k) => text.setAttribute("y", heights[k].toFixed(1)));
    out.push(...labels.map(({ text }) => text));
    const readouts = frame?.header.readouts;
    const now = readouts ? shown.value(readouts) : null;
    if (readouts && now !== null) out.push(s("circle", { class: "live", cx: px(readouts.depth).toFixed(1), cy: py(now).toFixed(1), r: 4 }));
    else if (readouts) out.push(s("text", { class: "none", x: px(x.top / 2).toFixed(1), y: ROOM.top + height / 2, "text-anchor": "middle" }, `${name(model)} knows no ${shown.name.toLowerCase()}`));
    return out;
  }
}

function plain(value: number): string {
  return String(Math.round(value * 1000) / 1000).replace("-", "\u2212");
}
