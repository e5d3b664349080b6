/** Follow one pointer from down to up; a cancelled pointer ends where it is. */

export interface Drag {
  move(dx: number, dy: number, event: PointerEvent): void;
  /** `cancelled`: taken away by the system rather than let go. */
  end?(cancelled: boolean): void;
}

export function draggable(element: Element, start: (event: PointerEvent) => Drag | null): void {
  element.addEventListener("pointerdown", (down) => {
    const first = down as PointerEvent;
    if (first.button !== 0) return;
    const drag = start(first);
    if (!drag) return;
    first.stopPropagation();
    element.setPointerCapture(first.pointerId);
    const move = (event: Event) => {
      const { clientX, clientY, pointerId } = event as PointerEvent;
      if (pointerId === first.pointerId) drag.move(clientX - first.clientX, clientY - first.clientY, event as PointerEvent);
    };
    const end = (event: Event) => {
      if ((event as PointerEvent).pointerId !== first.pointerId) return;
      element.removeEventListener("pointermove", move);
      for (const name of ENDS) element.removeEventListener(name, end);
      drag.end?.(event.type !== "pointerup");
    };
    element.addEventListener("pointermove", move);
    for (const name of ENDS) element.addEventListener(name, end);
  });
}

const ENDS = ["pointerup", "pointercancel", "lostpointercapture"];
