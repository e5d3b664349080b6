/** What is to be done, read before it begins: over the place of the image, which nobody works on meanwhile. */

import { h, write } from "../dom";
import { DONE } from "../input/focus";
import { clock, title, wanted } from "../metrics";
import type { Guide, OfferedExercise } from "../protocol";
import type { Trainer } from "../trainer";

const LEVELS = ["", "guided", "by the image", "the real lesson"];
const GUIDES: readonly (readonly [Guide, string])[] = [
  ["target", "target"], ["path", "path"], ["tip", "tip"], ["numbers", "numbers"], ["3-D view", "3-D view"],
];

export class Briefing {
  private readonly level = h("p", { class: "level" });
  private readonly name = h("h2", { id: "briefing-title" });
  private readonly task = h("p", { class: "task" });
  private readonly facts = h("dl", { class: "facts" });
  private readonly start = h("button", { type: "button", class: "button primary" }, "Start");
  private readonly back = h("button", { type: "button", class: "button" }, "Back");
  readonly element = h(
    "section",
    { class: "briefing", "aria-labelledby": "briefing-title", hidden: true },
    h("div", { class: "sheet-of" }, this.level, this.name, this.task, this.facts, h("div", { class: "buttons" }, this.start, this.back)),
  );

  constructor(trainer: Trainer) {
    this.start.addEventListener("click", () => {
      if (trainer.briefed) trainer.begin(trainer.briefed.id);
    });
    this.back.addEventListener("click", () => trainer.brief(null));
    this.element.addEventListener("keydown", (event) => {
      if (event.code !== "Escape") return;
      event.preventDefault();
      trainer.brief(null);
    });
    trainer.changed.on(() => {
      const exercise = trainer.briefed;
      const opened = this.element.hidden && exercise !== null;
      const closed = !this.element.hidden && exercise === null;
      this.element.hidden = exercise === null;
      if (exercise) this.show(exercise);
      if (opened) this.start.focus();
      if (closed) this.element.dispatchEvent(new Event(DONE, { bubbles: true }));
    });
    // while it loads, the button says so
    trainer.session.loading.on(({ share }) => write(this.start, share < 1 ? "Loading" : "Start"));
    trainer.session.sceneReady.on(() => write(this.start, "Start"));
    trainer.session.refused.on(() => write(this.start, "Start"));
  }

  private show(exercise: OfferedExercise): void {
    write(this.level, levelOf(exercise));
    write(this.name, exercise.name);
    write(this.task, exercise.description);
    const fact = (name: string, ...what: (string | Node)[]) => h("div", {}, h("dt", {}, name), h("dd", {}, ...what));
    const passes = exercise.most_passes === 1 ? "one pass" : `${exercise.most_passes} passes`;
    this.facts.replaceChildren(
      fact("Target", exercise.target),
      fact("Limits", `${clock(exercise.time_limit_s)} minutes, ${passes} at most`),
      fact("Entry", exercise.zone ? "within the yellow zone on the skin line" : "anywhere"),
      fact("Shown", inWords(GUIDES.filter(([guide]) => exercise.guides.includes(guide)), "the image alone")),
      fact("Not shown", inWords(GUIDES.filter(([guide]) => !exercise.guides.includes(guide)), "nothing is hidden")),
      fact("Do not touch", exercise.forbidden.length ? exercise.forbidden.join(", ") : "nothing is forbidden"),
      fact("To pass", h("ul", {}, h("li", {}, "you say “I am on target”"), ...exercise.marks.map((mark) => h("li", {}, `${title(mark.metric).toLowerCase()} ${wanted(mark)}`)))),
      ...(exercise.breathes ? [fact("Patient", "breathes; breath may be held (H)")] : []),
    );
  }
}

export function levelOf({ level }: OfferedExercise): string {
  return `Level ${level} of 3: ${LEVELS[level]}`;
}

function inWords(guides: typeof GUIDES, none: string): string {
  return guides.length ? guides.map(([, word]) => word).join(", ") : none;
}
