/** How far the target has moved at each insertion depth, for each model; the live one and what came before. */

import type { FrameHeader } from "./protocol";

/** mm of insertion that share one point of a curve. */
const BIN = 0.5;

export type Curve = readonly (readonly [number, number])[];

export class Curves {
  private moved = new Map<string, Map<number, readonly [number, number]>>();
  private entry = "";

  /** A new place of entry starts all curves again: they could not be compared. So does a needle that was never in. */
  add(model: string, { readouts, state, pass }: FrameHeader): void {
    if (!readouts) return;
    const entry = `${state.needle.u} ${state.needle.v}`;
    if (entry !== this.entry || (pass.passes === 0 && readouts.depth === 0)) {
      this.entry = entry;
      this.moved.clear();
    }
    let points = this.moved.get(model);
    if (!points) this.moved.set(model, (points = new Map()));
    points.set(Math.round(readouts.depth / BIN), [readouts.depth, readouts.moved]);
  }

  get(model: string): Curve {
    return [...(this.moved.get(model)?.entries() ?? [])].sort(([a], [b]) => a - b).map(([, point]) => point);
  }

  get models(): string[] {
    return [...this.moved.keys()];
  }

  clear(): void {
    this.moved.clear();
  }
}

/** The end of an axis that holds `largest` and at least `least`, and its step: round, as few as can be, at most `steps`. */
export function axisTop(largest: number, least: number, steps: number): { top: number; step: number } {
  const end = Math.max(largest, least);
  const ten = 10 ** Math.floor(Math.log10(end / steps));
  const sizes = [1, 2, 5, 10].map((k) => k * ten).filter((size) => end <= size * steps * (1 + 1e-9));
  const [step] = sizes;
  return { top: step * Math.ceil(end / step - 1e-9), step };
}
