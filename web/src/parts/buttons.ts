/** Buttons that run an action, with their key shown on hover, focus and long press. */

import type { Desk } from "../desk";
import { h } from "../dom";
import { icon, type IconName } from "../icons";
import { ACTIONS, keyOf, keyOfKnob, type ActionId } from "../keys";
import { holdable } from "../input/hold";
import { PUSH } from "../knobs";
import type { Pace } from "../motion";

export function actionButton(desk: Desk, action: ActionId, label: string, picture: IconName | null = null, className = ""): HTMLButtonElement {
  const button = h(
    "button",
    { type: "button", class: `button ${className}`.trim(), "data-action": action, "data-hint": ACTIONS[action], "data-key": keyOf(action), onclick: () => desk.run(action) },
    picture && icon(picture),
    h("span", {}, label),
  );
  // dimmed, not disabled: a disabled button loses the focus
  if (NEEDS_HANDS.includes(action)) {
    desk.session.statusChanged.on((status) => button.setAttribute("aria-disabled", String(status !== "live")));
  }
  return button;
}

/** What does nothing while needle and probe are held. */
const NEEDS_HANDS: readonly ActionId[] = ["entry", "undo", "recentre"];

/** An action that is on or off. */
export function toggleButton(desk: Desk, action: "guides" | "grid" | "colours" | "probeView", label: string, picture: IconName | null = null, className = ""): HTMLButtonElement {
  const button = actionButton(desk, action, label, picture, `toggle ${className}`);
  const refresh = () => button.setAttribute("aria-pressed", String(desk.switches[action]));
  desk.switched.on(refresh);
  refresh();
  return button;
}

export function pushButton(desk: Desk, sign: 1 | -1, label: string, className: string): HTMLButtonElement {
  const { session } = desk;
  const button = h("button", { type: "button", class: `button ${className}` }, icon(sign > 0 ? "down" : "up"), h("span", {}, label));
  holdable(button, desk, PUSH, sign);
  session.sceneReady.on(() => {
    const knob = session.knob(PUSH);
    button.dataset.hint = sign > 0 ? knob.up : knob.down;
    button.dataset.key = keyOfKnob(knob, sign);
  });
  const refresh = () => {
    const end = session.scene && session.knob(PUSH)[sign > 0 ? "high" : "low"];
    button.setAttribute("aria-disabled", String(!session.answers || session.value(PUSH) === end));
  };
  session.commanded.on(refresh);
  session.statusChanged.on(refresh);
  return button;
}

export function freezeButton(desk: Desk, className: string): HTMLButtonElement {
  const button = actionButton(desk, "freeze", "Freeze", "freeze", `freeze ${className}`);
  const word = button.lastElementChild as HTMLElement;
  const { session, trainer } = desk;
  const refresh = () => {
    const frozen = session.status === "frozen";
    button.setAttribute("aria-pressed", String(frozen));
    word.textContent = frozen ? "Frozen" : "Freeze";
    button.disabled = session.held || (session.status !== "live" && !frozen);
  };
  session.statusChanged.on(refresh);
  trainer.stationed.on(refresh);
  return button;
}

const PACES: readonly [Pace, string, string][] = [["slow", "Slow", "Shift"], ["normal", "Normal", ""], ["fast", "Fast", "F"]];

/** Slow, normal, fast: the choice stays; a held key lays another over it. */
export function paceGroup(desk: Desk): HTMLElement {
  const group = h("div", { class: "segments", role: "radiogroup", "aria-label": "Speed" });
  const buttons = PACES.map(([pace, label, key]) =>
    h("button", { type: "button", role: "radio", "data-pace": pace, "data-hint": `${label} motion`, "data-key": key && `hold ${key}`, onclick: () => desk.choosePace(pace) }, label),
  );
  group.append(...buttons);
  radioKeys(group, () => buttons, (k) => desk.choosePace(PACES[k][0]));
  const refresh = () => {
    for (const [k, button] of buttons.entries()) choose(button, PACES[k][0] === desk.motion.chosen, PACES[k][0] === desk.motion.pace);
  };
  desk.paced.on(refresh);
  refresh();
  return group;
}

/** One button that goes round the three speeds. */
export function paceButton(desk: Desk): HTMLButtonElement {
  const value = h("span", { class: "value" });
  const button = h(
    "button",
    { type: "button", class: "button pace", "data-hint": "Slow 0.2 x, normal, fast 4 x", onclick: () => {
      const now = PACES.findIndex(([pace]) => pace === desk.motion.chosen);
      desk.choosePace(PACES[(now + 1) % PACES.length][0]);
    } },
    h("span", { class: "name" }, "Speed"),
    value,
  );
  const refresh = () => (value.textContent = PACES.find(([pace]) => pace === desk.motion.pace)?.[1] ?? "");
  desk.paced.on(refresh);
  refresh();
  return button;
}

/** Chosen for good, and in force for the moment. */
export function choose(button: HTMLElement, chosen: boolean, lit = chosen): void {
  button.setAttribute("aria-checked", String(chosen));
  button.classList.toggle("lit", lit);
  button.tabIndex = chosen ? 0 : -1;
}

/** The arrows inside a radio group. */
export function radioKeys(group: HTMLElement, all: () => HTMLElement[], pick: (k: number) => void): void {
  group.addEventListener("keydown", (event) => {
    const buttons = all();
    const now = buttons.indexOf(document.activeElement as HTMLElement);
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.code];
    if (now < 0 || !step) return;
    event.preventDefault();
    for (let k = 1; k <= buttons.length; k += 1) {
      const next = (now + step * k + k * buttons.length) % buttons.length;
      if (buttons[next].getAttribute("aria-disabled") === "true") continue;
      buttons[next].focus();
      return pick(next);
    }
  });
}
