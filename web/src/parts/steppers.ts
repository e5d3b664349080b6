/** Steppers of the knobs that a scene has: made anew where another one has others. */

import type { Desk } from "../desk";
import { h } from "../dom";
import type { Knob } from "../protocol";
import { stepper, type Stepper } from "./stepper";

export interface Look {
  /** Those of the group that are moved by other means. */
  without?: readonly string[];
  /** Name and value above two large buttons. */
  tall?: boolean;
  /** The last one first. */
  upwards?: boolean;
}

export function steppers(desk: Desk, group: Knob["group"], className: string, { without = [], tall = false, upwards = false }: Look = {}): HTMLElement {
  const { session } = desk;
  const element = h("div", { class: className });
  let made: Stepper[] = [];
  let described = "";
  const refresh = () => made.forEach((one) => one.refresh());
  session.sceneReady.on((scene) => {
    const knobs = scene.knobs.filter((knob) => knob.group === group && !without.includes(knob.id));
    const now = JSON.stringify(knobs);
    if (now !== described) {
      described = now;
      made = knobs.map((knob) => stepper(desk, knob));
      if (tall) for (const one of made) one.element.classList.add("tall");
      const elements = made.map((one) => one.element);
      element.replaceChildren(...(upwards ? elements.reverse() : elements));
      element.style.setProperty("--count", String(made.length));
      element.style.setProperty("--columns", String(Math.ceil(made.length / 2)));
    }
    refresh();
  });
  session.commanded.on(refresh);
  session.statusChanged.on(refresh);
  return element;
}
