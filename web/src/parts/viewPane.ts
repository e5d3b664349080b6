/** The 3-D pane: the view, its three switches, and on a tablet the inset that changes places with the image. */

import type { Desk } from "../desk";
import { h, toggle, write } from "../dom";
import { icon } from "../icons";
import type { Frame, Geometry } from "../protocol";
import type { View3d } from "../view3d/view";
import { toggleButton } from "./buttons";
import { TargetRings } from "./targetRings";

export class ViewPane {
  view: View3d | null = null;
  private readonly scale = h("p", { class: "colour-scale", hidden: true }, h("span", {}, "0"), h("canvas", { width: 84, height: 1 }), h("output", { "aria-live": "off" }));
  private readonly swap = h("button", { type: "button", class: "button swap", "data-hint": "Change places with the image", "aria-label": "Change places with the image" }, icon("swap"));
  readonly element = h("section", { class: "view-pane", "aria-label": "3-D view" }, this.scale);
  /** The geometry of a scene comes once, and positions when they change; both may come before the view does. */
  private kept: Geometry | null = null;
  private moved: Frame | null = null;
  private loading = false;

  private readonly rings: TargetRings;

  constructor(private readonly desk: Desk) {
    const { session } = desk;
    this.rings = new TargetRings(session);
    this.element.append(this.rings.element);
    this.element.append(
      h("div", { class: "view-buttons" }, toggleButton(desk, "grid", "Grid"), toggleButton(desk, "colours", "Displacement"), h("span", { class: "space" }), toggleButton(desk, "probeView", "Probe view")),
      this.swap,
    );
    tapped(this.element, () => {
      if (!desk.switches.swapped && document.body.dataset.layout === "tablet") desk.flip("swapped", true);
    });
    this.swap.addEventListener("click", () => desk.flip("swapped"));
    session.sceneReady.on((scene) => {
      this.moved = null;
      this.view?.begin(scene);
    });
    session.geometry.on((geometry) => {
      this.kept = geometry;
      this.view?.build(geometry);
    });
    session.drawn.on((frame) => this.take(frame));
    desk.switched.on((switches) => {
      toggle(this.element, "small", !switches.swapped);
      this.apply();
    });
    toggle(this.element, "small", true);
    session.geometry.on(() => this.apply());
  }

  private take(frame: Frame): void {
    if (this.view) return this.view.take(frame);
    if (frame.positions) this.moved = frame;
    // the view comes in a file of its own after the first image, which then need not share the processor with it
    if (!this.loading) afterPaint(() => void this.load());
    this.loading = true;
  }

  private async load(): Promise<void> {
    try {
      const { View3d } = await import("../view3d/view");
      this.view = new View3d();
    } catch (error) {
      this.element.prepend(h("p", { class: "no-view" }, `The 3-D view cannot be shown: ${(error as Error).message}.`));
      return;
    }
    if (this.view.software) this.desk.session.look({ ahead: 0 });
    this.element.prepend(this.view.canvas);
    new ResizeObserver(([entry]) => this.view?.resize(entry.contentRect.width, entry.contentRect.height)).observe(this.element);
    void this.paintScale();
    const { dragProbe } = await import("../view3d/dragProbe");
    dragProbe(this.view, this.desk);
    const { scene, frame } = this.desk.session;
    if (scene) this.view.begin(scene);
    if (this.kept) this.view.build(this.kept);
    for (const past of [this.moved, frame]) if (past) this.view.take(past);
    this.apply();
  }

  /** Whether a processor draws it, which the image needs too. */
  get software(): boolean {
    return this.view?.software ?? false;
  }

  tick(now: number): void {
    this.view?.tick(now);
    if (this.view) this.rings.tick(this.view);
    if (this.view && this.desk.switches.colours) write(this.scale.lastElementChild as HTMLElement, `${this.view.tissue.top} mm`);
  }

  private apply(): void {
    const { grid, colours, probeView } = this.desk.switches;
    this.scale.hidden = !colours;
    if (!this.view) return;
    this.view.tissue.showGrid(grid);
    this.view.tissue.showColours(colours);
    if (this.view.follow !== probeView) {
      this.view.follow = probeView;
      if (probeView) this.view.lookAlongProbe();
      else this.view.home();
    }
    this.view.redraw();
  }

  private async paintScale(): Promise<void> {
    const canvas = this.scale.querySelector("canvas") as HTMLCanvasElement;
    const { cividis } = await import("../view3d/cividis");
    const context = canvas.getContext("2d") as CanvasRenderingContext2D;
    const colour = [0, 0, 0];
    for (let x = 0; x < canvas.width; x += 1) {
      cividis(x / (canvas.width - 1), colour, 0);
      context.fillStyle = `rgb(${colour.map((c) => Math.round(255 * c)).join(" ")})`;
      context.fillRect(x, 0, 1, 1);
    }
  }
}

/** Once what was just drawn is on the screen. */
function afterPaint(run: () => void): void {
  requestAnimationFrame(() => setTimeout(run));
}

/** A short touch that does not move; one on a button is the button's. */
export function tapped(element: HTMLElement, run: () => void): void {
  let from: PointerEvent | null = null;
  element.addEventListener("pointerdown", (event) => (from = (event.target as Element).closest("button") ? null : event), true);
  element.addEventListener(
    "pointerup",
    (event) => {
      if (from && Math.hypot(event.clientX - from.clientX, event.clientY - from.clientY) < TAP_PX && event.timeStamp - from.timeStamp < TAP_MS) run();
      from = null;
    },
    true,
  );
}

const TAP_PX = 8;
const TAP_MS = 350;
