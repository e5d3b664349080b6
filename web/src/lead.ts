/** How far what is asked for may be ahead of what is shown: a hand steers by the picture, never blindly. Pure. */

import { AXES, type AxisId } from "./axes";
import { PACE } from "./motion";
import { clamp } from "./vec";

/** mm or degrees ahead at most: one tap at the fast speed, which is 2 mm of needle. Settings show what they ask for. */
export function mostAhead(id: AxisId): number {
  return AXES[id].setting ? Infinity : AXES[id].step * PACE.fast;
}

/** Where a move gets to from what is asked for now. What is further ahead already stays; coming back is free. */
export function bounded(id: AxisId, asked: number, by: number, shown: number): number {
  const most = mostAhead(id);
  if (by > 0) return Math.max(asked, Math.min(asked + by, shown + most));
  return Math.min(asked, Math.max(asked + by, shown - most));
}

/** Where it stays once the hand lets go: at most one tap of the chosen speed from what is shown. */
export function letGo(id: AxisId, asked: number, shown: number, pace: number): number {
  if (AXES[id].setting) return asked;
  const step = AXES[id].step * pace;
  return clamp(asked, shown - step, shown + step);
}
