/** Which tissue model answers: a switch keeps the pose. */

import type { Desk } from "../desk";
import { h } from "../dom";
import { keyOf, type ActionId } from "../keys";
import type { OfferedModel } from "../protocol";
import { choose, radioKeys } from "./buttons";

export function modelSwitch(desk: Desk): HTMLElement {
  const { session } = desk;
  const group = h("div", { class: "segments models", role: "radiogroup", "aria-label": "Tissue model" });
  let buttons: HTMLButtonElement[] = [];
  const refresh = () => buttons.forEach((button) => choose(button, button.dataset.model === session.model));
  session.sceneReady.on((scene) => {
    buttons = scene.models.map((model, k) => modelButton(desk, model, k));
    group.replaceChildren(...buttons);
    refresh();
  });
  session.modelChanged.on(refresh);
  radioKeys(group, () => buttons, (k) => session.chooseModel(buttons[k].dataset.model ?? ""));
  return group;
}

function modelButton(desk: Desk, model: OfferedModel, place: number): HTMLButtonElement {
  const action = `model${place + 1}` as ActionId;
  return h(
    "button",
    {
      type: "button", role: "radio", "data-model": model.id, "data-hint": model.time ? model.name : `${model.name}: no time, the pose alone counts`,
      "data-key": place < 3 ? keyOf(action) : "",
      onclick: () => desk.session.chooseModel(model.id),
    },
    h("span", { class: "long" }, model.name),
    h("span", { class: "short" }, shortName(model.name)),
  );
}

/** The last word says enough where there is little room: "Paper spline" is the spline. */
function shortName(name: string): string {
  const word = name.split(" ").at(-1) ?? name;
  return word.charAt(0).toUpperCase() + word.slice(1);
}
