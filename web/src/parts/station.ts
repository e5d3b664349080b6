/** At a station of a lab: who sits there is asked before anything else, and said in the header. */

import { h, write } from "../dom";
import { DONE } from "../input/focus";
import type { Trainer } from "../trainer";

/** Over the place of the image, until somebody with a code sits here. */
export class SitDown {
  private readonly title = h("h2", { id: "sit-down-title" });
  private readonly code = h("input", { id: "code", class: "field-of", name: "code", maxlength: 16, autocomplete: "off", spellcheck: "false", required: true, "aria-describedby": "code-problem", placeholder: "K-17" });
  private readonly problem = h("p", { class: "problem", id: "code-problem", role: "alert" });
  readonly element = h(
    "section",
    { class: "briefing sit-down", "aria-labelledby": "sit-down-title", hidden: true },
    h(
      "form",
      { class: "sheet-of" },
      h("p", { class: "level" }, "Skills lab"),
      this.title,
      h("p", { class: "task" }, "Your trainer has given you a code. Results are kept under it; your name is not."),
      h("label", { for: "code" }, "Your code"),
      h("div", { class: "buttons" }, this.code, h("button", { type: "submit", class: "button primary" }, "Sit down")),
      this.problem,
    ),
  );

  constructor(trainer: Trainer) {
    const { session } = trainer;
    this.element.addEventListener("submit", (event) => {
      event.preventDefault();
      write(this.problem, "");
      session.say({ type: "sit_down", participant: this.code.value.trim() });
    });
    trainer.stationed.on(({ name, participant }) => {
      const [opened, closed] = [this.element.hidden && participant === null, !this.element.hidden && participant !== null];
      this.element.hidden = participant !== null;
      write(this.title, `Station ${name}`);
      if (opened) {
        this.code.value = "";
        this.code.focus();
      }
      if (closed) {
        write(this.problem, "");
        this.element.dispatchEvent(new Event(DONE, { bubbles: true }));
      }
    });
    session.refused.on(({ what, message }) => {
      if (what !== "sit_down" || this.element.hidden) return;
      write(this.problem, message);
      this.code.select();
    });
  }
}

/** Which station this is and who sits there; pressed, somebody else may. */
export class StationTag {
  private readonly place = h("span", { class: "name" });
  private readonly who = h("b", {});
  readonly element = h("button", { type: "button", class: "button station-tag", "data-hint": "Let somebody else sit down", hidden: true }, this.place, this.who);

  constructor(trainer: Trainer) {
    this.element.addEventListener("click", () => trainer.session.say({ type: "sit_down", participant: null }));
    trainer.stationed.on(({ name, participant }) => {
      this.element.hidden = false;
      write(this.place, `Station ${name}`);
      write(this.who, participant ?? "");
    });
  }
}
