/** The image itself: every pixel as it came, scaled by the browser alone. */

import type { Frame } from "../protocol";

/** Grey as little-endian RGBA. */
const GREY = Uint32Array.from({ length: 256 }, (_, g) => 0xff000000 | (g << 16) | (g << 8) | g);

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

  draw({ header, pixels }: Frame): void {
    const { rows, columns } = header;
    if (this.image?.width !== columns || this.image.height !== rows) {
      this.canvas.width = columns;
      this.canvas.height = rows;
      this.image = this.context.createImageData(columns, rows);
      this.words = new Uint32Array(this.image.data.buffer);
    }
    const { words } = this;
    for (let k = 0; k < pixels.length; k += 1) words[k] = GREY[pixels[k]];
    this.context.putImageData(this.image, 0, 0);
    this.canvas.dataset.frame = String(header.frame);
  }
}
