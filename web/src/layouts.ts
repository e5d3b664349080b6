/** Which of the three layouts a window gets (a small one is compact, whatever the pointer), and the room around the image in each. */

import type { Side } from "./image/corner";
import type { Keep, Margins } from "./image/fit";

export type Layout = "desktop" | "compact" | "tablet";

export function chooseLayout(width: number, height: number, coarse: boolean): Layout {
  const roomy = width > height ? width >= 900 && height >= 600 : width >= 700 && height >= 900;
  if (coarse && roomy) return "tablet";
  return width >= 1280 && height >= 820 ? "desktop" : "compact";
}

const MARGINS: Record<Layout, Margins> = {
  desktop: { left: 52, top: 32, right: 20, bottom: 28 },
  compact: { left: 48, top: 30, right: 14, bottom: 16 },
  tablet: { left: 60, top: 16, right: 14, bottom: 16 },
};

/** `alone`: nothing stands over the image. A sector has black corners for the texts beside it; parallel beams fill their corners, so they leave margins. */
export function margins(layout: Layout, parallel: boolean, alone = false): Margins {
  if (!parallel || alone) return MARGINS[layout];
  return { ...MARGINS[layout], top: 32, left: 190, right: layout === "compact" ? 160 : 236 };
}

/** px of the read-outs in the black corner. */
const READOUTS: Record<Layout, number> = { desktop: 190, compact: 0, tablet: 0 };
const BEHIND_SCALE = 48;

/** Read-outs or inset stand on the side where the needle does not come in; upright, nothing stands over the image. */
export function keep(layout: Layout, needleRight: boolean, upright = false, alone = false): Keep {
  if (alone) return { left: 0, right: 0 };
  const room = READOUTS[layout];
  if (needleRight && layout === "tablet" && !upright) return { left: Infinity, right: 0 };
  return needleRight && room > 0 ? { left: room + BEHIND_SCALE, right: 0 } : { left: 0, right: room };
}

/** px of a corner that the read-outs take, seen from its pane; nothing where they stand below the image. */
export function readoutCorner(layout: Layout, needleRight: boolean, alone = false): { side: Side; width: number; height: number } | null {
  if (layout !== "desktop" || alone) return null;
  return needleRight ? { side: "left", width: 224, height: 442 } : { side: "right", width: 178, height: 442 };
}

export const RULER_X: Record<Layout, number> = { desktop: 40, compact: 38, tablet: 40 };
