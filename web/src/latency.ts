/** Pose sent to its frame drawn, by sequence number, and frames drawn a second. Times in ms. */

const WINDOW = 1000;
const MEASURE = "pose to drawn";

export class Meter {
  private sent = new Map<number, number>();
  private samples: { at: number; value: number }[] = [];
  private drawn: number[] = [];
  private newest = 0;

  poseSent(seq: number, at: number): void {
    this.sent.set(seq, at);
    if (this.sent.size > 4096) this.sent.delete(this.sent.keys().next().value as number);
  }

  frameDrawn(seq: number, at: number): void {
    this.drawn.push(at);
    const from = this.sent.get(seq);
    if (seq > this.newest && from !== undefined) {
      this.samples.push({ at, value: at - from });
      report(from, at);
    }
    if (seq > this.newest) {
      for (const old of this.sent.keys()) if (old <= seq) this.sent.delete(old);
      this.newest = seq;
    }
  }

  /** The median of the last second that had poses in it; null before the first. */
  latency(now: number): number | null {
    const last = this.samples.at(-1);
    if (!last) return null;
    const since = Math.min(now, last.at) - WINDOW;
    this.samples = this.samples.filter((sample) => sample.at > since);
    return median(this.samples.map((sample) => sample.value));
  }

  /** Whether the latency is of now: a hand at rest sends no poses. */
  fresh(now: number): boolean {
    return (this.samples.at(-1)?.at ?? -Infinity) > now - WINDOW;
  }

  rate(now: number): number {
    this.drawn = this.drawn.filter((at) => at > now - WINDOW);
    return this.drawn.length;
  }

  clear(): void {
    this.sent.clear();
    this.samples = [];
    this.drawn = [];
    this.newest = 0;
  }
}

/** For whoever observes the page's performance entries; none are kept. */
function report(start: number, end: number): void {
  performance.measure(MEASURE, { start, end });
  performance.clearMeasures(MEASURE);
}

export function median(values: readonly number[]): number {
  const sorted = [...values].sort((a, b) => a - b);
  const half = sorted.length >> 1;
  return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
}
