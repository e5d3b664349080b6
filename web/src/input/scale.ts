/** The depth scale and the focus caret under a pointer. */

import type { Desk } from "../desk";
import { DEPTH, FOCUS } from "../knobs";
import type { ImagePane } from "../parts/imagePane";
import { draggable } from "./drag";

/** px of a drag on the scale that change the depth by one step. */
const PX_PER_STEP = 28;

export function scaleInput(pane: ImagePane, desk: Desk): void {
  const { session } = desk;
  draggable(pane.ruler.scale, () => {
    const depth = session.value(DEPTH);
    // pulling the scale down stretches it: less depth
    return { move: (_dx, dy) => session.answers && session.setKnob(DEPTH, depth - Math.trunc(dy / PX_PER_STEP) * session.knob(DEPTH).step) };
  });
  draggable(pane.ruler.caret, () => {
    const map = pane.mapping;
    const focus = session.value(FOCUS);
    if (!map || !session.answers) return null;
    const { step } = session.knob(FOCUS);
    return { move: (_dx, dy) => session.setKnob(FOCUS, Math.round((focus + dy / map.scale) / step) * step) };
  });
}
