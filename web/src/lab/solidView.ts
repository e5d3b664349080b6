/** The 3-D view of the station that is watched, beside its image: looked at from anywhere, and nothing in it answers. */

import { h, write } from "../dom";
import type { Frame, Geometry } from "../protocol";
import type { Session } from "../session";
import type { View3d } from "../view3d/view";

export class SolidView {
  readonly element = h("div", { class: "watched-view", role: "img", "aria-label": "3-D view of the station", hidden: true });
  private readonly problem = h("p", { class: "no-view" });
  private view: View3d | null = null;
  private kept: Geometry | null = null;
  /** The last positions, which come only when they change. */
  private moved: Frame | null = null;

  constructor(private readonly session: Session) {
    session.sceneReady.on((scene) => {
      this.kept = this.moved = null;
      this.view?.begin(scene);
    });
    session.geometry.on((geometry) => {
      this.kept = geometry;
      this.view?.build(geometry);
    });
    session.drawn.on((frame) => {
      if (frame.positions) this.moved = frame;
      if (!this.element.hidden) this.view?.take(frame);
    });
  }

  get shown(): boolean {
    return !this.element.hidden;
  }

  show(on: boolean): void {
    this.element.hidden = !on;
    if (on && !this.view) void this.load();
  }

  tick(now: number): void {
    if (this.shown) this.view?.tick(now);
  }

  private async load(): Promise<void> {
    let view: View3d;
    try {
      view = new (await import("../view3d/view")).View3d();
    } catch (error) {
      write(this.problem, `The 3-D view cannot be shown: ${(error as Error).message}.`);
      return this.element.append(this.problem);
    }
    this.view = view;
    this.element.prepend(view.canvas);
    new ResizeObserver(([entry]) => view.resize(entry.contentRect.width, entry.contentRect.height)).observe(this.element);
    const { scene, frame } = this.session;
    if (scene) view.begin(scene);
    if (this.kept) view.build(this.kept);
    for (const past of [this.moved, frame]) if (past) view.take(past);
  }
}
