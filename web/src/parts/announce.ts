/** One polite voice, at most one sentence in two seconds; faults speak at once. */

import type { Desk } from "../desk";
import { h } from "../dom";
import { inPlane, onTarget } from "./readouts";
import { happening, stopped } from "./words";

const EVERY = 2000;

export class Announcer {
  private readonly polite = h("p", { role: "status", "aria-live": "polite" });
  private readonly urgent = h("p", { role: "alert", "aria-live": "assertive" });
  readonly element = h("div", { class: "unseen" }, this.polite, this.urgent);
  private waiting: string | null = null;
  private saidAt = -Infinity;

  constructor(desk: Desk) {
    const { session } = desk;
    let [reached, plane, why] = [false, true, ""];
    session.drawn.on(({ header }) => {
      if (!session.scene) return;
      const { readouts } = header;
      const [nowReached, nowPlane] = readouts ? [onTarget(readouts, session.scene), inPlane(readouts)] : [false, true];
      if (nowReached && !reached) this.say("On target.");
      if (!nowPlane && plane) this.say("Tip out of plane.");
      const nowWhy = stopped(header)?.join(". ") ?? "";
      if (nowWhy && nowWhy !== why) this.say(`${nowWhy}.`);
      [reached, plane, why] = [nowReached, nowPlane, nowWhy];
    });
    session.statusChanged.on((status) => {
      if (status === "frozen") this.say("Frozen.");
      if (status === "lost") this.alarm("Connection lost.");
    });
    let held = false;
    desk.trainer.stationed.on(({ hands_locked }) => {
      if (hands_locked !== held) this.say(hands_locked ? "Frozen by the trainer." : "The trainer lets it go on.");
      held = hands_locked;
    });
    session.sceneReady.on((scene) => this.say(`${scene.name} is ready.`));
    session.modelChanged.on((model) => this.say(`Model: ${session.scene?.models.find(({ id }) => id === model)?.name ?? model}.`));
    session.refused.on(({ message }) => this.alarm(message));
    session.noticed.on(({ level, message }) => (level === "fault" ? this.alarm(message) : this.say(message)));
    session.happened.on(({ text }) => {
      const words = happening(text);
      if (words) this.say(`${words.join(" ").trim()}.`);
    });
    desk.said.on((sentence) => this.say(sentence));
  }

  tick(now: number): void {
    if (this.waiting === null || now - this.saidAt < EVERY) return;
    this.polite.textContent = this.waiting;
    this.waiting = null;
    this.saidAt = now;
  }

  /** The newest sentence wins: the older one is no longer true. */
  private say(sentence: string): void {
    this.waiting = sentence;
  }

  private alarm(sentence: string): void {
    this.urgent.textContent = sentence;
  }
}
