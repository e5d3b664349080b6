/** The numbers a hand can move, as the scene describes them: which there are, by how much at a tap, how fast while held. */

import type { Command, Knob } from "./protocol";
import { clamp } from "./vec";

type Numbers = Record<string, number>;
type Group = Knob["group"];
type Known = { [G in Group]: `${G}.${keyof Command[G] & string}` }[Group];

/** The few that gestures know by name; of all others the page knows what the scene says. */
export const PUSH = "needle.depth" satisfies Known;
export const ANGLE = "needle.angle" satisfies Known;
export const SWING = "needle.swing" satisfies Known;
export const ALONG = "needle.u" satisfies Known;
export const ACROSS = "needle.v" satisfies Known;
export const SLIDE = "probe.slide" satisfies Known;
export const SWEEP = "probe.sweep" satisfies Known;
export const ROTATE = "probe.rotate" satisfies Known;
export const PRESS = "probe.press" satisfies Known;
export const GAIN = "image.gain" satisfies Known;
export const DEPTH = "image.depth" satisfies Known;
export const FREQUENCY = "image.frequency" satisfies Known;
export const FOCUS = "image.focus" satisfies Known;
export const TRANSMIT = "image.transmit" satisfies Known;
/** Time-gain compensation, from the face down. */
export const SLIDERS = [
  "image.tgc1", "image.tgc2", "image.tgc3", "image.tgc4", "image.tgc5", "image.tgc6", "image.tgc7", "image.tgc8",
] as const satisfies readonly Known[];
/** Of colour Doppler. */
export const COLOUR = ["image.prf", "image.steer", "image.box_across", "image.box_depth"] as const satisfies readonly Known[];
/** Those of the image that have a menu of their own. */
export const IN_MENU: readonly string[] = [TRANSMIT, ...SLIDERS, ...COLOUR];

export function read(command: Command, { group, field }: Knob): number {
  return (command[group] as unknown as Numbers)[field];
}

/** The command with one number set, held within its limits; the others are the same objects. */
export function put(command: Command, { group, field, low, high }: Knob, value: number): Command {
  // free of the dust that adding steps leaves: nobody steers by a nanometre
  const kept = clamp(Math.round(value * 1e6) / 1e6, low, high);
  return { ...command, [group]: { ...command[group], [field]: kept } };
}

/** A value as it is shown, with a true minus sign. */
export function show({ shown, decimals }: Knob, value: number): string {
  const places = Math.abs(value / shown - Math.round(value / shown)) > 0.04 ? Math.max(decimals, 1) : decimals;
  return signless((value / shown).toFixed(places));
}

/** Text of a number with a true minus sign and no negative zero. */
export function signless(text: string): string {
  return /^-0(\.0*)?$/.test(text) ? text.slice(1) : text.replace("-", "\u2212");
}
