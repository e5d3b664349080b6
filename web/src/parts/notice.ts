/** One notice at a time in a black corner: what is held, what is slow, what failed. */

import type { Desk } from "../desk";
import { h, toggle, write } from "../dom";
import { icon, type IconName } from "../icons";
import type { Side } from "../image/corner";
import type { Header } from "./header";
import type { ImagePane } from "./imagePane";
import { happening, stopped } from "./words";

interface Entry { kind: "plain" | "event" | "caution" | "fault"; picture: IconName; title: string; text: string; undo?: boolean; close?: boolean; fades?: boolean }

const EVERY = 100;
/** px of its width, the widest that fits beside the sector, and what it keeps clear of. */
const WIDTHS = [190, 170, 150, 135, 120, 105, 90];
const CLEAR = 8;
/** ms a refusal and a block stay after their cause has gone. */
const LINGER = 4000;
const BLOCK_LINGER = 1200;
/** ms in which an event fades at the end. */
const FADE = 800;

export class NoticePart {
  private readonly title = h("b", {});
  private readonly text = h("span", {});
  private readonly place = h("span", { class: "picture" });
  private readonly undo = h("button", { type: "button", class: "button" }, "Undo reset");
  private readonly close = h("button", { type: "button", class: "button" }, "Dismiss");
  readonly element = h("div", { class: "notice", hidden: true }, h("p", { class: "title" }, this.place, this.title), h("p", {}, this.text), this.undo, this.close);
  /** What the trainer of a lab says, until it is read. */
  private said = "";
  private fault: { message: string } | null = null;
  private caution: { message: string; until: number } | null = null;
  private blocked: { title: string; text: string; until: number } | null = null;
  private happened: { title: string; text: string; until: number } | null = null;
  private shownAt = -Infinity;
  private fitted = "";

  constructor(
    private readonly desk: Desk,
    private readonly header: Header,
    private readonly pane: ImagePane,
  ) {
    const { session } = desk;
    this.undo.addEventListener("click", () => {
      desk.restoreUntil = 0;
      session.restore();
    });
    this.close.addEventListener("click", () => {
      if (this.fault) this.fault = null;
      else this.said = "";
    });
    let before = "";
    desk.trainer.stationed.on(({ said }) => {
      if (said !== before) this.said = before = said;
    });
    session.noticed.on(({ level, message }) => {
      if (level === "fault") this.fault = { message };
      else this.caution = { message, until: performance.now() + LINGER };
    });
    session.refused.on(({ what, message }) => {
      if (what !== "scene" && what !== "open_scene" && what !== "begin_attempt") this.caution = { message, until: performance.now() + LINGER };
    });
    session.drawn.on(({ header }) => {
      const words = stopped(header);
      if (words) this.blocked = { title: words[0], text: words[1], until: performance.now() + BLOCK_LINGER };
    });
    session.sceneReady.on(() => {
      this.fault = this.caution = this.blocked = this.happened = null;
    });
    session.happened.on(({ text }) => {
      const words = happening(text);
      if (words) this.happened = { title: words[0], text: words[1], until: performance.now() + LINGER };
    });
  }

  tick(now: number): void {
    if (now - this.shownAt < EVERY) return;
    this.shownAt = now;
    const entry = this.choose(now);
    this.element.hidden = entry === null;
    toggle(document.body, "noticed", entry !== null);
    if (!entry) return;
    this.element.dataset.kind = entry.kind;
    toggle(this.element, "fades", entry.fades ?? false);
    write(this.title, entry.title);
    write(this.text, entry.text);
    if (this.place.dataset.picture !== entry.picture) {
      this.place.dataset.picture = entry.picture;
      this.place.replaceChildren(icon(entry.picture));
    }
    this.undo.hidden = !entry.undo;
    this.close.hidden = !entry.close;
    this.fit();
  }

  /** As wide as the black corner allows: nothing stands over the sector. */
  private fit(): void {
    const { element, pane } = this;
    const { classList, dataset } = document.body;
    const side = classList.contains("needle-right") ? "left" : "right";
    const key = [element.textContent, side, dataset.layout, classList.contains("swapped"), pane.room(side, 0, Infinity), pane.element.clientWidth, pane.element.clientHeight].join("|");
    if (key === this.fitted) return;
    this.fitted = key;
    // below the read-outs a wide sector may leave too little: then in the other corner
    for (const elsewhere of dataset.layout === "desktop" ? [false, true] : [false]) {
      toggle(element, "elsewhere", elsewhere);
      if (WIDTHS.some((width) => this.fits(width, (side === "left") !== elsewhere ? "left" : "right"))) return;
    }
  }

  private fits(width: number, side: Side): boolean {
    const { element, pane } = this;
    element.style.width = `${width}px`;
    const { offsetTop, offsetLeft, offsetHeight } = element;
    const edge = side === "left" ? offsetLeft + width : pane.element.clientWidth - offsetLeft;
    return edge + CLEAR <= pane.room(side, offsetTop - CLEAR, offsetTop + offsetHeight + CLEAR);
  }

  /** The gravest first. */
  private choose(now: number): Entry | null {
    const { session, switches, restoreUntil } = this.desk;
    if (session.status === "lost" || session.status === "loading") return null;
    if (this.fault) return { kind: "fault", picture: "warning", title: "Fault", text: this.fault.message, close: true };
    if (this.said) return { kind: "plain", picture: "eye", title: session.held ? "Frozen by the trainer" : "Your trainer", text: this.said, close: true };
    if (session.held) return { kind: "plain", picture: "freeze", title: "Frozen by the trainer", text: "Time stands still" };
    if (session.status === "frozen") return { kind: "plain", picture: "freeze", title: "Frozen", text: "Space or Freeze to go on" };
    if (now < restoreUntil) return { kind: "plain", picture: "clockwise", title: "Reset", text: `can be undone for ${Math.ceil((restoreUntil - now) / 1000)} s`, undo: true };
    if (this.blocked && now < this.blocked.until) return { kind: "caution", picture: "warning", title: this.blocked.title, text: this.blocked.text };
    if (this.caution && now < this.caution.until) return { kind: "caution", picture: "warning", title: "Not done", text: this.caution.message };
    if (this.happened && now < this.happened.until) return { kind: "event", picture: "entry", title: this.happened.title, text: this.happened.text, fades: this.happened.until - now < FADE };
    if (switches.placing) return { kind: "plain", picture: "entry", title: "New entry", text: "Left, right: along the skin. Push to go in" };
    const late = session.busyFor(now);
    if (late !== null) return { kind: "caution", picture: "warning", title: "Busy", text: `The server is at work; the image is ${(late / 1000).toFixed(0)} s old` };
    const latency = this.header.latencyNow;
    if (this.header.slow.on && latency !== null) return { kind: "caution", picture: "warning", title: "Slow", text: `Image is ${latency.toFixed(0)} ms behind your hand` };
    return null;
  }
}
