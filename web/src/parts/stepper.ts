/** Minus, value, plus; the value can be typed. */

import type { Desk } from "../desk";
import { h, toggle } from "../dom";
import { icon, type IconName } from "../icons";
import { holdable } from "../input/hold";
import { DONE } from "../input/focus";
import { keyOfKnob } from "../keys";
import { show } from "../knobs";
import type { Knob } from "../protocol";

/** What stands on the two buttons. */
const PICTURES: Record<Knob["sense"], readonly [IconName, IconName]> = {
  "less-more": ["minus", "plus"], "left-right": ["left", "right"], "near-far": ["down", "up"], turn: ["anticlockwise", "clockwise"],
};

export interface Stepper {
  element: HTMLElement;
  /** Show what is asked for now. */
  refresh(): void;
}

export function stepper(desk: Desk, knob: Knob): Stepper {
  const { session } = desk;
  const { id, low, high } = knob;
  const unit = knob.unit === "°" ? "°" : ` ${knob.unit}`;
  const buttons = ([-1, 1] as const).map((sign) => {
    const label = sign < 0 ? knob.down : knob.up;
    const picture = icon(PICTURES[knob.sense][sign < 0 ? 0 : 1]);
    const button = h("button", { type: "button", "aria-label": label, "data-hint": label, "data-key": keyOfKnob(knob, sign) }, picture);
    holdable(button, desk, id, sign);
    return button;
  });
  const input = h("input", {
    type: "text", inputmode: "decimal", role: "spinbutton", "aria-label": knob.name, autocomplete: "off", spellcheck: "false",
    "data-knob": id,
  });
  const name = h("span", { class: "name" }, h("span", { class: "long" }, knob.name), h("span", { class: "short" }, knob.short));
  const element = h("div", { class: `stepper ${knob.field}` }, buttons[0], h("label", { class: "middle" }, name, input), buttons[1]);

  const refresh = () => {
    const value = session.value(id);
    const text = `${show(knob, value)}${unit}`;
    if (document.activeElement !== input && input.value !== text) input.value = text;
    input.setAttribute("aria-valuenow", String(value / knob.shown));
    input.setAttribute("aria-valuemin", String(low / knob.shown));
    input.setAttribute("aria-valuemax", String(high / knob.shown));
    input.setAttribute("aria-valuetext", text.replace("°", " degrees"));
    input.dataset.value = value.toFixed(3);
    const held = !session.answers;
    toggle(element, "held", held);
    input.disabled = held;
    // at its limit a button dims, but keeps the focus: it would be lost in the middle of a press
    buttons.forEach((button, k) => button.setAttribute("aria-disabled", String(held || value === (k ? high : low))));
  };
  const take = () => {
    const typed = Number.parseFloat(input.value.replace("\u2212", "-").replace(",", "."));
    if (Number.isFinite(typed)) desk.goTo(id, typed * knob.shown, "fast");
    write();
  };
  const write = () => (input.value = `${show(knob, desk.goal(id) ?? session.value(id))}${unit}`);
  // who came with a pointer goes back to the image with it; who came with the Tab key stays
  const done = () => (byPointer ? element.dispatchEvent(new Event(DONE, { bubbles: true })) : input.select());
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
  return { element, refresh };
}
