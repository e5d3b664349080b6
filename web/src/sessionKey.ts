/** The key of this page's session, over a reload: written when the page goes, taken away when it comes. */

const NAME = "sonospline-session";

/** A tab that was duplicated finds none: it must not take the session of the tab it was copied from. */
export function takeKey(): string | null {
  const key = sessionStorage.getItem(NAME);
  sessionStorage.removeItem(NAME);
  return key;
}

export function leaveKey(key: () => string | null): void {
  window.addEventListener("pagehide", () => {
    const now = key();
    if (now) sessionStorage.setItem(NAME, now);
  });
  // a page that was only put aside has its key still
  window.addEventListener("pageshow", ({ persisted }) => persisted && sessionStorage.removeItem(NAME));
}
