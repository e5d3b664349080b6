/** The image itself: every pixel as it came, scaled by the browser alone. */

import type { ColourPlace, Frame } from "../protocol";

/** Grey as little-endian RGBA. */
const GREY = Uint32Array.from({ length: 256 }, (_, g) => 0xff000000 | (g << 16) | (g << 8) | g);

export function drawGrey(words: Uint32Array, pixels: Uint8Array): void {
  for (let k = 0; k < pixels.length; k += 1) words[k] = GREY[pixels[k]];
}

/** Where nothing flows. */
const NO_FLOW = -128;
/** Of levels -128 to 127: red to yellow towards the probe, blue to cyan away; as `colours` of the package. */
const COLOURS = Uint32Array.from({ length: 256 }, (_, k) => {
  const fast = Math.abs(k - 128) / 127;
  const bright = Math.round(255 * Math.min(1, 0.35 + 1.1 * fast));
  const pale = Math.round(255 * 0.95 * Math.min(1, Math.max(0, 1.6 * fast - 0.6)));
  return 0xff000000 | (pale << 8) | (k >= 128 ? bright : bright << 16);
});

/** The colour of a velocity, of -1 to 1 of the scale, for style sheets. */
export function colourOf(share: number): string {
  const rgba = COLOURS[Math.round(127 * share) + 128];
  return `rgb(${rgba & 255}, ${(rgba >> 8) & 255}, ${(rgba >> 16) & 255})`;
}

export class Picture {
  readonly canvas = document.createElement("canvas");
  private readonly context: CanvasRenderingContext2D;
  private image: ImageData | null = null;
  private words = new Uint32Array(0);

  constructor() {
    const context = this.canvas.getContext("2d", { alpha: false });
    if (!context) throw new Error("this browser has no 2-D canvas");
    this.context = context;
    this.canvas.className = "picture";
    this.canvas.setAttribute("aria-hidden", "true");
  }

  draw({ header, pixels, colour }: Frame): void {
    const { rows, columns } = header;
    if (this.image?.width !== columns || this.image.height !== rows) {
      this.canvas.width = columns;
      this.canvas.height = rows;
      this.image = this.context.createImageData(columns, rows);
      this.words = new Uint32Array(this.image.data.buffer);
    }
    const { words } = this;
    drawGrey(words, pixels);
    if (colour && header.colour) paint(words, columns, colour, header.colour);
    this.context.putImageData(this.image, 0, 0);
    this.canvas.dataset.frame = String(header.frame);
  }
}

/** Velocities over the grey picture, in their window of it. */
function paint(words: Uint32Array, width: number, levels: Int8Array, { row, column, rows, columns }: ColourPlace): void {
  for (let i = 0; i < rows; i += 1) {
    const from = i * columns;
    const to = (row + i) * width + column;
    for (let j = 0; j < columns; j += 1) {
      const level = levels[from + j];
      if (level !== NO_FLOW) words[to + j] = COLOURS[level + 128];
    }
  }
}
