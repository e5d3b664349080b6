/** A scene that was refused: a sheet over plot and pass, never over the image; the simulation goes on. */

import { h, write } from "../dom";
import { icon } from "../icons";
import type { Session } from "../session";

/** What asks for something to be loaded. */
const LOADS: readonly string[] = ["scene", "open_scene", "begin_attempt"];

export class RefusalSheet {
  private readonly title = h("span", {});
  private readonly text = h("p", {});
  private readonly detail = h("pre", { tabindex: 0, "aria-label": "What is wrong" });
  readonly element: HTMLElement;

  constructor(session: Session, picker: HTMLElement) {
    const close = () => (this.element.hidden = true);
    const act = (name: string) => () => {
      close();
      picker.dispatchEvent(new Event(name));
    };
    const again = h("button", { type: "button", class: "button", onclick: act("open-scene-file") }, "Try again");
    this.element = h(
      "section",
      { class: "sheet", "aria-labelledby": "sheet-title", hidden: true },
      h("h2", { id: "sheet-title" }, icon("warning"), this.title),
      this.text,
      this.detail,
      h(
        "div",
        { class: "buttons" },
        h("button", { type: "button", class: "button", onclick: act("open-scene-menu") }, "Choose a scene"),
        again,
        h("button", { type: "button", class: "button quiet", onclick: close }, "Dismiss"),
      ),
    );
    session.refused.on(({ what, message, file, line }) => {
      if (!LOADS.includes(what)) return;
      write(this.title, what === "begin_attempt" ? "Exercise not begun" : "Scene not loaded");
      write(this.text, `${file ? `${file}. ` : ""}${session.scene ? `${session.scene.name} keeps running.` : ""}`);
      write(this.detail, line ? `line ${line}: ${message}` : message);
      again.hidden = !file;
      this.element.hidden = false;
    });
    session.sceneReady.on(close);
  }
}
