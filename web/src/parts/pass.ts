/** This pass in four numbers; while an exercise runs, what is to be done. */

import { h, write } from "../dom";
import { clock } from "../metrics";
import type { Trainer } from "../trainer";

const EVERY = 100;

export class PassPanel {
  private readonly metrics = { time: metric("Time"), passes: metric("Passes"), path: metric("Needle path"), blind: metric("Blind advance") };
  private readonly title = h("h2", { id: "pass-title" });
  private readonly note = h("span", {});
  private readonly goal = h("p", { class: "goal" });
  private readonly list = h("dl", {}, ...Object.values(this.metrics).map(({ root }) => root));
  readonly element = h(
    "section",
    { class: "panel pass", "aria-labelledby": "pass-title" },
    h("div", { class: "panel-head" }, this.title, this.note),
    this.goal,
    this.list,
  );
  private writtenAt = -Infinity;

  constructor(private readonly trainer: Trainer) {
    trainer.session.statusChanged.on((status) => {
      if (status === "lost" || status === "loading") for (const { value } of Object.values(this.metrics)) write(value, "–");
    });
    trainer.changed.on(() => this.arrange());
    this.arrange();
  }

  private arrange(): void {
    const attempt = this.trainer.attempt;
    write(this.title, attempt ? attempt.exercise.name : "This pass");
    write(this.note, attempt ? (attempt.recorded ? "not recorded" : "recorded") : "free practice");
    write(this.goal, attempt ? attempt.exercise.description : "");
    this.goal.hidden = !attempt;
    this.list.hidden = attempt !== null;
    this.element.classList.toggle("runs", attempt !== null);
  }

  tick(now: number): void {
    const { frame, status } = this.trainer.session;
    if (now - this.writtenAt < EVERY || !frame || status === "lost") return;
    this.writtenAt = now;
    const { time_s, passes, path_mm, blind_mm } = frame.header.pass;
    const { time, passes: count, path, blind } = this.metrics;
    write(time.value, clock(time_s));
    write(count.value, String(passes));
    write(path.value, path_mm === null ? "–" : `${path_mm.toFixed(0)} mm`);
    write(blind.value, blind_mm === null ? "–" : `${blind_mm.toFixed(0)} mm`);
    if (path_mm !== null) path.value.dataset.value = path_mm.toFixed(3);
  }
}

function metric(name: string): { root: HTMLElement; value: HTMLElement } {
  const value = h("dd", {}, "–");
  return { root: h("div", {}, h("dt", {}, name), value), value };
}
