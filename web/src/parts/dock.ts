/** The controls under the image: probe left, needle right, as the hands are. */

import type { Desk } from "../desk";
import { h } from "../dom";
import type { Layout } from "../layouts";
import { cap } from "../keys";
import { ACROSS, ALONG, IN_MENU, PRESS, PUSH, SLIDE, SWEEP } from "../knobs";
import { actionButton, freezeButton, paceGroup, pushButton } from "./buttons";
import { ScannerMenu } from "./scanner";
import { steppers } from "./steppers";
import { track } from "./track";

/** The keys of one knob, or of two: then as they lie, up first. */
function caps(desk: Desk, across: string, along?: string): HTMLElement {
  const { session } = desk;
  const element = h("span", { class: "caps", "aria-hidden": "true" });
  session.sceneReady.on(() => {
    const [first, last] = session.knob(across).keys ?? [];
    const [near, far] = (along && session.knob(along).keys) || [];
    const codes = [far, first, near, last].filter((code) => code !== undefined);
    element.replaceChildren(...codes.map((code) => h("kbd", {}, cap(code))));
  });
  return element;
}

export function dock(desk: Desk): HTMLElement {
  return h("footer", { class: "dock", "aria-label": "Controls" }, probe(desk), image(desk), needle(desk));
}

function probe(desk: Desk): HTMLElement {
  return h(
    "section",
    { class: "group probe", "aria-labelledby": "dock-probe" },
    h("div", { class: "top" }, h("h2", { id: "dock-probe" }, "Probe"), caps(desk, SLIDE, SWEEP), actionButton(desk, "recentre", "Recentre", null, "quiet")),
    steppers(desk, "probe", "steppers", { without: [PRESS] }),
  );
}

function image(desk: Desk): HTMLElement {
  return h(
    "section",
    { class: "group image", "aria-labelledby": "dock-image" },
    h("div", { class: "top" }, h("h2", { id: "dock-image" }, "Image"), new ScannerMenu(desk).element),
    steppers(desk, "image", "steppers", { without: IN_MENU }),
    freezeButton(desk, "tall"),
  );
}

function needle(desk: Desk): HTMLElement {
  return h(
    "section",
    { class: "group needle", "aria-labelledby": "dock-needle" },
    h("div", { class: "top" }, h("h2", { id: "dock-needle" }, "Needle"), caps(desk, PUSH), h("span", { class: "name" }, "Speed"), paceGroup(desk)),
    h("div", { class: "drive" }, pushButton(desk, -1, "Pull back", "pull"), track(desk), pushButton(desk, 1, "Push", "primary push")),
    h(
      "div",
      { class: "steer" },
      steppers(desk, "needle", "inline", { without: [PUSH, ALONG, ACROSS] }),
      actionButton(desk, "entry", "New entry", "entry", "entry"),
      actionButton(desk, "undo", "Undo pass", "undo", "undo"),
    ),
  );
}

/** Words that have less room in the compact layout. */
const SHORT: readonly [string, string, string][] = [
  [".pull span", "Pull back", "Pull"], [".steer .entry span", "New entry", "Entry"], [".steer .undo span", "Undo pass", "Undo"],
];

export function shorten(root: HTMLElement, layout: Layout): void {
  for (const [where, long, short] of SHORT) {
    for (const element of root.querySelectorAll(where)) element.textContent = layout === "desktop" ? long : short;
  }
}
