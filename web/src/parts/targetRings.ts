/** The targets that are not aimed at, as rings in the 3-D view: a click aims at one. */

import { h } from "../dom";
import type { Scene } from "../protocol";
import type { Session } from "../session";
import type { View3d } from "../view3d/view";

interface Ring { button: HTMLButtonElement; id: string; at: readonly number[]; shown: string }

export class TargetRings {
  readonly element = h("div", { class: "rings" });
  private rings: Ring[] = [];

  constructor(private readonly session: Session) {
    session.sceneReady.on((scene) => {
      this.rings = scene.targets.flatMap((target) => this.ring(target));
      this.element.replaceChildren(...this.rings.map(({ button }) => button));
      this.choose(session.target);
    });
    session.targetChanged.on((id) => this.choose(id));
  }

  /** Once an animation frame: where the camera has them. */
  tick(view: View3d): void {
    for (const ring of this.rings) {
      const place = view.onPane(ring.at);
      const shown = place ? `translate(${place[0].toFixed(1)}px, ${place[1].toFixed(1)}px)` : "";
      if (shown === ring.shown) continue;
      ring.shown = shown;
      ring.button.style.transform = shown;
      ring.button.style.visibility = shown ? "" : "hidden";
    }
  }

  private ring({ id, name, at }: Scene["targets"][number]): Ring[] {
    if (!at) return [];
    const button = h("button", { type: "button", class: "target-ring", "aria-label": `Aim at ${name}`, "data-hint": `Aim at ${name}`, onclick: () => this.session.chooseTarget(id) });
    return [{ button, id, at, shown: "" }];
  }

  private choose(id: string): void {
    for (const ring of this.rings) ring.button.hidden = ring.id === id;
  }
}
