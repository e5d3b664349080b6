/** All controls at a glance: the keyboard as it lies there, and a table. */

import type { Desk } from "../desk";
import { h } from "../dom";
import { cap, KEYS } from "../keys";

/** Rows of keys: code and width in keys; an empty code is a key without use. */
const ROWS: readonly (readonly (readonly [string, number])[])[] = [
  [["Backquote", 1], ...digits(), ["Minus", 1], ["Equal", 1], ["", 1.6]],
  [["Tab", 1.5], ...letters("QWERTYUIOP"), ["BracketLeft", 1], ["BracketRight", 1], ["", 1]],
  [["", 1.9], ...letters("ASDFGHJKL"), ["Semicolon", 1], ["Quote", 1], ["", 1.85]],
  [["ShiftLeft", 2.4], ...letters("ZXCVBNM"), ["Comma", 1], ["Period", 1], ["Slash", 1], ["ShiftRight", 2.4]],
  [["", 1.6], ["", 1.3], ["", 1.3], ["Space", 6.5], ["", 1.3], ["", 1.3], ["", 1.6]],
];

type Line = readonly [string, readonly string[], string, string];

const NEEDLE: readonly Line[] = [
  ["Push", ["ArrowDown"], "Wheel, or drag the handle in", "RT"],
  ["Pull back", ["ArrowUp"], "Wheel, or drag the handle out", "LT"],
  ["Angle in plane", ["ArrowLeft", "/", "ArrowRight"], "Drag the handle sideways", "R stick ← →"],
  ["Swing out of plane", ["Comma", "/", "Period"], "Swing buttons", "R stick ↑ ↓"],
  ["Pull back to the skin", ["Home"], "Double-click the handle", "Y"],
  ["New entry", ["KeyN"], "Double-click the skin", "X"],
  ["Undo pass", ["KeyU"], "Undo button", "B"],
];
const SPEED: readonly Line[] = [
  ["Slow, 0.2 ×", ["hold", "ShiftLeft"], "Slow button", "hold L3"],
  ["Fast, 4 ×", ["hold", "KeyF"], "Fast button", "hold R3"],
];
const PROBE: readonly Line[] = [
  ["Slide along image", ["KeyA", "/", "KeyD"], "Drag the probe", "L stick ← →"],
  ["Sweep across", ["KeyW", "/", "KeyS"], "Drag the probe", "L stick ↑ ↓"],
  ["Rotate", ["KeyQ", "/", "KeyE"], "Drag its ring", "LB RB"],
  ["Fan", ["KeyZ", "/", "KeyX"], "Fan buttons", "D-pad ← →"],
  ["Recentre", ["KeyB"], "Recentre button", "–"],
];
const IMAGE: readonly Line[] = [
  ["Freeze", ["Space"], "Freeze button", "A"],
  ["Depth; gain", ["BracketLeft", "BracketRight", "Minus", "Equal"], "Drag the scale; buttons", "D-pad ↑ ↓"],
  ["Focus; frequency", ["Semicolon", "Quote", "Digit9", "Digit0"], "Drag the caret; buttons", "–"],
  ["Model", ["Digit1", "Digit2", "Digit3"], "Model switch", "View"],
  ["Guides; probe view", ["KeyO", "KeyP"], "Buttons", "–"],
  ["Grid; colours", ["KeyG", "KeyK"], "Buttons", "–"],
  ["Reset; help", ["KeyR", "Slash"], "Buttons", "Menu"],
];

export function helpDialog(desk: Desk): HTMLDialogElement {
  const close = h("button", { type: "button", class: "button", onclick: () => desk.flip("help", false) }, "Close", h("kbd", {}, "Esc"));
  const left = h("button", { type: "button", class: "button toggle", role: "switch", onclick: () => desk.flip("leftHanded") }, "Left-handed");
  const dialog = h(
    "dialog",
    { class: "help-panel", "aria-labelledby": "help-title" },
    h("div", { class: "help-head" }, h("h2", { id: "help-title" }, "Controls"), legend(), left, close),
    keyboard(),
    h(
      "div",
      { class: "help-tables" },
      h("div", {}, table("Needle", NEEDLE), table("Speed", SPEED)),
      h("div", {}, table("Probe", PROBE), table("Image and view", IMAGE)),
    ),
    h("p", { class: "help-foot" }, "Keys follow their place on the keyboard, not the letter. Hold a key to move steadily, tap it for one step. Every action also has a button; hover or hold a button to see its key. Simulated image: not a medical device."),
  );
  // Escape closes a dialog by itself: the page must hear of it
  dialog.addEventListener("close", () => desk.flip("help", false));
  dialog.addEventListener("click", (event) => {
    if (event.target === dialog) desk.flip("help", false);
  });
  dialog.addEventListener("keydown", (event) => {
    if (event.key === "?") desk.flip("help", false);
    event.stopPropagation();
  });
  const refresh = () => {
    left.setAttribute("aria-checked", String(desk.switches.leftHanded));
    if (desk.switches.help === dialog.open) return;
    if (desk.switches.help) {
      dialog.showModal();
      close.focus();
    } else dialog.close();
  };
  desk.switched.on(refresh);
  refresh();
  return dialog;
}

function legend(): HTMLElement {
  const kinds = [["needle", "Needle, right hand"], ["probe", "Probe, left hand"], ["view", "Image and view"], ["pace", "Speed, held"]] as const;
  return h("p", { class: "legend" }, ...kinds.map(([kind, text]) => h("span", {}, h("i", { class: `key ${kind}` }), text)));
}

function keyboard(): HTMLElement {
  return h(
    "div",
    { class: "keyboard", "aria-hidden": "true" },
    h("div", {}, ...ROWS.map((row) => h("div", { class: "keys" }, ...row.map(([code, wide]) => key(code, wide))))),
    h("div", { class: "cursor-keys" }, key("Home", 2), h("div", { class: "arrows" }, key("ArrowUp", 1), key("ArrowLeft", 1), key("ArrowDown", 1), key("ArrowRight", 1))),
  );
}

function key(code: string, wide: number): HTMLElement {
  const element = h("i", { class: `key ${kind(code)} ${code}` }, code ? cap(code) : "");
  element.style.setProperty("--wide", String(wide));
  return element;
}

function kind(code: string): string {
  const binding = KEYS.get(code);
  if (!binding) return "unused";
  if (binding.does === "pace") return "pace";
  if (binding.does === "action") return { skin: "needle", entry: "needle", undo: "needle", recentre: "probe" }[binding.action as string] ?? "view";
  return ["push", "angle", "swing"].includes(binding.axis) ? "needle" : ["slide", "sweep", "rotate", "fan"].includes(binding.axis) ? "probe" : "view";
}

function table(title: string, lines: readonly Line[]): HTMLTableElement {
  const head = h("tr", {}, ...[title, "Key", "Mouse or touch", "Gamepad"].map((text) => h("th", { scope: "col" }, text)));
  const rows = lines.map(([action, keys, mouse, gamepad]) =>
    h(
      "tr",
      {},
      h("th", { scope: "row" }, action),
      h("td", {}, ...keys.map((code) => (code === "/" || code === "hold" ? h("span", {}, code) : h("kbd", {}, cap(code))))),
      h("td", {}, mouse),
      h("td", {}, gamepad),
    ),
  );
  return h("table", {}, h("thead", {}, head), h("tbody", {}, ...rows));
}

function digits(): [string, number][] {
  return [..."1234567890"].map((digit) => [`Digit${digit}`, 1]);
}

function letters(row: string): [string, number][] {
  return [...row].map((letter) => [`Key${letter}`, 1]);
}
