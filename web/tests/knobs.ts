/** Knobs as a scene describes them, and a command, for tests. */

import type { Command, Knob } from "../src/protocol";

export function knob(id: string, about: Partial<Knob> = {}): Knob {
  const [group, field] = id.split(".") as [Knob["group"], string];
  return {
    id, group, field, name: field, short: field, help: field, unit: "mm", shown: 1, decimals: 1, step: 0.5, rate: 10,
    setting: false, sense: "less-more", down: "less", up: "more", keys: null, pad: null, low: -1000, high: 1000, ...about,
  };
}

export const push = knob("needle.depth", { low: 0, high: 150 });
export const slide = knob("probe.slide", { rate: 20 });
export const rotate = knob("probe.rotate", { unit: "°", decimals: 0, step: 1, rate: 20 });
export const gain = knob("image.gain", { unit: "dB", decimals: 0, step: 2, rate: 12, setting: true });
export const depth = knob("image.depth", { unit: "cm", shown: 10, decimals: 0, step: 10, rate: 40, setting: true });
export const focus = knob("image.focus", { unit: "cm", shown: 10, step: 5, rate: 20, setting: true });

export const command: Command = {
  needle: { u: 0, v: 0, angle: 60, swing: 0, depth: 10 },
  probe: { slide: 0, sweep: 0, rotate: 0, fan: 0, press: 0 },
  image: { gain: 0, depth: 120, frequency: 3.5, focus: 65 , transmit: 0, tgc1: 0, tgc2: 0, tgc3: 0, tgc4: 0, tgc5: 0, tgc6: 0, tgc7: 0, tgc8: 0, prf: 4000, steer: 0, box_across: 0, box_depth: 24, pixels: 512, mode: "fundamental", grey_map: "linear", colour: "off" },
  tissue: { contact: "pose", relaxation: "none", breathing: "none", probe: "looks" }, frozen: false,
};
