/** Line icons on a 16 x 16 grid. Each stands beside a word. */

import { s } from "./dom";

const PATHS = {
  left: "M10 3.500 5.500 8 10 12.500",
  right: "M6 3.500 10.500 8 6 12.500",
  up: "M8 13V3M4 7l4-4 4 4",
  down: "M8 3v10M4 9l4 4 4-4",
  chevron: "M4 6l4 4 4-4",
  minus: "M3.500 8h9",
  plus: "M3.500 8h9M8 3.500v9",
  anticlockwise: "M3.200 6.200A5.200 5.200 0 1 1 2.900 9.200M3 2.800v3.700h3.700",
  clockwise: "M12.800 6.200A5.200 5.200 0 1 0 13.100 9.200M13 2.800v3.700H9.300",
  freeze: "M8 2v12M2.800 5l10.400 6M13.200 5 2.800 11",
  entry: "M8 1.500v4M8 10.500v4M1.500 8h4M10.500 8h4M8 5.800a2.200 2.200 0 1 0 .01 0z",
  undo: "M6 3 2.800 6.200 6 9.400M3 6.200h6.500a3.600 3.600 0 0 1 0 7.200H6",
  eye: "M1.500 8S4 3.600 8 3.600 14.500 8 14.500 8 12 12.400 8 12.400 1.500 8 1.500 8zM8 6a2 2 0 1 0 .01 0z",
  swap: "M9.500 2.500h4v4M13.500 2.500 9 7M6.500 13.500h-4v-4M2.500 13.500 7 9",
  warning: "M8 2 14.500 13.500h-13zM8 6.500v3.400M8 11.700v.1",
  lost: "M2 6.500a9 9 0 0 1 12 0M4.300 9a5.600 5.600 0 0 1 7.400 0M8 12.200v.1M2.500 2.500l11 11",
  grip: "M3 5h10M3 8h10M3 11h10",
  open: "M2 12.500v-9h4l1.500 2H14v7z",
  close: "M4 4l8 8M12 4l-8 8",
} as const;

export type IconName = keyof typeof PATHS;

export function icon(name: IconName, size = 16): SVGSVGElement {
  return s(
    "svg",
    { viewBox: "0 0 16 16", width: size, height: size, class: "icon", "aria-hidden": "true" },
    s("path", { d: PATHS[name] }),
  );
}

/** The mark: layers of tissue and a needle. */
export function logo(): SVGSVGElement {
  return s(
    "svg",
    { viewBox: "0 0 24 24", width: 24, height: 24, class: "logo", "aria-hidden": "true" },
    s("path", { class: "layers", d: "M4.500 9.500c2 2.200 4.800 3.300 7.500 3.300s5.500-1.100 7.500-3.300M6.500 14c1.500 1.500 3.500 2.300 5.500 2.300s4-.8 5.500-2.300M8.500 18c1 .8 2.200 1.200 3.500 1.200s2.500-.4 3.500-1.200" }),
    s("path", { class: "shaft", d: "M4 3l9 11" }),
  );
}
