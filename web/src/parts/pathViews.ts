/** Where the tip went, seen from three sides: with the target, the structures, and the needle at the chosen moment. */

import { h, write } from "../dom";
import { clock } from "../metrics";
import type { Course, Geometry, MeshData, Scene } from "../protocol";
import type { Reel } from "../reel";
import type { Trainer } from "../trainer";
import { dot, sub, type Vec } from "../vec";
import { missed } from "./verdict";

/** Places are to the right, deeper and away from the viewer; which of these a view has across and down. */
interface View { name: string; across: 0 | 1 | 2; down: 0 | 1 | 2; flip: 1 | -1 }

const VIEWS: readonly View[] = [
  { name: "From above", across: 0, down: 2, flip: -1 },
  { name: "From the side", across: 2, down: 1, flip: 1 },
  { name: "From the front", across: 0, down: 1, flip: 1 },
];
/** mm around what is shown, and px around that. */
const ROOM = 6;
const EDGE = 8;
const COLOURS = { inPlane: "#5cc8ff", blind: "#ff9b3d", target: "#ffe04d", text: "#aeb7c0" };

interface Shape { colour: string; opacity: number; path: (view: View) => Path2D }

export class PathViews {
  private readonly canvases = VIEWS.map(({ name }) => h("canvas", { role: "img", "aria-label": `Path of the tip, ${name.toLowerCase()}` }));
  private readonly story = h("ul", { class: "story" });
  private readonly comments = h("ul", { class: "comments", "aria-label": "The trainer's comments" });
  private readonly line = h("input", { class: "field-of", maxlength: 500, autocomplete: "off", "aria-label": "A comment on this moment", placeholder: "What a teacher says of it" });
  /** In a lab its trainer comments, on a page of his own. */
  private readonly remark = h("form", { class: "remark" }, this.line, h("button", { type: "submit", class: "button" }, "Comment"));
  readonly element = h(
    "section",
    { class: "path-views", "aria-labelledby": "path-title" },
    h("div", { class: "panel-head" }, h("h2", { id: "path-title" }, "Path of the tip"), h("span", {}, h("i", { class: "key in-plane" }), " in plane ", h("i", { class: "key blind" }), " out of plane")),
    h("div", { class: "views" }, ...this.canvases.map((canvas, k) => h("figure", {}, canvas, h("figcaption", {}, VIEWS[k].name)))),
    this.story,
    this.comments,
    this.remark,
  );
  private shapes: Shape[] = [];
  private geometry: Geometry | null = null;

  constructor(
    private readonly trainer: Trainer,
    private readonly reel: Reel,
  ) {
    const { session } = trainer;
    session.sceneReady.on(() => {
      this.geometry = null;
      this.shapes = [];
    });
    session.geometry.on((geometry) => {
      this.geometry = geometry;
      this.shapes = [];
      this.draw();
    });
    new ResizeObserver(() => this.draw()).observe(this.element);
    reel.moved.on(() => this.draw());
    const refresh = () => write(this.remark.lastElementChild as HTMLElement, `Comment at ${clock(reel.now)}`);
    reel.moved.on(refresh);
    trainer.changed.on(refresh);
    trainer.stationed.on(() => (this.remark.hidden = true));
    this.remark.addEventListener("submit", (event) => {
      event.preventDefault();
      const text = this.line.value.trim();
      if (!text) return this.line.focus();
      trainer.session.say({ type: "add_comment", time_s: reel.now, text });
      this.line.value = "";
    });
    trainer.commented.on((comments) => {
      this.comments.replaceChildren(
        ...comments.map(({ time_s, text }) => h("li", {}, h("button", { type: "button", onclick: () => reel.seek(time_s) }, clock(time_s)), ` ${text}`)),
      );
    });
    trainer.changed.on(() => {
      const { debrief } = trainer;
      if (!debrief) return;
      this.story.replaceChildren(...debrief.story.map((sentence) => h("li", {}, sentence)), ...missed(debrief).map((line) => h("li", { class: "caution" }, line)));
      this.draw();
    });
  }

  private draw(): void {
    const { course } = this.reel;
    const { scene } = this.trainer.session;
    if (!course || !scene || this.trainer.phase !== "debrief") return;
    if (this.geometry && this.shapes.length === 0) this.shapes = this.geometry.meshes.filter(isOrgan).map((mesh) => shapeOf(mesh, scene));
    this.canvases.forEach((canvas, k) => this.drawView(canvas, VIEWS[k], course));
  }

  private drawView(canvas: HTMLCanvasElement, view: View, course: Course): void {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const context = canvas.getContext("2d");
    if (!context || width < 1) return;
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const seen = extent(course);
    const [low, high] = [flat(view, seen.low), flat(view, seen.high)];
    const [left, right] = [Math.min(low[0], high[0]) - ROOM, Math.max(low[0], high[0]) + ROOM];
    const [top, bottom] = [Math.min(low[1], high[1]) - ROOM, Math.max(low[1], high[1]) + ROOM];
    const scale = Math.min((width - 2 * EDGE) / (right - left), (height - 2 * EDGE) / (bottom - top));
    const px = 1 / scale;
    context.setTransform(ratio * scale, 0, 0, ratio * scale, ratio * (width / 2 - (scale * (left + right)) / 2), ratio * (height / 2 - (scale * (top + bottom)) / 2));
    for (const { colour, opacity, path } of this.shapes) {
      context.globalAlpha = 0.25 + 0.35 * opacity;
      context.fillStyle = colour;
      context.fill(path(view));
    }
    context.globalAlpha = 1;
    if (view.down === 1) stroke(context, [[left - 1e3, 0], [right + 1e3, 0]], COLOURS.text, px);
    this.drawNeedle(context, view, course, px);
    drawPath(context, view, course, px);
    const { at } = this.reel;
    const tip = course.tip[at];
    ring(context, flat(view, course.target[at]), 6 * px, COLOURS.target, 2 * px);
    if (tip) ring(context, flat(view, tip), 4.5 * px, COLOURS.inPlane, 2 * px);
  }

  private drawNeedle(context: CanvasRenderingContext2D, view: View, course: Course, px: number): void {
    const { at } = this.reel;
    const [entry, tip] = [course.entry[at], course.tip[at]];
    if (entry && tip) stroke(context, [flat(view, entry), flat(view, tip)], "#eef1f4", px);
  }
}

function drawPath(context: CanvasRenderingContext2D, view: View, course: Course, px: number): void {
  for (let k = 1; k < course.tip.length; k += 1) {
    const [from, to, half] = [course.tip[k - 1], course.tip[k], course.half_slice[k]];
    if (!from || !to) continue;
    const blind = half !== null && Math.abs(course.out_of_plane[k] ?? 0) > half;
    stroke(context, [flat(view, from), flat(view, to)], blind ? COLOURS.blind : COLOURS.inPlane, 2.2 * px);
  }
}

function stroke(context: CanvasRenderingContext2D, points: readonly Vec[], colour: string, width: number): void {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.lineCap = "round";
  context.stroke();
}

function ring(context: CanvasRenderingContext2D, [x, y]: Vec, radius: number, colour: string, width: number): void {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
}

function flat({ across, down, flip }: View, place: Vec): [number, number] {
  return [place[across], flip * place[down]];
}

/** All that a tip and its target came to, and the skin. */
function extent({ tip, entry, target }: Course): { low: number[]; high: number[] } {
  const places = [...tip, ...entry, ...target].filter((place) => place !== null);
  const axis = (k: number) => places.map((place) => place[k]);
  const low = [0, 1, 2].map((k) => Math.min(...axis(k)));
  return { low: [low[0], Math.min(0, low[1]), low[2]], high: [0, 1, 2].map((k) => Math.max(...axis(k))) };
}

function isOrgan({ info }: MeshData): boolean {
  return info.kind === "surface" && info.name !== "skin";
}

/** The outline of a mesh from a side: all its triangles, turned the same way round so that none cuts a hole. */
function shapeOf({ info, positions, indices }: MeshData, scene: Scene): Shape {
  const { right, depth, out, skin_origin: origin } = scene.frame;
  const places: Vec[] = [];
  for (let k = 0; k < positions.length; k += 3) {
    const from = sub([positions[k], positions[k + 1], positions[k + 2]], origin);
    places.push([dot(from, right), dot(from, depth), dot(from, out)]);
  }
  const made = new Map<View, Path2D>();
  const path = (view: View) => {
    let found = made.get(view);
    if (found) return found;
    made.set(view, (found = new Path2D()));
    for (let k = 0; k < indices.length; k += 3) {
      const [a, b, c] = [indices[k], indices[k + 1], indices[k + 2]].map((index) => flat(view, places[index]));
      const turned = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) < 0;
      const [second, third] = turned ? [c, b] : [b, c];
      found.moveTo(a[0], a[1]);
      found.lineTo(second[0], second[1]);
      found.lineTo(third[0], third[1]);
      found.closePath();
    }
    return found;
  };
  return { colour: info.colour, opacity: info.opacity, path };
}
