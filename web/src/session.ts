/** One person at one simulator: the scene, the command of the hand, and the frames that answer it. */

import type { Link, Loss } from "./connection";
import { ACROSS, ALONG, put, read } from "./knobs";
import { Meter } from "./latency";
import { Heartbeat } from "./heartbeat";
import { bounded, letGo } from "./lead";
import { compareVersions, type ClientText, type Command, type Frame, type Geometry, type Guide, type Hello, type Knob, type Loading, type LoggedEvent, type Notice, type Refused, type Scene, type ServerText } from "./protocol";
import { Signal } from "./signal";
import { adopt, limited, same } from "./command";
import { STILL, turned, unavailable, type TissueSwitch } from "./tissue";

export type Status = "connecting" | "loading" | "live" | "frozen" | "lost";

/** ms without an image after which a server that is there is said to be at work. */
const BUSY = 1500;
/** At most this many ms apart: the server takes 240 messages a second. */
const PACE = 8;
/** How long a reset can be taken back, ms. */
export const RESTORE = 8000;

/** Whether the grid is drawn, and frames that may come before the last one was drawn. */
interface View { grid: boolean; ahead: 0 | 1 }

export class Session {
  hello: Hello | null = null;
  scene: Scene | null = null;
  model = "";
  target = "";
  command: Command | null = null;
  /** The last frame drawn. */
  frame: Frame | null = null;
  status: Status = "connecting";
  /** Whether the scene goes on where it was, rather than from its start. */
  resumed = false;
  loss: Loss | null = null;
  lastDrawnAt = 0;
  readonly meter = new Meter();

  readonly greeted = new Signal<Hello>();
  readonly loading = new Signal<Loading>();
  readonly sceneReady = new Signal<Scene>();
  readonly geometry = new Signal<Geometry>();
  /** An image is there to be drawn. */
  readonly arrived = new Signal<void>();
  readonly drawn = new Signal<Frame>();
  readonly commanded = new Signal<Command>();
  /** The server did not follow a knob that was going this way. */
  readonly limited = new Signal<readonly [Knob, 1 | -1]>();
  readonly modelChanged = new Signal<string>();
  readonly targetChanged = new Signal<string>();
  readonly statusChanged = new Signal<Status>();
  readonly refused = new Signal<Refused>();
  readonly noticed = new Signal<Notice>();
  /** What the session itself does not heed. */
  readonly unheeded = new Signal<ServerText>();
  /** An attempt is over: pictures are of its recording, and hands move nothing. */
  reviewing = false;
  /** Frozen by the trainer of a lab, who alone lets it go on. */
  held = false;
  /** Whether what an exercise hid is laid over the pictures of its recording. */
  truth = true;
  /** Something happened in the tissue, whether or not its frame was sent. */
  readonly happened = new Signal<LoggedEvent>();

  private pending: Frame[] = [];
  /** The newest frame that came before the pose asked for: its positions still count. */
  private early: Frame | null = null;
  /** Frames with a smaller number show another pose than the one the page goes on with. */
  private awaited = 0;
  /** Number of the last event; null before the first frame of a scene. */
  private heard: number | null = null;
  private seq = 0;
  private sent = new Map<number, Command>();
  private lastSent: Command | null = null;
  private lastSentAt = -Infinity;
  private view: View = { grid: false, ahead: 1 };
  private readonly heart = new Heartbeat();

  constructor(private readonly link: Link) {
    link.opened.on(() => this.restart());
    link.text.on((message) => this.hear(message));
    link.binary.on((message) => {
      this.heart.heardAt = performance.now();
      if (message.kind === "geometry") return this.geometry.emit(message.geometry);
      if (message.kind === "frame") this.pending.push(message.frame);
      this.arrived.emit();
    });
    link.lost.on((loss) => this.lose(loss));
    link.broken.on((message) => this.noticed.emit({ type: "notice", level: "fault", message }));
  }

  /** Whether hands move anything: not while frozen, loading or lost, nor before there is a picture to steer by. */
  get answers(): boolean {
    return this.status === "live" && !this.reviewing && this.command !== null && this.frame !== null;
  }

  /** Whether the picture and its numbers are of what is chosen: after a switch they come a moment later. */
  get agrees(): boolean {
    const header = this.frame?.header;
    if (!header) return false;
    return this.status === "frozen" || (header.model === this.model && (header.target?.id ?? this.target) === this.target);
  }

  /** ms since the last image where the server is there but at work; null where all is well. */
  busyFor(now: number): number | null {
    const late = now - this.lastDrawnAt;
    return this.status === "live" && !this.reviewing && late > BUSY ? late : null;
  }

  /** Whether something may be shown beside the image. */
  allows(guide: Guide): boolean {
    return (this.reviewing && this.truth) || !this.scene || this.scene.guides.includes(guide);
  }

  say(message: ClientText): void {
    this.link.send(message);
  }

  /** What the scene says of a knob. */
  knob(id: string): Knob {
    const found = this.scene?.knobs.find((knob) => knob.id === id);
    if (!found) throw new RangeError(`the server says nothing of the knob ${id}`);
    return found;
  }

  value(id: string): number {
    return this.command && this.scene ? read(this.command, this.knob(id)) : 0;
  }

  /** What the picture shows. */
  shown(id: string): number {
    return this.frame && this.scene ? read(this.frame.header.state, this.knob(id)) : this.value(id);
  }

  /** Move a knob, never further than its lead beyond what is shown. */
  nudge(id: string, by: number): void {
    if (this.answers) this.ask(this.knob(id), bounded(this.knob(id), this.value(id), by, this.shown(id)));
  }

  /** A setting goes to a value at once; what moves goes as far as its lead. */
  setKnob(id: string, value: number): void {
    this.nudge(id, value - this.value(id));
  }

  /** The hand let go: what it asked for ahead of the picture is taken back, but for one tap. */
  letGo(id: string, pace: number): void {
    if (this.answers) this.ask(this.knob(id), letGo(this.knob(id), this.value(id), this.shown(id), pace));
  }

  /** Choose what of the image's settings is chosen and not moved. */
  choose(words: Partial<Pick<Command["image"], "mode" | "grey_map" | "colour" | "pixels">>): void {
    const open = this.answers || this.status === "loading";
    if (open && this.command) this.want({ ...this.command, image: { ...this.command.image, ...words } });
  }

  private ask(knob: Knob, value: number): void {
    if (!this.command || !Number.isFinite(value)) return;
    // while the needle is in, its entry is where it went in
    if ((knob.id === ALONG || knob.id === ACROSS) && this.command.needle.depth > 0) return;
    this.want(put(this.command, knob, value));
  }

  toggleFreeze(): void {
    if (!this.command || this.reviewing || this.held || !(this.status === "live" || this.status === "frozen")) return;
    this.want({ ...this.command, frozen: !this.command.frozen });
    this.setStatus(this.command.frozen ? "frozen" : "live");
    this.heart.heardAt = performance.now();
  }

  /** Turn a switch of the tissue's; why it does nothing, where it does nothing. */
  turn(id: TissueSwitch): string | null {
    if (!this.answers || !this.command || !this.scene) return null;
    const tissue = this.command.tissue ?? STILL;
    const why = unavailable(this.scene, this.model, tissue, id);
    if (why) this.noticed.emit({ type: "notice", level: "caution", message: why });
    else this.want({ ...this.command, tissue: turned(tissue, id) });
    return why;
  }

  chooseModel(id: string): void {
    if (this.scene?.models.some((model) => model.id === id)) this.link.send({ type: "model", model: id });
  }

  chooseTarget(id: string): void {
    this.link.send({ type: "target", id });
  }

  chooseScene(id: string): void {
    this.link.send({ type: "scene", id });
  }

  openScene(name: string, text: string): void {
    this.link.send({ type: "open_scene", name, text });
  }

  /** The hand is where the command puts the needle, at once: a push before its frame comes must not put it back in. */
  undoPass(): void {
    if (!this.answers || !this.command) return;
    this.link.send({ type: "undo_pass" });
    this.want({ ...this.command, needle: { ...this.command.needle, depth: 0 } });
  }

  reset(): void {
    if (this.status === "frozen") this.toggleFreeze();
    this.link.send({ type: "reset" });
    if (this.command && this.scene) this.want(this.scene.start);
  }

  restore(): void {
    this.link.send({ type: "restore" });
  }

  /** What the page shows; one that needs the server's processors to draw gets the next image once it has drawn the last. */
  look(changes: Partial<View> = {}): void {
    this.view = { ...this.view, ...changes };
    this.link.send({ type: "view", ...this.view });
  }

  connectNow(): void {
    this.link.open();
  }

  /** Send the command if it changed; called after every touch and in every animation frame. */
  flush(now: number): void {
    if (!this.command || !this.link.isOpen || !this.scene || this.reviewing || now - this.lastSentAt < PACE) return;
    if (this.lastSent && same(this.lastSent, this.command)) return;
    this.seq += 1;
    this.link.send({ type: "command", seq: this.seq, ...this.command });
    this.lastSent = this.command;
    this.lastSentAt = now;
    this.sent.set(this.seq, this.command);
    this.meter.poseSent(this.seq, now);
  }

  /** Draw the newest frame that came; every frame that came is acknowledged, in order. */
  draw(now: number): void {
    const arrived = this.pending;
    const newest = arrived.at(-1);
    if (newest) {
      this.pending = [];
      // positions come only when they change: those of a frame that is skipped still count
      const moved = [this.early, ...arrived].findLast((frame) => frame && frame.positions !== null);
      if (moved && newest !== moved) {
        newest.positions = moved.positions;
        newest.header.mesh = moved.header.mesh;
        newest.header.grid = moved.header.grid;
      }
      // a replay answers no command
      this.early = !newest.header.replay && newest.header.seq < this.awaited ? newest : null;
      if (!this.early) this.take(newest, now);
      for (const frame of arrived) this.link.send({ type: "drawn", frame: frame.header.frame });
    }
    this.watch(now);
  }

  private take(frame: Frame, now: number): void {
    const { header } = frame;
    this.frame = frame;
    this.lastDrawnAt = now;
    if (!header.replay) this.reconcile(header.seq, header.state);
    else this.commanded.emit((this.command = header.state)); // the hand as a recording has it
    this.setStatus(this.command?.frozen && !header.replay ? "frozen" : "live");
    this.drawn.emit(frame);
    this.tell(header.log);
    this.meter.frameDrawn(header.seq, performance.now());
    this.link.settle();
  }

  /** Events that are new; those before the first frame of a scene are old, and after a restored reset they begin anew. */
  private tell(log: readonly LoggedEvent[]): void {
    const newest = log.at(-1)?.number ?? 0;
    for (const event of log) if (this.heard !== null && event.number > this.heard) this.happened.emit(event);
    this.heard = newest;
  }

  private reconcile(seq: number, state: Command): void {
    const sent = this.sent.get(seq);
    for (const old of this.sent.keys()) if (old < seq) this.sent.delete(old);
    if (!this.command || !this.scene || !sent) return;
    const next = adopt(this.command, sent, state);
    for (const end of limited(this.scene.knobs, sent, state)) this.limited.emit(end);
    // what is in force is what this number stands for from now on
    this.sent.set(seq, state);
    if (same(next, this.command)) return;
    if (seq === this.seq && same(next, state)) this.lastSent = next;
    this.command = next;
    this.commanded.emit(next);
  }

  private want(next: Command): void {
    if (this.command && same(this.command, next)) return;
    this.command = next;
    this.commanded.emit(next);
    this.flush(performance.now());
  }

  private hear(message: ServerText): void {
    this.heart.heardAt = performance.now();
    switch (message.type) {
      case "hello":
        this.hello = message;
        this.link.session = message.session;
        this.resumed = message.resumed;
        compareVersions(message.protocol, this.link.broken);
        return this.greeted.emit(message);
      case "loading":
        // the scene before goes on until the next one is ready
        if (!this.frame) this.setStatus("loading");
        return this.loading.emit(message);
      case "scene":
        return this.begin(message);
      case "model":
        this.model = message.model;
        return this.modelChanged.emit(message.model);
      case "target":
        this.target = message.id;
        return this.targetChanged.emit(message.id);
      case "refused":
        return this.refuse(message);
      case "notice":
        return this.noticed.emit(message);
      default:
        return this.unheeded.emit(message);
    }
  }

  private begin(scene: Scene): void {
    // a server that kept the session says where it is; to one that was started anew the page says where the hand was
    const again = this.kept && !this.resumed && this.scene?.id === scene.id && !scene.attempt ? this.command : null;
    const model = this.model;
    this.scene = scene;
    this.reviewing = false;
    this.model = scene.model;
    this.target = scene.target;
    this.frame = this.early = this.heard = null;
    this.pending = [];
    this.setStatus("loading");
    this.command = again ? { ...again, frozen: false } : scene.state;
    this.lastSent = scene.state;
    this.sent.clear();
    this.sent.set(0, scene.state);
    this.sceneReady.emit(scene);
    this.commanded.emit(this.command);
    if (again && model !== scene.model) this.chooseModel(model);
    this.look();
    this.kept = this.resumed = false;
    this.flush(performance.now());
    // until the server is where the hand was, its numbers are of another pose
    this.awaited = again || !same(this.command, scene.state) ? this.seq : 0;
  }

  /** After a lost connection the same scene goes on where the hand was, whatever the server still knows. */
  private kept = false;

  private restart(): void {
    this.kept = this.command !== null;
    this.seq = this.awaited = 0;
    this.lastSentAt = -Infinity;
    this.sent.clear();
    this.meter.clear();
    this.pending = [];
    this.heart.heardAt = performance.now();
  }

  private refuse(message: Refused): void {
    if (message.what === "command" && this.command && this.scene) {
      this.awaited = 0;
      this.command = this.frame?.header.state ?? this.scene.state;
      this.lastSent = this.command;
      this.commanded.emit(this.command);
    }
    if (message.what === "scene" && this.status === "loading") this.setStatus(this.frame ? "live" : "connecting");
    this.refused.emit(message);
  }

  private lose(loss: Loss, closed = true): void {
    this.loss = loss;
    if (closed) this.pending = []; // a frame drawn after its connection was lost would look as if it were live
    this.setStatus("lost", closed);
  }

  private watch(now: number): void {
    this.heart.watch(now, {
      open: this.link.isOpen,
      live: this.status === "live",
      silent: this.status === "lost" && this.link.isOpen,
      ping: () => this.link.send({ type: "ping" }),
      abandon: () => this.link.abandon("no answer"),
      lose: (until) => this.lose({ attempt: 0, nextAt: until, reason: "no answer" }, false),
    });
  }

  private setStatus(status: Status, again = false): void {
    if (status === this.status && !again) return;
    this.status = status;
    this.statusChanged.emit(status);
  }
}

