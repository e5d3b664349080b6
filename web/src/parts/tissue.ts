/** What tissue does in time and under the probe: a menu of five switches, and in a word what is on. */

import type { Desk } from "../desk";
import { h, toggle, write } from "../dom";
import { icon } from "../icons";
import { keyOf } from "../keys";
import { PRESS } from "../knobs";
import { inShort, isOn, pressing, STILL, SWITCHES, unavailable } from "../tissue";
import type { TissueSwitch } from "../tissue";
import { popup } from "./menu";
import { stepper, type Stepper } from "./stepper";

const EVERY = 100;

export class TissueMenu {
  private readonly state = h("output", { id: "read-excursion", "aria-live": "off" }, "–");
  private readonly button = h(
    "button",
    { type: "button", class: "button", id: "tissue-button", "aria-haspopup": "menu", "aria-expanded": "false", "aria-controls": "tissue-menu", "data-hint": "What tissue does in time" },
    h("span", { class: "name" }, "Tissue"),
    this.state,
    icon("chevron", 14),
  );
  private readonly menu = h("div", { class: "menu", id: "tissue-menu", role: "menu", "aria-labelledby": "tissue-button", hidden: true });
  readonly element = h("div", { class: "tissue" }, this.button, this.menu);
  private items: HTMLElement[] = [];
  private press: Stepper | null = null;
  private writtenAt = -Infinity;

  constructor(private readonly desk: Desk) {
    const { session } = desk;
    popup(this.element, this.button, this.menu, () => this.entries());
    const refresh = () => this.refresh();
    session.commanded.on(refresh);
    session.modelChanged.on(refresh);
    session.sceneReady.on(refresh);
    session.statusChanged.on(refresh);
  }

  /** Once an animation frame. */
  tick(now: number): void {
    const { session } = this.desk;
    if (!session.scene || now - this.writtenAt < EVERY) return;
    this.writtenAt = now;
    const values = session.agrees ? session.frame?.header.readouts : null;
    const excursion = values?.excursion ?? 0;
    const probe = values?.probe_n ?? null;
    write(this.state, inShort(session.scene, session.model, session.command?.tissue ?? STILL, excursion, probe));
    this.state.dataset.value = excursion.toFixed(3);
    this.state.dataset.probe = probe === null ? "" : probe.toFixed(3);
    if (this.menu.hidden) return;
    if (excursion !== 0) this.note("breathe", `The diaphragm is ${excursion.toFixed(0)} mm from rest`);
    if (probe !== null) this.note("press", `${pressing(probe)} on the skin`);
  }

  private note(id: TissueSwitch, text: string): void {
    const note = this.items[SWITCHES.findIndex((one) => one.id === id)]?.lastElementChild;
    if (note) write(note, text);
  }

  private entries(): HTMLElement[] {
    this.items = SWITCHES.map(({ id, name }) =>
      h(
        "button",
        { type: "button", role: "menuitemcheckbox", tabindex: -1, "data-switch": id, onclick: () => this.desk.run(id) },
        h("b", {}, name),
        h("kbd", { "aria-hidden": "true" }, keyOf(id)),
        h("span", {}),
      ),
    );
    this.press = stepper(this.desk, this.desk.session.knob(PRESS));
    this.refresh();
    return [...this.items, this.press.element];
  }

  private refresh(): void {
    const { scene, command, model, answers } = this.desk.session;
    if (!scene) return;
    this.press?.refresh();
    const tissue = command?.tissue ?? STILL;
    const able = unavailable(scene, model, tissue, "remember") === null;
    toggle(this.button, "lit", able && SWITCHES.some(({ id }) => isOn(tissue, id)));
    for (const [k, item] of this.items.entries()) {
      const { id, note } = SWITCHES[k];
      const why = unavailable(scene, model, tissue, id);
      item.setAttribute("aria-checked", String(why === null && isOn(tissue, id)));
      item.setAttribute("aria-disabled", String(why !== null || !answers));
      write(item.lastElementChild as HTMLElement, why ?? note);
    }
  }
}
