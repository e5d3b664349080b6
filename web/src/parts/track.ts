/** How far the needle is in: a slider with the target's depth marked. A place on it is a goal, not a jump. */

import type { Desk } from "../desk";
import { h, toggle } from "../dom";
import { draggable } from "../input/drag";
import { keyOf } from "../keys";
import { PUSH } from "../knobs";
import type { FrameHeader } from "../protocol";
import { clamp, dot, sub } from "../vec";

const TICK = 10;
/** mm of a page key. */
const PAGE = 10;

export function track(desk: Desk): HTMLElement {
  const { session } = desk;
  const fill = h("div", { class: "fill" });
  const knob = h("div", { class: "knob" });
  const goal = h("div", { class: "goal", hidden: true });
  const pin = h("div", { class: "pin" });
  const ticks = h("div", { class: "ticks" });
  const rail = h("div", { class: "rail", role: "slider", tabindex: 0, "aria-label": "Insertion depth", "aria-valuemin": 0 }, fill, pin, goal, knob);
  const skin = h("button", { type: "button", class: "skin", "data-action": "skin", "data-hint": "Pull back to the skin", "data-key": keyOf("skin"), onclick: () => desk.run("skin") }, "Skin");
  const end = h("span", { class: "end" });
  const root = h("div", { class: "track" }, h("div", { class: "ends" }, skin, end), rail, ticks);
  const length = () => session.scene?.needle.length_mm ?? 1;

  const place = (depth: number) => `${((100 * clamp(depth, 0, length())) / length()).toFixed(2)}%`;
  const refresh = () => {
    const depth = session.value(PUSH);
    fill.style.width = knob.style.left = place(depth);
    rail.setAttribute("aria-valuenow", depth.toFixed(1));
    rail.setAttribute("aria-valuetext", `${depth.toFixed(1)} millimetres`);
    toggle(root, "held", !session.answers);
  };
  const mark = ({ target, needle }: FrameHeader) => {
    pin.hidden = !target || !needle;
    if (!target || !needle) return;
    const depth = dot(sub(target.now, needle.entry), needle.direction);
    pin.hidden = depth < 0 || depth > length();
    pin.style.left = place(depth);
  };
  const aim = () => {
    const depth = desk.goal(PUSH);
    goal.hidden = depth === null;
    if (depth !== null) goal.style.left = place(depth);
  };
  const to = (event: PointerEvent) => {
    const box = rail.getBoundingClientRect();
    desk.goTo(PUSH, (length() * (event.clientX - box.left)) / box.width);
  };
  draggable(rail, (event) => {
    to(event);
    return { move: (_dx, _dy, moved) => to(moved), end: (cancelled) => cancelled && desk.halt(PUSH) };
  });
  rail.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.code];
    const page = { PageUp: PAGE, PageDown: -PAGE }[event.code];
    if (event.code === "Home") desk.run("skin");
    else if (step) desk.tap(PUSH, step);
    else if (page) desk.goTo(PUSH, (desk.goal(PUSH) ?? session.value(PUSH)) + page);
    else return;
    event.preventDefault();
  });
  session.sceneReady.on(() => {
    end.textContent = `${length().toFixed(0)} mm`;
    rail.setAttribute("aria-valuemax", String(session.knob(PUSH).high));
    const count = Math.floor(length() / TICK);
    ticks.replaceChildren(...Array.from({ length: count + 1 }, (_, k) => {
      const tick = h("i", { class: k % 5 ? "" : "long" });
      tick.style.left = `${((100 * k * TICK) / length()).toFixed(2)}%`;
      return tick;
    }));
  });
  session.commanded.on(refresh);
  desk.aimed.on(aim);
  session.statusChanged.on(refresh);
  session.drawn.on((frame) => mark(frame.header));
  return root;
}
