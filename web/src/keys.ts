/** Which key does what, by its place on the keyboard. One table for the keyboard, the hints and the help panel. */

import type { AxisId } from "./axes";

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
} as const;

export type ActionId = keyof typeof ACTIONS;

export type Binding =
  | { does: "axis"; axis: AxisId; sign: 1 | -1 }
  | { does: "action"; action: ActionId }
  | { does: "pace"; pace: "slow" | "fast" };

const pair = (axis: AxisId, down: string, up: string): [string, Binding][] => [
  [down, { does: "axis", axis, sign: -1 }],
  [up, { does: "axis", axis, sign: 1 }],
];
const action = (code: string, id: ActionId): [string, Binding] => [code, { does: "action", action: id }];

export const KEYS: ReadonlyMap<string, Binding> = new Map([
  ...pair("push", "ArrowUp", "ArrowDown"),
  ...pair("angle", "ArrowLeft", "ArrowRight"),
  ...pair("swing", "Comma", "Period"),
  ...pair("slide", "KeyA", "KeyD"),
  ...pair("sweep", "KeyS", "KeyW"),
  ...pair("rotate", "KeyQ", "KeyE"),
  ...pair("fan", "KeyZ", "KeyX"),
  ...pair("depth", "BracketLeft", "BracketRight"),
  ...pair("gain", "Minus", "Equal"),
  ...pair("focus", "Semicolon", "Quote"),
  ...pair("frequency", "Digit9", "Digit0"),
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

/** The key of an axis' direction or of an action. */
export function keyOf(wanted: { axis: AxisId; sign: 1 | -1 } | ActionId): string {
  for (const [code, binding] of KEYS) {
    if (typeof wanted === "string") {
      if (binding.does === "action" && binding.action === wanted) return cap(code);
    } else if (binding.does === "axis" && binding.axis === wanted.axis && binding.sign === wanted.sign) return cap(code);
  }
  return "";
}
