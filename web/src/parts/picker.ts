/** Which scene: a menu of those that are shipped, and a file of the user's own. */

import { h, write } from "../dom";
import { icon } from "../icons";
import type { Trainer } from "../trainer";
import { levelOf } from "./briefing";
import { popup } from "./menu";

/** The server takes messages of 64 KiB. */
const LARGEST = 60_000;

export function scenePicker(trainer: Trainer): HTMLElement {
  const { session } = trainer;
  const name = h("b", {}, "–");
  const kind = h("span", { class: "name" }, "Scene");
  const button = h(
    "button",
    { type: "button", class: "button", id: "scene-button", "aria-haspopup": "menu", "aria-expanded": "false", "aria-controls": "scene-menu" },
    kind,
    name,
    icon("chevron", 14),
  );
  const menu = h("div", { class: "menu", id: "scene-menu", role: "menu", "aria-labelledby": "scene-button", hidden: true });
  const file = h("input", { type: "file", accept: ".toml", hidden: true, "aria-label": "Scene file" });
  const progress = h("span", { class: "progress" });
  const root = h("div", { class: "picker" }, button, menu, file, progress);

  const item = (label: string, note: string, run: () => void, checked: boolean | null = null) =>
    h(
      "button",
      {
        type: "button", role: checked === null ? "menuitem" : "menuitemradio", "aria-checked": checked === null ? null : String(checked), tabindex: -1,
        onclick: () => {
          close();
          run();
        },
      },
      h("b", {}, label),
      h("span", {}, note),
    );
  const entries = () => [
    h("p", { class: "heading", role: "presentation" }, "Free practice"),
    ...(session.hello?.scenes ?? []).map((scene) => item(scene.name, scene.description, () => session.chooseScene(scene.id), !trainer.attempt && scene.id === session.scene?.id)),
    item("Open file", "A scene file of your own (.toml)", () => file.click()),
    ...(trainer.offered.length ? [h("p", { class: "heading", role: "presentation" }, "Exercises")] : []),
    ...trainer.offered.map((exercise) => item(exercise.name, levelOf(exercise), () => trainer.brief(exercise), trainer.attempt?.exercise.id === exercise.id)),
  ];

  const { open, close } = popup(root, button, menu, () => entries());
  file.addEventListener("change", () => {
    const chosen = file.files?.[0];
    file.value = "";
    if (chosen) void send(chosen);
  });
  const send = async (chosen: File) => {
    const text = await chosen.text();
    if (text.length <= LARGEST) return session.openScene(chosen.name, text);
    session.refused.emit({ type: "refused", what: "scene", message: `${text.length} characters are too many for a scene file; give at most ${LARGEST}`, file: chosen.name, line: null, seq: null });
  };
  root.addEventListener("open-scene-menu", () => open(true));
  root.addEventListener("open-scene-file", () => file.click());

  session.sceneReady.on((scene) => {
    write(name, scene.attempt?.exercise.name ?? scene.name);
    name.title = name.textContent ?? ""; // where the header has no room for all of it
    write(kind, scene.attempt ? "Exercise" : "Scene");
    button.dataset.hint = scene.attempt?.exercise.name ?? scene.name;
    root.classList.remove("loading");
  });
  session.loading.on(({ name: loading, share }) => {
    write(name, loading);
    root.classList.add("loading");
    progress.style.width = `${(100 * share).toFixed(0)}%`;
  });
  session.refused.on(() => {
    root.classList.remove("loading");
    if (session.scene) write(name, session.scene.attempt?.exercise.name ?? session.scene.name);
  });
  return root;
}
