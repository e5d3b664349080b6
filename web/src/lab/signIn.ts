/** Asks for the trainer's token where the address has none, or a wrong one; and says when the lab is away. */

import { h, write } from "../dom";
import type { Lab } from "./lab";

export class SignIn {
  private readonly token = h("input", { id: "token", type: "password", class: "field-of", autocomplete: "off", spellcheck: "false", required: true, "aria-describedby": "token-problem" });
  private readonly problem = h("p", { class: "problem", id: "token-problem", role: "alert" });
  private readonly form = h("div", { class: "buttons" }, this.token, h("button", { type: "submit", class: "button primary" }, "Open the lab"));
  private readonly label = h("label", { for: "token" }, "The trainer's token, as it was printed when the lab was started");
  readonly element = h(
    "section",
    { class: "sign-in", "aria-labelledby": "sign-in-title", hidden: true },
    h("form", { class: "sheet-of" }, h("h2", { id: "sign-in-title" }, "Trainer"), this.label, this.form, this.problem),
  );

  constructor(lab: Lab) {
    this.element.addEventListener("submit", (event) => {
      event.preventDefault();
      const address = new URL(location.href);
      address.searchParams.set("trainer", this.token.value.trim());
      location.assign(address);
    });
    lab.lost.on((loss) => {
      if (loss === null) return this.show(false);
      const shut = loss.nextAt === null;
      this.show(true, shut);
      write(this.problem, shut ? `${loss.reason}.` : "The lab does not answer; trying again.");
    });
    lab.greeted.on(() => this.show(false));
  }

  /** `asks`: whether a token is wanted. */
  show(open: boolean, asks = true): void {
    const opened = open && this.element.hidden;
    this.element.hidden = !open;
    this.form.hidden = this.label.hidden = !asks;
    if (opened && asks) this.token.focus();
  }
}
