/** The keys act while the image has the focus: it comes back there from whatever a pointer chose. */

/** Bubbles from a widget that a pointer opened and that is done with. */
export const DONE = "done";
/** What keeps the focus that a pointer gave it: a text that is typed, a menu, a dialog, an error to copy. */
const KEEPERS = "input, dialog, [role=menu], [role=alertdialog], pre, .briefing, .sit-down, .debrief, .player, .calliper";

export function returnFocus(image: HTMLElement): void {
  const focus = () => image.focus({ preventScroll: true });
  const back = (at: EventTarget | null) => {
    const keeper = document.activeElement?.closest(KEEPERS);
    // a number keeps it while it is typed, not once the pointer is used elsewhere
    const left = keeper instanceof HTMLInputElement && at instanceof Node && !keeper.closest("label")?.contains(at);
    if (!keeper || left) focus();
  };
  /** Whether a pointer opened the dialog that is open. */
  let opened = false;
  // at once: a browser that is busy hands over the next key before it runs any timer
  document.addEventListener("pointerup", ({ target }) => back(target));
  // a touch clicks well after it was lifted; a click without a pointer comes from a key or a screen reader
  document.addEventListener("click", ({ detail, target }) => {
    if (detail === 0) return;
    opened = document.querySelector("dialog[open]") !== null;
    back(target);
  });
  document.addEventListener("close", () => opened && focus(), true);
  document.addEventListener(DONE, focus);
}
