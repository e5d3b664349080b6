/** An attempt on one axis: lanes, what happened, and a line for now that is dragged. Against time, or against depth. */

import { axisTop } from "../curves";
import { h, s } from "../dom";
import { draggable } from "../input/drag";
import { clock, number } from "../metrics";
import type { Course, Happened } from "../protocol";
import type { Reel } from "../reel";
import type { Trainer } from "../trainer";
import { clamp } from "../vec";
import { choose, radioKeys } from "./buttons";

type Axis = "time" | "depth";
type Mark = Pick<Happened, "time_s" | "text"> & { kind: Happened["kind"] | "comment" };
interface Lane { name: string; unit: string; className: string; of: (course: Course) => readonly (number | null)[]; signed?: boolean; least: number; alone?: boolean }

const LANES: readonly Lane[] = [
  { name: "Depth", unit: "mm", className: "depth", of: (course) => course.depth, least: 20 },
  { name: "Out of plane", unit: "mm", className: "plane", of: (course) => course.out_of_plane, least: 2, signed: true },
  { name: "Tip to target", unit: "mm", className: "target", of: (course) => course.to_target, least: 5, alone: true },
  { name: "Force", unit: "N", className: "force", of: (course) => course.force, least: 1, signed: true, alone: true },
];
/** px: of the names at the left, of the end at the right, of the words above, and of the scale below. */
const LEFT = 116;
const RIGHT = 16;
const TOP = 42;
const BELOW = 20;
const GAP = 6;
/** px of a line of words, and between two words. */
const LINE = 19;
const APART = 8;

export class Timeline {
  private readonly svg = s("svg", { class: "lanes", role: "img" });
  private readonly words = h("div", { class: "happened" });
  private readonly handle = h("div", { class: "now", role: "slider", tabindex: 0, "aria-label": "Time of the picture", "aria-valuemin": 0 });
  private readonly tabs = (["time", "depth"] as const).map((axis) => h("button", { type: "button", role: "radio", "data-axis": axis, onclick: () => this.turn(axis) }, axis === "time" ? "Time" : "Depth"));
  private readonly names = h("div", { class: "lane-names" });
  private readonly field = h("div", { class: "field" }, this.svg, this.words, this.names, this.handle);
  readonly element = h(
    "section",
    { class: "timeline", "aria-label": "Course of the attempt" },
    h("div", { class: "segments", role: "radiogroup", "aria-label": "Axis" }, ...this.tabs),
    this.field,
  );
  private axis: Axis = "time";
  private size = { width: 0, height: 0 };

  constructor(
    private readonly trainer: Trainer,
    private readonly reel: Reel,
  ) {
    new ResizeObserver(([entry]) => {
      this.size = { width: entry.contentRect.width, height: entry.contentRect.height };
      this.draw();
    }).observe(this.field);
    radioKeys(this.element, () => this.tabs, (k) => this.turn(k ? "depth" : "time"));
    trainer.changed.on(() => this.draw());
    trainer.commented.on(() => this.draw());
    reel.moved.on(() => this.place());
    const to = (event: PointerEvent) => {
      const box = this.field.getBoundingClientRect();
      const share = clamp((event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT), 0, 1);
      if (this.axis === "time") reel.seek(share * reel.end);
    };
    draggable(this.field, (event) => {
      if ((event.target as Element).closest("button")) return null;
      reel.play(false);
      to(event);
      return { move: (_dx, _dy, moved) => to(moved) };
    });
    this.handle.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.code];
      const page = { PageUp: 5, PageDown: -5 }[event.code];
      if (step) reel.step(step);
      else if (page) reel.seek(reel.now + page);
      else if (event.code === "Home") reel.seek(0);
      else if (event.code === "End") reel.seek(reel.end);
      else if (event.code === "Space" || event.code === "Enter") reel.play(!reel.playing);
      else return;
      event.preventDefault();
    });
    this.turn("time");
  }

  private turn(axis: Axis): void {
    this.axis = axis;
    for (const tab of this.tabs) choose(tab, tab.dataset.axis === axis);
    this.draw();
  }

  private x(at: number): number {
    const { course } = this.reel;
    if (!course) return LEFT;
    const values = this.axis === "time" ? course.time_s : course.depth;
    const most = this.axis === "time" ? this.reel.end : this.deepest(course);
    return LEFT + ((this.size.width - LEFT - RIGHT) * values[at]) / Math.max(most, 1e-9);
  }

  private deepest(course: Course): number {
    return axisTop(Math.max(...course.depth), 20, 5).top;
  }

  private draw(): void {
    const { debrief } = this.trainer;
    const { width, height } = this.size;
    if (!debrief || width < 1) return;
    const { course } = debrief;
    const shown = LANES.filter((lane) => (this.axis === "time" || lane.alone) && lane.of(course).some((value) => value !== null));
    const high = (height - TOP - BELOW) / shown.length;
    const out: SVGElement[] = [];
    const names: HTMLElement[] = [];
    shown.forEach((lane, k) => {
      const top = TOP + k * high;
      const { elements, scale } = this.lane(lane, course, top + GAP, high - 2 * GAP);
      out.push(...elements, s("path", { class: "rule", d: `M0 ${top.toFixed(1)}H${width}` }));
      const name = h("p", {}, h("b", {}, lane.name), h("span", {}, scale));
      name.style.top = `${(top + GAP).toFixed(1)}px`;
      names.push(name);
    });
    out.push(s("path", { class: "rule", d: `M0 ${(height - BELOW).toFixed(1)}H${width}` }), ...this.scale(course, height - 5));
    this.names.replaceChildren(...names);
    this.words.replaceChildren(...(this.axis === "time" ? this.happened(this.marked(debrief.happened), out, height - BELOW) : []));
    this.svg.replaceChildren(...out);
    this.svg.setAttribute("aria-label", `${shown.map(({ name }) => name.toLowerCase()).join(", ")} against ${this.axis}`);
    this.handle.setAttribute("aria-valuemax", this.reel.end.toFixed(1));
    this.place();
  }

  private lane(lane: Lane, course: Course, top: number, high: number): { elements: SVGElement[]; scale: string } {
    const values = lane.of(course);
    const known = values.filter((value) => value !== null);
    const most = Math.max(lane.least, ...known.map(lane.signed ? Math.abs : (value) => value));
    const least = lane.signed && known.some((value) => value < -0.02 * most) ? -most : 0;
    const y = (value: number) => top + (high * (most - value)) / (most - least);
    const line: string[] = [];
    let drawn = false;
    values.forEach((value, k) => {
      if (value !== null) line.push(`${drawn ? "L" : "M"}${this.x(k).toFixed(1)} ${y(value).toFixed(1)}`);
      drawn = value !== null;
    });
    const elements: SVGElement[] = [];
    if (lane.className === "plane") elements.push(...this.blind(top, high), ...this.slice(course, y));
    else if (least < 0) elements.push(s("path", { class: "zero", d: `M${LEFT} ${y(0).toFixed(1)}H${this.size.width - RIGHT}` }));
    elements.push(s("path", { class: `curve ${lane.className}`, d: line.join("") }));
    return { elements, scale: `${number(least)} to ${number(Number(most.toPrecision(2)))} ${lane.unit}` };
  }

  /** Where the tip went on out of plane. */
  private blind(top: number, high: number): SVGElement[] {
    return (this.trainer.debrief?.happened ?? []).filter(({ kind }) => kind === "blind").map(({ time_s, until_s }) => {
      const [from, to] = [this.atTime(time_s), this.atTime(until_s ?? time_s)];
      return s("rect", { class: "blind", x: from.toFixed(1), y: top, width: Math.max(1, to - from).toFixed(1), height: Math.max(0, high) });
    });
  }

  private atTime(time: number): number {
    return LEFT + ((this.size.width - LEFT - RIGHT) * Math.min(time, this.reel.end)) / Math.max(this.reel.end, 1e-9);
  }

  /** Half the slice on both sides: within it the tip is in plane. */
  private slice(course: Course, y: (value: number) => number): SVGElement[] {
    const edge = (sign: number) =>
      course.half_slice.map((half, k) => (half === null ? "" : `${k && course.half_slice[k - 1] !== null ? "L" : "M"}${this.x(k).toFixed(1)} ${y(sign * half).toFixed(1)}`)).join("");
    return [1, -1].map((sign) => s("path", { class: "slice", d: edge(sign) }));
  }

  private scale(course: Course, y: number): SVGElement[] {
    const most = this.axis === "time" ? this.reel.end : this.deepest(course);
    const { step } = axisTop(most, most, 6);
    const wide = this.size.width - LEFT - RIGHT;
    return Array.from({ length: Math.floor(most / step + 1e-9) + 1 }, (_, k) => {
      const text = this.axis === "time" ? clock(k * step) : `${number(k * step)} mm`;
      return s("text", { x: (LEFT + (wide * k * step) / Math.max(most, 1e-9)).toFixed(1), y, "text-anchor": k ? "middle" : "start" }, text);
    });
  }

  /** What happened and what the trainer says of it, in the order of their times. */
  private marked(happened: readonly Happened[]): Mark[] {
    const said = this.trainer.comments.map(({ time_s, text }) => ({ time_s, kind: "comment" as const, text: `“${text}”` }));
    return [...happened, ...said].sort((a, b) => a.time_s - b.time_s);
  }

  /** Names above their lines, on two lines of text; a name that finds no room is left to its line's hint. */
  private happened(all: readonly Mark[], lines: SVGElement[], bottom: number): HTMLElement[] {
    const ends = [-Infinity, -Infinity];
    const out: HTMLElement[] = [];
    for (const { time_s, kind, text } of all) {
      const x = this.atTime(time_s);
      lines.push(s("path", { class: `event ${kind}`, d: `M${x.toFixed(1)} ${TOP}V${bottom.toFixed(1)}` }, s("title", {}, text)));
      const words = h("button", { type: "button", class: kind, onclick: () => this.reel.seek(time_s) }, text);
      this.words.append(words);
      const needed = words.offsetWidth;
      const from = Math.min(x + 3, this.size.width - needed - 2);
      const row = ends.findIndex((end) => from > end + APART);
      if (row < 0) continue;
      ends[row] = from + needed;
      words.style.left = `${from.toFixed(1)}px`;
      words.style.top = `${2 + row * LINE}px`;
      out.push(words);
    }
    return out;
  }

  private place(): void {
    const { reel } = this;
    if (!reel.course || this.size.width < 1) return;
    this.handle.style.left = `${this.x(reel.at).toFixed(1)}px`;
    this.handle.setAttribute("aria-valuenow", reel.now.toFixed(1));
    this.handle.setAttribute("aria-valuetext", `${clock(reel.now)} of ${clock(reel.end)}`);
  }
}
