/**
 * What the 3-D view is drawn on. Without a graphics card the browser would fetch each picture from the drawing process
 * and wait for it, tens of milliseconds in which no image is drawn; there pictures are fetched once they are ready.
 */

import * as THREE from "three";

interface Awaited {
  fence: WebGLSync;
  width: number;
  height: number;
}

export class Screen {
  /** Drawn by a processor, which the image needs too. */
  readonly software = isSoftware();
  /** What the page shows. */
  readonly canvas: HTMLCanvasElement;
  private readonly renderer: THREE.WebGLRenderer;
  private readonly shown: CanvasRenderingContext2D | null;
  private readonly buffer: WebGLBuffer | null;
  private pixels = new ImageData(1, 1);
  private awaited: Awaited | null = null;

  constructor(background: number) {
    this.renderer = new THREE.WebGLRenderer({ antialias: !this.software && window.devicePixelRatio < 2 });
    this.renderer.setClearColor(background);
    this.canvas = this.software ? document.createElement("canvas") : this.renderer.domElement;
    this.shown = this.software ? this.canvas.getContext("2d", { alpha: false }) : null;
    this.buffer = this.software ? this.gl.createBuffer() : null;
  }

  /** Whether the last picture is still being drawn. */
  get busy(): boolean {
    return this.awaited !== null;
  }

  resize(width: number, height: number, ratio: number): void {
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
  }

  draw(stage: THREE.Scene, camera: THREE.Camera): void {
    this.renderer.render(stage, camera);
    if (this.buffer) this.awaited = this.read(this.buffer);
  }

  /** Once an animation frame: show the picture that has come. */
  tick(): void {
    const { awaited, gl } = this;
    if (!awaited || gl.clientWaitSync(awaited.fence, 0, 0) === gl.TIMEOUT_EXPIRED) return;
    gl.deleteSync(awaited.fence);
    this.awaited = null;
    this.show(awaited.width, awaited.height);
  }

  private get gl(): WebGL2RenderingContext {
    return this.renderer.getContext() as WebGL2RenderingContext;
  }

  private read(buffer: WebGLBuffer): Awaited | null {
    const { gl } = this;
    const { width, height } = this.renderer.domElement;
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
    gl.bufferData(gl.PIXEL_PACK_BUFFER, 4 * width * height, gl.STREAM_READ);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, 0);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    return fence && { fence, width, height };
  }

  private show(width: number, height: number): void {
    const { gl, canvas } = this;
    if (this.pixels.width !== width || this.pixels.height !== height) this.pixels = new ImageData(width, height);
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const bottomUp = new Uint8Array(4 * width * height);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, this.buffer);
    gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, bottomUp);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    for (let row = 0; row < height; row += 1) {
      this.pixels.data.set(bottomUp.subarray(4 * width * row, 4 * width * (row + 1)), 4 * width * (height - 1 - row));
    }
    this.shown?.putImageData(this.pixels, 0, 0);
  }
}

/** Whether WebGL runs on the processor; throws where there is none. */
function isSoftware(): boolean {
  const context = document.createElement("canvas").getContext("webgl2");
  if (!context) throw new Error("this browser has no WebGL 2");
  const info = context.getExtension("WEBGL_debug_renderer_info");
  const name = String(context.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : context.RENDERER));
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}
