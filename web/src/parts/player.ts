/** Below the picture of a debrief: play, step and speed; the truth over the picture; and whether it is the recorded one. */

import { h, write } from "../dom";
import { clock } from "../metrics";
import { Reel, SPEEDS } from "../reel";
import type { Trainer } from "../trainer";

export class Player {
  private readonly play = h("button", { type: "button", class: "button play" }, "Play");
  private readonly time = h("output", { class: "time", "aria-label": "Time of the picture", "aria-live": "off" });
  private readonly note = h("p", { class: "note" });
  private readonly pace = h("button", { type: "button", class: "button quiet", "aria-label": "Speed" });
  private readonly truth = h("button", { type: "button", class: "button toggle quiet", "data-hint": "Target, tip and path over the picture" }, "Truth");
  readonly element: HTMLElement;
  private waited = false;

  constructor(
    private readonly trainer: Trainer,
    private readonly reel: Reel,
    refresh: () => void,
  ) {
    const back = h("button", { type: "button", class: "button", "aria-label": "A step back", onclick: () => reel.step(-1) }, "◀");
    const on = h("button", { type: "button", class: "button", "aria-label": "A step on", onclick: () => reel.step(1) }, "▶");
    const buttons = [back, this.play, on, this.pace];
    this.element = h("section", { class: "player", "aria-label": "Replay", hidden: true }, ...buttons, this.time, this.truth, this.note);
    this.play.addEventListener("click", () => reel.play(!reel.playing));
    this.pace.addEventListener("click", () => {
      reel.speed = SPEEDS[(SPEEDS.indexOf(reel.speed as 1) + 1) % SPEEDS.length];
      this.refresh();
    });
    this.truth.addEventListener("click", () => {
      trainer.session.truth = !trainer.session.truth;
      this.refresh();
      refresh();
    });
    trainer.changed.on((phase) => {
      this.element.hidden = phase !== "debrief";
      for (const button of buttons) button.disabled = !reel.plays;
      this.refresh();
    });
    reel.moved.on(() => this.refresh());
    reel.turned.on(() => this.refresh());
    trainer.session.drawn.on(() => this.refresh());
  }

  /** Once an animation frame. */
  tick(): void {
    if (this.reel.waits !== this.waited) this.refresh();
    this.waited = this.reel.waits;
  }

  private refresh(): void {
    const { reel, trainer } = this;
    const { debrief } = trainer;
    if (!debrief) return;
    write(this.play, reel.playing ? "Pause" : "Play");
    write(this.pace, `${reel.speed} ×`);
    write(this.time, `${clock(reel.now)} of ${clock(reel.end)}`);
    this.truth.setAttribute("aria-pressed", String(trainer.session.truth));
    const made = reel.same ? "every picture is made again from the recording, to the bit" : "pictures differ from the recorded ones";
    write(this.note, reel.waits ? "making the picture again" : debrief.problem || made);
    this.note.classList.toggle("caution", debrief.problem !== "" || !reel.same);
  }
}
