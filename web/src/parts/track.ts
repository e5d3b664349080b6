/** How far the needle is in: a slider with the target's depth marked. */

import type { Desk } from "../desk";
import { h, toggle } from "../dom";
import { draggable } from "../input/drag";
import { keyOf } from "../keys";
import type { FrameHeader } from "../protocol";
import { clamp, dot, sub } from "../vec";

const TICK = 10;

export function track(desk: Desk): HTMLElement {
  const { session } = desk;
  const fill = h("div", { class: "fill" });
  const knob = h("div", { class: "knob" });
  const pin = h("div", { class: "pin" });
  const ticks = h("div", { class: "ticks" });
  const rail = h("div", { class: "rail", role: "slider", tabindex: 0, "aria-label": "Insertion depth", "aria-valuemin": 0 }, fill, pin, knob);
  const skin = h("button", { type: "button", class: "skin", "data-command": "skin", "data-hint": "Pull back to the skin", "data-key": keyOf("skin"), onclick: () => desk.run("skin") }, "Skin");
  const end = h("span", { class: "end" });
  const root = h("div", { class: "track" }, h("div", { class: "ends" }, skin, end), rail, ticks);
  const length = () => session.scene?.needle.length_mm ?? 1;

  const refresh = () => {
    const depth = session.value("push");
    const share = `${((100 * clamp(depth, 0, length())) / length()).toFixed(2)}%`;
    fill.style.width = share;
    knob.style.left = share;
    rail.setAttribute("aria-valuenow", depth.toFixed(1));
    rail.setAttribute("aria-valuetext", `${depth.toFixed(1)} millimetres`);
    toggle(root, "held", !session.answers);
  };
  const mark = ({ target, needle }: FrameHeader) => {
    const depth = target ? dot(sub(target.now, needle.entry), needle.direction) : -1;
    pin.hidden = depth < 0 || depth > length();
    pin.style.left = `${((100 * depth) / length()).toFixed(2)}%`;
  };
  const to = (event: PointerEvent) => {
    const box = rail.getBoundingClientRect();
    session.setAxis("push", (length() * (event.clientX - box.left)) / box.width);
  };
  draggable(rail, (event) => {
    to(event);
    return { move: (_dx, _dy, moved) => to(moved) };
  });
  rail.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 0.5, ArrowUp: 0.5, ArrowLeft: -0.5, ArrowDown: -0.5, PageUp: 10, PageDown: -10 }[event.code];
    if (event.code === "Home") desk.run("skin");
    else if (step) session.nudge("push", step);
    else return;
    event.preventDefault();
  });
  session.sceneReady.on((scene) => {
    end.textContent = `${length().toFixed(0)} mm`;
    rail.setAttribute("aria-valuemax", String(scene.limits.needle.depth[1]));
    const count = Math.floor(length() / TICK);
    ticks.replaceChildren(...Array.from({ length: count + 1 }, (_, k) => {
      const tick = h("i", { class: k % 5 ? "" : "long" });
      tick.style.left = `${((100 * k * TICK) / length()).toFixed(2)}%`;
      return tick;
    }));
  });
  session.wished.on(refresh);
  session.statusChanged.on(refresh);
  session.drawn.on((frame) => mark(frame.header));
  return root;
}
