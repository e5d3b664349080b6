/** How far the target has moved against insertion depth: the live model, and the others' curves as they were left. */

import { axisTop, Curves, type Curve } from "../curves";
import { h, s } from "../dom";
import { standApart } from "../plotLabels";
import type { Session } from "../session";

const ROOM = { left: 22, right: 8, top: 22, bottom: 22 };
const EVERY = 100;
/** px that a name takes. */
const LABEL = 78;
/** px between two names. */
const LINE = 13;
const DASHES = ["5 4", "1.500 3.500", "8 3 2 3"];

interface Named { id: string; points: Curve }

export class MotionPlot {
  private readonly svg = s("svg", { class: "plot", role: "img", "aria-label": "Target motion in millimetres against insertion depth" });
  readonly element = h(
    "section",
    { class: "panel motion", "aria-labelledby": "motion-title" },
    h("div", { class: "panel-head" }, h("h2", { id: "motion-title" }, "Target motion"), h("span", {}, "mm, against insertion depth")),
    this.svg,
  );
  private readonly curves = new Curves();
  private dirty = true;
  private drawnAt = -Infinity;
  private size = { width: 0, height: 0 };

  constructor(private readonly session: Session) {
    new ResizeObserver(([entry]) => {
      this.size = { width: entry.contentRect.width, height: entry.contentRect.height };
      this.dirty = true;
    }).observe(this.svg);
    session.drawn.on(({ header }) => {
      this.curves.add(header.model, header);
      this.dirty = true;
    });
    session.sceneReady.on(() => {
      if (!session.resumed) this.curves.clear();
      this.dirty = true;
    });
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
    const all = this.curves.models.map((id) => ({ id, points: this.curves.get(id) }));
    const deepest = Math.max(0, ...all.flatMap(({ points }) => points.map(([depth]) => depth)));
    const largest = Math.max(0, ...all.flatMap(({ points }) => points.map(([, moved]) => moved)));
    const x = axisTop(deepest, 80, 5);
    const y = axisTop(largest, 2, 3);
    const px = (depth: number) => ROOM.left + (width * depth) / x.top;
    const py = (moved: number) => ROOM.top + height * (1 - moved / y.top);
    const line = (points: readonly (readonly [number, number])[]) =>
      points.length < 2 ? "" : `M${points.map(([a, b]) => `${px(a).toFixed(1)} ${py(b).toFixed(1)}`).join("L")}`;
    const out: SVGElement[] = [];
    for (let value = 0; value <= y.top + 1e-9; value += y.step) {
      out.push(s("path", { class: "grid-line", d: `M${px(0)} ${py(value).toFixed(1)}H${px(x.top)}` }));
      out.push(s("text", { x: ROOM.left - 8, y: (py(value) + 4).toFixed(1), "text-anchor": "end" }, plain(value)));
    }
    for (let value = 0; value <= x.top + 1e-9; value += x.step) {
      out.push(s("text", { x: px(value).toFixed(1), y: this.size.height - 5, "text-anchor": value > 0 && value >= x.top ? "end" : "middle" }, plain(value)));
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
    const now = frame?.header.readouts;
    if (now) out.push(s("circle", { class: "live", cx: px(now.depth).toFixed(1), cy: py(now.moved).toFixed(1), r: 4 }));
    return out;
  }
}

function plain(value: number): string {
  return String(Math.round(value * 1000) / 1000);
}
