/** The controls under the image: probe left, needle right, as the hands are. */

import type { Layout } from "../layouts";
import { IMAGE_AXES, PROBE_AXES, type Desk } from "../desk";
import { h } from "../dom";
import { actionButton, freezeButton, paceGroup, pushButton } from "./buttons";
import { stepper } from "./stepper";
import { track } from "./track";

const caps = (keys: readonly string[]) => h("span", { class: "caps", "aria-hidden": "true" }, ...keys.map((key) => h("kbd", {}, key)));

export function dock(desk: Desk): HTMLElement {
  return h("footer", { class: "dock", "aria-label": "Controls" }, probe(desk), image(desk), needle(desk));
}

function probe(desk: Desk): HTMLElement {
  return h(
    "section",
    { class: "group probe", "aria-labelledby": "dock-probe" },
    h("div", { class: "top" }, h("h2", { id: "dock-probe" }, "Probe"), caps(["W", "A", "S", "D"]), actionButton(desk, "recentre", "Recentre", null, "quiet")),
    h("div", { class: "steppers" }, ...PROBE_AXES.map((id) => stepper(desk, id))),
  );
}

function image(desk: Desk): HTMLElement {
  return h(
    "section",
    { class: "group image", "aria-labelledby": "dock-image" },
    h("div", { class: "top" }, h("h2", { id: "dock-image" }, "Image")),
    h("div", { class: "steppers" }, ...IMAGE_AXES.map((id) => stepper(desk, id))),
    freezeButton(desk, "tall"),
  );
}

function needle(desk: Desk): HTMLElement {
  return h(
    "section",
    { class: "group needle", "aria-labelledby": "dock-needle" },
    h("div", { class: "top" }, h("h2", { id: "dock-needle" }, "Needle"), caps(["↑", "↓"]), h("span", { class: "name" }, "Speed"), paceGroup(desk)),
    h("div", { class: "drive" }, pushButton(desk, -1, "Pull back", "pull"), track(desk), pushButton(desk, 1, "Push", "primary push")),
    h(
      "div",
      { class: "steer" },
      stepper(desk, "angle"),
      stepper(desk, "swing"),
      actionButton(desk, "entry", "New entry", "entry", "entry"),
      actionButton(desk, "undo", "Undo pass", "undo", "undo"),
    ),
  );
}

/** Words that have less room in the compact layout. */
const SHORT: readonly [string, string, string][] = [
  [".pull span", "Pull back", "Pull"], [".steer .entry span", "New entry", "Entry"], [".steer .undo span", "Undo pass", "Undo"],
  [".stepper.frequency .name", "Frequency", "Freq."], [".stepper.angle .name", "Angle in plane", "Angle"],
];

export function shorten(root: HTMLElement, layout: Layout): void {
  for (const [where, long, short] of SHORT) {
    for (const element of root.querySelectorAll(where)) element.textContent = layout === "desktop" ? long : short;
  }
}
