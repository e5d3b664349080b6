/** In the header of a debrief: what came of the attempt, and how to go on. */

import { courseTable, download, metricsTable } from "../csv";
import { h, toggle, write } from "../dom";
import { title, wanted, withUnit } from "../metrics";
import type { Debrief } from "../protocol";
import type { Trainer } from "../trainer";

export class VerdictBar {
  private readonly verdict = h("output", { class: "verdict-tag" });
  readonly element: HTMLElement;

  constructor(trainer: Trainer) {
    const button = (label: string, run: (debrief: Debrief) => void, hint = "", className = "") =>
      h("button", { type: "button", class: `button ${className}`, "data-hint": hint || null, onclick: () => trainer.debrief && run(trainer.debrief) }, label);
    this.element = h(
      "section",
      { class: "verdict", "aria-label": "Debrief", hidden: true },
      this.verdict,
      h("span", { class: "space" }),
      button("Same start", ({ exercise, seed }) => trainer.begin(exercise.id, seed), "The same exercise from the same start"),
      button("New start", ({ exercise }) => trainer.begin(exercise.id), "The same exercise from another start"),
      button("CSV", (debrief) => {
        const name = `${debrief.exercise.id}-${debrief.seed}`;
        download(`${name}-metrics.csv`, metricsTable(debrief));
        download(`${name}-course.csv`, courseTable(debrief));
      }, "Metrics and course as two tables"),
      button("Print", () => window.print(), "", "print"),
      button("Next exercise", ({ exercise }) => trainer.brief(trainer.next(exercise.id)), "", "primary"),
    );
    trainer.changed.on(() => {
      const { debrief } = trainer;
      this.element.hidden = trainer.phase !== "debrief";
      if (!debrief) return;
      write(this.verdict, inShort(debrief));
      toggle(this.verdict, "passed", debrief.passed);
      this.verdict.title = missed(debrief).join("; ");
    });
  }
}

/** Passed, or what is missing most. */
export function inShort(debrief: Debrief): string {
  if (debrief.passed) return "Passed";
  if (debrief.ended !== "on target") return `Not yet: ${debrief.ended}`;
  const [first, ...more] = debrief.metrics.filter(({ passed }) => passed === false);
  return first ? `Not yet: ${title(first.name).toLowerCase()} ${withUnit(first.value, first.unit)}${more.length ? `, and ${more.length} more` : ""}` : "Not yet";
}

/** What was asked for and not reached. */
export function missed({ metrics }: Debrief): string[] {
  return metrics.filter(({ passed }) => passed === false).map((metric) => `${title(metric.name)} ${withUnit(metric.value, metric.unit)}: ${wanted(metric)} to pass.`);
}
