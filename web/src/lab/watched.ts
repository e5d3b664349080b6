/** The station that is watched: the same pixels as its page shows, with what an exercise hides, and what the trainer says and sets. */

import { h, toggle, write } from "../dom";
import { signless } from "../knobs";
import { clock } from "../metrics";
import { ImagePane } from "../parts/imagePane";
import { Session } from "../session";
import { Signal } from "../signal";
import { exerciseChoice } from "./exerciseChoice";
import type { Lab, StationState } from "./lab";
import { lockButton } from "./lockButton";
import { SolidView } from "./solidView";

export class Watched {
  readonly session: Session;
  readonly image: ImagePane;
  private readonly solid: SolidView;
  private readonly title = h("h2", { id: "watched-title" }, "No station is watched");
  private readonly note = h("span", { class: "note" }, "same pixels, read only");
  private readonly numbers = {
    target: number("Tip to target", "mm"), plane: number("Out of plane", "mm"), blind: number("Blind advance", "mm"),
    force: number("Force", "N"), passes: number("Passes", ""), time: number("Time", ""),
  };
  private readonly verdict = h("p", { class: "watched-verdict" });
  private readonly line = h("input", { class: "field-of", id: "line", maxlength: 200, autocomplete: "off", "aria-label": "A line for the trainee", placeholder: "Sweep first, then push" });
  private readonly comments = h("ul", { class: "comments", "aria-label": "Comments" });
  private readonly remark: HTMLButtonElement;
  readonly element: HTMLElement;

  constructor(private readonly lab: Lab) {
    this.session = new Session(lab.watching);
    this.image = new ImagePane(this.session, { switched: new Signal() }, true);
    this.solid = new SolidView(this.session);
    this.remark = h("button", { type: "button", class: "button", title: "Kept with the attempt, and shown in its debrief" }, "Comment");
    this.remark.addEventListener("click", () => this.comment());
    const form = h("form", { class: "say" }, this.line, h("button", { type: "submit", class: "button" }, "Say now"), this.remark);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      if (lab.watched === null) return;
      lab.say({ type: "say_to_station", station: lab.watched, text: this.line.value });
      this.line.value = "";
    });
    this.element = h(
      "section",
      { class: "watched", "aria-labelledby": "watched-title" },
      h("div", { class: "panel-head" }, this.title, this.note, this.solidButton()),
      h("div", { class: "watched-panes" }, h("div", { class: "watched-image" }, this.image.element), this.solid.element),
      h("div", { class: "numbers" }, ...Object.values(this.numbers).map(({ root }) => root)),
      this.verdict,
      h("div", { class: "sets" }, exerciseChoice(lab, "Exercise", false), lockButton(lab, "Lock guides", "guides", false), lockButton(lab, "Lock model", "models", false), lockButton(lab, "Freeze", "hands", false)),
      form,
      this.comments,
    );
    lab.changed.on(() => this.show());
    lab.chosen.on(() => this.show());
  }

  /** Once an animation frame. */
  tick(now: number): void {
    this.session.draw(now);
    this.image.tick(now);
    this.solid.tick(now);
  }

  /** Surfaces are sent where they are shown, and not else. */
  private solidButton(): HTMLButtonElement {
    const button = h("button", { type: "button", class: "button toggle", "aria-pressed": "false", title: "The station's 3-D view, beside its image" }, "3-D view");
    button.addEventListener("click", () => {
      this.solid.show(!this.solid.shown);
      button.setAttribute("aria-pressed", String(this.solid.shown));
      this.lab.meshes = this.solid.shown;
      if (this.lab.watched !== null) this.lab.watch(this.lab.watched);
    });
    return button;
  }

  private get state(): StationState | null {
    return this.lab.station(this.lab.watched);
  }

  private comment(): void {
    const { state } = this;
    const text = this.line.value.trim();
    if (!state || !text) return this.line.focus();
    this.lab.say({ type: "comment_on", station: state.name, time_s: state.time_s, text });
    this.line.value = "";
  }

  private show(): void {
    const { state } = this;
    if (!state) return;
    const attempt = state.state === "running" || state.state === "debrief";
    write(this.title, `Watching station ${state.name}${state.participant ? ` · ${state.participant}` : ""}`);
    toggle(this.element, "empty", state.frame === 0);
    write(this.note, state.hands_locked ? "frozen by you" : "same pixels, read only");
    toggle(this.note, "frozen", state.hands_locked);
    const { target, plane, blind, force, passes, time } = this.numbers;
    put(target, state.to_target_mm);
    put(plane, state.out_of_plane_mm, Math.abs(state.out_of_plane_mm ?? 0) > (state.half_slice_mm ?? Infinity) && (state.depth_mm ?? 0) > 0);
    put(blind, state.blind_mm);
    put(force, state.force_n);
    write(passes.value, String(state.passes));
    write(time.value, clock(state.time_s));
    write(time.label, state.limit_s ? `of ${clock(state.limit_s)}` : "time");
    write(this.verdict, state.verdict);
    toggle(this.verdict, "passed", state.verdict === "passed");
    write(this.remark, attempt ? `Comment at ${clock(state.time_s)}` : "Comment");
    this.remark.disabled = !attempt;
    const comments = state.comments.map(({ time_s, text }) => `${clock(time_s)} ${text}`).join("\n");
    if (this.comments.dataset.text !== comments) {
      this.comments.dataset.text = comments;
      this.comments.replaceChildren(...state.comments.map(({ time_s, text }) => h("li", {}, h("b", {}, clock(time_s)), ` ${text}`)));
    }
  }
}

interface Shown { root: HTMLElement; value: HTMLOutputElement; label: HTMLElement }

function number(label: string, unit: string): Shown {
  const value = h("output", { "aria-label": label, "aria-live": "off" }, "–");
  const name = h("span", { class: "name" }, label.toLowerCase());
  return { root: h("p", { class: "number" }, value, h("span", { class: "unit" }, unit), name), value, label: name };
}

function put({ root, value }: Shown, found: number | null, caution = false): void {
  write(value, found === null ? "–" : signless(found.toFixed(1)));
  toggle(root, "caution", caution);
}
