/** Touch: probe at the left thumb, needle at the right, image settings along the bottom. */

import type { Desk } from "../desk";
import { h } from "../dom";
import { icon } from "../icons";
import { draggable } from "../input/drag";
import { ACROSS, ALONG, IN_MENU, PRESS, PUSH, SLIDE, SWEEP } from "../knobs";
import { actionButton, freezeButton, paceButton } from "./buttons";
import { ScannerMenu } from "./scanner";
import { steppers } from "./steppers";

/** px from the middle to full speed. */
const LEVER_REACH = 74;
const PAD_REACH = 42;
/** Full speed of the lever, in rates: 20 mm/s. */
const LEVER_SPEED = 2;
const DOUBLE_TAP = 350;

export function probeRail(desk: Desk): HTMLElement {
  return h(
    "aside",
    { class: "rail-column probe", "aria-label": "Probe" },
    h("h2", {}, "Probe"),
    actionButton(desk, "recentre", "Recentre", "entry"),
    h("div", { class: "space" }),
    steppers(desk, "probe", "inline", { without: [SLIDE, SWEEP, PRESS], tall: true, upwards: true }),
    pad(desk),
    h("p", { class: "hint" }, "Slide and sweep"),
  );
}

export function needleRail(desk: Desk): HTMLElement {
  return h(
    "aside",
    { class: "rail-column needle", "aria-label": "Needle" },
    h("h2", {}, "Needle"),
    h("div", { class: "pair" }, actionButton(desk, "undo", "Undo", "undo", "stacked"), actionButton(desk, "entry", "Entry", "entry", "stacked")),
    steppers(desk, "needle", "inline", { without: [PUSH, ALONG, ACROSS], tall: true }),
    h("div", { class: "space" }),
    paceButton(desk),
    lever(desk),
  );
}

export function imageBar(desk: Desk): HTMLElement {
  return h("footer", { class: "image-bar", "aria-label": "Image" }, steppers(desk, "image", "steppers", { without: IN_MENU }), new ScannerMenu(desk, "-touch").element, freezeButton(desk, ""));
}

/** Sprung: the distance from the middle is the speed, letting go stops. */
function lever(desk: Desk): HTMLElement {
  const knob = h("div", { class: "knob", role: "slider", tabindex: 0, "aria-label": "Push or pull the needle", "aria-valuenow": 0, "aria-orientation": "vertical" }, icon("grip", 28));
  const pull = h("button", { type: "button", class: "end pull" }, "Pull", icon("up", 20));
  const push = h("button", { type: "button", class: "end push" }, icon("down", 20), "Push");
  let fastest = 0;
  desk.session.sceneReady.on(() => {
    fastest = LEVER_SPEED * desk.session.knob(PUSH).rate;
    knob.setAttribute("aria-valuemin", String(-fastest));
    knob.setAttribute("aria-valuemax", String(fastest));
  });
  const set = (share: number) => {
    knob.style.transform = share ? `translateY(${(share * LEVER_REACH).toFixed(1)}px)` : "";
    knob.setAttribute("aria-valuenow", (share * fastest).toFixed(0));
    desk.drive("lever", PUSH, share * LEVER_SPEED);
  };
  draggable(knob, () => ({
    move: (_dx, dy) => set(Math.max(-1, Math.min(1, dy / LEVER_REACH))),
    end: () => set(0),
  }));
  knob.addEventListener("keydown", (event) => {
    const sign = { ArrowDown: 1, ArrowUp: -1 }[event.code];
    if (!sign || event.repeat) return;
    event.preventDefault();
    desk.press(event.code, PUSH, sign);
  });
  let tapped = -Infinity;
  pull.addEventListener("click", () => {
    const now = performance.now();
    if (now - tapped < DOUBLE_TAP) desk.run("skin");
    else desk.tap(PUSH, -1);
    tapped = now;
  });
  push.addEventListener("click", () => desk.tap(PUSH, 1));
  return h("div", { class: "lever" }, pull, h("div", { class: "slot" }, knob), push);
}

const ARROWS = [["up", SWEEP, 1], ["down", SWEEP, -1], ["left", SLIDE, -1], ["right", SLIDE, 1]] as const;

/** The left thumb's pad: across slides, up and down sweeps. */
function pad(desk: Desk): HTMLElement {
  const knob = h("div", { class: "knob" }, icon("plus", 34));
  const set = (x: number, y: number) => {
    knob.style.transform = x || y ? `translate(${(x * PAD_REACH).toFixed(1)}px, ${(y * PAD_REACH).toFixed(1)}px)` : "";
    desk.drive("pad-x", SLIDE, x);
    desk.drive("pad-y", SWEEP, -y);
  };
  const arrows = ARROWS.map(([side, id, sign]) => {
    const arrow = h("button", { type: "button", class: `arrow ${side}`, onclick: () => desk.tap(id, sign) });
    desk.session.sceneReady.on(() => arrow.setAttribute("aria-label", desk.session.knob(id)[sign < 0 ? "down" : "up"]));
    return arrow;
  });
  const root = h("div", { class: "pad" }, ...arrows, knob);
  draggable(knob, () => ({
    move: (dx, dy) => {
      const far = Math.hypot(dx, dy);
      const k = far > PAD_REACH ? 1 / far : 1 / PAD_REACH;
      set(dx * k, dy * k);
    },
    end: () => set(0, 0),
  }));
  return root;
}
