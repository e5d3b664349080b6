/** How far the target has moved at each insertion depth, for each model; the live one and what came before. */

import type { FrameHeader } from "./protocol";

/** mm of insertion that share one point of a curve. */
const BIN = 0.5;

export type Curve = readonly (readonly [number, number])[];

export class Curves {
  private moved = new Map<string, Map<number, readonly [number, number]>>();
  private entry = "";

  /** A new place of entry starts all curves again: they could not be compared. */
  add(model: string, { readouts, state }: FrameHeader): void {
    const entry = `${state.needle.u} ${state.needle.v}`;
    if (entry !== this.entry) {
      this.entry = entry;
      this.moved.clear();
    }
    if (readouts.moved === null) return;
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

/** The largest value of an axis, at least `least`, at a round step: at most so many steps. */
export function axisTop(largest: number, least: number, steps: number): { top: number; step: number } {
  const wanted = Math.max(largest, least) / steps;
  const ten = 10 ** Math.floor(Math.log10(wanted));
  const step = [1, 2, 2.5, 5, 10].map((k) => k * ten).find((size) => size >= wanted * (1 - 1e-9)) ?? 10 * ten;
  return { top: step * Math.ceil(Math.max(largest, least) / step - 1e-9), step };
}
