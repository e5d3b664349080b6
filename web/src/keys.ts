/** Which key does what, by its place on the keyboard. One table for the keyboard, the hints and the help panel. */

import type { AxisId } from "./axes";

export const COMMANDS = {
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

export type CommandId = keyof typeof COMMANDS;

export type Binding =
  | { does: "axis"; axis: AxisId; sign: 1 | -1 }
  | { does: "command"; command: CommandId }
  | { does: "pace"; pace: "slow" | "fast" };

const pair = (axis: AxisId, down: string, up: string): [string, Binding][] => [
  [down, { does: "axis", axis, sign: -1 }],
  [up, { does: "axis", axis, sign: 1 }],
];
const command = (code: string, id: CommandId): [string, Binding] => [code, { does: "command", command: id }];

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
  command("Home", "skin"),
  command("KeyN", "entry"),
  command("KeyU", "undo"),
  command("KeyB", "recentre"),
  command("Space", "freeze"),
  command("KeyR", "reset"),
  command("Slash", "help"),
  command("Escape", "close"),
  command("KeyO", "guides"),
  command("KeyG", "grid"),
  command("KeyK", "colours"),
  command("KeyP", "probeView"),
  command("Digit1", "model1"),
  command("Digit2", "model2"),
  command("Digit3", "model3"),
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

/** The key of an axis' direction or of a command. */
export function keyOf(wanted: { axis: AxisId; sign: 1 | -1 } | CommandId): string {
  for (const [code, binding] of KEYS) {
    if (typeof wanted === "string") {
      if (binding.does === "command" && binding.command === wanted) return cap(code);
    } else if (binding.does === "axis" && binding.axis === wanted.axis && binding.sign === wanted.sign) return cap(code);
  }
  return "";
}
