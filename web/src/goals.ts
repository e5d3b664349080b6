/** Places to go to at a speed, an axis each: a goal ends when it is reached, replaced or stopped. */

import { AXES, type AxisId } from "./axes";
import { PACE, type Increment, type Pace } from "./motion";
import { clamp } from "./vec";

const REACHED = 1e-6;

interface Goal { value: number; pace: Pace | null }

export class Goals {
  private readonly goals = new Map<AxisId, Goal>();

  /** `pace` null: the speed that is chosen at the moment. */
  set(axis: AxisId, value: number, pace: Pace | null): void {
    this.goals.set(axis, { value, pace });
  }

  get(axis: AxisId): number | null {
    return this.goals.get(axis)?.value ?? null;
  }

  stop(axis: AxisId): boolean {
    return this.goals.delete(axis);
  }

  stopAll(): void {
    this.goals.clear();
  }

  get axes(): AxisId[] {
    return [...this.goals.keys()];
  }

  /** What to move in the next `seconds`; `at` says where an axis is. */
  advance(seconds: number, at: (axis: AxisId) => number, chosen: Pace): Increment[] {
    const out: Increment[] = [];
    for (const [axis, { value, pace }] of this.goals) {
      const left = value - at(axis);
      const most = AXES[axis].rate * PACE[pace ?? chosen] * seconds;
      if (Math.abs(left) <= REACHED) this.goals.delete(axis);
      else out.push({ axis, by: clamp(left, -most, most) });
    }
    return out;
  }
}
