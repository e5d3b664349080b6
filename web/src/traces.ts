/** The force on a needle along its way, for each model: in and out again are two lines, for tissue remembers. */

import type { Curve } from "./curves";
import type { FrameHeader } from "./protocol";

/** mm and N between two points of a trace, at least: slower hands leave no more of them. */
const APART = [0.25, 0.05] as const;
const LONGEST = 4000;

export class Traces {
  private readonly traces = new Map<string, (readonly [number, number])[]>();
  private passes = -1;

  /** A new pass starts all traces again, and a model that knows no forces has none. */
  add(model: string, { readouts, pass }: FrameHeader): void {
    if (pass.passes !== this.passes) this.clear();
    this.passes = pass.passes;
    if (!readouts?.hub) return;
    let trace = this.traces.get(model);
    if (!trace) this.traces.set(model, (trace = []));
    const point = [readouts.depth, readouts.hub.axial_n] as const;
    const last = trace.at(-1);
    if (last && APART.every((apart, k) => Math.abs(point[k] - last[k]) < apart)) return;
    trace.push(point);
    if (trace.length > LONGEST) trace.shift();
  }

  get(model: string): Curve {
    return this.traces.get(model) ?? [];
  }

  get models(): string[] {
    return [...this.traces.keys()];
  }

  clear(): void {
    this.traces.clear();
  }
}
