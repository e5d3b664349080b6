/** Where a replay is, and how it goes on: the pictures of a recording, asked for one at a time. */

import type { Course, FrameHeader } from "./protocol";
import { Signal } from "./signal";
import type { Trainer } from "./trainer";
import { clamp } from "./vec";

/** s by which the clock may be ahead of the picture. */
const AHEAD = 0.5;
/** ms of waiting that are said. */
const LONG = 400;
export const SPEEDS = [0.5, 1, 2, 4] as const;

export class Reel {
  /** Place in the course of what is shown or asked for. */
  at = 0;
  playing = false;
  speed: number = 1;
  /** Whether every picture so far was the recorded one, pixel for pixel. */
  same = true;
  readonly moved = new Signal<number>();
  readonly turned = new Signal<boolean>();
  private shown = -1;
  private awaited: number | null = null;
  private askedAt = 0;
  private time = 0;
  private before: number | null = null;

  constructor(private readonly trainer: Trainer) {
    trainer.changed.on((phase) => {
      if (phase !== "debrief" || !this.course) return this.play(false);
      this.same = true;
      this.shown = -1;
      this.awaited = null;
      this.at = this.course.time_s.length - 1;
      this.time = this.end;
      this.moved.emit(this.at);
    });
    trainer.session.drawn.on(({ header }) => header.replay && this.take(header.replay));
    trainer.session.refused.on(({ what }) => {
      if (what === "show_step") this.awaited = null; // the next one that is asked for may come
    });
  }

  get course(): Course | null {
    return this.trainer.debrief?.course ?? null;
  }

  /** Whether there is anything to be replayed. */
  get plays(): boolean {
    return (this.trainer.debrief?.steps ?? 0) > 0;
  }

  /** A jump takes longer than one is to be left without a word. */
  get waits(): boolean {
    return this.awaited !== null && performance.now() - this.askedAt > LONG;
  }

  get end(): number {
    return this.course?.time_s.at(-1) ?? 0;
  }

  get now(): number {
    return this.course?.time_s[this.at] ?? 0;
  }

  seek(time: number): void {
    this.time = clamp(time, 0, this.end);
    this.go(placeAt(this.course, this.time));
  }

  step(by: number): void {
    this.play(false);
    if (!this.course) return;
    this.go(clamp(this.at + by, 0, this.course.time_s.length - 1));
    this.time = this.now;
  }

  play(on: boolean): void {
    if (on && this.time >= this.end) this.seek(0);
    this.before = null;
    if (on === this.playing) return;
    this.playing = on && this.plays;
    this.turned.emit(this.playing);
  }

  /** Once an animation frame. */
  tick(now: number): void {
    if (!this.playing || !this.course) return;
    const passed = this.before === null ? 0 : (now - this.before) / 1000;
    this.before = now;
    const shown = this.shown < 0 ? this.time : this.course.time_s[placeOfStep(this.course, this.shown)];
    this.time = Math.min(this.time + this.speed * passed, this.end, shown + AHEAD * this.speed);
    this.go(placeAt(this.course, this.time));
    if (this.time >= this.end) this.play(false);
  }

  private go(at: number): void {
    if (at !== this.at) {
      this.at = at;
      this.moved.emit(at);
    }
    this.ask();
  }

  /** One at a time: the server makes every step up to the one that is asked for. */
  private ask(): void {
    const step = this.course?.step[this.at] ?? 0;
    if (!this.plays || this.awaited !== null || step === this.shown) return;
    this.awaited = step;
    this.askedAt = performance.now();
    this.trainer.session.say({ type: "show_step", step });
  }

  private take({ step, same }: NonNullable<FrameHeader["replay"]>): void {
    this.shown = step;
    this.same &&= same;
    this.awaited = null;
    this.ask();
  }
}

/** The last sample at a time, or before. */
export function placeAt(course: Course | null, time: number): number {
  return lastNotAbove(course?.time_s ?? [], time + 1e-6);
}

function placeOfStep(course: Course, step: number): number {
  return lastNotAbove(course.step, step);
}

function lastNotAbove(values: readonly number[], most: number): number {
  let [low, high] = [0, Math.max(0, values.length - 1)];
  while (low < high) {
    const middle = Math.ceil((low + high) / 2);
    if (values[middle] <= most) low = middle;
    else high = middle - 1;
  }
  return low;
}
