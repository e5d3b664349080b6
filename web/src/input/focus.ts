/** The keys act while the image has the focus: it comes back there from whatever a pointer chose. */

/** Bubbles from a widget that a pointer opened and that is done with. */
export const DONE = "done";
/** What keeps the focus that a pointer gave it: a text that is typed, a menu, a dialog, an error to copy. */
const KEEPERS = "input, dialog, [role=menu], [role=alertdialog], pre";

export function returnFocus(image: HTMLElement): void {
  const focus = () => image.focus({ preventScroll: true });
  const back = () => {
    if (!document.activeElement?.closest(KEEPERS)) focus();
  };
  /** Whether a pointer opened the dialog that is open. */
  let opened = false;
  document.addEventListener("pointerup", () => window.setTimeout(back));
  // a touch clicks well after it was lifted; a click without a pointer comes from a key or a screen reader
  document.addEventListener("click", ({ detail }) => {
    if (detail === 0) return;
    window.setTimeout(() => {
      opened = document.querySelector("dialog[open]") !== null;
      back();
    });
  });
  document.addEventListener("close", () => opened && focus(), true);
  document.addEventListener(DONE, focus);
}
