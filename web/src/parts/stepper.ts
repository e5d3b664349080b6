/** Minus, value, plus; the value can be typed. */

import { axis, AXES, limits, show, type AxisId } from "../axes";
import type { Desk } from "../desk";
import { h, toggle } from "../dom";
import { icon, type IconName } from "../icons";
import { holdable } from "../input/hold";
import { DONE } from "../input/focus";
import { keyOf } from "../keys";

/** Which pictures stand on the two buttons. */
const PICTURES: Partial<Record<AxisId, readonly [IconName, IconName]>> = {
  slide: ["left", "right"], sweep: ["down", "up"], rotate: ["anticlockwise", "clockwise"], fan: ["anticlockwise", "clockwise"],
  angle: ["anticlockwise", "clockwise"], swing: ["left", "right"],
};

export function stepper(desk: Desk, id: AxisId, name = AXES[id].name as string): HTMLElement {
  const { session } = desk;
  const spec = axis(id);
  const pictures = PICTURES[id] ?? ["minus", "plus"];
  const unit = spec.unit === "°" ? "°" : ` ${spec.unit}`;
  const buttons = ([-1, 1] as const).map((sign) => {
    const label = sign < 0 ? spec.down : spec.up;
    const button = h("button", { type: "button", "aria-label": label, "data-hint": label, "data-key": keyOf({ axis: id, sign }) }, icon(pictures[(sign + 1) / 2]));
    holdable(button, desk, id, sign);
    return button;
  });
  const input = h("input", {
    type: "text", inputmode: "decimal", role: "spinbutton", "aria-label": spec.name, autocomplete: "off", spellcheck: "false",
    "data-axis": id,
  });
  const root = h("div", { class: `stepper ${id}` }, buttons[0], h("label", { class: "middle" }, h("span", { class: "name" }, name), input), buttons[1]);

  const refresh = () => {
    if (!session.command || !session.scene) return;
    const value = session.value(id);
    const [low, high] = limits(session.scene.limits, id);
    const text = `${show(id, value)}${unit}`;
    if (document.activeElement !== input && input.value !== text) input.value = text;
    input.setAttribute("aria-valuenow", String(value / spec.shown));
    input.setAttribute("aria-valuemin", String(low / spec.shown));
    input.setAttribute("aria-valuemax", String(high / spec.shown));
    input.setAttribute("aria-valuetext", text.replace("°", " degrees"));
    input.dataset.value = value.toFixed(3);
    const held = !session.answers;
    toggle(root, "held", held);
    input.disabled = held;
    // at its limit a button dims, but keeps the focus: it would be lost in the middle of a press
    buttons.forEach((button, k) => button.setAttribute("aria-disabled", String(held || value === (k ? high : low))));
  };
  const take = () => {
    const typed = Number.parseFloat(input.value.replace("\u2212", "-").replace(",", "."));
    if (Number.isFinite(typed)) desk.goTo(id, typed * spec.shown, "fast");
    write();
  };
  const write = () => (input.value = `${show(id, desk.goal(id) ?? session.value(id))}${unit}`);
  // who came with a pointer goes back to the image with it; who came with the Tab key stays
  const done = () => (byPointer ? root.dispatchEvent(new Event(DONE, { bubbles: true })) : input.select());
  let byPointer = false;
  input.parentElement?.addEventListener("pointerdown", () => (byPointer = true));
  input.addEventListener("focus", () => input.select());
  input.addEventListener("blur", () => {
    byPointer = false;
    refresh();
  });
  input.addEventListener("change", take);
  input.addEventListener("keydown", (event) => {
    const sign = { ArrowUp: 1, ArrowDown: -1 }[event.code];
    if (sign) desk.tap(id, sign);
    if (sign || event.code === "Escape") write();
    if (sign || event.code === "Enter" || event.code === "Escape") event.preventDefault();
    if (event.code === "Enter") take();
    if (event.code === "Enter" || event.code === "Escape") done();
  });
  session.commanded.on(refresh);
  session.sceneReady.on(refresh);
  session.statusChanged.on(refresh);
  return root;
}
