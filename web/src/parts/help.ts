/** All controls at a glance: the keyboard as it lies there, and a table. */

import type { Desk } from "../desk";
import { h } from "../dom";
import { cap, type Binding } from "../keys";
import { ANGLE, DEPTH, FOCUS, PUSH, ROTATE, SLIDE, SWEEP } from "../knobs";
import type { Knob } from "../protocol";

/** Rows of keys: code and width in keys; an empty code is a key without use. */
const ROWS: readonly (readonly (readonly [string, number])[])[] = [
  [["Backquote", 1], ...digits(), ["Minus", 1], ["Equal", 1], ["", 1.6]],
  [["Tab", 1.5], ...letters("QWERTYUIOP"), ["BracketLeft", 1], ["BracketRight", 1], ["", 1]],
  [["", 1.9], ...letters("ASDFGHJKL"), ["Semicolon", 1], ["Quote", 1], ["", 1.85]],
  [["ShiftLeft", 2.4], ...letters("ZXCVBNM"), ["Comma", 1], ["Period", 1], ["Slash", 1], ["ShiftRight", 2.4]],
  [["", 1.6], ["", 1.3], ["", 1.3], ["Space", 6.5], ["", 1.3], ["", 1.3], ["", 1.6]],
];

type Line = readonly [string, readonly string[], string, string];

/** What a pointer can do beside the buttons that every knob has. */
const GESTURES: Record<string, string> = {
  [PUSH]: "Wheel, or drag the handle", [ANGLE]: "Drag the handle sideways", [SLIDE]: "Drag the probe", [SWEEP]: "Drag the probe",
  [ROTATE]: "Drag its ring", [DEPTH]: "Drag the scale", [FOCUS]: "Drag the caret",
};
const PADS: Record<NonNullable<Knob["pad"]>, string> = {
  "left stick across": "L stick ← →", "left stick along": "L stick ↑ ↓", "right stick across": "R stick ← →",
  "right stick along": "R stick ↑ ↓", triggers: "LT RT", bumpers: "LB RB", "d-pad along": "D-pad ↑ ↓", "d-pad across": "D-pad ← →",
};
const NEEDLE: readonly Line[] = [
  ["Pull back to the skin", ["Home"], "Double-click the handle", "Y"],
  ["New entry", ["KeyN"], "Double-click the skin", "X"],
  ["Undo pass", ["KeyU"], "Undo button", "B"],
];
const SPEED: readonly Line[] = [
  ["Slow, 0.2 ×", ["hold", "ShiftLeft"], "Slow button", "hold L3"],
  ["Fast, 4 ×", ["hold", "KeyF"], "Fast button", "hold R3"],
];
const PROBE: readonly Line[] = [["Recentre", ["KeyB"], "Recentre button", "–"]];
const FREEZE: Line = ["Freeze", ["Space"], "Freeze button", "A"];
const TISSUE: readonly Line[] = [
  ["Breathing", ["KeyT"], "Tissue menu", "–"],
  ["Hold the breath", ["KeyH"], "Tissue menu", "–"],
  ["Needle remembers", ["KeyM"], "Tissue menu", "–"],
  ["Tissue relaxes", ["KeyL"], "Tissue menu", "–"],
];
const VIEW: readonly Line[] = [
  ["Model", ["Digit1", "Digit2", "Digit3"], "Model switch", "View"],
  ["Guides; probe view", ["KeyO", "KeyP"], "Buttons", "–"],
  ["Grid; colours", ["KeyG", "KeyK"], "Buttons", "–"],
  ["Reset; help", ["KeyR", "Slash"], "Buttons", "Menu"],
];

/** The knobs of a group that keys or a gamepad move, so many a line. */
function lines(knobs: readonly Knob[], group: Knob["group"], each: number): Line[] {
  const moved = knobs.filter((knob) => knob.group === group && (knob.keys || knob.pad));
  return Array.from({ length: Math.ceil(moved.length / each) }, (_, k) => line(moved.slice(each * k, each * (k + 1))));
}

function line(knobs: readonly Knob[]): Line {
  const keys = knobs.map((knob) => knob.keys ?? []);
  const gestures = new Set(knobs.map(({ id, short }) => GESTURES[id] ?? (knobs.length > 1 ? "buttons" : `${short} buttons`)));
  return [
    sentence(knobs.map(({ help }) => help)),
    knobs.length > 1 ? keys.flat() : keys.flatMap(([down, up]) => (down ? [down, "/", up] : [])),
    sentence([...gestures].sort()),
    knobs.flatMap(({ pad }) => (pad ? [PADS[pad]] : [])).join("; ") || "–",
  ];
}

function sentence(parts: readonly string[]): string {
  const text = parts.map((part) => part.charAt(0).toLowerCase() + part.slice(1)).join("; ");
  return text.charAt(0).toUpperCase() + text.slice(1);
}

export function helpDialog(desk: Desk): HTMLDialogElement {
  const close = h("button", { type: "button", class: "button", onclick: () => desk.flip("help", false) }, "Close", h("kbd", {}, "Esc"));
  const left = h("button", { type: "button", class: "button toggle", role: "switch", onclick: () => desk.flip("leftHanded") }, "Left-handed");
  const board = h("div", { class: "keyboard", "aria-hidden": "true" });
  const tables = h("div", { class: "help-tables" });
  desk.session.sceneReady.on(({ knobs }) => {
    board.replaceChildren(...keyboard(desk.keys));
    tables.replaceChildren(
      h("div", {}, table("Needle", [...lines(knobs, "needle", 1), ...NEEDLE]), table("Speed", SPEED), table("Tissue", TISSUE)),
      h("div", {}, table("Probe", [...lines(knobs, "probe", 1), ...PROBE]), table("Image and view", [FREEZE, ...lines(knobs, "image", 2), ...VIEW])),
    );
  });
  const dialog = h(
    "dialog",
    { class: "help-panel", "aria-labelledby": "help-title" },
    h("div", { class: "help-head" }, h("h2", { id: "help-title" }, "Controls"), legend(), left, close),
    board,
    tables,
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

function keyboard(keys: ReadonlyMap<string, Binding>): HTMLElement[] {
  const key = (code: string, wide: number): HTMLElement => {
    const element = h("i", { class: `key ${kind(keys.get(code))} ${code}` }, code ? cap(code) : "");
    element.style.setProperty("--wide", String(wide));
    return element;
  };
  const rows = ROWS.map((row) => h("div", { class: "keys" }, ...row.map(([code, wide]) => key(code, wide))));
  const arrows = ["ArrowUp", "ArrowLeft", "ArrowDown", "ArrowRight"].map((code) => key(code, 1));
  return [h("div", {}, ...rows), h("div", { class: "cursor-keys" }, key("Home", 2), h("div", { class: "arrows" }, ...arrows))];
}

function kind(binding: Binding | undefined): string {
  if (!binding) return "unused";
  if (binding.does === "pace") return "pace";
  if (binding.does === "action") return { skin: "needle", entry: "needle", undo: "needle", recentre: "probe" }[binding.action as string] ?? "view";
  return binding.knob.group === "image" ? "view" : binding.knob.group;
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
