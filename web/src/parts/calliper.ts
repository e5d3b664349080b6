/** The distance between two places of the image, mm: two clicks, or a drag; the next click begins anew. */

import { h, s, set, write } from "../dom";
import type { Point } from "../image/sector";
import { draggable } from "../input/drag";
import type { ImagePane } from "./imagePane";

/** px of the arms of a cross, and of the words from it. */
const ARM = 7;
const BESIDE = 14;
/** px by which a pointer may shake in a click. */
const SHAKE = 4;
/** mm of an arrow key, and with Shift. */
const NEAR = 0.5;
const FAR = 5;

export class Calliper {
  private readonly line = s("path", { class: "line" });
  private readonly halo = s("path", { class: "halo" });
  private readonly words = s("text", {});
  private readonly ground = s("rect", { class: "ground", x: 0, y: 0, width: "100%", height: "100%" });
  private readonly said = h("output", { class: "unseen", "aria-label": "Distance" });
  readonly svg = s("svg", { class: "calliper", hidden: true, tabindex: 0, role: "application", "aria-label": "Calliper: arrows move its end, Enter sets it, Escape ends it" }, this.ground, this.halo, this.line, this.words);
  readonly button = h("button", { type: "button", class: "button toggle calliper-button", "aria-pressed": "false", "data-hint": "Measure a distance on the image" }, "Calliper");
  readonly element = h("div", { class: "measuring" }, this.button, this.said);
  /** mm in the image. */
  private ends: Point[] = [];

  constructor(private readonly pane: ImagePane) {
    pane.element.append(this.svg);
    this.button.addEventListener("click", ({ detail }) => {
      this.turn(this.button.getAttribute("aria-pressed") !== "true");
      if (detail === 0) this.begin(); // by a key
    });
    for (const kind of ["keydown", "keyup"] as const) this.svg.addEventListener(kind, (event) => this.heed(event));
    draggable(this.ground, (event) => {
      const from = this.place(event);
      if (!from) return null;
      this.ends = this.ends.length === 1 ? [this.ends[0], from] : [from];
      this.draw();
      const began = this.ends.length === 1;
      return {
        move: (dx, dy, moved) => {
          const to = this.place(moved);
          if (!to || (began && Math.hypot(dx, dy) < SHAKE)) return;
          this.ends = [this.ends[0], to];
          this.draw();
        },
      };
    });
    new ResizeObserver(() => this.draw()).observe(pane.element);
  }

  /** An end in the middle of the image, for the arrows to move. */
  private begin(): void {
    const { mapping } = this.pane;
    if (this.svg.hasAttribute("hidden") || !mapping) return;
    const { box } = mapping;
    this.ends = [mapping.back([box.left + box.width / 2, box.top + box.height / 2])];
    this.svg.focus();
    this.draw();
  }

  /** Keys while it has the focus; none of them moves needle or probe. */
  private heed(event: KeyboardEvent): void {
    if (event.code === "Tab") return;
    event.stopPropagation();
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.code];
    const end = this.ends.at(-1);
    if (event.type === "keyup" || !(arrow || ["Enter", "Space", "Escape"].includes(event.code))) return;
    event.preventDefault();
    if (event.code === "Escape") {
      this.turn(false);
      return this.button.focus();
    }
    if (!end) return this.begin();
    if (arrow) {
      const by = event.shiftKey ? FAR : NEAR;
      this.ends[this.ends.length - 1] = [end[0] + (this.pane.mapping?.sign ?? 1) * by * arrow[0], end[1] + by * arrow[1]];
    } else this.ends = this.ends.length === 1 ? [end, end] : [end];
    this.draw();
  }

  private turn(on: boolean): void {
    this.button.setAttribute("aria-pressed", String(on));
    this.svg.toggleAttribute("hidden", !on);
    this.ends = [];
    this.draw();
  }

  private place({ clientX, clientY }: PointerEvent): Point | null {
    const box = this.pane.element.getBoundingClientRect();
    return this.pane.mapping?.back([clientX - box.left, clientY - box.top]) ?? null;
  }

  private draw(): void {
    const { mapping } = this.pane;
    const places = mapping ? this.ends.map((end) => mapping.point(end)) : [];
    const crosses = places.map(([x, y]) => `M${x - ARM} ${y}h${2 * ARM}M${x} ${y - ARM}v${2 * ARM}`).join("");
    const [a, b] = places;
    const d = crosses + (b ? `M${a[0]} ${a[1]}L${b[0]} ${b[1]}` : "");
    for (const stroke of [this.halo, this.line]) set(stroke, { d });
    const [from, to] = this.ends;
    const text = to ? `${Math.hypot(to[0] - from[0], to[1] - from[1]).toFixed(1)} mm` : "";
    write(this.words, text);
    write(this.said, text);
    this.said.dataset.value = to ? Math.hypot(to[0] - from[0], to[1] - from[1]).toFixed(3) : "";
    if (b) set(this.words, { x: b[0] + BESIDE, y: b[1] - BESIDE / 2 });
  }
}
