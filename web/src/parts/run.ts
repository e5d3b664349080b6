/** While an exercise runs: time and passes that are left, "I am on target", and giving up. */

import { h, toggle, write } from "../dom";
import { keyOf } from "../keys";
import { clock } from "../metrics";
import type { Trainer } from "../trainer";

const EVERY = 100;
/** s before the end that are said in amber. */
const SHORT = 30;

export class RunStrip {
  private readonly time = h("output", { class: "left", "aria-label": "Time left", "aria-live": "off" });
  private readonly passes = h("output", { class: "left", "aria-label": "Passes left", "aria-live": "off" });
  private readonly timeItem = h("span", { class: "item" }, this.time, h("span", { class: "unit" }, "left"));
  private readonly passWord = h("span", { class: "unit" });
  private readonly passItem = h("span", { class: "item passes" }, this.passes, this.passWord);
  readonly element: HTMLElement;
  private writtenAt = -Infinity;

  constructor(private readonly trainer: Trainer) {
    const onTarget = h("button", { type: "button", class: "button on-target", "data-hint": "Say that the needle is on target", "data-key": keyOf("onTarget"), onclick: () => trainer.sayOnTarget() }, h("span", { class: "long" }, "I am on target"), h("span", { class: "short" }, "On target"));
    const giveUp = h("button", { type: "button", class: "button give-up", onclick: () => trainer.giveUp() }, "Give up");
    this.element = h("section", { class: "run", "aria-label": "Exercise", hidden: true }, this.timeItem, this.passItem, onTarget, giveUp);
    trainer.changed.on((phase) => (this.element.hidden = phase !== "attempt"));
  }

  tick(now: number): void {
    const { attempt, session } = this.trainer;
    if (!attempt || !session.frame || now - this.writtenAt < EVERY) return;
    this.writtenAt = now;
    const { time_s, passes } = session.frame.header.pass;
    const left = attempt.exercise.time_limit_s - time_s;
    const punctures = Math.max(0, attempt.exercise.most_passes - passes);
    write(this.time, clock(Math.ceil(left)));
    this.time.dataset.value = left.toFixed(3);
    write(this.passes, String(punctures));
    write(this.passWord, punctures === 1 ? "pass left" : "passes left");
    toggle(this.timeItem, "caution", left < SHORT);
  }
}
