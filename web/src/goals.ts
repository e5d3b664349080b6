/** Places to go to at a speed, a knob each: a goal ends when it is reached, replaced or stopped. */

import { PACE, type Increment, type Pace } from "./motion";
import type { Knob } from "./protocol";
import { clamp } from "./vec";

const REACHED = 1e-6;

interface Goal { knob: Knob; value: number; pace: Pace | null }

export class Goals {
  private readonly goals = new Map<string, Goal>();

  /** `pace` null: the speed that is chosen at the moment. */
  set(knob: Knob, value: number, pace: Pace | null): void {
    this.goals.set(knob.id, { knob, value, pace });
  }

  get(id: string): number | null {
    return this.goals.get(id)?.value ?? null;
  }

  stop(id: string): boolean {
    return this.goals.delete(id);
  }

  get ids(): string[] {
    return [...this.goals.keys()];
  }

  /** What to move in the next `seconds`; `at` says where a knob is. */
  advance(seconds: number, at: (knob: Knob) => number, chosen: Pace): Increment[] {
    const out: Increment[] = [];
    for (const { knob, value, pace } of this.goals.values()) {
      const left = value - at(knob);
      const most = knob.rate * PACE[pace ?? chosen] * seconds;
      if (Math.abs(left) <= REACHED) this.goals.delete(knob.id);
      else out.push({ knob, by: clamp(left, -most, most) });
    }
    return out;
  }
}
