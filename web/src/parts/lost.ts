/** The connection is lost: how old the image is, and when the next attempt comes. */

import { h, write } from "../dom";
import { icon } from "../icons";
import type { Session } from "../session";

const EVERY = 200;

export class LostPanel {
  private readonly title = h("span", {});
  private readonly text = h("p", {});
  private readonly now = h("button", { type: "button", class: "button primary" }, "Connect now");
  private readonly copy = h("button", { type: "button", class: "button" }, "Copy details");
  readonly element = h(
    "div",
    { class: "lost", role: "alertdialog", "aria-labelledby": "lost-title", "aria-describedby": "lost-text", hidden: true },
    h("h2", { id: "lost-title" }, icon("lost"), this.title),
    this.text,
    h("div", { class: "buttons" }, this.now, this.copy),
  );
  private shownAt = -Infinity;

  constructor(
    private readonly session: Session,
    image: HTMLElement,
  ) {
    this.text.id = "lost-text";
    this.now.addEventListener("click", () => session.connectNow());
    this.copy.addEventListener("click", () => void navigator.clipboard?.writeText(this.details()).then(() => write(this.copy, "Copied")));
    session.statusChanged.on((status) => {
      const hidden = status !== "lost";
      if (hidden === this.element.hidden) return;
      const had = this.element.contains(document.activeElement);
      this.element.hidden = hidden;
      write(this.copy, "Copy details");
      if (!hidden) this.now.focus();
      else if (had) image.focus({ preventScroll: true });
    });
  }

  tick(now: number): void {
    if (this.element.hidden || now - this.shownAt < EVERY) return;
    this.shownAt = now;
    const { loss, lastDrawnAt } = this.session;
    const waits = loss?.nextAt === null;
    write(this.title, waits || !lastDrawnAt ? "Not connected" : "Connection lost");
    write(this.now, waits ? "Start a new session" : "Connect now");
    const age = lastDrawnAt ? `The image is ${Math.round((now - lastDrawnAt) / 1000)} s old. Needle and probe are held where they were. ` : "";
    const reason = loss?.reason ? `The server says: ${loss.reason}. ` : "";
    const wait = loss?.nextAt ? Math.max(0, Math.ceil((loss.nextAt - now) / 1000)) : null;
    const next = wait === null ? "" : wait > 0 ? `Trying again in ${wait} s, attempt ${(loss?.attempt ?? 0) + 1}.` : "Trying again now.";
    write(this.text, `${age}${reason}${next}`);
  }

  private details(): string {
    const { loss, hello, scene, frame } = this.session;
    return JSON.stringify({ page: location.origin, version: hello?.version, scene: scene?.id, frame: frame?.header.frame, seq: frame?.header.seq, loss, browser: navigator.userAgent }, null, 2);
  }
}
