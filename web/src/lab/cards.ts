/** A card for each station: its picture, who sits there, what is done, and a word; pressed, it is watched. */

import { h, toggle, write } from "../dom";
import { drawGrey } from "../image/picture";
import { clock } from "../metrics";
import type { Thumb } from "../protocol";
import type { Lab, StationState } from "./lab";

class Card {
  private readonly canvas = h("canvas", { "aria-hidden": "true" });
  private readonly place = h("span", { class: "place" });
  private readonly who = h("b", {});
  private readonly what = h("span", { class: "what" });
  private readonly word = h("span", { class: "word" });
  readonly element = h(
    "button",
    { type: "button", class: "card", "aria-pressed": "false" },
    h("span", { class: "thumb" }, this.canvas, this.place),
    h("span", { class: "about" }, this.who, this.word, this.what),
  );

  constructor(lab: Lab, name: string) {
    write(this.place, `Station ${name}`);
    this.element.addEventListener("click", () => lab.watch(name));
    lab.chosen.on((chosen) => this.element.setAttribute("aria-pressed", String(chosen === name)));
  }

  show(state: StationState): void {
    this.element.dataset.state = state.state;
    write(this.who, state.participant ?? "–");
    write(this.what, doing(state));
    write(this.word, state.word);
    toggle(this.word, "caution", state.caution);
    toggle(this.word, "good", state.word === "passed" || state.word === "on target");
  }

  draw({ header: { rows, columns }, pixels }: Thumb): void {
    const context = this.canvas.getContext("2d");
    if (!context || rows === 0) return;
    if (this.canvas.width !== columns || this.canvas.height !== rows) [this.canvas.width, this.canvas.height] = [columns, rows];
    const image = context.createImageData(columns, rows);
    drawGrey(new Uint32Array(image.data.buffer), pixels);
    context.putImageData(image, 0, 0);
  }
}

/** What is done, and for how long. */
export function doing(state: StationState): string {
  if (state.state === "empty") return "nobody here";
  if (state.state === "no code") return "waiting for a code";
  return `${state.exercise ?? "Free practice"} · ${clock(state.time_s)}`;
}

export function stationCards(lab: Lab): HTMLElement {
  const cards = new Map<string, Card>();
  const root = h("section", { class: "cards", "aria-label": "Stations" });
  lab.changed.on(({ stations }) => {
    for (const state of stations) {
      let card = cards.get(state.name);
      if (!card) {
        cards.set(state.name, (card = new Card(lab, state.name)));
        root.append(card.element);
      }
      card.show(state);
    }
  });
  lab.thumb.on((thumb) => cards.get(thumb.header.station)?.draw(thumb));
  return root;
}
