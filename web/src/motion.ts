/** From what the hands hold down to how far things move: one tap is one step, holding moves steadily. */

import type { Knob } from "./protocol";

export type Pace = "slow" | "normal" | "fast";
export const PACE: Record<Pace, number> = { slow: 0.2, normal: 1, fast: 4 };

/** Seconds before a held key or button moves on by itself. */
export const HOLD_DELAY = 0.25;

interface Held { knob: Knob; sign: number; age: number; left: number }
/** `barred`: the way that is at its end until the hand lets go or turns back. */
interface Driven { knob: Knob; speed: number; barred: number }

/**
 * Collects what is held (keys, buttons: a step at once, then a rate) and driven (sticks, levers: a speed), and
 * integrates them. It knows nothing of poses: it hands out increments.
 */
export class Motion {
  /** The speed that stays chosen, and the one a held key lays over it. */
  chosen: Pace = "normal";
  over: Pace | null = null;
  private held = new Map<string, Held>();
  private driven = new Map<string, Driven>();

  get pace(): Pace {
    return this.over ?? this.chosen;
  }

  /** A key or button goes down: one step now. A second press of the same source changes nothing. */
  press(source: string, knob: Knob, sign: number): Increment | null {
    if (this.held.has(source)) return null;
    this.held.set(source, { knob, sign, age: 0, left: 0 });
    return { knob, by: sign * knob.step * this.factor(knob) };
  }

  release(source: string): void {
    this.held.delete(source);
    this.driven.delete(source);
  }

  /** A stick or lever stands at a speed, in units of the knob's rate; 0 lets go. */
  drive(source: string, knob: Knob, speed: number): void {
    if (speed === 0) this.driven.delete(source);
    else this.driven.set(source, { knob, speed, barred: this.driven.get(source)?.barred === Math.sign(speed) ? Math.sign(speed) : 0 });
  }

  /** Everything stops: blur, hidden tab, lost connection, an unplugged gamepad. */
  stop(): void {
    this.held.clear();
    this.driven.clear();
    this.over = null;
  }

  /** What pushes one way lets go until it is pressed again: a needle at its end must not wind up. */
  stopKnob(id: string, sign: number): void {
    for (const held of this.held.values()) if (held.knob.id === id && held.sign === sign) held.age = -Infinity;
    for (const driven of this.driven.values()) if (driven.knob.id === id) driven.barred = sign;
  }

  get moving(): boolean {
    return this.held.size > 0 || this.driven.size > 0;
  }

  /** Knobs that move by themselves, beyond the first step of a tap. */
  get steady(): Set<string> {
    const held = [...this.held.values()].filter(({ age }) => age > HOLD_DELAY);
    return new Set([...held, ...this.driven.values()].map(({ knob }) => knob.id));
  }

  /** What moved in the last `seconds`. */
  advance(seconds: number): Increment[] {
    const out: Increment[] = [];
    const ways = new Set<string>();
    for (const held of this.held.values()) {
      const before = held.age;
      held.age += seconds;
      const active = held.age - Math.max(before, HOLD_DELAY);
      // a key and a button that push the same way push no faster than one
      const way = `${held.knob.id} ${held.sign}`;
      if (active <= 0 || ways.has(way)) continue;
      ways.add(way);
      const by = held.sign * held.knob.rate * active * this.factor(held.knob);
      out.push({ knob: held.knob, by: held.knob.setting ? this.whole(held, by) : by });
    }
    for (const { knob, speed, barred } of this.driven.values()) {
      if (Math.sign(speed) === barred) continue;
      out.push({ knob, by: speed * knob.rate * seconds * this.factor(knob) });
    }
    return out.filter((increment) => increment.by !== 0);
  }

  private factor({ setting }: Knob): number {
    return setting ? 1 : PACE[this.pace];
  }

  /** Settings go from step to step: keep what is short of one. */
  private whole(held: Held, by: number): number {
    const { step } = held.knob;
    held.left += by;
    const steps = Math.trunc(held.left / step + 1e-9 * Math.sign(held.left));
    held.left -= steps * step;
    return steps * step;
  }
}

export interface Increment { knob: Knob; by: number }
