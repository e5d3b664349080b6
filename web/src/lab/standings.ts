/** Where participants stand, and how new ones are added: by codes. */

import { h, write } from "../dom";
import { choose, radioKeys } from "../parts/buttons";
import type { Lab, StandingRow } from "./lab";

export class Standings {
  private readonly rows = h("tbody", {});
  private readonly none = h("p", { class: "none" });
  private readonly tabs = ["Today", "All days"].map((name, k) => h("button", { type: "button", role: "radio", onclick: () => this.turn(k === 0) }, name));
  private readonly problem = h("p", { class: "problem", role: "status" });
  readonly element: HTMLElement;
  /** Whose curve is drawn before the others. */
  chosen: string | null = null;

  constructor(
    private readonly lab: Lab,
    private readonly choosing: () => void,
  ) {
    const group = h("div", { class: "segments", role: "radiogroup", "aria-label": "Days" }, ...this.tabs);
    radioKeys(group, () => this.tabs, (k) => this.turn(k === 0));
    const codes = h("input", { class: "field-of", "aria-label": "Codes of new participants", placeholder: "K-31 K-32", autocomplete: "off", spellcheck: "false", required: true });
    const team = h("input", { class: "field-of team", "aria-label": "Their group", placeholder: "group", autocomplete: "off" });
    const form = h("form", { class: "add" }, codes, team, h("button", { type: "submit", class: "button" }, "Add participants"));
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      write(this.problem, "");
      lab.say({ type: "add_participants", codes: codes.value.split(/[\s,;]+/).filter(Boolean), group: team.value.trim() || null });
      codes.value = "";
    });
    const heads = ["code", "exercise", "passed", "error", "blind", "last"].map((name) => h("th", { scope: "col", class: name }, name));
    this.element = h(
      "section",
      { class: "standings", "aria-labelledby": "standings-title" },
      h("div", { class: "panel-head" }, h("h2", { id: "standings-title" }, "Results"), group),
      h("div", { class: "rows", tabindex: 0, role: "group", "aria-label": "Results by participant and exercise" }, h("table", {}, h("thead", {}, h("tr", {}, ...heads)), this.rows), this.none),
      form,
      this.problem,
    );
    lab.found.on(({ standings, participants }) => {
      this.rows.replaceChildren(...standings.map((one) => this.row(one)));
      write(this.none, standings.length ? "" : `Nothing has been kept ${lab.today ? "today" : "yet"}; ${participants.length || "no"} ${participants.length === 1 ? "participant" : "participants"}.`);
    });
    lab.refused.on((line) => write(this.problem, line));
    this.turn(true);
  }

  private turn(today: boolean): void {
    this.tabs.forEach((tab, k) => choose(tab, (k === 0) === today));
    this.lab.ask({ today });
  }

  private row(one: StandingRow): HTMLElement {
    const mm = (value: number | null) => (value === null ? "–" : `${value.toFixed(1)} mm`);
    const who = h("button", { type: "button", class: "who", title: "Show the learning curve" }, one.participant);
    who.addEventListener("click", () => {
      this.chosen = one.participant;
      this.lab.ask({ exercise: one.exercise });
      this.choosing();
    });
    return h(
      "tr",
      {},
      h("th", { scope: "row" }, who),
      h("td", { class: "exercise", title: one.exercise }, one.exercise),
      h("td", {}, `${one.passed} of ${one.attempts}`),
      h("td", {}, mm(one.final_error_mm)),
      h("td", {}, mm(one.blind_advance_mm)),
      h("td", {}, h("span", { class: `word ${one.last_passed ? "good" : "caution"}`, title: one.last_verdict }, one.last_passed ? "passed" : "not yet")),
    );
  }
}
