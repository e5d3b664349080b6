/** More of the scanner: time-gain compensation by eight sliders, where the beam is sent, what is heard, grey maps. */

import type { Desk } from "../desk";
import { h, toggle, write } from "../dom";
import { icon } from "../icons";
import { COLOUR, DEPTH, FOCUS, FREQUENCY, GAIN, show, SLIDERS, TRANSMIT } from "../knobs";
import type { ImageSettings, Knob } from "../protocol";
import { clamp } from "../vec";
import { popup } from "./menu";
import { stepper } from "./stepper";

const MAPS: readonly ImageSettings["grey_map"][] = ["linear", "soft", "contrast", "dark", "reject"];
/** How a hand leaves sliders, dB: as `IMPERFECT_TGC_DB` of the package. */
const IMPERFECT = [1.5, -2, 0.5, 2.5, -1, 1, -3, 2];

interface Seen { frequency: number; depth: number; focus: number; gain: number }
type Preset = (start: Seen, frequency: Knob, depth: Knob) => Seen;
/** From how the scene starts: finer and nearer, or deeper and louder. */
const PRESETS: Record<string, Preset> = {
  "As the scene": (start) => start,
  Resolution: (start, { high }, { low }) => {
    const depth = Math.max(low, 0.75 * start.depth);
    return { frequency: (start.frequency + high) / 2, depth, focus: Math.min(start.focus, depth / 2), gain: start.gain };
  },
  Penetration: (start, { low }, { high }) => {
    const depth = Math.min(high, 1.35 * start.depth);
    return { frequency: (start.frequency + low) / 2, depth, focus: 0.6 * depth, gain: start.gain + 4 };
  },
};

export class ScannerMenu {
  private readonly button: HTMLElement;
  private readonly menu: HTMLElement;
  readonly element: HTMLElement;
  private refreshed: (() => void)[] = [];

  /** `place` tells two of them on a page apart. */
  constructor(private readonly desk: Desk, place = "") {
    const { session } = desk;
    const [button, menu] = [`scanner-button${place}`, `scanner-menu${place}`];
    this.button = h(
      "button",
      { type: "button", class: "button", id: button, "aria-haspopup": "menu", "aria-expanded": "false", "aria-controls": menu, "data-hint": "Presets, left and right, TGC, transmit focus, harmonic, colour Doppler, grey map" },
      h("span", {}, "TGC", h("span", { class: "more" }, ", colour")),
      icon("chevron", 14),
    );
    this.menu = h("div", { class: "menu", id: menu, role: "menu", "aria-labelledby": button, hidden: true });
    this.element = h("div", { class: "scanner" }, this.button, this.menu);
    popup(this.element, this.button, this.menu, () => this.entries());
    const refresh = () => this.refresh();
    session.commanded.on(refresh);
    session.statusChanged.on(refresh);
    session.sceneReady.on(refresh);
  }

  private refresh(): void {
    const { command, answers } = this.desk.session;
    if (!command) return;
    const image = command.image as unknown as Record<string, number>;
    toggle(this.button, "lit", SLIDERS.some((id) => image[id.slice("image.".length)] !== 0) || command.image.mode === "harmonic" || command.image.grey_map !== "linear" || command.image.colour !== "off");
    toggle(this.menu, "held", !answers);
    for (const one of this.refreshed) one();
  }

  private entries(): HTMLElement[] {
    const { session } = this.desk;
    this.refreshed = [];
    const sliders = SLIDERS.map((id) => this.slider(session.knob(id)));
    const all = (values: readonly number[]) => () => SLIDERS.forEach((id, k) => session.setKnob(id, values[k] ?? 0));
    const transmit = stepper(this.desk, session.knob(TRANSMIT));
    this.refreshed.push(transmit.refresh);
    const entries = [
      h("h3", {}, "Presets"),
      h("div", { class: "row maps presets" }, ...Object.entries(PRESETS).map(([name, of]) => this.action(name, () => this.preset(of)))),
      this.mirror(),
      h("h3", {}, "Time-gain compensation"),
      h("div", { class: "sliders" }, ...sliders),
      h("div", { class: "row" }, this.action("Level", all([])), this.action("As left by a hand", all(IMPERFECT))),
      h("div", { class: "row" }, transmit.element),
      this.word("Harmonic", "Heard at twice the frequency: a narrower beam, less clutter", "mode", "harmonic", "fundamental"),
      ...this.doppler(),
      h("h3", {}, "Grey map"),
      h("div", { class: "row maps" }, ...MAPS.map((map) => this.word(map, "", "grey_map", map))),
    ];
    this.refresh();
    return entries;
  }

  /** All of frequency, depth, focus, gain and sliders at once. */
  private preset(of: Preset): void {
    const { session } = this.desk;
    if (!session.scene) return;
    const { image } = session.scene.start;
    const [frequency, depth] = [session.knob(FREQUENCY), session.knob(DEPTH)];
    const chosen = of({ frequency: image.frequency, depth: image.depth, focus: image.focus, gain: image.gain }, frequency, depth);
    for (const [id, value] of [[FREQUENCY, chosen.frequency], [DEPTH, chosen.depth], [FOCUS, chosen.focus], [GAIN, chosen.gain]] as const) {
      const knob = session.knob(id);
      session.setKnob(id, clamp(value, knob.low, knob.high));
    }
    SLIDERS.forEach((id) => session.setKnob(id, 0));
  }

  /** Left and right change places, and the mark of the probe's side with them. */
  private mirror(): HTMLElement {
    const item = h(
      "button",
      { type: "button", role: "menuitemcheckbox", tabindex: -1, onclick: () => {
        this.desk.flip("mirrored");
        this.refresh();
      } },
      h("b", {}, "Left and right"),
      h("span", {}, "The image mirrored, with the mark of the probe's side"),
    );
    this.refreshed.push(() => item.setAttribute("aria-checked", String(this.desk.switches.mirrored)));
    return item;
  }

  /** Colour Doppler, where anything flows: the switch, and what its box needs. */
  private doppler(): HTMLElement[] {
    const { session } = this.desk;
    if (!session.scene?.flows) return [];
    const knobs = COLOUR.map((id) => session.knob(id)).filter(({ low, high }) => high > low);
    const steppers = knobs.map((knob) => stepper(this.desk, knob));
    this.refreshed.push(...steppers.map(({ refresh }) => refresh));
    return [
      h("h3", {}, "Colour Doppler"),
      this.word("Colour", "What flows in the box, in cm/s along the beam", "colour", "flow", "off"),
      ...steppers.map(({ element }) => h("div", { class: "row" }, element)),
    ];
  }

  private action(name: string, act: () => void): HTMLElement {
    return h("button", { type: "button", role: "menuitem", tabindex: -1, onclick: act }, h("b", {}, name));
  }

  /** A word of the image's settings; where there is another, it goes back to that. */
  private word<K extends "mode" | "grey_map" | "colour">(name: string, note: string, field: K, on: ImageSettings[K], off?: ImageSettings[K]): HTMLElement {
    const { session } = this.desk;
    const is = () => session.command?.image[field] === on;
    const click = () => session.choose({ [field]: is() && off !== undefined ? off : on });
    const item = h("button", { type: "button", role: off === undefined ? "menuitemradio" : "menuitemcheckbox", tabindex: -1, "data-word": String(on), onclick: click }, h("b", {}, name), h("span", {}, note));
    this.refreshed.push(() => item.setAttribute("aria-checked", String(is())));
    return item;
  }

  private slider(knob: Knob): HTMLElement {
    const { session } = this.desk;
    const input = h("input", { type: "range", min: knob.low, max: knob.high, step: knob.step / 2, "aria-label": knob.name, "data-slider": knob.id });
    const value = h("output", {});
    input.addEventListener("input", () => session.setKnob(knob.id, Number(input.value)));
    // the menu moves between its entries by the arrows, which move the slider here
    input.addEventListener("keydown", (event) => {
      if (event.code !== "Escape" && event.code !== "Tab") event.stopPropagation();
    });
    this.refreshed.push(() => {
      const now = session.value(knob.id);
      input.value = String(now);
      write(value, `${show(knob, now)} dB`);
    });
    return h("label", {}, h("span", {}, knob.short.replace("TGC ", "")), input, value);
  }
}
