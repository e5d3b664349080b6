/** How far what is asked for may be ahead of what is shown: a hand steers by the picture, never blindly. Pure. */

import { PACE } from "./motion";
import type { Knob } from "./protocol";
import { clamp } from "./vec";

/** mm or degrees ahead at most: one tap at the fast speed, which is 2 mm of needle. Settings show what they ask for. */
export function mostAhead({ setting, step }: Knob): number {
  return setting ? Infinity : step * PACE.fast;
}

/** Where a move gets to from what is asked for now. What is further ahead already stays; coming back is free. */
export function bounded(knob: Knob, asked: number, by: number, shown: number): number {
  const most = mostAhead(knob);
  if (by > 0) return Math.max(asked, Math.min(asked + by, shown + most));
  return Math.min(asked, Math.max(asked + by, shown - most));
}

/** Where it stays once the hand lets go: at most one tap of the chosen speed from what is shown. */
export function letGo({ setting, step }: Knob, asked: number, shown: number, pace: number): number {
  return setting ? asked : clamp(asked, shown - step * pace, shown + step * pace);
}
