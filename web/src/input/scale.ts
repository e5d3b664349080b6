/** The depth scale and the focus caret under a pointer. */

import { AXES } from "../axes";
import type { Desk } from "../desk";
import type { ImagePane } from "../parts/imagePane";
import { draggable } from "./drag";

/** px of a drag on the scale that change the depth by one step. */
const PX_PER_STEP = 28;

export function scaleInput(pane: ImagePane, desk: Desk): void {
  const { session } = desk;
  draggable(pane.ruler.scale, () => {
    const depth = session.value("depth");
    // pulling the scale down stretches it: less depth
    return { move: (_dx, dy) => session.setAxis("depth", depth - Math.trunc(dy / PX_PER_STEP) * AXES.depth.step) };
  });
  draggable(pane.ruler.caret, () => {
    const map = pane.mapping;
    const focus = session.value("focus");
    const { step } = AXES.focus;
    return map && { move: (_dx, dy) => session.setAxis("focus", Math.round((focus + dy / map.scale) / step) * step) };
  });
}
