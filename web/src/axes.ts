/** What a hand can move: which number, by how much at a tap, how fast while held. */

import type { Limits, State } from "./protocol";
import { clamp } from "./vec";

export type Group = "needle" | "probe" | "image";

export interface Axis {
  group: Group;
  field: string;
  name: string;
  unit: "mm" | "cm" | "°" | "dB" | "MHz";
  /** mm, degrees, dB or MHz for one tap. */
  step: number;
  /** The same a second, while held. */
  rate: number;
  /** Shown = value / shown. */
  shown: number;
  decimals: number;
  /** Settings move from step to step and know neither slow nor fast. */
  setting: boolean;
  /** What going down and going up are called. */
  down: string;
  up: string;
}

const moves = { shown: 1, decimals: 1, setting: false } as const;
const turns = { shown: 1, decimals: 0, setting: false, unit: "°", step: 1, rate: 20 } as const;
const sets = { setting: true } as const;

export const AXES = {
  push: { ...moves, group: "needle", field: "depth", name: "Insertion depth", unit: "mm", step: 0.5, rate: 10, down: "Pull back", up: "Push" },
  angle: { ...moves, group: "needle", field: "angle", name: "Angle in plane", unit: "°", step: 0.5, rate: 10, down: "Turn anticlockwise", up: "Turn clockwise" },
  swing: { ...moves, group: "needle", field: "swing", name: "Swing", unit: "°", step: 0.5, rate: 10, down: "Swing towards you", up: "Swing away" },
  along: { ...moves, group: "needle", field: "u", name: "Entry along the image", unit: "mm", step: 0.5, rate: 20, down: "Entry left", up: "Entry right" },
  across: { ...moves, group: "needle", field: "v", name: "Entry across the image", unit: "mm", step: 0.5, rate: 20, down: "Entry towards you", up: "Entry away" },
  slide: { ...moves, group: "probe", field: "slide", name: "Slide", unit: "mm", step: 0.5, rate: 20, down: "Slide left", up: "Slide right" },
  sweep: { ...moves, group: "probe", field: "sweep", name: "Sweep", unit: "mm", step: 0.5, rate: 20, down: "Sweep towards you", up: "Sweep away" },
  rotate: { ...turns, group: "probe", field: "rotate", name: "Rotate", down: "Rotate anticlockwise", up: "Rotate clockwise" },
  fan: { ...turns, group: "probe", field: "fan", name: "Fan", down: "Fan towards you", up: "Fan away" },
  gain: { ...sets, group: "image", field: "gain", name: "Gain", unit: "dB", step: 2, rate: 12, shown: 1, decimals: 0, down: "Less gain", up: "More gain" },
  depth: { ...sets, group: "image", field: "depth", name: "Depth", unit: "cm", step: 10, rate: 40, shown: 10, decimals: 0, down: "Less depth", up: "More depth" },
  frequency: { ...sets, group: "image", field: "frequency", name: "Frequency", unit: "MHz", step: 0.5, rate: 2, shown: 1, decimals: 1, down: "Lower frequency", up: "Higher frequency" },
  focus: { ...sets, group: "image", field: "focus", name: "Focus", unit: "cm", step: 5, rate: 20, shown: 10, decimals: 1, down: "Focus nearer", up: "Focus deeper" },
} as const satisfies Record<string, Axis>;

export type AxisId = keyof typeof AXES;

type Numbers = Record<string, number>;

export const axis = (id: AxisId): Axis => AXES[id];

export function read(state: State, id: AxisId): number {
  return (state[AXES[id].group] as unknown as Numbers)[AXES[id].field];
}

export function limits(all: Limits, id: AxisId): readonly [number, number] {
  return (all[AXES[id].group] as Record<string, readonly [number, number]>)[AXES[id].field];
}

/** The state with one number set, held within its limits; the others are the same objects. */
export function put(state: State, id: AxisId, value: number, all: Limits): State {
  const { group, field } = AXES[id];
  const [low, high] = limits(all, id);
  // free of the dust that adding steps leaves: nobody steers by a nanometre
  const kept = clamp(Math.round(value * 1e6) / 1e6, low, high);
  return { ...state, [group]: { ...state[group], [field]: kept } };
}

/** A value as it is shown, with a true minus sign. */
export function show(id: AxisId, value: number): string {
  const { shown, decimals } = AXES[id];
  const places = Math.abs(value / shown - Math.round(value / shown)) > 0.04 ? Math.max(decimals, 1) : decimals;
  return signless((value / shown).toFixed(places));
}

/** Text of a number with a true minus sign and no negative zero. */
export function signless(text: string): string {
  return /^-0(\.0*)?$/.test(text) ? text.slice(1) : text.replace("-", "\u2212");
}
