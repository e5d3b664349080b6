/** Which key does what, by its place on the keyboard. One table for the keyboard, the hints and the help panel; the keys of knobs come with them. */

import type { Knob } from "./protocol";

export const ACTIONS = {
  skin: "Pull back to the skin",
  entry: "New entry",
  undo: "Undo pass",
  recentre: "Recentre the probe",
  freeze: "Freeze",
  reset: "Reset",
  help: "Help",
  close: "Close or stop",
  guides: "Guides",
  grid: "Grid",
  colours: "Displacement colours",
  probeView: "Probe view",
  model1: "First model",
  model2: "Second model",
  model3: "Third model",
  nextModel: "Next model",
  breathe: "Breathing",
  hold: "Hold the breath",
  remember: "Needle remembers",
  relax: "Tissue relaxes",
  press: "Probe presses",
  onTarget: "I am on target",
} as const;

export type ActionId = keyof typeof ACTIONS;

export type Binding =
  | { does: "knob"; knob: Knob; sign: 1 | -1 }
  | { does: "action"; action: ActionId }
  | { does: "pace"; pace: "slow" | "fast" };

const action = (code: string, id: ActionId): [string, Binding] => [code, { does: "action", action: id }];

/** What the page itself does; knobs bring keys of their own. */
const OWN: ReadonlyMap<string, Binding> = new Map([
  action("Home", "skin"),
  action("KeyN", "entry"),
  action("KeyU", "undo"),
  action("KeyB", "recentre"),
  action("Space", "freeze"),
  action("KeyR", "reset"),
  action("Slash", "help"),
  action("Escape", "close"),
  action("KeyO", "guides"),
  action("KeyG", "grid"),
  action("KeyK", "colours"),
  action("KeyP", "probeView"),
  action("KeyT", "breathe"),
  action("KeyH", "hold"),
  action("KeyM", "remember"),
  action("KeyL", "relax"),
  action("KeyI", "press"),
  action("Enter", "onTarget"),
  action("Digit1", "model1"),
  action("Digit2", "model2"),
  action("Digit3", "model3"),
  ["ShiftLeft", { does: "pace", pace: "slow" }],
  ["ShiftRight", { does: "pace", pace: "slow" }],
  ["KeyF", { does: "pace", pace: "fast" }],
]);

const CAPS: Record<string, string> = {
  ArrowUp: "↑", ArrowDown: "↓", ArrowLeft: "←", ArrowRight: "→", Comma: ",", Period: ".", BracketLeft: "[",
  BracketRight: "]", Minus: "−", Equal: "=", Semicolon: ";", Quote: "'", Slash: "?", Escape: "Esc",
  ShiftLeft: "Shift", ShiftRight: "Shift", Backquote: "`",
};

/** What is printed on a key. */
export function cap(code: string): string {
  return CAPS[code] ?? code.replace(/^(Key|Digit)/, "");
}

/** What the keys do in a scene; a knob takes none of the page's own. */
export function bindings(knobs: readonly Knob[]): ReadonlyMap<string, Binding> {
  const moving = knobs.flatMap((knob) =>
    (knob.keys ?? []).map((code, k): [string, Binding] => [code, { does: "knob", knob, sign: k ? 1 : -1 }]),
  );
  return new Map([...moving, ...OWN]);
}

/** The key of an action. */
export function keyOf(wanted: ActionId): string {
  for (const [code, binding] of OWN) if (binding.does === "action" && binding.action === wanted) return cap(code);
  return "";
}

/** The key of a knob's direction. */
export function keyOfKnob(knob: Knob, sign: 1 | -1): string {
  return knob.keys ? cap(knob.keys[sign < 0 ? 0 : 1]) : "";
}
