/** The large pane: image, marks, scale, and the few words in its black corners. */

import type { Desk } from "../desk";
import { h, s, toggle } from "../dom";
import { roomBeside, type Side } from "../image/corner";
import { fit, Mapping, type Raster } from "../image/fit";
import { needleInImage, skinLine } from "../image/geometry";
import { faceOrigin, Marks } from "../image/marks";
import { colourOf, Picture } from "../image/picture";
import { Ruler } from "../image/ruler";
import { parallel, sector, type Point, type Sector } from "../image/sector";
import { cap } from "../keys";
import { DEPTH, FREQUENCY, GAIN, show } from "../knobs";
import { keep, margins, readoutCorner, RULER_X, type Layout } from "../layouts";
import type { Command, FrameHeader, Scene } from "../protocol";
import type { Session } from "../session";
import { clamp } from "../vec";
import { inPlane, onTarget } from "./readouts";

/** ms the hand may be ahead before its last drawn place is shown too. */
const AHEAD = 100;
/** px by which the image gives way at a time. */
const GIVE_WAY = 8;
/** Pixels of the picture along its longer side: as many as it is shown on, in such steps, so that resizing asks seldom. */
const STEP = 128;
const FEWEST = 256;
const MOST = 1024;
/** px of a pane below which nothing stands beside the image. */
const NARROW = 560;
/** px around the skin line that count as on it. */
const NEAR = 16;

export class ImagePane {
  readonly picture = new Picture();
  readonly marks = new Marks();
  private readonly caption = h("p", { class: "caption", "aria-hidden": "true" });
  private readonly greyBar = h("div", { class: "grey-bar", "aria-hidden": "true" });
  private readonly keys = h("p", { id: "image-keys", class: "unseen" });
  readonly element: HTMLElement;
  readonly ruler = new Ruler();
  mapping: Mapping | null = null;
  /** Depth at which a drag along the needle took hold of the handle, which then goes with the needle. */
  grabbedAt: number | null = null;
  private layout: Layout = "desktop";
  private mirrored = false;
  private size = { width: 0, height: 0 };
  private pixels = 0;
  private view: Sector | null = null;
  private handleAt: Point = [0, 0];
  private drawnHandle: Point | null = null;
  private aheadSince: number | null = null;

  /** `readOnly`: nobody works on it, and nothing stands over it. */
  constructor(
    private readonly session: Session,
    desk: Pick<Desk, "switched">,
    private readonly readOnly = false,
  ) {
    const worked = { role: "application", tabindex: 0, "aria-describedby": "image-keys", "aria-roledescription": "ultrasound image" };
    this.element = h(
      "section",
      { class: "image-pane", "aria-label": "Ultrasound image", ...(readOnly ? {} : worked) },
      this.picture.canvas,
      this.marks.svg,
      this.caption,
      this.greyBar,
      this.keys,
    );
    this.marks.svg.prepend(s("g", { class: "ruler" }, this.ruler.scale, this.ruler.caret));
    new ResizeObserver(([entry]) => {
      this.size = { width: entry.contentRect.width, height: entry.contentRect.height };
      this.place();
    }).observe(this.element);
    session.sceneReady.on((scene) => {
      if (!this.readOnly) this.keys.textContent = keysInWords(scene);
      this.place();
    });
    session.drawn.on((frame) => {
      this.picture.draw(frame);
      this.drawFrame(frame.header);
    });
    session.commanded.on((command) => {
      this.drawCommand(command);
      this.askForPixels();
    });
    session.statusChanged.on((status) => {
      toggle(this.element, "stale", status === "lost");
      toggle(this.element, "held", status !== "live");
      if (status === "loading") this.place();
    });
    desk.switched.on(({ guides, placing, mirrored }) => {
      if (mirrored !== this.mirrored) {
        this.mirrored = mirrored;
        toggle(this.picture.canvas, "mirrored", mirrored);
        this.place();
      }
      toggle(this.element, "no-guides", !guides);
      toggle(this.element, "placing", placing);
    });
  }

  get handle(): SVGGElement {
    return this.marks.handle;
  }

  use(layout: Layout): void {
    this.layout = layout;
    this.ruler.stand(RULER_X[layout]);
    this.place();
  }

  /** Once an animation frame: is the hand ahead of the image? */
  tick(now: number): void {
    const drawn = this.drawnHandle;
    const apart = drawn !== null && Math.hypot(drawn[0] - this.handleAt[0], drawn[1] - this.handleAt[1]) > 3;
    this.aheadSince = apart ? (this.aheadSince ?? now) : null;
    this.marks.drawGhost(this.aheadSince !== null && now - this.aheadSince > AHEAD ? drawn : null);
  }

  /** What may be shown has changed. */
  refreshMarks(): void {
    const { frame, scene } = this.session;
    if (frame && scene) this.drawMarks(frame.header, scene);
  }

  refresh(): void {
    if (this.session.command) this.drawCommand(this.session.command);
  }

  /** px beside the sector, between two heights of the pane. */
  room(side: Side, from: number, to: number): number {
    const { mapping, view } = this;
    if (!mapping || !view) return this.size.width;
    const header = this.session.frame?.header;
    const [x0, y0] = header ? faceOrigin(header) : [-view.low[0], -view.low[1]];
    const outline = view.outline.map(([x, y]) => mapping.point([x + x0, y + y0]));
    return roomBeside(outline, side, this.size.width, from, to);
  }

  /** Unit direction of the needle on the screen. */
  needleOnScreen(): Point | null {
    const { frame, scene, command } = this.session;
    if (!frame || !scene || !command || !this.mapping) return null;
    return this.mapping.turned(needleInImage(scene.frame, command.needle, frame.header.image_to_reference).along);
  }

  /** The entry u of a place on the skin line outside the image; null elsewhere. */
  skinAt(clientX: number, clientY: number): number | null {
    const { frame, scene, command } = this.session;
    const skin = frame && scene ? skinLine(scene.frame, frame.header.image_to_reference) : null;
    if (!frame || !scene || !command || !skin || !this.mapping || !this.view) return null;
    const box = this.element.getBoundingClientRect();
    const [x, y] = this.mapping.back([clientX - box.left, clientY - box.top]);
    const t = (x - skin.through[0]) / (skin.along[0] || 1e-9);
    const line = skin.through[1] + t * skin.along[1];
    const origin = faceOrigin(frame.header);
    const beside = x < origin[0] + this.view.face[0][0] || x > origin[0] + this.view.face[this.view.face.length - 1][0];
    if (!beside || Math.abs(y - line) * this.mapping.scale > NEAR) return null;
    const here = needleInImage(scene.frame, command.needle, frame.header.image_to_reference).entry;
    return command.needle.u + (x - here[0]) / Math.max(0.2, skin.along[0]);
  }

  /** Where the image goes: of the frame drawn, or of the one awaited. */
  private place(): void {
    const { scene, command, frame } = this.session;
    if (!scene || !command || this.size.width === 0) return;
    const header = frame?.header;
    this.view = sector(scene.probe, header?.state.image.depth ?? command.image.depth);
    const raster: Raster = header ?? expected(this.view);
    const mapping = this.layOut(scene, raster);
    const { box } = mapping;
    this.pixels = clamp(Math.ceil((Math.max(box.width, box.height) * window.devicePixelRatio) / STEP) * STEP, FEWEST, MOST);
    this.askForPixels();
    const { style } = this.picture.canvas;
    style.left = `${box.left}px`;
    style.top = `${box.top}px`;
    style.width = `${box.width}px`;
    style.height = `${box.height}px`;
    const origin: Point = header ? faceOrigin(header) : [-this.view.low[0], -this.view.low[1]];
    this.marks.drawWaiting(mapping, this.view, origin, !header);
    toggle(this.element, "waiting", !header);
    this.ruler.draw(mapping, origin[1], command.image.depth, command.image.focus);
    this.writeCaption(header?.state ?? command, scene);
    if (header) this.drawMarks(header, scene);
  }

  /** A picture as fine as the pane shows it, no finer than need be. */
  private askForPixels(): void {
    const { pixels, session } = this;
    if (pixels && !this.readOnly && session.command && session.command.image.pixels !== pixels) session.choose({ pixels });
  }

  /** As large as can be; it gives way where the read-outs would stand over the sector. */
  private layOut(scene: Scene, raster: Raster): Mapping {
    const { layout, size } = this;
    const right = needleRight(scene) !== this.mirrored;
    const alone = this.readOnly || this.session.reviewing || size.width < NARROW;
    const corner = readoutCorner(layout, right, alone);
    const kept = keep(layout, right, window.innerHeight > window.innerWidth, alone);
    const room = margins(layout, parallel(scene.probe), alone);
    for (let less = 0; ; less += GIVE_WAY) {
      const box = fit(size, raster, corner ? { ...room, [corner.side]: room[corner.side] + less } : room, kept);
      const mapping = (this.mapping = new Mapping(box, raster, size, this.mirrored));
      if (!corner || less > size.width / 4 || this.room(corner.side, 0, corner.height) >= corner.width) return mapping;
    }
  }

  private drawFrame(header: FrameHeader): void {
    const { scene } = this.session;
    const map = this.mapping;
    const kept =
      map && map.raster.rows === header.rows && map.raster.columns === header.columns && map.raster.pixel[0] === header.pixel[0];
    if (!kept || this.element.classList.contains("waiting") || !scene) this.place();
    else this.drawMarks(header, scene);
    if (scene) this.writeCaption(header.state, scene);
    this.drawScale(header.colour?.nyquist_cm_s ?? 0);
  }

  /** Beside the image stand the greys, or with colour Doppler its colours, up to the velocity that aliases. */
  private drawScale(nyquist: number): void {
    const text = nyquist ? nyquist.toFixed(nyquist < 10 ? 1 : 0) : "";
    if (this.greyBar.dataset.scale === text) return;
    this.greyBar.dataset.scale = text;
    const stops = Array.from({ length: 21 }, (_, k) => colourOf(1 - k / 10));
    this.greyBar.style.background = nyquist ? `linear-gradient(${stops.join(",")})` : "";
    this.greyBar.replaceChildren(...(nyquist ? [`+${text}`, `\u2212${text} cm/s`].map((end) => h("span", {}, end)) : []));
  }

  private drawMarks(header: FrameHeader, scene: Scene): void {
    const { mapping, view, session, size } = this;
    if (!mapping || !view || !session.command) return;
    this.marks.drawProbe(mapping, view, header, scene, size.width);
    this.drawnHandle = this.marks.drawHandle(mapping, view, header, scene, header.state.needle, 0);
    const name = scene.targets.find((target) => target.id === header.target?.id)?.name ?? "";
    const { readouts } = header;
    const stands = { inPlane: !readouts || inPlane(readouts), onTarget: readouts !== null && onTarget(readouts, scene) };
    this.marks.drawGuides(mapping, header, name, { ...stands, allows: (guide) => session.allows(guide) }, size.width);
    this.drawCommand(session.command);
  }

  private drawCommand(command: Command): void {
    const { mapping, view } = this;
    const { frame, scene } = this.session;
    if (!mapping || !view || !frame || !scene) return;
    const slid = this.grabbedAt === null ? 0 : command.needle.depth - this.grabbedAt;
    this.handleAt = this.marks.drawHandle(mapping, view, frame.header, scene, command.needle, slid);
    this.ruler.draw(mapping, faceOrigin(frame.header)[1], frame.header.state.image.depth, command.image.focus);
  }

  private writeCaption(state: Command, scene: Scene): void {
    const { image } = state;
    const knob = (id: string) => this.session.knob(id);
    const lines = [
      scene.probe.name,
      `${show(knob(FREQUENCY), image.frequency)} MHz`,
      `Depth ${show(knob(DEPTH), image.depth)} cm`,
      `Gain ${show(knob(GAIN), image.gain)} dB`,
      "Simulated image",
    ];
    if (this.caption.dataset.text === lines.join("\n")) return;
    this.caption.dataset.text = lines.join("\n");
    this.caption.replaceChildren(...lines.map((line) => h("span", {}, line)));
  }
}

/** Whether the needle starts on the right of the probe. */
export function needleRight(scene: Scene): boolean {
  return scene.start.needle.u - scene.start.probe.slide > 0;
}

/** The raster of an image that has not come yet, fine enough to be placed. */
function expected(view: Sector): Raster {
  const pixel = 0.25;
  const count = (axis: 0 | 1) => Math.ceil((view.high[axis] - view.low[axis]) / pixel);
  return { columns: clamp(count(0), 1, 4096), rows: clamp(count(1), 1, 4096), pixel: [pixel, pixel] };
}

/** The keys that move something, for those who hear them. */
function keysInWords(scene: Scene): string {
  const moves = scene.knobs.filter(({ keys }) => keys).map(({ keys, name }) => `${(keys ?? []).map(spoken).join(" and ")}: ${name.toLowerCase()}`);
  return `${moves.join("; ")}. Space freezes; question mark shows all keys.`;
}

/** A key as it is read out: its name where what is printed on it is no letter. */
function spoken(code: string): string {
  const printed = cap(code);
  return /^\w$/.test(printed) ? printed : code.replace(/([a-z])([A-Z])/g, "$1 $2").toLowerCase();
}
